r"""Solved columns of the implicit step, their rank-one updates, and the coupling of blocks.

The implicit step asks for

.. math:: A q = p + \Phi^T\lambda,\quad A = \iota I + \nu C + K,\qquad
          e = \Phi q + R\lambda + r,\qquad \lambda = D g + b

with modes and residual flexibility of a block at its ends `e`. Modes count as ends, on which `p` is
the force. Without deviations a unit force on an end or a mode displaces ends and modes by a row of
the *compliance*

.. math:: S = \begin{pmatrix} R + \Phi A^{-1}\Phi^T & \Phi A^{-1} \\ A^{-1}\Phi^T & A^{-1}
              \end{pmatrix},

which depends on the length of the step alone (`assemble_level`). Its sums run entry
by entry in an order that does not depend on the number of ends, so that one more end changes no bit
of the others. With the deviations of the block's own rows

.. math:: \begin{pmatrix} e \\ q \end{pmatrix} = \sum_j p_j\, P e_j + c, \qquad
          c = (I + P D)\,r + P\,b, \qquad P = (I - S D)^{-1} S .

`State` keeps `c` and the columns :math:`P e_j` of all modes and of the *active* ends, those with a
deviation, each for leading ends and modes; the displacement of an end that follows is the weighted
sum of those of leading ends. A law that changes its segment changes one row of `D` by :math:`d^T`
and its entry of `b` by :math:`\beta`, and by the Sherman-Morrison formula every column of the block
becomes

.. math:: x \leftarrow x + P e_r\,\frac{d^T x}{1 - d^T P e_r}

(for `c` with :math:`d^T c + \beta`), without a factorisation.

Rows that join two blocks are solved last (`turnout.solver.solve`).

Columns of active ends are rows of `State.columns`; each block has its own range of slots there.
"""

import numpy as np

from turnout.kernels.compiled import compiled
from turnout.kernels.native import (
    acquire_matrix,
    factorise_in_place,
    invert_factors,
    release_matrix,
)
from turnout.kernels.vector import (
    add_multiple,
    add_weighted_rows,
    copy,
    scale_into,
    sum_weighted_rows,
    update_rank_one,
)
from turnout.law.friction import STICK, limit_line
from turnout.solver.state import (
    COUNT_FLIPS,
    COUNT_JOINING,
    COUNT_REBUILDS,
    COUNT_RECENT,
    COUPLED,
    FRICTIONS,
    LAWS,
    LEVEL,
    UNSOLVED,
    Run,
    State,
    Work,
)
from turnout.solver.system import Floats, Ints, System

REBUILD_AFTER = 2000
"""Flips after which the columns are rebuilt at the end of the step in any case."""


@compiled
def evaluate_deviation(run: Run, state: State, row: int, slopes: Floats) -> float:
    """Evaluate the deviation of a row: write its slope per term [N/m], return its shift [N]."""
    system, table = run.system, run.table
    start, stop = system.term_start[row], system.term_start[row + 1]
    slopes[: stop - start] = 0.0
    shift = 0.0
    for i in range(system.row_law_start[row], system.row_law_start[row + 1]):
        law = system.row_law_list[i]
        slopes[0] += system.base_slope[law] - state.slope[law]
        shift -= state.constant[law]
    for i in range(system.row_friction_start[row], system.row_friction_start[row + 1]):
        friction = system.row_friction_list[i]
        branch = state.friction[friction]
        if branch == STICK:
            slopes[0] -= table.stick_stiffness[friction]
            shift += table.stick_stiffness[friction] * state.anchor[friction]
            continue
        normal = table.friction_normal[friction]
        slope, constant = limit_line(
            table.friction_coefficient[friction], state.slope[normal], state.constant[normal]
        )
        normal_row = table.row[normal]
        for k in range(start, stop):
            if system.term_list[k] == normal_row:
                slopes[k - start] -= branch * slope
                break
        shift -= branch * (constant + state.friction_beyond[friction])
    return shift


@compiled
def _dot_pattern(change: Floats, at: Ints, column: Floats) -> float:
    """Return the scalar product of the changed entries of a row with a column."""
    total = 0.0
    for k in range(change.size):
        total += change[k] * column[at[k]]
    return total


@compiled
def force_from(system: System, state: State, row: int, column: Floats) -> float:
    """Return the force of the deviation of a row by a column of its block [N]."""
    first, last = system.pattern_start[row], system.pattern_start[row + 1]
    return _dot_pattern(state.entries[first:last], system.pattern_at[first:last], column)


@compiled
def activate(run: Run, state: State, end: int, row: int, weights: Floats) -> int:
    """Assemble the column of an end that becomes active; return its slot.

    `weights` is scratch memory with room for the slots of a block.
    """
    system = run.system
    block = system.block_of_end[end]
    start = system.end_start[block]
    width = system.end_start[block + 1] - start
    first = system.slot_start[block]
    slot: int = first + state.slots[block]
    column = state.columns[slot, :width]
    base = state.compliance[state.counters[LEVEL], end, :width]
    for other in range(first, slot):
        other_row, weight = state.row_of_slot[other], 0.0
        if system.row_ends[other_row, 1] < 0:
            weight = force_from(system, state, other_row, base)
        weights[other - first] = weight
    sum_weighted_rows(base, weights[: slot - first], state.columns[first:slot], column)
    state.end_of_slot[slot] = end
    state.row_of_slot[slot] = row
    state.slot_of_end[end] = slot
    state.slots[block] += 1
    return slot


