"""Whatever the panel, a run keeps its laws and its energy balance, or says why it stopped.

Scenarios: `robustness_scenarios`; what must hold: `robustness_checks`. The long job draws thousands
of them from a seeded generator; here hypothesis draws some, the same ones in each run.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.verification.robustness_checks import Run, faults, run_scenario
from tests.verification.robustness_scenarios import (
    LIFTED,
    Scenario,
    numbered_scenario,
    scenario,
)

from turnout.panel.load import library_names, load_panel
from turnout.solver.outcome import Code
from turnout.throw.simulate import simulate

QUICK: dict[str, float | None] = {
    "movement.throw.start": 0.1,
    "movement.throw.duration": 0.8,
    "movement.return.start": 0.9,
    "movement.return.duration": 0.8,
    "movement.return.extra_time.2": 0.1,
    "schedule.end": 1.8,
    "object_defaults.appears": None,
    "object_defaults.disappears": None,
}
"""A throw and, the instant it ends, the return; the run ends with it."""


def quick_of(panel: str) -> dict[str, float | None]:
    """Return QUICK for the drives of a panel: one drive has no second one that starts later."""
    there = load_panel(panel).drive
    later = "movement.return.extra_time."
    return {
        key: value
        for key, value in QUICK.items()
        if not key.startswith(later) or key.removeprefix(later) in there
    }


ONCE_DEFECTS = (603, 1003, 1256, 1562)
"""Chairs lifted by metres: balances that are rounding alone, stops off their law at the start."""


@pytest.mark.parametrize("index", ONCE_DEFECTS)
def test_lifted_chairs_keep_their_laws_and_end_complete(index: int) -> None:
    run = run_scenario(numbered_scenario(index))
    assert run.history.outcome.complete, run.history.outcome.message()
    assert not faults(run)


class Drawn:
    """Choices of hypothesis, which can make a failing scenario plainer."""

    def __init__(self, draw: st.DrawFn) -> None:
        self._draw = draw

    def integer(self, low: int, high: int) -> int:
        return self._draw(st.integers(low, high))

    def number(self, low: float, high: float) -> float:
        return self._draw(st.floats(low, high))


@st.composite
def scenarios(draw: st.DrawFn) -> Scenario:
    return scenario(Drawn(draw))


def library_scenario(panel: str, **changes: object) -> Scenario:
    plain = Scenario(panel, quick_of(panel), (), 1e-3, 300.0, 0.5, "plain")
    return replace(plain, **changes)


@settings(max_examples=20)
@given(scenarios())
def test_any_scenario_keeps_laws_and_books(drawn: Scenario) -> None:
    assert faults(run_scenario(drawn)) == []


EXTREMES: dict[str, dict[str, float | None]] = {
    "all chairs lifted": {"chair.clearance": LIFTED},
    "all sticking": {"chair.friction_coefficient": 2.0},
    "no friction": {"chair.friction_coefficient": 0.0},
    "soft drives": {"drive.stiffness": 1e3, "drive.saturated_stiffness": 0.0},
    "hard drives": {"drive.stiffness": 1e9, "drive.saturation_force": 2e4},
    "soft stops": {"stop.stiffness": 2e5},
    "hard stops": {"stop.stiffness": 2e11},
    "soft chairs": {"chair.normal_stiffness": 1e4},
    "hard chairs": {"chair.normal_stiffness": 1e10},
    "soft stick": {"chair.stick_stiffness": 5e3},
    "hard stick": {"chair.stick_stiffness": 5e9},
}


PAIRS = [
    pytest.param(panel, extreme, marks=[pytest.mark.long] if (row + column) % 3 else [])
    for row, panel in enumerate(library_names())
    for column, extreme in enumerate(EXTREMES)
]
"""All are thrown in the long job; every panel and every extreme in some pair in each run."""


@pytest.mark.parametrize(("panel", "extreme"), PAIRS)
def test_extremes_of_library_panels(panel: str, extreme: str) -> None:
    run = run_scenario(library_scenario(panel, overrides=quick_of(panel) | EXTREMES[extreme]))
    assert faults(run) == []
    assert run.history.outcome.complete, run.history.outcome.message()


def test_lifted_chairs_carry_nothing_and_soft_ones_do() -> None:
    lifted = run_scenario(library_scenario("sb2", overrides=QUICK | {"chair.clearance": LIFTED}))
    assert not lifted.dataset["chair_normal_force"].any()
    soft = run_scenario(library_scenario("sb2", overrides=QUICK | {"chair.normal_stiffness": 1e4}))
    assert float(soft.dataset["chair_normal_force"].min()) >= -1e-3
    assert float(soft.dataset["chair_normal_force"].sum(("rail", "chair"))[-1]) > 1e4


def test_an_object_placed_in_a_closed_rail_waits_for_room() -> None:
    run = closed_in()
    assert faults(run) == []
    law = run.mechanism.index.object["1"]
    placed, first = run.history.law_placed[law], run.history.law_first[law]
    gap = run.dataset["sensor_gap"].sel(sensor="TKK1")
    assert 0.1 < placed < 0.9
    assert float(gap.sel(time=placed - 0.002, method="nearest")) < 0.0131
    assert float(gap.sel(time=placed + 0.002, method="nearest")) > 0.0129
    assert 0.9 < first < 1.8
    assert not run.dataset["object_force"].sel(time=slice(0, first - 1e-3)).any()
    assert float(run.dataset["object_force"].max()) > 100.0


def test_an_object_for_which_there_is_never_room_is_never_placed() -> None:
    inside = {"size": 0.05, "at": "drive 1", "rail": "straight", "appears": 1.79}
    run = run_scenario(library_scenario("uic60-760-1-15", objects=(inside,)))
    assert faults(run) == []
    assert np.isnan(run.history.law_placed[run.mechanism.index.object["1"]])
    assert not run.dataset["object_touched"]


@pytest.mark.parametrize("panel", library_names())
def test_a_panel_that_never_moves(panel: str) -> None:
    still = load_panel(panel).model_copy(update={"movement": {}})
    found = simulate(still)
    assert found.attrs["complete"]
    assert float(np.abs(found["drive_force"] - found["drive_force"][:, 0]).max()) < 1e-6


def test_the_scenarios_are_as_wide_as_they_claim() -> None:
    drawn = [numbered_scenario(index) for index in range(60)]
    panels = [item.panel() for item in drawn]
    drives = [drive.stiffness for panel in panels for drive in panel.drive.values()]
    assert min(drives) < 1e4
    assert max(drives) > 1e8
    assert {len(panel.drive) for panel in panels} == {1, 2, 3, 4, 5, 6}
    assert {len(panel.rail) for panel in panels} == {1, 2}
    assert {len(panel.movement) for panel in panels} == {0, 1, 2, 3, 4}
    assert {len(item.objects) for item in drawn} == {0, 1, 2, 3}
    assert {item.special for item in drawn} >= {"plain", "lifted", "sticking", "uneven"}
    places = {item["at"].split()[0] for one in drawn for item in one.objects}
    assert places == {"sleeper", "drive", "sensor", "chair", "x"}
    without = [p for p in panels if any(r.stock_rail_gap is None for r in p.rail.values())]
    assert 5 < len(without) < 30


INSIDE = {"size": 0.013, "at": "sleeper 6", "rail": "straight", "appears": 0.05}


@cache
def closed_in() -> Run:
    """Return a run with an object placed in a closed rail; no test may change it."""
    # One rail for the sensor, as a pair gives the gap of the other one while this opens.
    own = QUICK | {"sensor.TKK1.rail": "straight"}
    return run_scenario(library_scenario("uic60-760-1-15", objects=(INSIDE,), overrides=own))


def sound() -> Run:
    """Return a run for the tests below to spoil."""
    run = closed_in()
    copied = {name: getattr(run.history, name).copy() for name in ("law_force", "friction_force")}
    dataset = run.dataset.copy(deep=True)
    return replace(run, history=replace(run.history, **copied), dataset=dataset)


def spoil(run: Run, what: str) -> None:
    index = run.mechanism.index
    if what == "drive_force has NaN":
        run.dataset["drive_force"][0, 5] = np.nan
    elif what == "pulls with":
        run.history.law_force[3, index.chair["straight", "3"][0]] = -0.01
    elif what == "above its limit":
        run.history.friction_force[3, 0] = 1e4
    elif what == "off its law":
        run.history.law_force[3, index.drive["2"]] += 0.01
    elif what == "energy residual":
        run.dataset["energy_residual"][-1] = 1.01e-6 * run.dataset.attrs["energy_scale"]
    else:
        run.dataset["energy_friction"][-1] = -1.0


@pytest.mark.parametrize(
    "what",
    [
        "drive_force has NaN", "pulls with", "above its limit", "off its law", "energy residual",
        "friction gave",
    ],
)  # fmt: skip
def test_what_is_spoilt_is_seen(what: str) -> None:
    run = sound()
    assert faults(run) == []
    spoil(run, what)
    assert any(what in text for text in faults(run))


def test_a_message_that_says_too_little_is_seen() -> None:
    run = sound()
    outcome = replace(run.history.outcome, code=Code.NOT_CONVERGED, contacts=())
    silent = replace(run, history=replace(run.history, outcome=outcome))
    assert "message without contacts" in faults(silent)
    named = replace(outcome, contacts=("drive 1",))
    assert faults(replace(run, history=replace(run.history, outcome=named))) == []
