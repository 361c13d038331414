"""The compliance of the blocks for one length of a step, as `turnout.solver.columns` has it."""

import numpy as np

from turnout.kernels.compiled import compiled
from turnout.kernels.inverse import factorise_in_place, invert_factors
from turnout.kernels.memory import acquire_matrix, release_matrix
from turnout.kernels.vector import add_weighted_rows, copy
from turnout.solver.state import Run, State
from turnout.solver.system import Floats, System

READY, STALE = 1, 2
"""Of a compliance: as for the present system, or for one whose objects stand elsewhere."""


@compiled
def assemble_level(run: Run, state: State, level: int, inertia: float, viscosity: float) -> None:
    """Assemble the compliance of every block from the inverse of ``inertia I + viscosity C + K``.

    It is done once for each length of a step. A singular matrix gives NaN. What is *stale* is known
    from a run of the same rails with its objects elsewhere: only what hangs on these is made again.
    """
    system = run.system
    ready = state.level_ready[level]
    state.level_ready[level] = READY
    compliance = state.compliance[level]
    if ready == STALE:
        _move_ends(system, compliance)
    if ready != 0:
        return
    _fill(0.0, compliance)  # its memory may have served before
    for block in range(system.end_stop.size):
        first, last = system.mode_start[block], system.mode_start[block + 1]
        n = last - first
        matrix, inverse = acquire_matrix(n, n), acquire_matrix(n, n)
        _put(system.stiffness[first:last, :n], matrix)
        for i in range(n):
            matrix[i, i] += inertia + viscosity * system.damping[first + i]
        invert(matrix, inverse)
        release_matrix(matrix)
        start, stop = system.end_start[block], system.end_stop[block]
        width = stop - start
        modes = system.mode_ends[first:last]
        for end in range(start, stop):
            column = compliance[end]
            _assemble_column(system, end, inverse, modes, column[: width + n])
            for i in range(n):
                compliance[stop + i, end - start] = column[width + i]
        for end in range(system.follower_start[block], system.follower_start[block + 1]):
            _assemble_column(system, end, inverse, modes, compliance[end, : width + n])
        _put(inverse, compliance[stop : stop + n, width : width + n])
        release_matrix(inverse)


@compiled
def _move_ends(system: System, compliance: Floats) -> None:
    """Assemble what of a compliance depends on the ends of objects, bit by bit as for the whole."""
    for k in range(system.moved_end.size):
        end = system.moved_end[k]
        block = system.block_of_end[end]
        first, last = system.mode_start[block], system.mode_start[block + 1]
        start, stop = system.end_start[block], system.end_stop[block]
        n, width = last - first, stop - start
        inverse = acquire_matrix(n, n)
        _put(compliance[stop : stop + n, width : width + n], inverse)
        modes = system.mode_ends[first:last]
        column = compliance[end]
        _assemble_column(system, end, inverse, modes, column[: width + n])
        for i in range(n):
            compliance[stop + i, end - start] = column[width + i]
        for other in range(start, stop):
            _move_entry(
                system,
                other,
                end - start,
                compliance[other, width : width + n],
                modes,
                compliance[other],
            )
        for other in range(system.follower_start[block], system.follower_start[block + 1]):
            _move_entry(
                system,
                other,
                end - start,
                compliance[other, width : width + n],
                modes,
                compliance[other],
            )
        release_matrix(inverse)


@compiled
def _move_entry(
    system: System, end: int, at: int, of_modes: Floats, modes: Floats, column: Floats
) -> None:
    """Assemble one displacement under a unit force on an end, summed as `_assemble_column` does."""
    total, r = system.flexibility[end, at], 0
    while r + 4 <= of_modes.size:
        pair = of_modes[r] * modes[r, at] + of_modes[r + 1] * modes[r + 1, at]
        other = of_modes[r + 2] * modes[r + 2, at] + of_modes[r + 3] * modes[r + 3, at]
        total += pair + other
        r += 4
    while r < of_modes.size:
        total += of_modes[r] * modes[r, at]
        r += 1
    column[at] = total


@compiled
def _put(values: Floats, to: Floats) -> None:
    """Copy a matrix into another of its shape; an assignment of slices takes seconds to compile."""
    for i in range(to.shape[0]):
        for j in range(to.shape[1]):
            to[i, j] = values[i, j]


@compiled
def _fill(value: float, to: Floats) -> None:
    """Set all of a matrix to a value."""
    for i in range(to.shape[0]):
        for j in range(to.shape[1]):
            to[i, j] = value


@compiled
def _assemble_column(
    system: System, end: int, inverse: Floats, modes: Floats, column: Floats
) -> None:
    """Assemble the displacements of leading ends and modes under a unit force on an end [m/N]."""
    n = inverse.shape[0]
    width = column.size - n
    of_ends, of_modes = column[:width], column[width:]
    of_modes[:] = 0.0
    add_weighted_rows(system.end_modes[end, :n], inverse, of_modes)
    copy(system.flexibility[end], of_ends)
    add_weighted_rows(of_modes, modes, of_ends)


@compiled
def invert(matrix: Floats, inverse: Floats) -> None:
    """Write the inverse of a matrix to another one; NaN where there is none.

    Parameters
    ----------
    matrix : ndarray, shape (n, n)
        It is used up.
    inverse : ndarray, shape (n, n)
        Written.

    Examples
    --------
    >>> found = np.zeros((2, 2))
    >>> invert(np.array([[2.0, 1.0], [0.0, 4.0]]), found)
    >>> found.tolist()
    [[0.5, -0.125], [0.0, 0.25]]
    >>> invert(np.zeros((2, 2)), found)
    >>> found.tolist()
    [[nan, nan], [nan, nan]]
    """
    n, exists = matrix.shape[0], True
    for i in range(n):  # LAPACK has columns where NumPy has rows
        for j in range(n):
            inverse[j, i] = matrix[i, j]
            exists = exists and np.isfinite(matrix[i, j])
    if exists and n > 0:
        pivots = acquire_matrix(1, n)
        exists = (
            factorise_in_place(inverse, pivots[0]) == 0 and invert_factors(inverse, pivots[0]) == 0
        )
        release_matrix(pivots)
    for i in range(n):
        for j in range(n):
            matrix[j, i] = inverse[i, j]
    for i in range(n):
        for j in range(n):
            inverse[i, j] = matrix[i, j] if exists else np.nan
