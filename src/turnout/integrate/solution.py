r"""The solution of one implicit step for a given contact set; see `turnout.integrate.columns`.

The right side of a step is given as two vectors, :math:`p = A u + s`, so that the damping matrix
need not be multiplied: :math:`A^{-1}p = u + A^{-1}s`.
"""

from turnout.integrate.coupling import couple, solve_coupling
from turnout.integrate.system import COUNT_JOINING, COUPLED, LEVEL, State, System
from turnout.integrate.vector import add, add_rows, copy
from turnout.integrate.work import Work
from turnout.law.compiled import compiled
from turnout.law.table import LawTable


@compiled
def solve_free(system: System, state: State, work: Work) -> None:
    """Solve the step from ``work.shifted`` (u) and ``work.right_side`` (s) without deviations."""
    copy(system.end_load, work.free_ends)
    copy(work.shifted, work.free_q)
    add_free(system, state, work)


@compiled
def add_free(system: System, state: State, work: Work) -> None:
    """Add to ``work.free_q`` what ``work.right_side`` does, and to ``work.free_ends`` all of it."""
    inverses = state.inverse[state.counters[LEVEL]]
    mode_start, end_start, mode_ends = system.mode_start, system.end_start, system.mode_ends
    all_q, all_ends, right_side = work.free_q, work.free_ends, work.right_side
    for block in range(end_start.size - 1):
        first, last = mode_start[block], mode_start[block + 1]
        free = all_q[first:last]
        add_rows(right_side[first:last], inverses[first:last], free)
        ends = all_ends[end_start[block] : end_start[block + 1]]
        add_rows(free, mode_ends[first:last], ends)


@compiled
def solve_set(system: System, table: LawTable, state: State, work: Work) -> None:
    """Correct the free solution for the present contact set; writes the ends and the rows."""
    _push(system, table, state, work)
    spread(system, state, work)


@compiled
def spread(system: System, state: State, work: Work) -> None:
    """Let free ends and the forces ``work.force`` on the rows meet the deviations of the set."""
    copy(work.free_ends, state.ends)
    end_start, slots, row_of_slot, row_ends = (
        system.end_start,
        state.slots,
        state.row_of_slot,
        system.row_ends,
    )
    pattern_start, pattern_at, entries = system.pattern_start, system.pattern_at, state.entries
    row_force, slot_force, columns = work.force, work.slot_force, state.columns
    for block in range(end_start.size - 1):
        first, last = end_start[block], end_start[block + 1]
        free, stop = work.free_ends[first:last], first + slots[block]
        for slot in range(first, stop):
            row = row_of_slot[slot]
            force = 0.0
            if row_ends[row, 1] < 0:
                force = row_force[row]
                for k in range(pattern_start[row], pattern_start[row + 1]):
                    force += entries[k] * free[pattern_at[k]]
            slot_force[slot] = force
        add_rows(slot_force[first:stop], columns[first:stop], state.ends[first:last])
    if state.counters[COUNT_JOINING]:
        _exchange_forces(system, state, work)
    ends, g = state.ends, state.g
    for row in range(g.size):
        g[row] = ends[row_ends[row, 0]]
    for i in range(system.joining_rows.size):
        row = system.joining_rows[i]
        g[row] += ends[row_ends[row, 1]]


@compiled
def _push(system: System, table: LawTable, state: State, work: Work) -> None:
    """Write the force on each row that does not depend on its displacement [N]."""
    copy(state.shift, work.force)
    for k in range(system.input_law.size):
        law = system.input_law[k]
        work.force[table.row[law]] += state.slope[law] * state.inputs[table.input_index[law]]


@compiled
def _exchange_forces(system: System, state: State, work: Work) -> None:
    """Let the blocks feel what joins them: find the joining forces, and move the ends."""
    count = state.counters[COUNT_JOINING]
    if not state.counters[COUPLED]:
        couple(system, state)
    force = work.joining[:count]
    for i in range(count):
        row = state.joining[i]
        apart = state.ends[system.row_ends[row, 0]] + state.ends[system.row_ends[row, 1]]
        force[i] = work.force[row] + state.entries[system.pattern_start[row]] * apart
    solve_coupling(state.coupling, state.exchange, force)
    for i in range(count):
        for side in range(2):
            end = system.row_ends[state.joining[i], side]
            block = system.block_of_end[end]
            first, last = system.end_start[block], system.end_start[block + 1]
            add(force[i], state.columns[state.slot_of_end[end]], state.ends[first:last])


@compiled
def deviation_forces(system: System, table: LawTable, state: State, work: Work) -> None:
    """Write the deviation force of every row at its present displacement to ``work.force`` [N]."""
    _push(system, table, state, work)
    add_pull(system, state, work)


@compiled
def add_pull(system: System, state: State, work: Work) -> None:
    """Add to ``work.force`` what the displacements of the rows make of the deviations [N]."""
    row_of_slot, slot_of_end, row_ends = state.row_of_slot, state.slot_of_end, system.row_ends
    pattern_start, pattern_list, entries = system.pattern_start, system.pattern_list, state.entries
    g, row_force = state.g, work.force
    for block in range(system.end_start.size - 1):
        first = system.end_start[block]
        for slot in range(first, first + state.slots[block]):
            row = row_of_slot[slot]
            if slot_of_end[row_ends[row, 0]] != slot:
                continue  # the second end of a row
            force = 0.0
            for k in range(pattern_start[row], pattern_start[row + 1]):
                force += entries[k] * g[pattern_list[k]]
            row_force[row] += force


@compiled
def solve_modes(system: System, table: LawTable, state: State, work: Work) -> None:
    """Complete a solution by its modal coordinates and its deviation forces."""
    copy(work.free_q, state.q)
    deviation_forces(system, table, state, work)
    add_responses(system, state, work)


@compiled
def add_responses(system: System, state: State, work: Work) -> None:
    """Add to the modal coordinates what the row forces ``work.force`` do to them."""
    responses = state.response[state.counters[LEVEL]]
    end_start, slots, mode_start = system.end_start, state.slots, system.mode_start
    end_of_slot, row_of_slot, row_force = state.end_of_slot, state.row_of_slot, work.force
    all_q = state.q
    for block in range(end_start.size - 1):
        q = all_q[mode_start[block] : mode_start[block + 1]]
        start = end_start[block]
        for slot in range(start, start + slots[block]):
            add(row_force[row_of_slot[slot]], responses[end_of_slot[slot]], q)
