r"""Residuals of a solution from columns that have been updated many times, and its refinement.

Each rank-one update multiplies the rounding errors of the columns by about its divisor or the
inverse, whichever is larger: a stiff stop that closes leaves small differences of large numbers,
one that opens amplifies them. `State.drift` is the product since the residual was last measured;
beyond `DRIFTS` the solution is put into the equations

.. math:: e = \Phi q + R\lambda + r, \qquad A q = p + \Phi^T\lambda

with the deviations :math:`\lambda` from the law table. The columns must be rebuilt if the error of
an end exceeds `LARGEST_ERROR`, or if the modal residual does so much work in the step that the
energy balance would show it, `LARGEST_LEAK`.
"""

from turnout.kernels.compiled import compiled, compiled_part
from turnout.kernels.vector import (
    add_multiple,
    add_scaled,
    add_two_multiples,
    add_weighted_rows,
    copy,
    dot,
)
from turnout.solver.energy import MARKERS
from turnout.solver.solution import (
    apply_joining_forces,
    evaluate_deviation_forces,
    expand_displacements,
    gather_modes,
)
from turnout.solver.solve import evaluate_row_forces
from turnout.solver.state import COUNT_JOINING, Run, State
from turnout.solver.system import Floats, System

DRIFTS = 1e7
"""Growth of rounding errors beyond which the residual is measured [-].

This bound is far above what happens: where it was 1e9, errors were 2e-15 m at most in 256 throws.
"""
LARGEST_ERROR = 1e-12
"""Largest accepted error of an end [m]."""
LARGEST_LEAK = 1e-10
"""Largest accepted work of the modal residual in a step, per 1 J and per work so far [-]."""


@compiled
def _end_errors(run: Run, state: State, force: Floats, error: Floats) -> float:
    """Write the displacement errors of the leading ends under forces [m]; return the largest."""
    system = run.system
    worst = 0.0
    for block in range(system.end_stop.size):
        first, last = system.end_start[block], system.end_stop[block]
        of_block = error[first:last]
        for end in range(first, last):
            error[end] = system.end_load[end] - state.g[end]
        start, stop = system.mode_start[block], system.mode_start[block + 1]
        add_weighted_rows(state.q[start:stop], system.mode_ends[start:stop], of_block)
        waiting = -1  # rows are added in pairs; beyond the ends they are zero
        for end in range(first, last):
            if force[end] == 0.0:
                continue
            if waiting < 0:
                waiting = end
                continue
            rows = system.flexibility[waiting], system.flexibility[end]
            add_two_multiples(force[waiting], rows[0], force[end], rows[1], of_block)
            waiting = -1
        if waiting >= 0:
            add_multiple(force[waiting], system.flexibility[waiting], of_block)
        for end in range(first, last):
            worst = max(worst, abs(error[end]))
    return worst


@compiled
def _scatter_to_leaders(system: System, force: Floats) -> None:
    """Scatter forces on following ends and joining rows to the leading ends (in place)."""
    ends = system.joining_ends
    for row in range(ends.shape[1]):
        for side in range(2):
            force[ends[side, row]] += force[system.follower_start[-1] + row]
    leaders, weights = system.follower_list, system.follower_weight
    for term in range(leaders.shape[0]):
        for end in range(leaders.shape[1]):
            force[leaders[term, end]] += weights[term, end] * force[system.follower_start[0] + end]


@compiled
def _modal_errors(run: Run, state: State, force: Floats, inertia: float, viscosity: float) -> float:
    """Write the residual of the modal equations to ``work.modal_error``.

    Returns its work in the step [J].
    """
    system, work = run.system, run.work
    leak = 0.0
    for block in range(system.end_start.size - 1):
        first, last = system.mode_start[block], system.mode_start[block + 1]
        q, error = state.q[first:last], work.modal_error[first:last]
        for i in range(last - first):
            mode = first + i
            total = (inertia + viscosity * system.damping[mode]) * q[i]
            total += dot(q, system.stiffness[mode])
            error[i] = work.right_side[mode] - total
        for end in range(system.end_start[block], system.end_stop[block]):
            if force[end] != 0.0:
                add_scaled(force[end], system.end_modes[end], error)
    for mode in range(state.q.size):
        leak += abs(work.modal_error[mode] * (state.q[mode] - work.q_start[mode]))
    return leak


@compiled
def refine(run: Run, state: State) -> None:
    """Refine the solution by the errors from `measure_residual`, with the same columns."""
    system, work = run.system, run.work
    copy(state.g, work.end_scratch)
    _expand_end_errors(run, state)
    for block in range(system.end_start.size - 1):
        first, last = system.mode_start[block], system.mode_start[block + 1]
        solved = state.g[system.end_start[block] : system.end_start[block + 1]]
        add_weighted_rows(work.modal_error[first:last], state.mode_columns[first:last], solved)
    if state.counters[COUNT_JOINING]:
        apply_joining_forces(run, state, 0.0)
    add_scaled(1.0, work.end_scratch, state.g)
    gather_modes(run, state)
    expand_displacements(run, state)


@compiled
def _expand_end_errors(run: Run, state: State) -> None:
    """Write the response of uncoupled blocks to the free displacements ``work.end_error``."""
    system, work = run.system, run.work
    copy(work.end_error, state.g)
    for block in range(system.end_start.size - 1):
        first, last = system.end_start[block], system.end_start[block + 1]
        free, solved = work.end_error[first:last], state.g[first:last]
        start = system.slot_start[block]
        for slot in range(start, start + state.slots[block]):
            row = state.row_of_slot[slot]
            if system.row_ends[row, 1] >= 0:
                continue
            force = 0.0
            for k in range(system.pattern_start[row], system.pattern_start[row + 1]):
                force += state.entries[k] * free[system.pattern_at[k]]
            add_scaled(force, state.columns[slot], solved)


@compiled_part
def is_inaccurate(run: Run, state: State, inertia: float, viscosity: float) -> bool:
    """Return whether the columns are too inaccurate for the present solution.

    The residual is measured only where rounding errors may have grown since the last time.

    Parameters
    ----------
    inertia, viscosity : float
        Factors of identity [1/s2] and damping [1/s] in the matrix of the step.
    """
    if state.drift[0] < DRIFTS:
        return False
    return measure_residual(run, state, inertia, viscosity)


@compiled
def measure_residual(run: Run, state: State, inertia: float, viscosity: float) -> bool:
    """Put the solution into the equations; return whether the residual is too large.

    Errors are written to ``work.end_error`` and ``work.modal_error``; the drift is reset to 1.
    """
    system, work = run.system, run.work
    state.drift[0] = 1.0
    evaluate_deviation_forces(run, state)
    force = work.end_force
    force[:] = 0.0
    for block in range(system.end_stop.size):
        first = system.slot_start[block]
        for slot in range(first, first + state.slots[block]):
            force[state.end_of_slot[slot]] = work.slot_force[slot]
    _scatter_to_leaders(system, force)
    error = _end_errors(run, state, force, work.end_error)
    leak = _modal_errors(run, state, force, inertia, viscosity)
    allowed = LARGEST_LEAK * (1.0 + abs(float(state.ledger[MARKERS])))
    return error > LARGEST_ERROR or leak > allowed


@compiled
def equilibrium_residual(run: Run, state: State) -> float:
    """Return the largest displacement error of the leading ends under the law forces [m].

    It does not use the columns, so that their drift shows.
    """
    system, work = run.system, run.work
    evaluate_row_forces(run, state, work.end_force)
    _scatter_to_leaders(system, work.end_force)
    return _end_errors(run, state, work.end_force, work.end_error)
