"""Slip levels that movements show, and those that a fit only pushed out of its way."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from tests.unit.test_calibration_fit import PARAMETERS, TRUE, MadeUp, misfit, movement, response

from turnout.calibration.covariance import drop_unidentified_slip_levels, spread_of
from turnout.calibration.evaluate import Response, ThrowInputs
from turnout.calibration.fit import fit
from turnout.calibration.measured_movements import MeasuredMovement
from turnout.calibration.misfit import Misfit
from turnout.calibration.stages import Selection, selected
from turnout.panel.load import load_panel

KEY = "drive.1.saturation_force"
LEVEL = replace(
    PARAMETERS[1], name=KEY, keys=(KEY,), start=5000.0, lower=1000.0, upper=20000.0, unit="N"
)


class Slipping(MadeUp):
    """The force is cut where the drive slips."""

    def responses(self, throws: Sequence[ThrowInputs]) -> list[Response]:
        found = []
        for throw in throws:
            made = response(throw.overrides)
            cut = np.minimum(made.drive_force["1"], float(str(throw.overrides[KEY])))
            found.append(replace(made, drive_force={"1": cut}))
        return found


def slipping(level: float) -> Misfit:
    """Return a misfit to movements of a drive that slips at a level; 6300 N are reached."""
    rng = np.random.default_rng(12)
    measured = [movement(f"m{n}", rng=rng) for n in range(4)]
    for item in measured:
        np.minimum(item.signals[0].values, level, out=item.signals[0].values)
    whole = misfit(measured)
    whole.evaluator = Slipping(load_panel("sb1"))
    whole.parameters = (*PARAMETERS, LEVEL)
    whole.base = {**whole.base, KEY: LEVEL.start}
    return whole


def test_a_level_that_was_only_pushed_away_is_not_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = slipping(9000.0)
    largest = max(float(item.signals[0].values.max()) for item in whole.movements)
    # A fit that stops as soon as the level hardly matters; there its slope still does.
    monkeypatch.setattr("turnout.calibration.fit.MAX_STEPS", 0)
    monkeypatch.setattr("turnout.calibration.fit.SMOOTH_PASSES", 0)
    found = fit(whole, whole.parameters, {**TRUE, KEY: 0.999 * largest})
    assert spread_of(found).states[2] == "fitted"
    honest, warnings = drop_unidentified_slip_levels(found)
    assert spread_of(honest).states[2] == "not identified"
    assert len(warnings) == 1
    assert "only at least" in warnings[0]


def test_a_level_at_which_a_drive_slips_is_reported() -> None:
    whole = slipping(5600.0)
    found = fit(whole, whole.parameters, {**TRUE, KEY: 5300.0})
    assert found.values[KEY] == pytest.approx(5600.0, rel=2e-3)
    honest, warnings = drop_unidentified_slip_levels(found)
    assert honest is found
    assert not warnings
    assert spread_of(honest).states[2] == "fitted"


def test_movements_that_slip_each_at_a_level_of_its_own_show_it_and_others_keep_theirs() -> None:
    owns = (0.06, -0.05, 0.03, -0.06, 0.5)
    rng = np.random.default_rng(12)
    measured = [movement(f"m{n}", rng=rng) for n in range(len(owns))]
    for item, own in zip(measured, owns, strict=True):
        row = item.signals[0].values
        np.minimum(row, 5600.0 * (1.0 + own), out=row)
    whole = replace(slipping(5600.0), movements=tuple(measured))
    whole.comparison = replace(whole.comparison, scatter={"mu": 0.02, KEY: 0.05})
    whole.effects = {KEY: (0.0, 0.0, 0.0, 0.0, 0.2)}
    found = fit(whole, whole.parameters, {**TRUE, KEY: 5600.0})
    assert found.converged
    levels = [found.values[KEY] * (1.0 + share) for share in found.misfit.effects[KEY]]
    np.testing.assert_allclose(levels[:4], 5600.0 * (1.0 + np.array(owns[:4])), rtol=2e-3)
    # The fifth pushes 6300 N, and slips nowhere: it is not carried back to where it would.
    assert levels[4] > 6300.0


def loaded(name: str, size: float, force: float) -> MeasuredMovement:
    item = movement(name, rng=np.random.default_rng(1))
    item.signals[0].values[100] = force
    return replace(item, size=size, x=1.0)


def test_the_movement_in_which_a_drive_pushes_hardest_is_kept() -> None:
    forces = [7000.0 if n == 7 else 6500.0 for n in range(20)]
    every = [loaded(f"m{n}", 0.001 * (n + 1), force) for n, force in enumerate(forces)]
    kept = [item.name for item in selected(every, Selection(most=5), load_panel("sb1"))]
    assert "m7" in kept
    assert len(kept) <= 5
    assert {"m0", "m19"} <= set(kept)
