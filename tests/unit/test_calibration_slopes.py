"""Slopes that are shared by repeats, and taken at their word."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.test_calibration_fit import (
    PARAMETERS,
    TRUE,
    MadeUp,
    alike,
    listened,
    misfit,
    movement,
    response,
)

from turnout.calibration import evaluate
from turnout.calibration.evaluate import Evaluator, Response, ThrowInputs, throw_processes
from turnout.calibration.fit import fit, sought_effects, update_movement_effects
from turnout.calibration.linearisation import leaders_of
from turnout.calibration.misfit import Misfit, framed, jacobian
from turnout.core.errors import SolverError
from turnout.core.scheme import Scheme
from turnout.core.workers import Workers
from turnout.panel.load import load_panel


def repeats(count: int) -> Misfit:
    return misfit(alike(count, seed=5))


def test_repeats_near_the_same_values_share_slopes_and_others_have_their_own() -> None:
    whole = repeats(4)
    own = [{**TRUE, "mu": TRUE["mu"] * (1.0 + share)} for share in (0.0, 0.004, 0.02, 0.021)]
    assert leaders_of(whole.movements, PARAMETERS, own, within=0.005) == [0, 0, 2, 2]
    whole.effects = {"mu": (0.0, 0.004, 0.02, 0.021)}
    asked = listened(whole)
    local = whole.local(TRUE, ("k",))
    assert len(asked) == 4 + 2 * 2
    assert local.stepped["k"][1] is local.stepped["k"][0]
    assert local.origin[1] is local.origin[0]
    assert local.simulated[1] is not local.simulated[0]
    assert local.about[3] == own[2]


class Limited(MadeUp):
    """Cannot simulate above a stiffness, as a panel that a drive presses home."""

    def responses(self, throws: Sequence[ThrowInputs]) -> list[Response]:
        return [
            replace(item, failure="it slips at rest")
            if float(str(throw.overrides["k"])) > TRUE["k"]
            else item
            for throw, item in zip(throws, super().responses(throws), strict=True)
        ]


def test_a_slope_is_taken_on_the_other_side_where_a_throw_aside_fails() -> None:
    whole = repeats(2)
    names = [item.name for item in PARAMETERS]
    expected = jacobian(local := whole.local(TRUE, names), framed(local, whole), names)
    limited = replace(whole, evaluator=Limited(load_panel("sb1")))
    local = limited.local(TRUE, names)
    assert local.steps["mu"][0] > 0.0 > local.steps["k"][0]
    found = jacobian(local, framed(local, limited), names)
    np.testing.assert_allclose(found, expected, atol=0.02 * np.abs(expected).max())
    with pytest.raises(SolverError, match="it slips at rest"):
        limited.local({**TRUE, "k": 1.1 * TRUE["k"]}, names)


def test_a_slope_is_not_taken_over_less_than_half_a_difference() -> None:
    # Near its lower bound a value has no room on the other side.
    low = {**TRUE, "k": TRUE["k"] * (1.0 - 1e-9)}
    bound = replace(PARAMETERS[1], start=TRUE["k"], lower=low["k"])
    limited = replace(
        repeats(2), parameters=(PARAMETERS[0], bound), evaluator=Limited(load_panel("sb1"))
    )
    with pytest.raises(SolverError, match="it slips at rest"):
        limited.local(TRUE, ("mu", "k"))


def test_slopes_foretell_responses_a_small_step_away() -> None:
    whole = repeats(2)
    near = {**TRUE, "k": 1.002 * TRUE["k"]}
    moved = whole.local(TRUE, ("k",)).moved(near, {"k": np.log(1.002), "mu": 0.0})
    assert moved.values == near
    for row in moved.simulated:
        exact = response(near).drive_force["1"]
        np.testing.assert_allclose(row.drive_force["1"], exact, atol=0.02)


def test_only_movements_whose_friction_changed_are_thrown_again() -> None:
    rng = np.random.default_rng(8)
    whole = misfit([movement(f"m{n}", rng=rng, own=own) for n, own in enumerate((0.0, 0.03, 0.0))])
    local = whole.local(TRUE, ("k",))
    changed, _, _ = update_movement_effects(whole, local, ("k",), passes=1)
    assert changed.effects["mu"][0] == changed.effects["mu"][2] == 0.0
    assert changed.effects["mu"][1] == pytest.approx(0.03, abs=0.005)


class Sticking(MadeUp):
    """Far from its own friction a movement sticks elsewhere: a wave that hides the way back."""

    def responses(self, throws: Sequence[ThrowInputs]) -> list[Response]:
        found = []
        for throw, item in zip(throws, super().responses(throws), strict=True):
            off = abs(float(str(throw.overrides["mu"])) / TRUE["mu"] - 1.0) > 0.05
            wave = 300.0 * off * np.sin(9.0 * item.time)
            found.append(replace(item, drive_force={"1": item.drive_force["1"] + wave}))
        return found


def test_a_movement_that_stands_out_is_thrown_with_other_values_of_its_own() -> None:
    whole = repeats(4)
    whole.evaluator = Sticking(load_panel("sb1"))
    found = fit(whole, PARAMETERS, TRUE, rough=True)
    assert sought_effects(found)["mu"] == found.misfit.effects["mu"]
    effects = {"mu": (0.0, 0.0, 0.15, 0.0)}
    misfit = replace(found.misfit, effects=effects)
    local = replace(found.local, simulated=tuple(misfit.responses([found.values])[0]))
    held = replace(found, misfit=misfit, local=local, frame=framed(local, misfit))
    own = sought_effects(held)["mu"]
    assert (own[0], own[1], own[3]) == (0.0, 0.0, 0.0)
    assert abs(own[2]) <= 0.02


def test_finely_meshed_throws_of_a_place_go_to_one_process_and_first() -> None:
    scheme = Scheme()
    throws = [
        ThrowInputs(overrides={}, place=place, size=0.013, kind=kind)
        for kind in ("plain", "halved", "fine")
        for place in ("drive 1", "drive 2")
    ]
    jobs = [(str(number), throw, scheme) for number, throw in enumerate(throws)]
    sent = [[key for key, _, _ in some] for some in evaluate._messages(jobs)]
    assert sent == [["2", "4"], ["3", "5"], ["0"], ["1"]]


def test_work_counts_what_each_kind_of_throw_takes() -> None:
    assert list(evaluate.WORK) == ["quick", "lean", "plain", "halved", "fine"]
    works = list(evaluate.WORK.values())
    assert works[0] == 1.0
    assert works == sorted(works)


def test_processes_begin_before_there_is_anything_to_throw(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    started: list[object] = []
    monkeypatch.setattr(Workers, "start", lambda self, job: started.append((self.count, job)))
    panel = load_panel("sb1")
    with throw_processes(panel, 2, tmp_path / "none"):
        assert [count for count, _ in started] == [2]
    (tmp_path / "kept.npz").touch()
    with throw_processes(panel, 2, tmp_path) as given:
        assert given.idle
    assert len(started) == 1


def test_an_evaluator_throws_with_processes_that_it_is_given(tmp_path: Path) -> None:
    panel = load_panel("sb1")
    throws: Sequence[ThrowInputs] = [
        ThrowInputs(overrides={"chair.friction_coefficient": mu}, kind="quick") for mu in (0.3, 0.4)
    ]
    with (
        throw_processes(panel, 2, tmp_path / "none") as processes,
        Evaluator(panel, workers=processes) as evaluator,
    ):
        found = evaluator.responses(throws)
        assert evaluator.work == 2.0
    with Evaluator(panel) as alone:
        for one, other in zip(found, alone.responses(throws), strict=True):
            np.testing.assert_array_equal(one.drive_force["1"], other.drive_force["1"])
