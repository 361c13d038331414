"""One implicit step: predict, solve, check every law, flip what changed, until nothing changes.

With an unchanged contact set a solution is a few small matrix-vector products. A set change costs
one rank-one update a row. Law checks compare the solution with the segment or friction branch that
it was computed with; the last solution of a converged step satisfies every law.
"""

from typing import NamedTuple

import numpy as np

from turnout.integrate.columns import refresh_inverse, update_row
from turnout.integrate.system import COUNT_ITERATIONS, Floats, Ints, State, System, set_segment
from turnout.law.compiled import compiled
from turnout.law.kernel import (
    STICK,
    any_not_finite,
    friction_state,
    segment_for,
)
from turnout.law.table import LawTable

CONVERGED, NOT_CONVERGED, NOT_FINITE, STOPPED = 0, 1, 2, 4


class Work(NamedTuple):
    """Scratch arrays of the kernels; their content means nothing between calls.

    Except `unsettled`, which flags the rows that still changed when a step was given up, and
    `stop`, which another thread sets to end the work between two solutions.
    """

    row: Floats
    predicted: Floats
    velocity: Floats
    right_side: Floats
    dirty: Ints
    dirty_list: Ints
    unsettled: Ints
    old_segment: Ints
    old_friction: Ints
    q: Floats
    v: Floats
    a: Floats
    acceleration: Floats
    g: Floats
    g_start: Floats
    row_error: Floats
    modal_error: Floats
    predicted_error: Floats
    stop: Ints


class Tolerances(NamedTuple):
    """Violations that are overlooked, and the iterations a step may take."""

    gap: float
    force: float
    iterations: int


@compiled
def mark_row(work: Work, count: int, row: int) -> int:
    """Add a row to the list of rows to be updated, once."""
    if work.dirty[row]:
        return count
    work.dirty[row] = 1
    work.dirty_list[count] = row
    return count + 1


@compiled
def mark_law(
    system: System, table: LawTable, state: State, work: Work, count: int, law: int
) -> int:
    """Mark the row of a law and the rows of slipping frictions that it limits."""
    count = mark_row(work, count, table.row[law])
    for i in range(system.normal_friction_start[law], system.normal_friction_start[law + 1]):
        friction = system.normal_friction_list[i]
        if state.friction[friction] != STICK:
            count = mark_row(work, count, table.friction_row[friction])
    return count


@compiled
def update_marked(system: System, table: LawTable, state: State, work: Work, count: int) -> None:
    """Bring every marked row to the present law states."""
    for i in range(count):
        row = work.dirty_list[i]
        work.dirty[row] = 0
        update_row(system, table, state, row, work.row)


@compiled
def friction_limit(table: LawTable, state: State, friction: int) -> float:
    """Return the force of one friction law that slips [N].

    It follows the normal law on its segment, as the solution does: a contact that ends within the
    overlooked gap may pull by a trace, and a limit cut at zero would leave the books open.
    """
    normal = table.friction_normal[friction]
    force = state.slope[normal] * state.g[table.row[normal]] + state.constant[normal]
    limit: float = table.friction_coefficient[friction] * force
    return limit


@compiled
def displacements(system: System, table: LawTable, state: State, q: Floats, g: Floats) -> None:
    """Write the row displacements for modal coordinates `q` and the present inputs."""
    n_rows, n_modes = system.row_load.size, q.size
    g[:] = state.columns[n_modes, :n_rows]
    for j in range(n_modes):
        weight = q[j]
        column = state.columns[j]
        for i in range(n_rows):
            g[i] += weight * column[i]
    for k in range(system.input_law.size):
        law = system.input_law[k]
        weight = state.slope[law] * state.inputs[table.input_index[law]]
        if weight != 0.0:
            column = state.columns[n_modes + 1 + state.slot_of_row[table.row[law]]]
            for i in range(n_rows):
                g[i] += weight * column[i]


@compiled
def solve_set(system: System, table: LawTable, state: State, work: Work) -> None:
    """Solve the step for the present contact set from ``work.right_side``."""
    n_rows, n_modes = system.row_load.size, system.eigenvalues.size
    right = work.row[:n_modes]
    for i in range(n_modes):
        right[i] = work.right_side[i] + state.columns[n_modes, n_rows + i]
    for k in range(system.input_law.size):
        law = system.input_law[k]
        weight = state.slope[law] * state.inputs[table.input_index[law]]
        if weight != 0.0:
            column = state.columns[n_modes + 1 + state.slot_of_row[table.row[law]]]
            for i in range(n_modes):
                right[i] += weight * column[n_rows + i]
    for i in range(n_modes):
        total = 0.0
        row = state.inverse[i]
        for j in range(n_modes):
            total += row[j] * right[j]
        state.q[i] = total
    displacements(system, table, state, state.q, state.g)


@compiled
def check_segments(
    system: System, table: LawTable, state: State, work: Work, gap: float, one_at_a_time: bool
) -> int:
    """Move laws whose argument has left its segment; return how many rows are marked."""
    count = 0
    for law in range(table.row.size):
        at = state.g[table.row[law]]
        if table.input_index[law] >= 0:
            at -= state.inputs[table.input_index[law]]
        if at > state.upper[law] + gap or at < state.lower[law] - gap:
            e = at - table.offset[law]
            present = state.segment[law]
            segment = segment_for(table, law, e, present, gap)
            # to the neighbour only: a jump over a segment can go back and forth for ever
            segment = min(max(segment, present - 1), present + 1)
            set_segment(table, state, law, segment)
            count = mark_law(system, table, state, work, count, law)
            if one_at_a_time:
                return count
    return count


