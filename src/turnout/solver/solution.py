r"""Displacements of one implicit step for a given contact set, from its columns and coupling.

Rows that join two blocks (links, stops against a rail that bends, objects) are solved last. With
the compliance :math:`H` between them, assembled from the columns of their ends
(`turnout.solver.columns`),

.. math:: (I - D H)\,\lambda = D g_0 + b

where :math:`g_0` are the joining displacements without the joining forces. This small dense matrix
is factorised by rows with partial pivoting, and kept until a column of an end changes.
"""

import numpy as np

from turnout.kernels.compiled import compiled, compiled_loop, compiled_part
from turnout.kernels.lanes import LANES, broadcast, gather, gather_neighbours, load, store
from turnout.kernels.vector import (
    add_multiple,
    add_two_multiples,
    copy,
    gather_all,
    sum_weighted_rows,
)
from turnout.solver.state import COUNT_JOINING, COUPLED, UNSOLVED, Run, State
from turnout.solver.system import Floats, Ints, System


@compiled
def solve_displacements(run: Run, state: State) -> None:
    """Solve for all displacements of the present contact set from ``work.right_side``.

    Blocks whose columns and right side are the same (`UNSOLVED`) move as in the last solution but
    for the forces of inputs and joining rows.
    """
    system, work = run.system, run.work
    end_start, mode_start = system.end_start, system.mode_start
    force, g, columns = work.right_side, state.g, state.mode_columns
    constant = state.constant_column
    for block in range(end_start.size - 1):
        first, last = mode_start[block], mode_start[block + 1]
        start, stop = end_start[block], end_start[block + 1]
        free = work.free[start:stop]
        if state.counters[UNSOLVED] >> block & 1:
            sum_weighted_rows(constant[start:stop], force[first:last], columns[first:last], free)
        copy(free, g[start:stop])
    state.counters[UNSOLVED] = 0
    _evaluate_inputs(run, state)
    gather_all(work.input_force, system.input_end, work.input_end_force)
    _apply_end_forces(run, state, system.input_end, work.input_end_force)
    if state.counters[COUNT_JOINING]:
        apply_joining_forces(run, state, 1.0)
    else:
        state.counters[COUPLED] = 1
    expand_displacements(run, state)


@compiled_part
def _evaluate_inputs(run: Run, state: State) -> None:
    """Write the inputs of all laws [m] and their forces on the rows [N]; a row may have several."""
    system, table, work = run.system, run.table, run.work
    force = work.input_force
    for k in range(system.input_row.size):
        force[system.input_row[k]] = 0.0
    for k in range(system.input_law.size):
        law = system.input_law[k]
        force[table.row[law]] += state.slope[law] * state.inputs[table.input_index[law]]
    for k in range(1, work.padded_inputs.size):
        work.padded_inputs[k] = state.inputs[k - 1]
    for k in range(system.input_group.size):
        at = system.input_group[k]
        store(gather(work.padded_inputs, system.input_place, at), work.law_input, at)


@compiled_part
def expand_displacements(run: Run, state: State) -> None:
    """Write the displacements of following ends and joining rows from those of the leading ends."""
    system = run.system
    leaders, weights = system.follower_list, system.follower_weight
    _expand_followers(state.g, leaders, weights, state.g[system.follower_start[0] :])
    _sum_joining_ends(state.g, system.joining_ends, state.g[system.follower_start[-1] :])


@compiled_loop
def _expand_followers(g: Floats, leaders: Ints, weights: Floats, following: Floats) -> None:
    for i in range(0, leaders.shape[1], LANES):
        sums = broadcast(0.0)
        for term in range(leaders.shape[0]):
            sums = sums + load(weights[term], i) * gather_neighbours(g, leaders[term], i)
        store(sums, following, i)


@compiled_loop
def _sum_joining_ends(g: Floats, ends: Ints, joining: Floats) -> None:
    for i in range(0, ends.shape[1], LANES):
        store(gather(g, ends[0], i) + gather_neighbours(g, ends[1], i), joining, i)


@compiled_part
def _apply_end_forces(run: Run, state: State, ends: Ints, force: Floats) -> None:
    """Add the displacements from forces on active ends, two neighbours of a block at a time."""
    system = run.system
    columns, slot, g = state.columns, state.slot_of_end, state.g
    k, count = 0, force.size
    while k < count:
        end = ends[k]
        block = system.block_of_end[end]
        block_g = g[system.end_start[block] : system.end_start[block + 1]]
        column = columns[slot[end]]
        if k + 1 < count and system.block_of_end[ends[k + 1]] == block:
            next_end = ends[k + 1]
            add_two_multiples(force[k], column, force[k + 1], columns[slot[next_end]], block_g)
            k += 2
        else:
            add_multiple(force[k], column, block_g)
            k += 1


