"""Worn columns are noticed when rounding may have grown, and only then; energy of a slip."""

import numpy as np
import pytest
from tests.unit.test_solver_columns import INERTIA, OPTIONS, VISCOSITY, Setup, flip, setup

from turnout.law.friction import SLIP_FORWARD
from turnout.solver.columns import assemble_level, rebuild, update_row
from turnout.solver.energy import account_friction
from turnout.solver.march import _try_step, step_factors
from turnout.solver.solve import (
    CONVERGED,
    DRIFTS,
    evaluate,
    gather_modes,
    is_inaccurate,
    refine,
    solve_displacements,
)
from turnout.solver.state import COUNT_RECENT, UNSOLVED, set_segment


def solved(made: Setup) -> None:
    """Solve a step with a right side of its own for the set that `made` has come to."""
    side = made.work.right_side
    side[:] = np.linspace(-500.0, 900.0, side.size)
    made.state.inputs[:] = [2e-3, -1e-3]
    made.state.counters[UNSOLVED] = -1
    solve_displacements(made.run, made.state)
    gather_modes(made.run, made.state)


def judged(made: Setup) -> bool:
    return is_inaccurate(made.run, made.state, INERTIA, VISCOSITY)


@pytest.fixture
def made() -> Setup:
    made = setup(7, seed=12)
    rng = np.random.default_rng(3)
    for _ in range(30):
        flip(made, rng)
    rebuild(made.run, made.state, 0)
    return made


def test_a_fresh_solution_passes_and_the_count_starts_again(made: Setup) -> None:
    solved(made)
    made.state.drift[0] = 10.0 * DRIFTS
    assert not judged(made)
    assert made.state.drift[0] == 1.0


@pytest.mark.parametrize("worn", ["columns", "mode_columns"])
def test_worn_numbers_are_found_once_rounding_may_have_grown(made: Setup, worn: str) -> None:
    getattr(made.state, worn)[:] *= 1.0 + 1e-6
    solved(made)
    made.state.drift[0] = 0.9 * DRIFTS
    assert not judged(made)
    made.state.drift[0] = DRIFTS
    assert judged(made)


@pytest.mark.parametrize("worn", ["columns", "mode_columns"])
def test_the_errors_found_are_taken_off(made: Setup, worn: str) -> None:
    solved(made)
    exact = made.state.q.copy(), made.state.g.copy()
    getattr(made.state, worn)[:] *= 1.0 + 1e-6
    solved(made)
    off = [np.abs(made.state.q - exact[0]).max(), np.abs(made.state.g - exact[1]).max()]
    made.state.drift[0] = DRIFTS
    assert judged(made)
    refine(made.run, made.state)
    left = [np.abs(made.state.q - exact[0]).max(), np.abs(made.state.g - exact[1]).max()]
    assert left[0] < 1e-4 * off[0]
    assert left[1] < 1e-4 * off[1]


def test_a_solution_is_corrected_where_columns_are_fresh_and_yet_wrong(made: Setup) -> None:
    state = made.state
    options = OPTIONS._replace(gap=1e9, force=1e12, iterations=10)
    run = made.run._replace(options=options)
    factors = step_factors(options, options.step)
    inertia, viscosity = factors.inertia, factors.viscosity
    state.level_ready[:] = 0
    assemble_level(run, state, 0, inertia, viscosity)
    rebuild(run, state, 0)
    state.mode_columns[:] *= 1.0 + 1e-6
    state.drift[0] = DRIFTS  # as after the last correction
    run.work.changed[:] = 1
    inputs = state.inputs.copy(), state.inputs.copy()
    state.inputs[:] = [2e-3, -1e-3]
    assert _try_step(run, state, factors, inputs, True) == CONVERGED
    assert state.counters[COUNT_RECENT] == 0
    assert state.drift[0] == DRIFTS  # checked once more after the next step
    assert not is_inaccurate(run, state, inertia, viscosity)


def test_a_flip_counts_by_its_divisor_both_ways(made: Setup) -> None:
    table, state = made.table, made.state
    law = 1  # a contact outside the folded system
    set_segment(table, state, law, 0)
    update_row(made.run, state, int(table.row[law]))
    state.drift[0] = 1.0
    grown = []
    for segment in (1, 0):
        set_segment(table, state, law, segment)
        update_row(made.run, state, int(table.row[law]))
        grown.append(float(state.drift[0]))
    assert grown[0] > 1.5
    assert grown[1] == pytest.approx(grown[0] ** 2, rel=1e-9)


def test_the_books_follow_a_contact_that_pulls_within_the_overlooked_gap(made: Setup) -> None:
    table, state = made.table, made.state
    friction = 0
    normal, row = int(table.friction_normal[friction]), int(table.friction_row[friction])
    set_segment(table, state, normal, 1)
    state.friction[friction] = SLIP_FORWARD
    state.g[table.row[normal]] = table.offset[normal] - 1e-11
    state.g[row] = 0.5
    evaluate(made.run, state)
    account_friction(made.run, state)
    pull = table.friction_coefficient[friction] * state.slope[normal] * 1e-11
    assert state.friction_force[friction] == pytest.approx(-pull, rel=1e-6)
    assert pull > 0
