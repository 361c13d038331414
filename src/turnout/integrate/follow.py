"""The last resort of a step: follow the solution event by event from the last instant.

Right side and inputs of the step are moved in a straight line from values for which the last
instant is the solution to those of the new instant. With piecewise-linear laws the solution moves
in straight lines too, and bends where one law leaves its segment or one foot its branch; that law
is changed, and the walk goes on. Nothing is guessed, so nothing can cycle but where the path itself
turns back, which ends in an outcome.
"""

from turnout.integrate.scratch import Work
from turnout.integrate.solution import deviation_forces, set_modes, solve_set
from turnout.integrate.solve import (
    CONVERGED,
    NOT_CONVERGED,
    STOPPED,
    Tolerances,
    evaluate,
    mark_law,
    mark_row,
    update_marked,
)
from turnout.integrate.state import State, set_segment
from turnout.integrate.system import Floats, System
from turnout.kernels.compiled import compiled
from turnout.kernels.vector import add, copy, dot
from turnout.law.kernel import SLIP_BACKWARD, SLIP_FORWARD, STICK
from turnout.law.table import LawTable

EVENTS, EVENTS_AT_ONE_PLACE = 2000, 400
"""A walk ends without an answer after so many events, in all or without getting on."""


@compiled
def _start_of_path(
    system: System, table: LawTable, state: State, work: Work, inertia: float, viscosity: float
) -> None:
    """Write to ``work.origin`` the right side for which the present state solves the step."""
    deviation_forces(system, table, state, work)
    for block in range(system.mode_start.size - 1):
        first, last = system.mode_start[block], system.mode_start[block + 1]
        q, side = state.q[first:last], work.origin[first:last]
        for i in range(last - first):
            mode = first + i
            side[i] = (inertia + viscosity * system.damping[mode]) * q[i]
            side[i] += dot(q, system.stiffness[mode])
        start = system.slot_start[block]
        for slot in range(start, start + state.slots[block]):
            add(-work.slot_force[slot], system.end_modes[state.end_of_slot[slot]], side)


@compiled
def _place(
    system: System,
    table: LawTable,
    state: State,
    work: Work,
    inputs: tuple[Floats, Floats],
    share: float,
) -> None:
    """Solve for the present contact set at a share of the path."""
    for i in range(work.right_side.size):
        work.right_side[i] = work.origin[i] + share * (work.aim[i] - work.origin[i])
    for k in range(state.inputs.size):
        state.inputs[k] = inputs[0][k] + share * (inputs[1][k] - inputs[0][k])
    solve_set(system, table, state, work)


@compiled
def _share_until_zero(spare: float, spare_end: float) -> float:
    """Return where a room that is negative at the end is used up; at once if it already is."""
    return spare / (spare - spare_end) if spare > 0.0 else 0.0


@compiled
def _law_event(
    table: LawTable, state: State, law: int, end: tuple[Floats, Floats], gap: float
) -> tuple[float, int]:
    """Return how far the path goes until a law leaves its segment, and to which side."""
    row, index = table.row[law], table.input_index[law]
    at, then = state.g[row], end[0][row]
    if index >= 0:
        at -= state.inputs[index]
        then -= end[1][index]
    if then > state.upper[law] + gap:
        return _share_until_zero(state.upper[law] - at, state.upper[law] - then), 1
    if then < state.lower[law] - gap:
        return _share_until_zero(at - state.lower[law], then - state.lower[law]), -1
    return 2.0, 0