@compiled
def check_frictions(
    table: LawTable, state: State, work: Work, count: int, force: float, one_at_a_time: bool
) -> int:
    """Move friction laws between stick and slip; return how many rows are marked in all."""
    g, friction_row, normals = state.g, table.friction_row, table.friction_normal
    branches, anchor = state.friction, state.anchor
    for friction in range(friction_row.size):
        normal = normals[friction]
        resistance = state.slope[normal] * g[table.row[normal]] + state.constant[normal]
        limit = table.friction_coefficient[friction] * max(resistance, 0.0)
        trial = table.stick_stiffness[friction] * (g[friction_row[friction]] - anchor[friction])
        branch = friction_state(trial, limit, branches[friction], force)
        if branch != branches[friction]:
            branches[friction] = branch
            count = mark_row(work, count, friction_row[friction])
            if one_at_a_time:
                return count
    return count


@compiled
def check_laws(
    system: System,
    table: LawTable,
    state: State,
    work: Work,
    tolerances: Tolerances,
    one_at_a_time: bool,
) -> int:
    """Move every law (or the first) that its solution contradicts; return how many rows changed."""
    count = check_segments(system, table, state, work, tolerances.gap, one_at_a_time)
    if one_at_a_time and count > 0:
        return count
    return check_frictions(table, state, work, count, tolerances.force, one_at_a_time)


@compiled
def settle(
    system: System, table: LawTable, state: State, work: Work, tolerances: Tolerances
) -> int:
    """Iterate the contact set of one step; return CONVERGED or what kept it from that.

    After half of the iterations laws change one at a time, which breaks cycles in which several
    laws undo each other.
    """
    for iteration in range(tolerances.iterations):
        solve_set(system, table, state, work)
        state.counters[COUNT_ITERATIONS] += 1
        if any_not_finite(state.q):
            return NOT_FINITE
        if work.stop[0]:
            return STOPPED
        one_at_a_time = 2 * iteration > tolerances.iterations
        count = check_laws(system, table, state, work, tolerances, one_at_a_time)
        if count == 0:
            return CONVERGED
        if iteration == tolerances.iterations - 1:
            work.unsettled[:] = work.dirty
        update_marked(system, table, state, work, count)
    return NOT_CONVERGED


@compiled
def restore_set(system: System, table: LawTable, state: State, work: Work) -> None:
    """Go back to the contact set saved in `work`."""
    count = 0
    for law in range(table.row.size):
        if state.segment[law] != work.old_segment[law]:
            set_segment(table, state, law, work.old_segment[law])
            count = mark_law(system, table, state, work, count, law)
    for friction in range(table.friction_row.size):
        if state.friction[friction] != work.old_friction[friction]:
            state.friction[friction] = work.old_friction[friction]
            count = mark_row(work, count, table.friction_row[friction])
    # a friction that returned to slip after its normal law was handled still needs its row
    for friction in range(table.friction_row.size):
        count = mark_row(work, count, table.friction_row[friction])
    update_marked(system, table, state, work, count)


@compiled
def equilibrium(
    system: System, table: LawTable, state: State, work: Work, tolerances: Tolerances
) -> int:
    """Find the static equilibrium for the present inputs by iterating the contact set."""
    refresh_inverse(system, state, 0.0, 0.0)
    work.right_side[:] = system.load
    return settle(system, table, state, work, tolerances)


@compiled
def row_forces(system: System, table: LawTable, state: State, force: Floats) -> None:
    """Write the deviation force of every row from the laws' own forces [N]."""
    force[:] = 0.0
    for law in range(table.row.size):
        row = table.row[law]
        force[row] += system.base_slope[law] * state.g[row] - state.law_force[law]
    for friction in range(table.friction_row.size):
        force[table.friction_row[friction]] -= state.friction_force[friction]


def new_work(system: System, table: LawTable) -> Work:
    """Return scratch arrays that fit a system."""
    n_rows, n_modes = system.row_load.size, system.eigenvalues.size
    widest = int(np.max(np.diff(system.pattern_start), initial=1))
    modal = [np.zeros(n_modes) for _ in range(9)]
    return Work(
        row=np.zeros(max(n_rows, widest + 3 * n_modes)),
        predicted=modal[0],
        velocity=modal[1],
        right_side=modal[2],
        dirty=np.zeros(n_rows, dtype=np.int64),
        dirty_list=np.zeros(n_rows, dtype=np.int64),
        unsettled=np.zeros(n_rows, dtype=np.int64),
        old_segment=np.zeros(table.row.size, dtype=np.int64),
        old_friction=np.zeros(table.friction_row.size, dtype=np.int64),
        q=modal[3],
        v=modal[4],
        a=modal[5],
        acceleration=modal[6],
        g=np.zeros(n_rows),
        row_error=np.zeros(n_rows),
        modal_error=modal[7],
        predicted_error=modal[8],
        g_start=np.zeros(n_rows),
        stop=np.zeros(1, dtype=np.int64),
    )