@compiled
def deactivate(run: Run, state: State, end: int) -> None:
    """Remove the column of an end whose deviation has vanished."""
    system = run.system
    block = system.block_of_end[end]
    slot = state.slot_of_end[end]
    state.slots[block] -= 1
    last = system.slot_start[block] + state.slots[block]
    if slot != last:
        moved = state.end_of_slot[last]
        copy(state.columns[last], state.columns[slot])
        state.end_of_slot[slot] = moved
        state.row_of_slot[slot] = state.row_of_slot[last]
        state.slot_of_end[moved] = slot
    state.end_of_slot[last] = -1
    state.row_of_slot[last] = -1
    state.slot_of_end[end] = -1


@compiled
def update_row(run: Run, state: State, row: int) -> None:
    """Update one row to the present state of its laws."""
    system = run.system
    start, stop = system.pattern_start[row], system.pattern_start[row + 1]
    n_terms = system.term_start[row + 1] - system.term_start[row]
    scratch, used = run.work.row, n_terms + stop - start
    slopes, entries, rest = scratch[:n_terms], scratch[n_terms:used], scratch[used:]
    shift = evaluate_deviation(run, state, row, slopes)
    vanished = shift == 0.0 and system.pinned[row] == 0
    changed = False
    for k in range(stop - start):
        entries[k] = system.pattern_weight[start + k] * slopes[system.pattern_term[start + k]]
        if entries[k] != 0.0:
            vanished = False
        if entries[k] != state.entries[start + k]:
            changed = True
    if not changed and shift == state.shift[row]:
        return
    shift_change = shift - state.shift[row]
    state.shift[row] = shift
    state.counters[COUNT_FLIPS] += 1
    state.counters[COUNT_RECENT] += 1
    if system.row_ends[row, 1] >= 0:
        state.entries[start] = entries[0]
        _update_joining_row(run, state, row, not vanished, rest)
        return
    end = system.row_ends[row, 0]
    if state.slot_of_end[end] < 0:
        activate(run, state, end, row, rest)
    for k in range(stop - start):
        delta = entries[k] - state.entries[start + k]
        state.entries[start + k] = entries[k]
        entries[k] = delta
    if changed:
        _update_columns(run, state, row, entries, rest, shift_change)
    else:
        shift_constant(run, state, end, shift_change)
    if vanished:
        deactivate(run, state, end)


@compiled
def shift_constant(run: Run, state: State, end: int, shift_change: float) -> None:
    """Add the displacements from a change of the shift of a row [N]."""
    system = run.system
    block = system.block_of_end[end]
    first, stop = system.end_start[block], system.end_start[block + 1]
    state.counters[UNSOLVED] |= 1 << block
    add_multiple(
        shift_change, state.columns[state.slot_of_end[end]], state.constant_column[first:stop]
    )


@compiled
def _update_columns(
    run: Run, state: State, row: int, change: Floats, scratch: Floats, shift_change: float
) -> None:
    """Update all columns of a block for a change of entries of a row and of its shift [N].

    `scratch` holds one column.
    """
    system = run.system
    end = system.row_ends[row, 0]
    block, slot = system.block_of_end[end], state.slot_of_end[end]
    first, slots = system.end_start[block], system.slot_start[block]
    width = system.end_start[block + 1] - first
    pivot, scaled = state.columns[slot, :width], scratch[:width]
    at = system.pattern_at[system.pattern_start[row] : system.pattern_start[row + 1]]
    denominator = 1.0
    for k in range(change.size):
        denominator -= change[k] * pivot[at[k]]
    constant = state.constant_column[first : first + width]
    scale_into(1.0 / denominator, pivot, scaled)
    add_multiple(shift_change + _dot_pattern(change, at, constant), scaled, constant)
    state.counters[UNSOLVED] |= 1 << block
    state.drift[0] *= max(abs(denominator), 1.0 / abs(denominator))
    state.counters[COUPLED] = 0
    copy(scaled, pivot)
    update_rank_one(change, at, pivot, state.columns[slots:slot])
    update_rank_one(change, at, pivot, state.columns[slot + 1 : slots + state.slots[block]])
    modes = system.mode_start[block], system.mode_start[block + 1]
    update_rank_one(change, at, pivot, state.mode_columns[modes[0] : modes[1]])


