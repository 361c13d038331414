r"""How well a solution found from many times updated columns fulfils the equations themselves.

Each rank-one update multiplies the rounding that the columns already carry by about its divisor or
the inverse, whichever is larger: a stiff stop that closes leaves small differences of large
numbers, one that opens makes them large again. `State.drift` keeps the product since the columns
were last measured; when it has grown by `DRIFTS`, the solution is put into the equations

.. math:: e = \Phi q + R\lambda + r, \qquad A q = p + \Phi^T\lambda

with the deviations :math:`\lambda` from the laws' own numbers. Columns must be made anew if the
ends are off by more than `LARGEST_ERROR`, or if what is left over in the modal equations does work
in the step that the books of energy would notice, `LARGEST_LEAK`.
"""

from turnout.integrate.energy import MARKERS
from turnout.integrate.scratch import Work
from turnout.integrate.solution import (
    derive,
    deviation_forces,
    exchange_forces,
    set_modes,
)
from turnout.integrate.solve import row_forces
from turnout.integrate.state import COUNT_JOINING, State
from turnout.integrate.system import Floats, System
from turnout.kernels.compiled import compiled, compiled_part
from turnout.kernels.vector import add, add_rows, copy, dot
from turnout.law.table import LawTable

DRIFTS = 100.0
"""Growth of rounding after which a solution is measured [-]."""
LARGEST_ERROR = 1e-12
"""Error of an end that is overlooked [m]."""
LARGEST_LEAK = 1e-10
"""Work of a step out of nowhere that is overlooked, as a share of 1 J and the work so far [-]."""


@compiled
def _end_errors(system: System, state: State, force: Floats, error: Floats) -> float:
    """Write how far blocks under forces are from their leading ends [m]; return the largest."""
    worst = 0.0
    for block in range(system.end_stop.size):
        first, last = system.end_start[block], system.end_stop[block]
        of_block = error[first:last]
        for end in range(first, last):
            error[end] = system.end_load[end] - state.g[end]
        start, stop = system.mode_start[block], system.mode_start[block + 1]
        add_rows(state.q[start:stop], system.mode_ends[start:stop], of_block)
        for end in range(first, last):
            if force[end] != 0.0:
                add(force[end], system.flexibility[end], of_block)
        for end in range(first, last):
            worst = max(worst, abs(error[end]))
    return worst


@compiled
def _lead(system: System, force: Floats) -> None:
    """Hand forces on ends that follow, and on rows that join blocks, to the leading ends."""
    ends = system.joining_ends
    for row in range(ends.shape[1]):
        for side in range(2):
            force[ends[side, row]] += force[system.follower_start[-1] + row]
    leaders, weights = system.follower_list, system.follower_weight
    for term in range(leaders.shape[0]):
        for end in range(leaders.shape[1]):
            force[leaders[term, end]] += weights[term, end] * force[system.follower_start[0] + end]


@compiled
def _modal_errors(
    system: System, state: State, work: Work, force: Floats, inertia: float, viscosity: float
) -> float:
    """Write what is left over in the modal equations to ``work.modal_error``.

    Returns the work that it does in the step [J].
    """
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
                add(force[end], system.end_modes[end], error)
    for mode in range(state.q.size):
        leak += abs(work.modal_error[mode] * (state.q[mode] - work.q[mode]))
    return leak


@compiled
def correct(system: System, state: State, work: Work) -> None:
    """Take the errors that `measure` has found off the solution, with the same columns."""
    copy(state.g, work.found)
    _spread(system, state, work)
    for block in range(system.end_start.size - 1):
        first, last = system.mode_start[block], system.mode_start[block + 1]
        solved = state.g[system.end_start[block] : system.end_start[block + 1]]
        add_rows(work.modal_error[first:last], state.mode_columns[first:last], solved)
    if state.counters[COUNT_JOINING]:
        exchange_forces(system, state, work, 0.0)
    add(1.0, work.found, state.g)
    set_modes(system, state)
    derive(system, state)


@compiled
def _spread(system: System, state: State, work: Work) -> None:
    """Write what blocks by themselves make of ``work.end_error``, a free motion."""
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
            add(force, state.columns[slot], solved)


@compiled_part
def is_inaccurate(
    system: System, table: LawTable, state: State, work: Work, inertia: float, viscosity: float
) -> bool:
    """Tell whether the solution of the step just found suffers from worn columns.

    It is measured where rounding may have grown since it was last.

    Parameters
    ----------
    inertia, viscosity : float
        What multiplies identity and damping in the matrix of the step.
    """
    if state.drift[0] < DRIFTS:
        return False
    return measure(system, table, state, work, inertia, viscosity)


@compiled
def measure(
    system: System, table: LawTable, state: State, work: Work, inertia: float, viscosity: float
) -> bool:
    """Put a solution into the equations, and tell whether what is left over is too much.

    Errors are left in ``work.end_error`` and ``work.modal_error``; rounding is counted from here.
    """
    state.drift[0] = 1.0
    deviation_forces(system, table, state, work)
    force = work.end_force
    force[:] = 0.0
    for block in range(system.end_stop.size):
        first = system.slot_start[block]
        for slot in range(first, first + state.slots[block]):
            force[state.end_of_slot[slot]] = work.slot_force[slot]
    _lead(system, force)
    error = _end_errors(system, state, force, work.end_error)
    leak = _modal_errors(system, state, work, force, inertia, viscosity)
    allowed = LARGEST_LEAK * (1.0 + abs(float(state.ledger[MARKERS])))
    return error > LARGEST_ERROR or leak > allowed


@compiled
def equilibrium_residual(system: System, table: LawTable, state: State, work: Work) -> float:
    """Return the largest disagreement of the ends with their block under the law forces [m].

    The columns are bypassed, so that their drift shows.
    """
    row_forces(system, table, state, work.end_force)
    _lead(system, work.end_force)
    return _end_errors(system, state, work.end_force, work.end_error)
