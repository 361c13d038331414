"""Static equilibrium of a mechanism: without friction the minimum of its potential energy.

`equilibrium` iterates the contact set of the condensed system. Where that cycles,
`equilibrium_segments` finds the segments of the laws first, on all coordinates: the force of every
law never falls with its argument, so the energy is convex, and a Newton iteration with line search
finds the minimum from any start. `settle` finds an equilibrium with friction that a motion left.
"""

import numpy as np

from turnout.kernels.compiled import compiled
from turnout.kernels.vector import copy
from turnout.law.friction import STICK
from turnout.law.kernel import any_not_finite
from turnout.law.table import LawTable
from turnout.mechanism.mechanism import Mechanism
from turnout.solver.accuracy import measure_residual, refine
from turnout.solver.columns import rebuild
from turnout.solver.compliance import assemble_level
from turnout.solver.energy import account_friction, account_laws, set_energy_reference
from turnout.solver.follow import follow_path
from turnout.solver.solution import gather_modes, solve_displacements
from turnout.solver.solve import (
    CONVERGED,
    NOT_CONVERGED,
    NOT_FINITE,
    evaluate,
    iterate_contact_set,
    restore_contact_set,
    save_contact_set,
    update_contact_set,
    update_marked,
)
from turnout.solver.state import Run, State
from turnout.solver.system import Floats, Ints

ITERATIONS = 100
"""Most Newton steps; some ten are usual."""
REFINEMENTS = 8
"""Most refinements of a static solution that change its contact set."""


def equilibrium_segments(mechanism: Mechanism, *, inputs: Floats, present: Ints) -> Ints:
    """Return the segment of every law at the minimum of the energy, by a Newton iteration.

    Parameters
    ----------
    mechanism : Mechanism
        Its laws are evaluated without friction.
    inputs : ndarray, shape (n_inputs,)
        Marker positions [m].
    present : ndarray of int, shape (n_laws,)
        1 where a law acts, else 0.
    """
    table, rows = mechanism.laws, mechanism.rows
    at_input = np.where(table.input_index >= 0, inputs[table.input_index] if inputs.size else 0, 0)
    zero = table.offset + at_input
    u = np.zeros(rows.shape[1])

    def energy(u: Floats) -> float:
        _, potential, _ = _evaluate_laws(table, (rows @ u)[table.row] - zero)
        return float(u @ (0.5 * (mechanism.stiffness @ u) - mechanism.load) + present @ potential)

    for _ in range(ITERATIONS):
        e = (rows @ u)[table.row] - zero
        force, _, slope = _evaluate_laws(table, e)
        residual = mechanism.stiffness @ u - mechanism.load
        residual += np.bincount(table.row, present * force, rows.shape[0]) @ rows
        tangent = (
            mechanism.stiffness
            + (rows.T * np.bincount(table.row, present * slope, rows.shape[0])) @ rows
        )
        if not np.isfinite(residual).all():
            break
        direction = -np.linalg.lstsq(tangent, residual)[0]
        energy_u, descent, share = energy(u), float(residual @ direction), 1.0
        while energy(u + share * direction) > energy_u + 1e-4 * share * descent and share > 1e-9:
            share *= 0.5
        u = u + share * direction
        segments = _find_segments(table, (rows @ u)[table.row] - zero)
        if share == 1.0 and np.array_equal(segments, _find_segments(table, e)):
            break  # a whole step within them ends at the minimum
    return _find_segments(table, (rows @ u)[table.row] - zero)


def _find_segments(table: LawTable, e: Floats) -> Ints:
    counts = [
        int(np.searchsorted(table.segment_upper[first : last - 1], value))
        for first, last, value in zip(
            table.segment_start[:-1], table.segment_start[1:], e, strict=True
        )
    ]
    return np.array(counts, dtype=np.int64)


def _evaluate_laws(table: LawTable, e: Floats) -> tuple[Floats, Floats, Floats]:
    """Return force [N], energy [J] and slope [N/m] of every law at its argument."""
    at = table.segment_start[:-1] + _find_segments(table, e)
    force = table.slope[at] * e + table.intercept[at]
    energy = (0.5 * table.slope[at] * e + table.intercept[at]) * e + table.potential[at]
    return force, energy, table.slope[at]


@compiled
def equilibrium(run: Run, state: State) -> int:
    """Find the static equilibrium for the present inputs by iterating the contact set.

    The columns are those of a level without inertia and viscosity, the last one. The solution is
    refined, so that a rail at rest does not move in its first step.
    """
    system, work = run.system, run.work
    static = state.level_ready.size - 1
    assemble_level(run, state, static, 0.0, 0.0)
    rebuild(run, state, static)
    copy(system.load, work.right_side)
    code = iterate_contact_set(run, state)
    if code == CONVERGED:
        _refine_contact_set(run, state)
        if any_not_finite(state.g):  # an infinite one may lie in the last segment of its law
            return NOT_FINITE
    return code


@compiled
def _refine_contact_set(run: Run, state: State) -> None:
    """Refine the static solution, and the contact set where the refined solution violates it.

    Where chairs lie metres below their rails a refinement moves contacts by more than their
    tolerance, which is that of rails in the range of a switch. If rounding undoes every change, the
    last solution stays, which violates its laws by that rounding.
    """
    for attempt in range(REFINEMENTS + 1):
        measure_residual(run, state, 0.0, 0.0)
        refine(run, state)
        if attempt == REFINEMENTS:
            return
        count = update_contact_set(run, state, one_at_a_time=False)
        if count == 0:
            return
        update_marked(run, state, count)
        solve_displacements(run, state)
        gather_modes(run, state)


@compiled
def anchor_at_rest(run: Run, state: State) -> None:
    """Anchor every foot at its present place, and start the energy balance from here."""
    table = run.table
    state.friction[:] = STICK
    for friction in range(state.anchor.size):
        state.anchor[friction] = state.g[table.friction_row[friction]]
    start_energy_balance(run, state)


@compiled
def start_energy_balance(run: Run, state: State) -> None:
    """Start the energy balance from the present solution; anchors of slipping feet follow it."""
    work = run.work
    evaluate(run, state)
    account_laws(run, state, state.inputs, 0.0)
    account_friction(run, state)
    state.ledger[:] = 0.0
    work.unconverged[:] = 0
    set_energy_reference(run, state)


@compiled
def settle(run: Run, state: State) -> int:
    """Bring a state in motion to rest under friction; return CONVERGED or what prevented it.

    The contact set is iterated from the present one with the anchors as they are. Where that does
    not converge, the forces of inertia and dampers, without which the present state would not be
    one of equilibrium, are taken away along a straight path, event by event.
    """
    system, work = run.system, run.work
    static = state.level_ready.size - 1
    assemble_level(run, state, static, 0.0, 0.0)
    rebuild(run, state, static)
    copy(system.load, work.right_side)
    copy(state.q, work.q_start)
    work.changed[:] = 1
    save_contact_set(run, state)
    code = iterate_contact_set(run, state)
    if code == NOT_CONVERGED:
        copy(work.q_start, state.q)
        copy(work.g_start, state.g)
        restore_contact_set(run, state)
        rebuild(run, state, static)
        copy(system.load, work.right_side)
        copy(state.inputs, work.inputs_start)
        copy(state.inputs, work.inputs_end)
        inputs = (work.inputs_start, work.inputs_end)
        code = follow_path(run, state, inputs, 0.0, 0.0)
    if code == CONVERGED:
        _refine_contact_set(run, state)
    return code
