r"""The small dense system of the rows that join two blocks.

With the compliance :math:`H` between the joining rows, gathered from the columns of their ends, and
their deviations :math:`\lambda = D g + b`

.. math:: (I - D H)\,\lambda = D g_0 + b

where :math:`g_0` are the joining displacements without the joining forces. The matrix is factorised
by rows with partial pivoting, and kept until a column of an end changes.
"""

import numpy as np

from turnout.integrate.state import COUNT_JOINING, COUPLED, State
from turnout.integrate.system import Floats, Ints, System
from turnout.law.compiled import compiled


@compiled
def couple(system: System, state: State) -> None:
    """Gather and factorise the matrix of the joining rows."""
    count = state.counters[COUNT_JOINING]
    matrix = state.coupling
    for i in range(count):
        row = state.joining[i]
        entry = state.entries[system.pattern_start[row]]
        for j in range(count):
            total = 0.0
            for side in range(2):
                end = system.row_ends[row, side]
                block = system.block_of_end[end]
                for other_side in range(2):
                    other = system.row_ends[state.joining[j], other_side]
                    if system.block_of_end[other] == block:
                        total += at_end(system, state.columns[state.slot_of_end[other]], end)
            matrix[i, j] = (1.0 if i == j else 0.0) - entry * total
    _factorise(matrix, state.exchange, count)
    state.counters[COUPLED] = 1


@compiled
def at_end(system: System, column: Floats, end: int) -> float:
    """Return a column of a block at one of its ends."""
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
    """Factorise a matrix in place; a singular one becomes NaN or infinite."""
    for k in range(count):
        pivot = k
        for i in range(k + 1, count):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        exchange[k] = pivot
        if pivot != k:
            for j in range(count):
                kept = matrix[k, j]
                matrix[k, j] = matrix[pivot, j]
                matrix[pivot, j] = kept
        for i in range(k + 1, count):
            share = matrix[i, k] / matrix[k, k]
            matrix[i, k] = share
            if share != 0.0:
                for j in range(k + 1, count):
                    matrix[i, j] -= share * matrix[k, j]


@compiled
def solve_coupling(matrix: Floats, exchange: Ints, force: Floats) -> None:
    """Solve the factorised system in place for one right side."""
    count = force.size
    for k in range(count):
        pivot = exchange[k]
        if pivot != k:
            kept = force[k]
            force[k] = force[pivot]
            force[pivot] = kept
    for i in range(count):
        total = force[i]
        for j in range(i):
            total -= matrix[i, j] * force[j]
        force[i] = total
    for i in range(count - 1, -1, -1):
        total = force[i]
        for j in range(i + 1, count):
            total -= matrix[i, j] * force[j]
        force[i] = total / matrix[i, i]
