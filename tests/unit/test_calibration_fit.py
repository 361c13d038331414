"""Fits to movements that were made up, without any simulation."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from turnout.calibration import fit as fitting
from turnout.calibration.comparison import (
    Comparison,
    Noise,
    Uncertainty,
    measured_noise,
    missed_by_model,
    peaks_of,
    predicted,
)
from turnout.calibration.covariance import (
    moves_by,
    spread_of,
)
from turnout.calibration.evaluate import CELL, Evaluator, Response, ThrowInputs
from turnout.calibration.fit import _least_squares, fit, inflate_noise
from turnout.calibration.linearisation import FINE_DIFFERENCE
from turnout.calibration.measured_movements import BIN, MeasuredMovement, Signal
from turnout.calibration.misfit import Misfit, framed, jacobian, plain_gain_column
from turnout.calibration.result_entries import distrust_reasons
from turnout.calibration.stages import Parameter
from turnout.panel.load import load_panel

TRUE = {"mu": 0.31, "k": 900e3}
PARAMETERS = (
    Parameter(name="mu", keys=("mu",), start=0.4, lower=0.05, upper=1.0, scatter=0.02),
    Parameter(name="k", keys=("k",), start=600e3, lower=1e5, upper=1e7, unit="N/m"),
)
ONSET = 1.0


def force(time: np.ndarray, *, mu: float, k: float) -> np.ndarray:
    """Give a force that rises with friction, then meets an object and saturates smoothly."""
    moving = 1000.0 * mu * (1.0 - np.exp(-np.maximum(time, 0.0) / 0.2))
    pushed = k * 0.02 * np.maximum(time - 1.5, 0.0)
    return moving + 6000.0 * np.tanh(pushed / 6000.0)


class MadeUp(Evaluator):
    """Answers at once, by a formula of the values of a throw."""

    def responses(self, throws: Sequence[ThrowInputs]) -> list[Response]:
        self.made += len(throws)
        return [response(self.values(throw)) for throw in throws]

    def values(self, throw: ThrowInputs) -> Mapping[str, object]:
        return throw.overrides


def response(values: Mapping[str, object]) -> Response:
    time = CELL * (np.arange(1500) + 0.5)
    signal = force(time - ONSET, mu=float(str(values["mu"])), k=float(str(values["k"])))
    return Response(
        time=time,
        drive_force={"1": signal},
        object_force=0.0 * time,
        onsets={"closing": ONSET},
    )


def measured_force(name: str, time: np.ndarray, values: np.ndarray) -> MeasuredMovement:
    signal = Signal(channel="drive_force", drive="1", time=time, values=values)
    return MeasuredMovement(
        name=name, direction="closing", place="none", size=0.0, x=np.nan,
        signals=(signal,), length=3.0, clocked=False,
    )  # fmt: skip


def movement(
    name: str, *, rng: np.random.Generator, late: float = 0.0, own: float = 0.0
) -> MeasuredMovement:
    """Make a measured movement whose onset is marked too early, with friction of its own."""
    time = BIN * (np.arange(-50, 150) + 0.5)
    truth = {"mu": TRUE["mu"] * (1.0 + own), "k": TRUE["k"]}
    bare = measured_force(name, time, 0.0 * time)
    at = np.arange(time.size)
    clean = predicted(response(truth), bare, bare.signals[0], at, shift=late)
    return measured_force(name, time, clean + 2.0 * rng.standard_normal(time.size))


def alike(count: int, *, seed: int) -> list[MeasuredMovement]:
    """Make movements that differ in their noise alone."""
    rng = np.random.default_rng(seed)
    return [movement(f"m{n}", rng=rng) for n in range(count)]


def misfit(movements: Sequence[MeasuredMovement]) -> Misfit:
    return Misfit(
        evaluator=MadeUp(load_panel("sb1")),
        parameters=PARAMETERS,
        base={item.name: item.start for item in PARAMETERS},
        movements=tuple(movements),
        comparison=Comparison(noise=measured_noise(movements), scatter={"mu": 0.02}),
    )


@pytest.mark.parametrize("start", [{"mu": 0.6, "k": 2e6}, {"mu": 0.1, "k": 3e5}])
def test_the_truth_is_found_from_far_starts(start: dict[str, float]) -> None:
    rng = np.random.default_rng(1)
    owns = 0.02 * rng.standard_normal(8)
    measured = [
        movement(f"m{n}", rng=rng, late=0.015 * rng.standard_normal(), own=own)
        for n, own in enumerate(owns - owns.mean())
    ]
    found = fit(misfit(measured), PARAMETERS, start)
    assert found.converged
    assert found.values["mu"] == pytest.approx(TRUE["mu"], rel=0.01)
    assert found.values["k"] == pytest.approx(TRUE["k"], rel=0.01)
    assert 0.8 < found.rms < 1.2
    estimated = [alignment.estimates["mu"][0] for alignment in found.frame.alignments]
    np.testing.assert_allclose(estimated, owns - owns.mean(), atol=0.008)


def test_intervals_hold_the_truth_and_are_not_wide() -> None:
    hits = {"mu": 0, "k": 0}
    for seed in range(20):
        rng = np.random.default_rng(seed)
        off = 0.02 * rng.standard_normal((6, 2))
        measured = [
            movement(f"m{n}", rng=rng, late=late, own=own) for n, (late, own) in enumerate(off)
        ]
        found = fit(misfit(measured), PARAMETERS, TRUE)
        for item, (low, high) in zip(PARAMETERS, spread_of(found).intervals, strict=True):
            hits[item.name] += low <= TRUE[item.name] <= high
    # 19 are expected of 20; fewer than 18 happen in one set of seeds of thirteen.
    assert all(18 <= count <= 20 for count in hits.values()), hits


def test_a_gain_that_is_no_unknown_moves_the_values_as_foretold() -> None:
    measured = alike(8, seed=6)
    whole = misfit(measured)
    # Nothing else is uncertain, so that the parameters have to imitate the gain.
    uncertainty = Uncertainty(gain=0.0, zero=0.01)
    known = replace(
        whole, comparison=replace(whole.comparison, scatter={}, uncertainty=uncertainty)
    )
    found = _least_squares(known, PARAMETERS, TRUE, rough=False)
    foretold = moves_by(found, 1e-3 * plain_gain_column(found.frame, ("drive_force", "1")))
    for item in measured:
        item.signals[0].values[:] *= 1.001
    moved = _least_squares(known, PARAMETERS, found.values, rough=False)
    np.testing.assert_allclose(foretold, moved.point - found.point, rtol=0.05)
    assert np.abs(foretold).min() > 2e-4


def test_a_fit_begins_with_the_noise_of_what_it_misses() -> None:
    whole = misfit(alike(1, seed=7))
    far = inflate_noise(whole, PARAMETERS, {"mu": 0.6, "k": 2e6}).comparison.noise[
        "drive_force", "1"
    ]
    near = inflate_noise(whole, PARAMETERS, TRUE).comparison.noise["drive_force", "1"]
    assert far.total > 50.0 * near.total
    assert near.total < 2.0 * whole.comparison.noise["drive_force", "1"].total


def listened(whole: Misfit) -> list[tuple[ThrowInputs, float]]:
    """Write down what a misfit throws from now on, each with its stiffness."""
    asked: list[tuple[ThrowInputs, float]] = []
    answer = whole.evaluator.responses

    def listening(throws: Sequence[ThrowInputs]) -> list[Response]:
        asked.extend((throw, float(str(throw.overrides["k"]))) for throw in throws)
        return answer(throws)

    whole.evaluator = SimpleNamespace(responses=listening, step_made=lambda _: None)
    return asked


def test_throws_are_fine_where_a_fit_ends_and_plain_aside() -> None:
    whole = misfit(alike(1, seed=2))
    asked = listened(whole)
    refined = whole.refined(TRUE)
    kinds = [(throw.kind == "halved", throw.kind == "fine") for throw, _ in asked]
    assert kinds == [(False, False), (True, False), (False, True)]
    assert {value for _, value in asked} == {TRUE["k"]}
    asked.clear()
    refined.local(TRUE, ("k",))
    assert {value for _, value in asked} > {TRUE["k"]}
    assert not any(throw.kind in ("quick", "fine") for throw, _ in asked)
    asked.clear()
    whole.quick = True
    whole.local(TRUE, ("k",))
    assert all(throw.kind == "quick" for throw, _ in asked)


def test_what_fine_throws_change_is_added_near_by() -> None:
    whole = misfit(alike(1, seed=2))
    whole.evaluator = Discretised(load_panel("sb1"))
    refined, near = whole.refined(TRUE), {**TRUE, "k": 1.002 * TRUE["k"]}
    (found,) = refined.responses([near])[0]
    fine = near["k"] * (1.0 + STEP_ERROR - MODES_ERROR)
    exact = response({**near, "k": fine}).drive_force["1"]
    np.testing.assert_allclose(found.drive_force["1"], exact, atol=0.1)
    (plain,) = whole.responses([near])[0]
    assert np.abs(plain.drive_force["1"] - exact).max() > 2.0


def test_steps_of_parameters_with_priors_are_lean() -> None:
    whole = misfit(alike(1, seed=2))
    whole.parameters = (PARAMETERS[0], replace(PARAMETERS[1], prior=0.1))
    asked = listened(whole)
    local = whole.local(TRUE, ("k",))
    # One aside and one where the fit is, whose difference is what counts.
    assert sorted(value for throw, value in asked if throw.kind == "lean") == [
        TRUE["k"],
        pytest.approx(TRUE["k"] * np.exp(0.01)),
    ]
    assert not any(throw.kind == "quick" for throw, _ in asked)
    assert local.stepped["k"][0] is not local.origin[0]


def test_slopes_are_thrown_again_only_for_movements_that_went_away() -> None:
    whole = misfit(alike(2, seed=2))
    known = whole.local(TRUE, ("k",))
    asked = listened(whole)
    near = whole.local_near({**TRUE, "k": TRUE["k"] * 1.002}, ("k",), known)
    assert near.stepped is known.stepped
    assert len(asked) == 2
    asked.clear()
    whole.effects = {"mu": (0.0, 0.02)}
    part = whole.local_near(TRUE, ("k",), known)
    assert part.stepped["k"][0] is known.stepped["k"][0]
    assert part.stepped["k"][1] is not known.stepped["k"][1]
    assert len(asked) == 2 + 3
    asked.clear()
    whole.local_near({**TRUE, "k": TRUE["k"] * 1.02}, ("k",), known)
    assert len(asked) == 2 * 3
    asked.clear()
    whole.effects, whole.quick = {}, True
    assert whole.local_near(TRUE, ("k",), known).quick
    assert len(asked) == 2 + 2  # repeats at the same values share their slopes


class Steep(MadeUp):
    """Friction that enters with its fifth power: a few per cent are no straight line."""

    def values(self, throw: ThrowInputs) -> Mapping[str, object]:
        return {**throw.overrides, "mu": steep(float(str(throw.overrides["mu"])))}


def steep(mu: float) -> float:
    return TRUE["mu"] * (mu / TRUE["mu"]) ** 5


def test_movements_are_thrown_at_their_own_values_however_far_these_are() -> None:
    owns = np.array([-0.06, -0.03, 0.0, 0.02, 0.07])
    rng = np.random.default_rng(9)
    measured = [
        movement(f"m{n}", rng=rng, own=steep(TRUE["mu"] * (1.0 + own)) / TRUE["mu"] - 1.0)
        for n, own in enumerate(owns)
    ]
    whole = misfit(measured)
    whole.evaluator = Steep(load_panel("sb1"))
    found = fit(whole, PARAMETERS, {"mu": 0.33, "k": 850e3})
    thrown = found.values["mu"] * (1.0 + np.array(found.misfit.effects["mu"]))
    np.testing.assert_allclose(thrown, TRUE["mu"] * (1.0 + owns), rtol=2e-3)
    assert found.values["k"] == pytest.approx(TRUE["k"], rel=1e-3)
    assert 0.8 < found.rms < 1.2


def test_a_parameter_that_does_nothing_is_not_identified() -> None:
    idle = Parameter(name="idle", keys=("idle",), start=1.0, lower=0.1, upper=10.0)
    whole = misfit(alike(1, seed=2))
    whole.parameters = (*PARAMETERS, idle)
    whole.base = {**whole.base, "idle": 1.0}
    found = fit(whole, whole.parameters, {**TRUE, "idle": 1.0})
    assert spread_of(found).states == ("fitted", "fitted", "not identified")


def test_a_bound_that_stops_the_fit_is_reported() -> None:
    low = Parameter(name="k", keys=("k",), start=500e3, lower=1e5, upper=800e3, unit="N/m")
    whole = misfit(alike(1, seed=2))
    whole.parameters = (PARAMETERS[0], low)
    found = fit(whole, whole.parameters, {"mu": 0.3, "k": 500e3})
    spread = spread_of(found)
    assert spread.states[1] == "at its bound"
    assert np.isnan(spread.deviations[1])


def test_a_fit_goes_on_while_it_gains_and_says_where_it_did_not_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole = misfit(alike(3, seed=2))
    monkeypatch.setattr(fitting, "MAX_STEPS", 1)
    monkeypatch.setattr(fitting, "EXTRA_STEPS", 1)
    found = fit(whole, PARAMETERS, {"mu": 0.6, "k": 2e6})
    assert found.converged
    assert found.values["k"] == pytest.approx(TRUE["k"], rel=0.01)
    assert distrust_reasons(found, spread_of(found)) == []
    monkeypatch.setattr(fitting, "STEP_LIMIT", 1)
    monkeypatch.setattr(fitting, "MAX_PASSES", 1)
    found = fit(whole, PARAMETERS, {"mu": 0.6, "k": 2e6})
    reasons = distrust_reasons(found, spread_of(found))
    assert reasons[0].startswith("the last stage stopped after 1 steps before convergence")


def test_a_movement_that_no_friction_explains_is_not_thrown_without_any() -> None:
    rng = np.random.default_rng(2)
    whole = misfit([movement("m", rng=rng, own=-0.9), movement("n", rng=rng)])
    whole.comparison = replace(whole.comparison, scatter={"mu": 0.5})
    found = fit(whole, PARAMETERS[1:], {**TRUE, "mu": 0.9})
    assert min(found.misfit.effects["mu"]) == -0.5


def test_a_model_of_something_else_is_not_to_be_trusted_and_not_refined() -> None:
    measured = alike(3, seed=2)
    time = measured[0].signals[0].time
    seen = {}
    for name, amplitude in (("right", 0.0), ("other", 400.0)):
        for item in measured:
            item.signals[0].values[:] += amplitude * np.sin(9.0 * time) * (time > 0)
        whole = misfit(measured)
        thrown = listened(whole)
        found = fit(whole, PARAMETERS, TRUE)
        seen[name] = any(throw.kind == "fine" for throw, _ in thrown)
        reasons = distrust_reasons(found, spread_of(found))
        assert bool(reasons) == (name == "other")
    assert seen == {"right": True, "other": False}
    assert "drive_force of drive 1: model error" in reasons[-1]
    assert "that rods and places are named right" in reasons[-1]


@pytest.mark.parametrize("amplitude", [10.0, 40.0])
def test_misses_in_common_are_no_noise_that_hides_them(amplitude: float) -> None:
    """A switch with a metre more of rail was trusted: its misses had raised the limit of them."""
    measured = alike(4, seed=2)
    time = measured[0].signals[0].time
    for item in measured:
        item.signals[0].values[:] += amplitude * np.sign(np.sin(60.0 * time)) * (time > 0)
    whole = misfit(measured)
    whole.comparison = replace(whole.comparison, gains={("drive_force", "1"): 0.01})
    noise = fit(whole, PARAMETERS, TRUE).misfit.comparison.noise["drive_force", "1"]
    assert noise.white == whole.comparison.noise["drive_force", "1"].white
    assert noise.total > noise.left > 1.5 * noise.white


@pytest.mark.parametrize(("share", "alone", "beside"), [(0.1, 0, 0), (0.3, 0, 1), (0.5, 1, 1)])
def test_beside_causes_a_model_may_miss_no_more_than_another_solver(
    share: float, alone: int, beside: int
) -> None:
    """A bushing taken for another left 0.32 % of a drive, with values up to 0.8 % off."""
    found = fit(misfit(alike(3, seed=1)), PARAMETERS, TRUE)
    comparison = found.misfit.comparison
    (key,) = comparison.noise
    missed = share / 100.0 * peaks_of(found.misfit.movements)[key]
    noise = {key: replace(comparison.noise[key], white=0.1, missed=missed)}
    there = replace(comparison, noise=noise, discrepancy={})
    found = replace(found, misfit=replace(found.misfit, comparison=there))
    spread = spread_of(found)
    assert len(distrust_reasons(found, spread)) == alone
    reasons = distrust_reasons(found, spread, ["bushing shape", "bushing shape"])
    assert len(reasons) == beside
    assert not reasons or "bushing shape explains it only in part" in reasons[0]


def test_sensitivities_are_those_of_the_residuals() -> None:
    whole = misfit(alike(1, seed=3))
    local = whole.local(TRUE, ("mu", "k"))
    frame = framed(local, whole)
    slopes = jacobian(local, frame, ("mu", "k"))
    ahead = whole.residuals_of(
        whole.responses([{**TRUE, "k": TRUE["k"] * np.exp(FINE_DIFFERENCE)}])[0], frame
    )
    change = (ahead - whole.residuals_of(local.simulated, frame)) / FINE_DIFFERENCE
    np.testing.assert_allclose(slopes[:, 1], change, atol=1e-6 * np.abs(change).max())


def test_an_impact_that_the_model_misses_does_not_bend_the_fit() -> None:
    measured = alike(4, seed=4)
    for item in measured:
        item.signals[0].values[60] += 400.0
    found = fit(misfit(measured), PARAMETERS, TRUE)
    assert found.values["k"] == pytest.approx(TRUE["k"], rel=2e-3)


def test_throws_are_taken_up_from_the_folder(tmp_path: Path) -> None:
    panel = load_panel("sb1")
    throw = ThrowInputs(overrides={"chair.friction_coefficient": 0.3}, kind="quick")
    found = []
    for reused in (0, 1):
        with Evaluator(panel, folder=tmp_path) as evaluator:
            found += evaluator.responses([throw])
            assert (evaluator.made, evaluator.reused) == (1 - reused, reused)
    made, back = found
    np.testing.assert_allclose(back.drive_force["1"], made.drive_force["1"], rtol=1e-6)
    assert (back.onsets, back.failure) == (made.onsets, "")


def test_noise_at_rest_and_its_correlation_are_found() -> None:
    rng = np.random.default_rng(5)
    slow = np.zeros(4000)
    for n in range(1, slow.size):
        slow[n] = 0.8 * slow[n - 1] + 0.6 * rng.standard_normal()
    time = BIN * (np.arange(4000) - 4010.0)
    values = 3.0 * slow + 1.0 * rng.standard_normal(4000)
    item = measured_force("m", time, values)
    noise = measured_noise([item])["drive_force", "1"]
    assert noise.slow == pytest.approx(3.0, rel=0.1)
    assert noise.white == pytest.approx(1.0, rel=0.3)
    assert noise.slow_length == pytest.approx(-BIN / np.log(0.8), rel=0.2)


def test_what_the_model_misses_is_distinguished_from_noise() -> None:
    rng = np.random.default_rng(6)
    wave = 10.0 * np.sin(np.arange(300) * BIN * 2.0 * np.pi / 0.8)
    rows = [wave + rng.standard_normal(300), -wave + rng.standard_normal(300)]
    size, length = missed_by_model(rows, Noise(white=1.0))
    assert size == pytest.approx(10.0 / np.sqrt(2.0), rel=0.1)
    assert 0.08 < length < 0.3
    assert missed_by_model([rng.standard_normal(300)], Noise(white=1.0))[0] == 0.0


def test_an_onset_that_forces_showed_far_too_early_is_found() -> None:
    rng = np.random.default_rng(8)
    lates = (0.0, 0.03, 0.145)
    measured = [movement(f"m{n}", rng=rng, late=late) for n, late in enumerate(lates)]
    found = fit(misfit(measured), PARAMETERS, TRUE)
    estimated = [alignment.estimates["onset"][0] for alignment in found.frame.alignments]
    np.testing.assert_allclose(estimated, lates, atol=1e-3)
    assert found.values["k"] == pytest.approx(TRUE["k"], rel=2e-3)


class Discretised(MadeUp):
    """Is wrong by the square of the step and by modes that are left out, in the stiffness."""

    def values(self, throw: ThrowInputs) -> Mapping[str, object]:
        steps = STEP_ERROR * (1.0 if throw.kind in ("halved", "fine") else 4.0)
        modes = MODES_ERROR * (1.0 if throw.kind == "fine" else 4.0**1.2)
        k = float(str(throw.overrides["k"])) * (1.0 + steps - modes)
        return {**throw.overrides, "k": k}


STEP_ERROR, MODES_ERROR = 2e-3, 1e-3


def test_what_step_and_modes_leave_is_in_the_deviations() -> None:
    """Errors of opposite signs do not cancel in what is stated of them."""
    measured = alike(6, seed=3)
    exact = fit(misfit(measured), PARAMETERS, TRUE)
    whole = replace(misfit(measured), evaluator=Discretised(load_panel("sb1")))
    found = fit(whole, PARAMETERS, TRUE)
    assert found.misfit.refinement
    left = 1.0 - STEP_ERROR + MODES_ERROR
    assert found.values["k"] == pytest.approx(exact.values["k"] * left, rel=2e-4)
    _, plain = spread_of(exact).deviations
    _, wide = spread_of(found).deviations
    own = np.array([STEP_ERROR, MODES_ERROR]) * found.values["k"]
    assert wide == pytest.approx(float(np.hypot(plain, np.hypot(*own))), rel=0.03)
    # Throws that were not refined say nothing of it.
    rough = replace(found, misfit=replace(found.misfit, refinement=()))
    assert spread_of(rough).deviations[1] == pytest.approx(plain, rel=0.05)


def test_movements_of_one_place_and_size_share_fine_throws() -> None:
    whole = misfit(alike(3, seed=3))
    whole.effects = {"mu": (0.0, 0.05, -0.02)}
    asked = listened(whole)
    whole.refined(TRUE)
    (fine,) = {throw.overrides["mu"] for throw, _ in asked if throw.kind == "fine"}
    assert fine == pytest.approx(1.01 * TRUE["mu"])


def test_a_refinement_goes_with_its_own_movement() -> None:
    """A subset had what fine throws change of other movements added."""
    whole = misfit(alike(3, seed=3))
    whole.effects = {"mu": (0.0, 0.05, -0.05)}
    refined = whole.refined(TRUE)
    refined.refinement = tuple(
        replace(item, fine=response({**TRUE, "k": (1.0 + 0.01 * n) * TRUE["k"]}))
        for n, item in enumerate(refined.refinement)
    )
    every = refined.responses([TRUE])[0]
    some = refined.of([2, 1]).responses([TRUE])[0]
    for number, found in zip([2, 1], some, strict=True):
        np.testing.assert_allclose(found.drive_force["1"], every[number].drive_force["1"])
