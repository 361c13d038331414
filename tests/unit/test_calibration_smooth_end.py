"""The end of a fit of responses that are rough, as those of rails that stick and slide are."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.unit.test_calibration_fit import (
    BIN,
    ONSET,
    PARAMETERS,
    TRUE,
    MadeUp,
    alike,
    measured_force,
    misfit,
    response,
)

from turnout.calibration import fit as fit_module
from turnout.calibration.comparison import predicted
from turnout.calibration.covariance import spread_of
from turnout.calibration.evaluate import Response, ThrowInputs
from turnout.calibration.fit import Fit, brief_fit, fit
from turnout.calibration.linearisation import (
    REACH,
    Differences,
    plane_of,
    points_about,
    reaches_of,
)
from turnout.calibration.misfit import Misfit
from turnout.calibration.result_entries import distrust_reasons
from turnout.calibration.stages import Parameter
from turnout.panel.load import load_panel

Floats = NDArray[np.float64]


class Rough(MadeUp):
    """Forces depend on the stiffness in waves as well, which are over within two thousandths."""

    def responses(self, throws: Sequence[ThrowInputs]) -> list[Response]:
        found = []
        for throw, item in zip(throws, super().responses(throws), strict=True):
            turns = np.log(float(str(throw.overrides["k"])) / TRUE["k"]) / 2e-3
            wave = 1.5 * np.sin(2.0 * np.pi * (turns + item.time)) * (item.time > 2.5)
            found.append(replace(item, drive_force={"1": item.drive_force["1"] + wave}))
        return found


def rough(*, seed: int, gains: bool = True) -> Misfit:
    whole = misfit(alike(3, seed=seed))
    whole.evaluator = Rough(load_panel("sb1"))
    if gains:
        stated = dict.fromkeys(whole.comparison.noise, whole.comparison.uncertainty.common_gain)
        whole.comparison = replace(whole.comparison, gains=stated)
    return whole


def off(found: Fit) -> float:
    """Return how far the stiffness is off, in its stated deviations."""
    return (found.values["k"] - TRUE["k"]) / spread_of(found).deviations[1]


def test_waves_of_the_cost_do_not_hold_a_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    starts = [{**TRUE, "k": TRUE["k"] * share} for share in (0.985, 0.99, 1.01, 1.015)]
    ends = [off(fit(rough(seed=5, gains=False), PARAMETERS, start)) for start in starts]
    assert np.abs(ends).max() < 2.6
    monkeypatch.setattr("turnout.calibration.fit.SMOOTH_PASSES", 0)
    held = [off(fit(rough(seed=5, gains=False), PARAMETERS, start)) for start in starts]
    assert np.abs(held).max() > 10.0


def test_planes_without_an_end_are_no_convergence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("turnout.calibration.fit.SMOOTH_DECREASE", 0.0)
    found = fit(rough(seed=3), PARAMETERS, {**TRUE, "k": 0.985 * TRUE["k"]})
    assert not found.converged
    (reason,) = distrust_reasons(found, spread_of(found))
    assert reason.startswith("the last stage stopped after 16 planes before convergence")
    assert "--fix" in reason
    assert abs(off(found)) < 2.6


def test_steps_to_and_fro_end_half_way(monkeypatch: pytest.MonkeyPatch) -> None:
    """With half of its slope the stiffness would go as far beyond with every plane."""
    whole = misfit(alike(3, seed=5))
    found = fit(whole, PARAMETERS, TRUE)
    true_slopes = fit_module.jacobian

    def half(*given: Any) -> Floats:
        slopes = true_slopes(*given)
        slopes[:, 1] *= 0.5
        return slopes

    monkeypatch.setattr(fit_module, "jacobian", half)
    start = replace(found, values={**found.values, "k": 1.005 * found.values["k"]})
    again = fit_module.smooth_end(start, whole)
    assert again.converged
    assert again.values["k"] == pytest.approx(found.values["k"], rel=1e-4)


def test_planes_without_an_end_lead_back_to_single_throws(monkeypatch: pytest.MonkeyPatch) -> None:
    whole, start = rough(seed=3), {**TRUE, "k": 0.985 * TRUE["k"]}
    near = brief_fit(whole, fit(whole, PARAMETERS, start, rough=True))
    begun: list[dict[str, int]] = []
    by_planes = fit_module.smooth_end

    def first_without_an_end(found: Fit, first: Misfit, **most: int) -> Fit:
        begun.append(most)
        return replace(by_planes(found, first, **most), converged=len(begun) > 1)

    monkeypatch.setattr(fit_module, "smooth_end", first_without_an_end)
    found = fit(whole, PARAMETERS, near.values, near=near)
    assert found.converged
    assert begun == [{"most": fit_module.FIRST_PASSES}, {}]
    assert abs(off(found)) < 2.6


def test_an_end_that_cannot_be_thrown_on_all_sides_is_no_convergence() -> None:
    class Failing(Rough):
        """No throw from 0.06 % beyond the true stiffness on."""

        def responses(self, throws: Sequence[ThrowInputs]) -> list[Response]:
            return [
                replace(item, failure="stuck")
                if float(str(throw.overrides["k"])) > 1.0006 * TRUE["k"]
                else item
                for throw, item in zip(throws, super().responses(throws), strict=True)
            ]

    whole = rough(seed=3)
    whole.evaluator = Failing(load_panel("sb1"))
    found = fit(whole, PARAMETERS, {**TRUE, "k": 0.985 * TRUE["k"]})
    assert not found.converged
    (reason,) = distrust_reasons(found, spread_of(found))
    assert "stuck" in reason


def test_intervals_hold_the_truth_of_a_rough_model() -> None:
    errors = [
        off(fit(rough(seed=seed), PARAMETERS, {**TRUE, "k": 0.98 * TRUE["k"]})) for seed in range(8)
    ]
    assert np.abs(errors).max() < 2.6


# Steps of force one after another, beside friction and stiffness: ten unknowns in all.
STEPS = tuple(
    Parameter(name=f"step {n}", keys=(f"step {n}",), start=1.0, lower=0.2, upper=5.0)
    for n in range(8)
)
MANY, WAVES = (*PARAMETERS, *STEPS), 0.4
TRUTH = {**TRUE, **{item.name: 1.0 for item in STEPS}}


def stepped_response(values: Mapping[str, object], *, waves: float) -> Response:
    """Return a force with steps, and with waves over less than a thousandth of each of them."""
    item = response(values)
    time, row = item.time - ONSET, item.drive_force["1"].copy()
    turns = np.log(float(str(values["k"])) / TRUE["k"])
    for number, step in enumerate(STEPS):
        size = float(str(values[step.name]))
        row += 1500.0 * size / (1.0 + np.exp(-(time - 0.6 - 0.12 * number) / 0.04))
        turns += (1.0 + 0.37 * number) * np.log(size)
    wave = waves * np.sin(2.0 * np.pi * (turns / 2e-3 + 3.0 * item.time)) * (time > 0.2)
    return replace(item, drive_force={"1": row + wave})


class ManyRough(MadeUp):
    """Steps of force, with waves."""

    def responses(self, throws: Sequence[ThrowInputs]) -> list[Response]:
        self.made += len(throws)
        return [stepped_response(throw.overrides, waves=WAVES) for throw in throws]


def many(*, seed: int) -> Misfit:
    rng, time = np.random.default_rng(seed), BIN * (np.arange(-50, 150) + 0.5)
    bare = measured_force("m", time, 0.0 * time)
    at = np.arange(time.size)
    true = predicted(stepped_response(TRUTH, waves=0.0), bare, bare.signals[0], at)
    rows = [true + 2.0 * rng.standard_normal(time.size) for _ in range(3)]
    whole = misfit([measured_force(f"m{n}", time, row) for n, row in enumerate(rows)])
    whole.evaluator = ManyRough(load_panel("sb1"))
    whole.parameters, whole.base = MANY, TRUTH
    return whole


def many_off(seed: int, share: float) -> Floats:
    """Return how far each of the values is off, in its stated deviations."""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], len(MANY))
    pairs = zip(TRUTH.items(), signs, strict=True)
    found = fit(many(seed=seed), MANY, {name: x * (1.0 + share * s) for (name, x), s in pairs})
    assert found.converged
    errors = [found.values[item.name] - TRUTH[item.name] for item in MANY]
    return np.abs(np.array(errors) / spread_of(found).deviations)


def test_waves_do_not_hold_a_fit_of_ten_values(monkeypatch: pytest.MonkeyPatch) -> None:
    starts = [(seed, share) for seed in range(3, 8) for share in (0.02, 0.04)]
    errors = np.concatenate([many_off(*start) for start in starts])
    assert np.mean(errors < 1.96) > 0.9
    assert np.sqrt(np.mean(errors**2)) < 1.0
    monkeypatch.setattr("turnout.calibration.fit.SMOOTH_PASSES", 0)
    assert max(many_off(*start).max() for start in starts[:4]) > 8.0


def test_values_that_are_hardly_known_together_are_thrown_further_aside() -> None:
    alone = np.array([[1e4, 0.0], [0.0, 1e4]])
    np.testing.assert_allclose(reaches_of(PARAMETERS, alone, ()), np.eye(2), atol=1e-12)
    # Their sum is known to 0.0001, their difference to 0.01.
    alike = np.array([[1e4, 1e4], [1e2, -1e2]]) / 2.0**0.5
    far = reaches_of(PARAMETERS, alike, ())
    np.testing.assert_allclose(far @ [1.0, 1.0], [1.0, 1.0], rtol=1e-3)
    np.testing.assert_allclose(far @ [1.0, -1.0], [30.0, -30.0], rtol=1e-3)
    own = reaches_of(PARAMETERS, alike, ("mu",))
    np.testing.assert_allclose(own[:, 0], [3.0, 0.0], atol=1e-12)
    sides = [
        (np.log(point["mu"] / TRUE["mu"]), np.log(point["k"] / TRUE["k"]))
        for point in points_about(TRUE, PARAMETERS, far, range(4))
    ]
    shares = np.abs(np.linalg.solve(far, np.array(sides).T / REACH))
    assert shares.min() > 0.5
    assert shares.max() < 1.5


def test_a_known_slope_counts_less_than_throws_and_serves_where_there_are_none() -> None:
    def of(k: float, step: float) -> Response:
        return stepped_response({**TRUTH, "k": k, "step 2": step}, waves=0.0)

    k = TRUE["k"]
    known = {"step 2": (of(k, 1.01), of(k, 1.0), 10.0)}
    steps = np.array([[x, 0.0] for x in (1.0, -1.0, 1.2, -1.2)])
    thrown = [of(k * (1.0 + REACH * x), 1.0) for x, _ in steps]
    middle, aside = plane_of(steps, ["k", "step 2"], thrown, known)
    for name, wanted in (("k", of(k * (1.0 + REACH), 1.0)), ("step 2", of(k, 1.001))):
        found = aside[name].drive_force["1"] - middle.drive_force["1"]
        exact = wanted.drive_force["1"] - of(k, 1.0).drive_force["1"]
        np.testing.assert_allclose(found, exact, atol=0.01 * np.abs(exact).max())
    throws = float((steps[:, 0] ** 2).sum())
    for far, counts in ((1.0, 0.5), (3.0, 4.5)):
        wrong = {"k": (of(k, 1.0 + far), of(k, 1.0), far), **known}
        _, moved = plane_of(steps, ["k", "step 2"], thrown, wrong)
        away = moved["k"].drive_force["1"] - aside["k"].drive_force["1"]
        share = counts / (counts + throws)
        assert np.abs(away).max() == pytest.approx(share * 1500.0, rel=0.02)


def test_what_is_rough_is_no_information_of_many_movements() -> None:
    rng, far, count = np.random.default_rng(7), 3.0, 400
    base = response(TRUE)

    def noisy() -> Response:
        row = rng.standard_normal(base.time.size)
        return replace(base, drive_force={"1": row})

    def excess(known: Differences) -> float:
        """Return the mean square of slopes that noise of size 1 alone leaves."""
        steps = np.array([[x] for x in (1.0, -1.0, 1.2, -1.2)])
        middle, aside = plane_of(steps, ["k"], [noisy() for _ in steps], known)
        return float(np.mean((aside["k"].drive_force["1"] - middle.drive_force["1"]) ** 2))

    alone = np.mean([excess({}) for _ in range(count)])
    both = np.mean([excess({"k": (noisy(), noisy(), far)}) for _ in range(count)])
    assert alone == pytest.approx(1.0 / 4.88, rel=0.05)
    assert both == pytest.approx(1.0 / (4.88 + 0.5 * far**2), rel=0.05)


def test_a_far_start_is_left_by_single_throws_before_planes_are_thrown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole, begun = rough(seed=3), list[Fit]()
    by_planes = fit_module.smooth_end

    def listening(found: Fit, first: Misfit, **most: int) -> Fit:
        begun.append(found)
        return by_planes(found, first, **most)

    monkeypatch.setattr(fit_module, "smooth_end", listening)
    found = fit(whole, PARAMETERS, {**TRUE, "k": 0.985 * TRUE["k"]})
    values = {**found.values, "k": 1.01 * found.values["k"]}
    fit(whole, PARAMETERS, values, near=replace(found, values=values))
    assert begun[-1].values["k"] == pytest.approx(TRUE["k"], rel=4e-3)
    monkeypatch.setattr(fit_module, "FAR_DECREASE", np.inf)
    fit(whole, PARAMETERS, values, near=replace(found, values=values))
    assert begun[-1].values["k"] == values["k"]


def test_a_plane_has_the_slopes_of_a_smooth_model_and_shares_throws_of_repeats() -> None:
    whole = misfit(alike(2, seed=1))
    whole.effects = {"mu": (0.0, 0.004)}
    plane, local = whole.smoothed(TRUE, ("k",), {}, np.eye(1)), whole.local(TRUE, ("k",))
    assert whole.evaluator.made == (1 + 16) + (2 + 2)
    for one, other in zip(plane.simulated, local.simulated, strict=True):
        np.testing.assert_allclose(one.drive_force["1"], other.drive_force["1"], atol=0.05)
    for name in ("mu", "k"):
        ends = (plane.stepped[name][0], plane.origin[0]), (local.stepped[name][0], local.origin[0])
        rows = [
            (aside.drive_force["1"] - here.drive_force["1"]) / found.steps[name][0]
            for (aside, here), found in zip(ends, (plane, local), strict=True)
        ]
        np.testing.assert_allclose(*rows, atol=0.01 * np.abs(rows[0]).max())
