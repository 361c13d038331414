"""The solution of one implicit step for a given contact set; see `turnout.integrate.columns`."""

from turnout.integrate.columns import at_end, couple, solve_coupling
from turnout.integrate.scratch import Work
from turnout.integrate.state import COUNT_JOINING, COUPLED, State
from turnout.integrate.system import Floats, Ints, System
from turnout.kernels.compiled import compiled, compiled_loop, compiled_part
from turnout.kernels.lanes import LANES, broadcast, gather, load, store
from turnout.kernels.vector import add, add_two, gather_all, sum_rows
from turnout.law.table import LawTable


@compiled
def solve_set(system: System, table: LawTable, state: State, work: Work) -> None:
    """Find all displacements for the present contact set from ``work.right_side``."""
    end_start, mode_start = system.end_start, system.mode_start
    force, g, columns = work.right_side, state.g, state.mode_columns
    constant = state.constant_column
    for block in range(end_start.size - 1):
        first, last = mode_start[block], mode_start[block + 1]
        start, stop = end_start[block], end_start[block + 1]
        sum_rows(constant[start:stop], force[first:last], columns[first:last], g[start:stop])
    _push(system, table, state, work)
    gather_all(work.push, system.pushed_end, work.pushed)
    _move_blocks(system, state, system.pushed_end, work.pushed)
    if state.counters[COUNT_JOINING]:
        exchange_forces(system, state, work, 1.0)
    derive(system, state)


@compiled_part
def _push(system: System, table: LawTable, state: State, work: Work) -> None:
    """Write the inputs of laws, and what they push on their rows [N]; a row may have several."""
    push = work.push
    for k in range(system.input_row.size):
        push[system.input_row[k]] = 0.0
    for k in range(system.input_law.size):
        law = system.input_law[k]
        push[table.row[law]] += state.slope[law] * state.inputs[table.input_index[law]]
    for k in range(1, work.given.size):
        work.given[k] = state.inputs[k - 1]
    for k in range(system.input_group.size):
        at = system.input_group[k]
        store(gather(work.given, system.input_place, at), work.law_input, at)


@compiled_part
def derive(system: System, state: State) -> None:
    """Take the ends that follow, and the rows that join blocks, from the leading ends."""
    leaders, weights = system.follower_list, system.follower_weight
    _follow(state.g, leaders, weights, state.g[system.follower_start[0] :])
    _join(state.g, system.joining_ends, state.g[system.follower_start[-1] :])


@compiled_loop
def _follow(g: Floats, leaders: Ints, weights: Floats, following: Floats) -> None:
    for i in range(0, leaders.shape[1], LANES):
        sums = broadcast(0.0)
        for term in range(leaders.shape[0]):
            sums = sums + load(weights[term], i) * gather(g, leaders[term], i)
        store(sums, following, i)


@compiled_loop
def _join(g: Floats, ends: Ints, joining: Floats) -> None:
    for i in range(0, ends.shape[1], LANES):
        store(gather(g, ends[0], i) + gather(g, ends[1], i), joining, i)


@compiled_part
def _move_blocks(system: System, state: State, ends: Ints, force: Floats) -> None:
    """Move blocks by forces on active ends, by two at a time that follow each other in a block."""
    columns, slot, g = state.columns, state.slot_of_end, state.g
    k, count = 0, force.size
    while k < count:
        end = ends[k]
        block = system.block_of_end[end]
        moved = g[system.end_start[block] : system.end_start[block + 1]]
        column = columns[slot[end]]
        if k + 1 < count and system.block_of_end[ends[k + 1]] == block:
            other = ends[k + 1]
            add_two(force[k], column, force[k + 1], columns[slot[other]], moved)
            k += 2
        else:
            add(force[k], column, moved)
            k += 1


@compiled
def exchange_forces(system: System, state: State, work: Work, constant: float) -> None:
    """Let the blocks feel what joins them: find the joining forces, and move the ends.

    `constant` is the share of the forces that do not depend on displacements: 1, or 0 for a change.
    """
    count = state.counters[COUNT_JOINING]
    if not state.counters[COUPLED]:
        couple(system, state)
    force = work.joining[:count]
    for i in range(count):
        row = state.joining[i]
        apart = 0.0
        for side in range(2):
            end = system.row_ends[row, side]
            first = system.end_start[system.block_of_end[end]]
            apart += at_end(system, state.g[first:], end)
        entry = state.entries[system.pattern_start[row]]
        force[i] = constant * (state.shift[row] + work.push[row]) + entry * apart
    solve_coupling(state.coupling, state.exchange, force)
    for side in range(2):
        for i in range(count):
            work.joined_end[i] = system.row_ends[state.joining[i], side]
        _move_blocks(system, state, work.joined_end, force)


@compiled
def deviation_forces(system: System, table: LawTable, state: State, work: Work) -> None:
    """Write the deviation force of every active end to ``work.slot_force`` [N]."""
    row_of_slot, slot_force, shift, push = (
        state.row_of_slot,
        work.slot_force,
        state.shift,
        work.push,
    )
    pattern_start, pattern_list, entries = system.pattern_start, system.pattern_list, state.entries
    g = state.g
    _push(system, table, state, work)
    for block in range(system.end_start.size - 1):
        first = system.slot_start[block]
        for slot in range(first, first + state.slots[block]):
            row = row_of_slot[slot]
            force = shift[row] + push[row]
            for k in range(pattern_start[row], pattern_start[row + 1]):
                force += entries[k] * g[pattern_list[k]]
            slot_force[slot] = force


@compiled_part
def set_modes(system: System, state: State) -> None:
    """Take the modal coordinates from the solution."""
    _pick_all(state.g, system.mode_place, state.q)


@compiled_loop
def _pick_all(values: Floats, places: Ints, to: Floats) -> None:
    for i in range(0, places.size, LANES):
        store(gather(values, places, i), to, i)
