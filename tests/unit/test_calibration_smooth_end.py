"""The end of a fit of responses that are rough, as those of rails that stick and slide are."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from tests.unit.test_calibration_fit import PARAMETERS, TRUE, MadeUp, alike, misfit

from turnout.calibration.covariance import spread_of
from turnout.calibration.evaluate import Response, ThrowInputs
from turnout.calibration.fit import Fit, fit
from turnout.calibration.misfit import Misfit
from turnout.panel.load import load_panel


class Rough(MadeUp):
    """Forces depend on the stiffness in waves as well, which are over within two thousandths."""

    def responses(self, throws: Sequence[ThrowInputs]) -> list[Response]:
        found = []
        for throw, item in zip(throws, super().responses(throws), strict=True):
            turns = np.log(float(str(throw.overrides["k"])) / TRUE["k"]) / 2e-3
            wave = 1.5 * np.sin(2.0 * np.pi * (turns + item.time)) * (item.time > 2.5)
            found.append(replace(item, drive_force={"1": item.drive_force["1"] + wave}))
        return found


def rough(*, seed: int) -> Misfit:
    whole = misfit(alike(3, seed=seed))
    whole.evaluator = Rough(load_panel("sb1"))
    return whole


def off(found: Fit) -> float:
    """Return how far the stiffness is off, in its stated deviations."""
    return (found.values["k"] - TRUE["k"]) / spread_of(found).deviations[1]


def test_waves_of_the_cost_do_not_hold_a_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    starts = [{**TRUE, "k": TRUE["k"] * share} for share in (0.985, 0.99, 1.01, 1.015)]
    ends = [off(fit(rough(seed=3), PARAMETERS, start)) for start in starts]
    assert np.abs(ends).max() < 2.6
    monkeypatch.setattr("turnout.calibration.fit.SMOOTH_PASSES", 0)
    held = [off(fit(rough(seed=3), PARAMETERS, start)) for start in starts]
    assert np.abs(held).max() > 10.0


def test_intervals_hold_the_truth_of_a_rough_model() -> None:
    errors = [
        off(fit(rough(seed=seed), PARAMETERS, {**TRUE, "k": 0.98 * TRUE["k"]})) for seed in range(8)
    ]
    assert np.abs(errors).max() < 2.6


def test_a_plane_has_the_slopes_of_a_smooth_model_and_shares_throws_of_repeats() -> None:
    whole = misfit(alike(2, seed=1))
    whole.effects = {"mu": (0.0, 0.004)}
    plane, local = whole.smoothed(TRUE, ("k",), {}), whole.local(TRUE, ("k",))
    assert whole.evaluator.made == (1 + 8) + (2 + 2)
    for one, other in zip(plane.simulated, local.simulated, strict=True):
        np.testing.assert_allclose(one.drive_force["1"], other.drive_force["1"], atol=0.05)
    for name in ("mu", "k"):
        ends = (plane.stepped[name][0], plane.origin[0]), (local.stepped[name][0], local.origin[0])
        rows = [
            (aside.drive_force["1"] - here.drive_force["1"]) / found.steps[name][0]
            for (aside, here), found in zip(ends, (plane, local), strict=True)
        ]
        np.testing.assert_allclose(*rows, atol=0.01 * np.abs(rows[0]).max())