@compiled
def apply_joining_forces(run: Run, state: State, constant: float) -> None:
    """Solve for the forces of the joining rows, and add the displacements from them.

    `constant` is 1 for a solution; 0 for a correction, which leaves out the forces that do not
    depend on displacements.
    """
    system, work = run.system, run.work
    count = state.counters[COUNT_JOINING]
    if state.counters[COUPLED] != 1:
        assemble_coupling(run, state)
    force = work.joining[:count]
    for i in range(count):
        row = state.joining[i]
        gap = 0.0
        for side in range(2):
            end = system.row_ends[row, side]
            first = system.end_start[system.block_of_end[end]]
            gap += value_at_end(system, state.g[first:], end)
        entry = state.entries[system.pattern_start[row]]
        force[i] = constant * (state.shift[row] + work.input_force[row]) + entry * gap
    solve_coupling(state.coupling, state.pivots, force)
    for side in range(2):
        for i in range(count):
            work.coupled_end[i] = system.row_ends[state.joining[i], side]
        _apply_end_forces(run, state, work.coupled_end, force)


@compiled
def evaluate_deviation_forces(run: Run, state: State) -> None:
    """Write the deviation force of every active end to ``work.slot_force`` [N]."""
    system, work = run.system, run.work
    row_of_slot, shift = state.row_of_slot, state.shift
    slot_force, input_force = work.slot_force, work.input_force
    pattern_start, pattern_list, entries = system.pattern_start, system.pattern_list, state.entries
    g = state.g
    _evaluate_inputs(run, state)
    for block in range(system.end_start.size - 1):
        first = system.slot_start[block]
        for slot in range(first, first + state.slots[block]):
            row = row_of_slot[slot]
            force = shift[row] + input_force[row]
            for k in range(pattern_start[row], pattern_start[row + 1]):
                force += entries[k] * g[pattern_list[k]]
            slot_force[slot] = force


@compiled_part
def gather_modes(run: Run, state: State) -> None:
    """Gather the modal coordinates from the displacements."""
    system = run.system
    gather_all(state.g, system.mode_place, state.q)


@compiled
def assemble_coupling(run: Run, state: State) -> None:
    """Assemble and factorise the matrix of the joining rows.

    Where the rows are the same as before, entries of blocks whose columns are too stay as they are.
    """
    system = run.system
    count = state.counters[COUNT_JOINING]
    matrix, assembled = state.coupling, state.assembled
    whole, stale = state.counters[COUPLED] == 0, state.counters[COUPLED] >> 1
    for i in range(count):
        row = state.joining[i]
        of_row = blocks_of(system, row)
        entry = state.entries[system.pattern_start[row]]
        for j in range(count):
            other = state.joining[j]
            if whole or of_row & blocks_of(system, other) & stale:
                total = _compliance_between(run, state, row, other)
                assembled[i, j] = (1.0 if i == j else 0.0) - entry * total
            matrix[i, j] = assembled[i, j]
    _factorise(matrix, state.pivots, count)
    state.counters[COUPLED] = 1


@compiled
def blocks_of(system: System, row: int) -> int:
    """Return the blocks that a row joins, a bit each."""
    one, other = system.row_ends[row, 0], system.row_ends[row, 1]
    bits: int = (1 << system.block_of_end[one]) | (1 << system.block_of_end[other])
    return bits


@compiled
def _compliance_between(run: Run, state: State, row: int, other: int) -> float:
    """Return the displacement of a joining row under a unit force on another one [m/N]."""
    system = run.system
    total = 0.0
    for side in range(2):
        end = system.row_ends[row, side]
        block = system.block_of_end[end]
        for other_side in range(2):
            other_end = system.row_ends[other, other_side]
            if system.block_of_end[other_end] == block:
                total += value_at_end(system, state.columns[state.slot_of_end[other_end]], end)
    return total


@compiled
def value_at_end(system: System, column: Floats, end: int) -> float:
    """Return the value of a column of a block at one of its ends."""
    start, follower = system.end_start[system.block_of_end[end]], end - system.follower_start[0]
    if follower < 0:
        value: float = column[end - start]
        return value
    total = 0.0
    for term in range(system.follower_list.shape[0]):
        weight = system.follower_weight[term, follower]
        if weight != 0.0:
            total += weight * column[np.int64(system.follower_list[term, follower]) - start]
    return total


@compiled
def _factorise(matrix: Floats, exchange: Ints, count: int) -> None:
    """Factorise a matrix in place, with reciprocals of the pivots on the diagonal.

    A singular one becomes NaN or infinite.
    """
    for k in range(count):
        pivot = k
        for i in range(k + 1, count):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        exchange[k] = pivot
        if pivot != k:
            for j in range(count):
                saved = matrix[k, j]
                matrix[k, j] = matrix[pivot, j]
                matrix[pivot, j] = saved
        matrix[k, k] = 1.0 / matrix[k, k]
        for i in range(k + 1, count):
            factor = matrix[i, k] * matrix[k, k]
            matrix[i, k] = factor
            if factor != 0.0:
                for j in range(k + 1, count):
                    matrix[i, j] -= factor * matrix[k, j]


@compiled
def solve_coupling(matrix: Floats, exchange: Ints, force: Floats) -> None:
    """Solve the factorised system for the right side `force`, in place."""
    count = force.size
    for k in range(count):
        pivot = exchange[k]
        if pivot != k:
            saved = force[k]
            force[k] = force[pivot]
            force[pivot] = saved
    for i in range(count):
        total = force[i]
        for j in range(i):
            total -= matrix[i, j] * force[j]
        force[i] = total
    for i in range(count - 1, -1, -1):
        total = force[i]
        for j in range(i + 1, count):
            total -= matrix[i, j] * force[j]
        force[i] = total * matrix[i, i]