@compiled
def _friction_event(
    table: LawTable, state: State, friction: int, end: Floats, force: float
) -> tuple[float, int]:
    """Return how far the path goes until a foot changes its branch, and to which."""
    normal, row = table.friction_normal[friction], table.friction_row[friction]
    slope, constant = state.slope[normal], state.constant[normal]
    normal_row, stiffness = table.row[normal], table.stick_stiffness[friction]
    coefficient, anchor = table.friction_coefficient[friction], state.anchor[friction]
    limit = coefficient * (slope * state.g[normal_row] + constant)
    limit_end = coefficient * (slope * end[normal_row] + constant)
    trial = stiffness * (state.g[row] - anchor)
    trial_end = stiffness * (end[row] - anchor)
    branch = int(state.friction[friction])
    if branch == STICK:
        for side in (SLIP_FORWARD, SLIP_BACKWARD):
            spare, spare_end = limit - side * trial, limit_end - side * trial_end
            if spare_end < -force:
                return _share_until_zero(spare, spare_end), side
        return 2.0, branch
    if limit <= 0.0 and limit_end <= 0.0:
        return 2.0, branch
    spare, spare_end = branch * trial - limit, branch * trial_end - limit_end
    if spare_end < -force:
        return _share_until_zero(spare, spare_end), STICK
    return 2.0, branch


@compiled
def next_event(
    table: LawTable, state: State, end: tuple[Floats, Floats], tolerances: Tolerances
) -> tuple[float, int, int]:
    """Find what first contradicts its law on the straight way from the present state to `end`.

    Parameters
    ----------
    end : tuple of two ndarray
        Rows and inputs at the end of the way, for the present contact set.

    Returns
    -------
    share, which, to : float, int, int
        How far that is, as a share of the way; the law, or beyond the laws the friction, -1 for
        none; and the side to which a law, or the branch to which a friction changes.
    """
    nearest, which, to = 1.0, -1, 0
    n_laws = table.row.size
    for law in range(n_laws):
        way, side = _law_event(table, state, law, end, tolerances.gap)
        if way < nearest:
            nearest, which, to = way, law, side
    for friction in range(table.friction_row.size):
        way, branch = _friction_event(table, state, friction, end[0], tolerances.force)
        if way < nearest:
            nearest, which, to = way, n_laws + friction, branch
    return nearest, which, to


@compiled
def take_event(
    system: System, table: LawTable, state: State, work: Work, which: int, to: int
) -> None:
    """Change the law or friction that `next_event` has found, and note its row as unsettled."""
    n_laws = table.row.size
    if which < n_laws:
        set_segment(table, state, which, state.segment[which] + to)
        count = mark_law(system, table, state, work, 0, which)
    else:
        state.friction[which - n_laws] = to
        count = mark_row(work, 0, table.friction_row[which - n_laws])
    for i in range(count):
        work.unsettled[work.dirty_list[i]] = 1
    update_marked(system, table, state, work, count)


@compiled
def follow_path(
    system: System,
    table: LawTable,
    state: State,
    work: Work,
    tolerances: Tolerances,
    inputs: tuple[Floats, Floats],
    inertia: float,
    viscosity: float,
) -> int:
    """Walk from the present state to the end of the path; return CONVERGED or what prevented it.

    Parameters
    ----------
    inputs : tuple of two ndarray, shape (n_inputs,)
        Marker positions at the start and at the end [m].
    inertia, viscosity : float
        What multiplies identity and damping in the matrix of the step.
    """
    copy(work.right_side, work.aim)
    _start_of_path(system, table, state, work, inertia, viscosity)
    share, stalled = 0.0, 0
    for _ in range(EVENTS):
        if work.stop[0]:
            return STOPPED
        if stalled >= EVENTS_AT_ONE_PLACE:
            break
        _place(system, table, state, work, inputs, 1.0)
        copy(state.g, work.g)
        _place(system, table, state, work, inputs, share)
        nearest, which, to = next_event(table, state, (work.g, inputs[1]), tolerances)
        if which < 0:
            _place(system, table, state, work, inputs, 1.0)
            set_modes(system, state)
            evaluate(table, state, work)
            return CONVERGED
        stalled = stalled + 1 if nearest * (1.0 - share) < 1e-12 else 0
        share += nearest * (1.0 - share)
        work.unsettled[:] = 0
        take_event(system, table, state, work, which, to)
    return NOT_CONVERGED
