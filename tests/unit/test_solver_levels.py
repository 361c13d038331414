"""Compliances serve the next run of the same rails and objects with the same bits."""

from dataclasses import dataclass

import numpy as np
import pytest

from turnout.core.scheme import Scheme
from turnout.mechanism.build import build_mechanism
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import load_panel
from turnout.solver.arrange import (
    Arrangement,
    arrange,
    clear_buffers,
    clear_memory,
    give_back,
    prepare,
    set_up_run,
)
from turnout.solver.march import switch_level
from turnout.solver.record import SavePlan
from turnout.solver.state import Run, State

PANEL = load_panel("sb2")  # its records are known by identity
QUICK = Scheme.of("quick")
LEVELS = (0, 2)


@dataclass(frozen=True)
class Prepared:
    """A run with its state and what it is of."""

    arrangement: Arrangement
    run: Run
    state: State

    def give_back(self, *, record: bool = False) -> None:
        give_back(self.arrangement, self.run, self.state, record=record)


def prepared(place: str, *, scheme: Scheme = QUICK, instants: int = 3) -> Prepared:
    """Prepare a run with an object between the places of the panel."""
    objects = resolve_objects(PANEL, (ForeignObject("13 mm", place),))
    mechanism = build_mechanism(PANEL, objects)
    arrangement = arrange(mechanism, scheme)
    setup = set_up_run(arrangement, scheme, np.zeros((3, 2)), SavePlan(instants))
    return Prepared(arrangement, *prepare(setup))


def assembled(made: Prepared) -> np.ndarray:
    """Assemble some levels; return a copy of all that they hold."""
    for level in LEVELS:
        switch_level(made.run, made.state, level)
    return made.state.compliance[list(LEVELS)].copy()


def given_back(place: str = "x = 3.61 m") -> np.ndarray:
    """Assemble a run with an object at a place and give it back; return what it held."""
    run = prepared(place)
    held = assembled(run)
    run.give_back()
    return held


@pytest.fixture(autouse=True)
def _without_memory() -> None:
    clear_memory()
    assert not prepared(
        "drive 1"
    ).arrangement.known  # the first run of these rails, which gives nothing back


def test_the_only_throw_of_some_rails_leaves_nothing() -> None:
    clear_buffers()
    clear_memory()
    given_back()
    assert not prepared("x = 3.61 m").state.level_ready.any()


def test_another_place_of_an_object_has_a_compliance_of_its_own() -> None:
    elsewhere = given_back()
    moved = prepared("x = 2.17 m")
    assert not moved.state.level_ready.any()
    found = assembled(moved)
    assert moved.state.level_ready[list(LEVELS)].all()
    clear_buffers()
    fresh = assembled(prepared("x = 2.17 m"))
    np.testing.assert_array_equal(found, fresh)
    assert np.count_nonzero(elsewhere != fresh) > 100


def test_the_same_place_needs_nothing() -> None:
    before = given_back()
    again = prepared("x = 3.61 m")
    assert again.state.level_ready[list(LEVELS)].all()
    np.testing.assert_array_equal(assembled(again), before)


def test_no_two_runs_share_their_memory() -> None:
    given_back()
    second, third = prepared("x = 3.61 m"), prepared("x = 3.61 m")
    assert not np.shares_memory(second.state.compliance, third.state.compliance)
    assert not third.state.level_ready.any()


def test_another_step_has_a_compliance_of_its_own() -> None:
    given_back()
    other = prepared("x = 3.61 m", scheme=Scheme(step=2e-3, cutoff_frequency=100.0))
    assert not other.state.level_ready.any()


def test_nothing_of_a_run_is_left_in_its_memory() -> None:
    first = prepared("x = 3.61 m")
    used = first.state, first.run.work
    for record in used:
        for name in ("q", "counters", "friction", "segment", "right_side", "dirty", "stop"):
            if hasattr(record, name):
                getattr(record, name)[:] = 1
    first.give_back()
    again = prepared("x = 3.61 m")
    assert (again.state, again.run.work) == used
    clear_buffers()
    fresh = prepared("x = 3.61 m")
    assert fresh.state is not again.state
    np.testing.assert_array_equal(again.state.memory, fresh.state.memory)
    np.testing.assert_array_equal(again.run.work.memory, fresh.run.work.memory)


def test_a_record_that_is_given_back_serves_runs_of_as_many_instants() -> None:
    first = prepared("x = 3.61 m")
    first.run.record.residual[:] = 1.0
    first.give_back(record=True)
    again = prepared("x = 2.17 m")
    assert again.run.record is first.run.record
    assert again.run.record.residual.tolist() == [0.0]
    again.give_back(record=True)
    assert prepared("x = 2.17 m", instants=2).run.record is not first.run.record


def test_a_record_stays_with_its_run_otherwise() -> None:
    first = prepared("x = 3.61 m")
    first.give_back()
    again = prepared("x = 3.61 m")
    assert again.state is first.state
    assert not np.shares_memory(again.run.record.q, first.run.record.q)
