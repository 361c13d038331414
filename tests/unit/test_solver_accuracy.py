"""Worn columns are noticed when rounding may have grown, and only then; energy of a slip."""

import numpy as np
import pytest
from tests.unit.test_solver_columns import INERTIA, VISCOSITY, Setup, flip, setup

from turnout.core.scheme import AlphaCoefficients
from turnout.law.friction import SLIP_FORWARD
from turnout.law.obstruction import no_obstructions
from turnout.solver.accuracy import DRIFTS, is_inaccurate, refine
from turnout.solver.columns import rebuild, update_row
from turnout.solver.compliance import assemble_level
from turnout.solver.energy import account_friction
from turnout.solver.march import _try_step
from turnout.solver.scratch import Work
from turnout.solver.solution import gather_modes, solve_displacements
from turnout.solver.solve import CONVERGED, Tolerances, evaluate
from turnout.solver.state import COUNT_RECENT, UNSOLVED, set_segment
from turnout.solver.step import Stepping, step_factors


def solved(made: Setup) -> Work:
    """Solve a step with a right side of its own for the set that `made` has come to."""
    work = made.work
    work.right_side[:] = np.linspace(-500.0, 900.0, work.right_side.size)
    made.state.inputs[:] = [2e-3, -1e-3]
    made.state.counters[UNSOLVED] = -1
    solve_displacements(made.system, made.table, made.state, work)
    gather_modes(made.system, made.state)
    return work


def judged(made: Setup, work: Work) -> bool:
    return is_inaccurate(made.system, made.table, made.state, work, INERTIA, VISCOSITY)


@pytest.fixture
def made() -> Setup:
    made = setup(7, seed=12)
    rng = np.random.default_rng(3)
    for _ in range(30):
        flip(made, rng)
    rebuild(made.system, made.table, made.state, 0, made.scratch)
    return made


def test_a_fresh_solution_passes_and_the_count_starts_again(made: Setup) -> None:
    work = solved(made)
    made.state.drift[0] = 10.0 * DRIFTS
    assert not judged(made, work)
    assert made.state.drift[0] == 1.0


@pytest.mark.parametrize("worn", ["columns", "mode_columns"])
def test_worn_numbers_are_found_once_rounding_may_have_grown(made: Setup, worn: str) -> None:
    getattr(made.state, worn)[:] *= 1.0 + 1e-6
    work = solved(made)
    made.state.drift[0] = 0.9 * DRIFTS
    assert not judged(made, work)
    made.state.drift[0] = DRIFTS
    assert judged(made, work)


@pytest.mark.parametrize("worn", ["columns", "mode_columns"])
def test_the_errors_found_are_taken_off(made: Setup, worn: str) -> None:
    work = solved(made)
    exact = made.state.q.copy(), made.state.g.copy()
    getattr(made.state, worn)[:] *= 1.0 + 1e-6
    work = solved(made)
    off = [np.abs(made.state.q - exact[0]).max(), np.abs(made.state.g - exact[1]).max()]
    made.state.drift[0] = DRIFTS
    assert judged(made, work)
    refine(made.system, made.state, work)
    left = [np.abs(made.state.q - exact[0]).max(), np.abs(made.state.g - exact[1]).max()]
    assert left[0] < 1e-4 * off[0]
    assert left[1] < 1e-4 * off[1]


def stepping(step: float) -> Stepping:
    alpha = AlphaCoefficients.from_spectral_radius(0.5)
    coefficients = (alpha.alpha_m, alpha.alpha_f, alpha.beta, alpha.gamma)
    return Stepping(step, *coefficients, 0, False, 1, True)


def test_a_solution_is_corrected_where_columns_are_fresh_and_yet_wrong(made: Setup) -> None:
    system, table, state, work = made.system, made.table, made.state, made.work
    given = stepping(1e-3)
    factors = step_factors(given, given.step)
    inertia, viscosity, _ = factors
    state.level_ready[:] = 0
    assemble_level(system, state, 0, inertia, viscosity)
    rebuild(system, table, state, 0, work.row)
    state.mode_columns[:] *= 1.0 + 1e-6
    state.drift[0] = DRIFTS  # as after the last correction
    work.changed[:] = 1
    tolerances, inputs = Tolerances(1e9, 1e12, 10), (state.inputs.copy(), state.inputs.copy())
    state.inputs[:] = [2e-3, -1e-3]
    args = (system, table, state, work, tolerances, given, given.step, factors, inputs, True)
    args += (no_obstructions(),)
    assert _try_step(*args) == CONVERGED
    assert state.counters[COUNT_RECENT] == 0
    assert state.drift[0] == DRIFTS  # checked once more after the next step
    assert not is_inaccurate(system, table, state, work, inertia, viscosity)


def test_a_flip_counts_by_its_divisor_both_ways(made: Setup) -> None:
    table, state = made.table, made.state
    law = 1  # a contact outside the folded system
    set_segment(table, state, law, 0)
    update_row(*made[:3], int(table.row[law]), made.scratch, defer=False)
    state.drift[0] = 1.0
    grown = []
    for segment in (1, 0):
        set_segment(table, state, law, segment)
        update_row(*made[:3], int(table.row[law]), made.scratch, defer=False)
        grown.append(float(state.drift[0]))
    assert grown[0] > 1.5
    assert grown[1] == pytest.approx(grown[0] ** 2, rel=1e-9)


def test_the_books_follow_a_contact_that_pulls_within_the_overlooked_gap(made: Setup) -> None:
    system, table, state, work = made.system, made.table, made.state, made.work
    friction = 0
    normal, row = int(table.friction_normal[friction]), int(table.friction_row[friction])
    set_segment(table, state, normal, 1)
    state.friction[friction] = SLIP_FORWARD
    state.g[table.row[normal]] = table.offset[normal] - 1e-11
    state.g[row] = 0.5
    evaluate(table, state, work)
    account_friction(system, state, work)
    pull = table.friction_coefficient[friction] * state.slope[normal] * 1e-11
    assert state.friction_force[friction] == pytest.approx(-pull, rel=1e-6)
    assert pull > 0