@compiled
def _update_joining_row(run: Run, state: State, row: int, active: bool, scratch: Floats) -> None:
    """Activate or deactivate both ends of a row that joins blocks, and list the row or not."""
    system = run.system
    state.counters[COUPLED] = 0
    for side in range(2):
        end = system.row_ends[row, side]
        has_column = state.slot_of_end[end] >= 0
        if active and not has_column:
            activate(run, state, end, row, scratch)
        if has_column and not active:
            deactivate(run, state, end)
    count = state.counters[COUNT_JOINING]
    at = 0
    while at < count and state.joining[at] != row:
        at += 1
    if active and at == count:
        state.joining[count] = row
        state.counters[COUNT_JOINING] = count + 1
    if not active and at < count:
        state.joining[at] = state.joining[count - 1]
        state.joining[count - 1] = -1
        state.counters[COUNT_JOINING] = count - 1


@compiled
def rebuild(run: Run, state: State, level: int) -> None:
    """Rebuild every column for the step of a level, which removes the drift of many updates.

    The level must have been assembled.
    """
    system, scratch = run.system, run.work.row
    state.counters[LEVEL] = level
    state.drift[0] = 1.0
    state.entries[:] = 0.0
    state.shift[:] = 0.0
    state.slot_of_end[:] = -1
    state.end_of_slot[:] = -1
    state.row_of_slot[:] = -1
    state.slots[:] = 0
    state.joining[:] = -1
    state.counters[COUNT_JOINING] = 0
    state.counters[COUPLED] = 0
    state.counters[UNSOLVED] = -1  # all blocks
    copy(system.end_load, state.constant_column)
    for block in range(system.end_stop.size):
        stop, start = system.end_stop[block], system.mode_start[block]
        for mode in range(start, system.mode_start[block + 1]):
            copy(state.compliance[level, stop + mode - start], state.mode_columns[mode])
    for row in range(system.row_ends.shape[0]):
        if system.row_ends[row, 0] < 0:  # no row has this place
            continue
        if system.pinned[row] and system.row_ends[row, 1] < 0:
            activate(run, state, system.row_ends[row, 0], row, scratch)
        elif system.pinned[row]:
            _update_joining_row(run, state, row, True, scratch)
        update_row(run, state, row)
    state.counters[COUNT_RECENT] = 0
    state.counters[COUNT_REBUILDS] += 1


@compiled
def mark_row(work: Work, count: int, row: int) -> int:
    """Add a row to the list of rows to be updated, once; its laws have changed."""
    work.changed[FRICTIONS] = 1  # or laws, as `mark_law` says
    if work.dirty[row]:
        return count
    work.dirty[row] = 1
    work.dirty_list[count] = row
    return count + 1


@compiled
def mark_law(run: Run, state: State, count: int, law: int) -> int:
    """Mark the row of a law and the rows of slipping frictions that it limits."""
    system, table, work = run.system, run.table, run.work
    work.changed[LAWS] = 1
    count = mark_row(work, count, table.row[law])
    for i in range(system.normal_friction_start[law], system.normal_friction_start[law + 1]):
        friction = system.normal_friction_list[i]
        if state.friction[friction] != STICK:
            count = mark_row(work, count, table.friction_row[friction])
    return count


@compiled
def update_marked(run: Run, state: State, count: int) -> None:
    """Update every marked row to the present states of its laws."""
    work = run.work
    for i in range(count):
        row = work.dirty_list[i]
        work.dirty[row] = 0
        update_row(run, state, row)


@compiled
def assemble_level(run: Run, state: State, level: int, inertia: float, viscosity: float) -> None:
    """Assemble the compliance of every block from the inverse of ``inertia I + viscosity C + K``.

    It is done once for each length of a step. A singular matrix gives NaN.
    """
    system = run.system
    if state.level_ready[level]:
        return
    state.level_ready[level] = 1
    compliance = state.compliance[level]
    for end in range(compliance.shape[0]):
        column = compliance[end]
        column[:] = 0.0  # its memory may have served before
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
        for end in range(start, stop):
            _assemble_end(system, compliance, end, block, inverse)
        for end in range(system.follower_start[block], system.follower_start[block + 1]):
            _assemble_end(system, compliance, end, block, inverse)
        _put(inverse, compliance[stop : stop + n, width : width + n])
        release_matrix(inverse)


@compiled
def _put(values: Floats, to: Floats) -> None:
    """Copy a matrix into another of its shape; an assignment of slices takes seconds to compile."""
    for i in range(to.shape[0]):
        for j in range(to.shape[1]):
            to[i, j] = values[i, j]


@compiled
def _assemble_end(
    system: System, compliance: Floats, end: int, block: int, inverse: Floats
) -> None:
    """Assemble the displacements of leading ends and modes under a unit force on an end [m/N].

    Those of a leading end are those of the modes at this end under forces on them.
    """
    n, start, stop = inverse.shape[0], system.end_start[block], system.end_stop[block]
    column, width = compliance[end], stop - start
    of_ends, of_modes = column[:width], column[width : width + n]
    of_modes[:] = 0.0
    add_weighted_rows(system.end_modes[end, :n], inverse, of_modes)
    copy(system.flexibility[end], of_ends)
    modes = system.mode_ends[system.mode_start[block] : system.mode_start[block + 1]]
    add_weighted_rows(of_modes, modes, of_ends)
    if end < stop:
        for i in range(n):
            compliance[stop + i, end - start] = of_modes[i]


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
