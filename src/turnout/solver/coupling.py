r"""Coupling of blocks by the rows that join two of them.

These rows (links, stops against a rail that bends, objects) are solved last. With the compliance
:math:`H` between the joining rows, assembled from the columns of their ends
(`turnout.solver.columns`),

.. math:: (I - D H)\,\lambda = D g_0 + b

where :math:`g_0` are the joining displacements without the joining forces. This small dense matrix
is factorised by rows with partial pivoting, and kept until a column of an end changes.
"""

import numpy as np

from turnout.kernels.compiled import compiled
from turnout.solver.state import COUNT_JOINING, COUPLED, Run, State
from turnout.solver.system import Floats, Ints, System


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
