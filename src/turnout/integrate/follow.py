"""The last resort of a step: follow the solution event by event from the last instant.

Right side and inputs of the step are moved in a straight line from values for which the last
instant is the solution to those of the new instant. With piecewise-linear laws the solution moves
in straight lines too, and bends where one law leaves its segment or one foot its branch; that law
is changed, and the walk goes on. Nothing is guessed, so nothing can cycle but where the path itself
turns back, which ends in an outcome.
"""

import numpy as np

from turnout.integrate.solve import (
    CONVERGED,
    NOT_CONVERGED,
    STOPPED,
    Tolerances,
    Work,
    mark_law,
    mark_row,
    solve_set,
    update_marked,
)
from turnout.integrate.system import Floats, State, System, set_segment
from turnout.law.compiled import compiled
from turnout.law.kernel import SLIP_BACKWARD, SLIP_FORWARD, STICK
from turnout.law.table import LawTable

EVENTS, EVENTS_AT_ONE_PLACE = 2000, 400
"""A walk ends without an answer after so many events, in all or without getting on."""


@compiled
def start_of_path(
    system: System, table: LawTable, state: State, inertia: float, viscosity: float
) -> Floats:
    """Return the right side for which the present state solves the step."""
    n_rows, n_modes = system.row_load.size, system.eigenvalues.size
    side = np.empty(n_modes)
    for i in range(n_modes):
        total = (inertia + system.eigenvalues[i]) * state.q[i] - state.columns[n_modes, n_rows + i]
        for j in range(n_modes):
            stiffness = viscosity * system.damping[i, j] - state.columns[j, n_rows + i]
            total += stiffness * state.q[j]
        side[i] = total
    for k in range(system.input_law.size):
        law = system.input_law[k]
        weight = state.slope[law] * state.inputs[table.input_index[law]]
        column = state.columns[n_modes + 1 + state.slot_of_row[table.row[law]]]
        for i in range(n_modes):
            side[i] -= weight * column[n_rows + i]
    return side


@compiled
def _place(
    system: System,
    table: LawTable,
    state: State,
    work: Work,
    sides: tuple[Floats, Floats],
    inputs: tuple[Floats, Floats],
    share: float,
) -> None:
    """Solve for the present contact set at a share of the path."""
    for i in range(work.right_side.size):
        work.right_side[i] = sides[0][i] + share * (sides[1][i] - sides[0][i])
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
    branch = state.friction[friction]
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
def follow_path(
    system: System,
    table: LawTable,
    state: State,
    work: Work,
    tolerances: Tolerances,
    sides: tuple[Floats, Floats],
    inputs: tuple[Floats, Floats],
) -> int:
    """Walk from the present state to the end of the path; return CONVERGED or what prevented it.

    Parameters
    ----------
    sides : tuple of two ndarray, shape (n_modes,)
        Right side at the start, from `start_of_path`, and at the end.
    inputs : tuple of two ndarray, shape (n_inputs,)
        Marker positions at the start and at the end [m].
    """
    n_laws = table.row.size
    share, stalled = 0.0, 0
    for _ in range(EVENTS):
        if work.stop[0]:
            return STOPPED
        if stalled >= EVENTS_AT_ONE_PLACE:
            break
        _place(system, table, state, work, sides, inputs, 1.0)
        work.g[:] = state.g
        _place(system, table, state, work, sides, inputs, share)
        end = (work.g, inputs[1])
        nearest, which, to = 1.0, -1, 0
        for law in range(n_laws):
            way, side = _law_event(table, state, law, end, tolerances.gap)
            if way < nearest:
                nearest, which, to = way, law, side
        for friction in range(table.friction_row.size):
            way, branch = _friction_event(table, state, friction, work.g, tolerances.force)
            if way < nearest:
                nearest, which, to = way, n_laws + friction, branch
        if which < 0:
            _place(system, table, state, work, sides, inputs, 1.0)
            return CONVERGED
        stalled = stalled + 1 if nearest * (1.0 - share) < 1e-12 else 0
        share += nearest * (1.0 - share)
        if which < n_laws:
            set_segment(table, state, which, state.segment[which] + to)
            count = mark_law(system, table, state, work, 0, which)
        else:
            state.friction[which - n_laws] = to
            count = mark_row(work, 0, table.friction_row[which - n_laws])
        work.unsettled[:] = work.dirty
        update_marked(system, table, state, work, count)
    return NOT_CONVERGED
