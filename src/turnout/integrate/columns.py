r"""Solved columns of the condensed system and their rank-one updates.

With the deviations :math:`\lambda = D g + b` the rows are

.. math:: g = \Phi q + R\lambda + r \;\Rightarrow\; g = T q + c + P\,b_{in},\quad
          T = B^{-1}\Phi,\; c = B^{-1}(R b + r),\; P = B^{-1}R,\; B = I - R D.

Kept are the columns of `T`, the column `c`, and :math:`P e_r` of the *active* rows, those with a
deviation. Each is continued by the modal force :math:`\Phi^T\lambda` that goes with it. A law that
changes its segment changes one row of `D` and `b` by :math:`d^T` and :math:`\delta`, and with
Sherman-Morrison every column becomes

.. math:: x \leftarrow x + P e_r\,\frac{d^T x\;(+\,\delta\text{ for } c)}{1 - d^T P e_r},

and so does the modal matrix of the implicit step by a rank-one term. Nothing is factorised.
Columns are float64 rows of `State.columns`; slot `s` of an active row is column
``n_modes + 1 + s``.
"""

import numpy as np

from turnout.integrate.system import (
    COUNT_ACTIVE,
    COUNT_FLIPS,
    COUNT_REBUILDS,
    COUNT_RECENT,
    Floats,
    State,
    System,
)
from turnout.law.compiled import compiled
from turnout.law.kernel import STICK
from turnout.law.table import LawTable

# After so many flips columns are made anew after the step, whatever they look like.
REBUILD_AFTER = 500


@compiled
def row_target(system: System, table: LawTable, state: State, row: int, entries: Floats) -> float:
    """Write the deviation entries of a row for the present law states; return its shift [N]."""
    start, stop = system.pattern_start[row], system.pattern_start[row + 1]
    entries[: stop - start] = 0.0
    shift = 0.0
    for i in range(system.row_law_start[row], system.row_law_start[row + 1]):
        law = system.row_law_list[i]
        entries[0] += system.base_slope[law] - state.slope[law]
        shift -= state.constant[law]
    for i in range(system.row_friction_start[row], system.row_friction_start[row + 1]):
        friction = system.row_friction_list[i]
        branch = state.friction[friction]
        if branch == STICK:
            entries[0] -= table.stick_stiffness[friction]
            shift += table.stick_stiffness[friction] * state.anchor[friction]
            continue
        normal = table.friction_normal[friction]
        gain = branch * table.friction_coefficient[friction]
        normal_row = table.row[normal]
        for k in range(start, stop):
            if system.pattern_list[k] == normal_row:
                entries[k - start] -= gain * state.slope[normal]
                break
        shift -= gain * state.constant[normal]
    return shift


@compiled
def activate(system: System, state: State, row: int) -> int:
    """Give a row a solved column; return its slot."""
    n_modes = system.eigenvalues.size
    count: int = state.counters[COUNT_ACTIVE]
    column = state.columns[n_modes + 1 + count]
    base = system.base[row]
    column[:] = base
    for slot in range(count):
        active_row = state.row_of_slot[slot]
        weight = 0.0
        for k in range(system.pattern_start[active_row], system.pattern_start[active_row + 1]):
            weight += state.entries[k] * base[system.pattern_list[k]]
        if weight != 0.0:
            other = state.columns[n_modes + 1 + slot]
            for i in range(column.size):
                column[i] += weight * other[i]
    state.row_of_slot[count] = row
    state.slot_of_row[row] = count
    state.counters[COUNT_ACTIVE] = count + 1
    return count


@compiled
def deactivate(system: System, state: State, row: int) -> None:
    """Drop the column of a row whose deviation has vanished."""
    n_modes = system.eigenvalues.size
    slot = state.slot_of_row[row]
    last = state.counters[COUNT_ACTIVE] - 1
    if slot != last:
        moved = state.row_of_slot[last]
        state.columns[n_modes + 1 + slot] = state.columns[n_modes + 1 + last]
        state.row_of_slot[slot] = moved
        state.slot_of_row[moved] = slot
    state.row_of_slot[last] = -1
    state.slot_of_row[row] = -1
    state.counters[COUNT_ACTIVE] = last


@compiled
def update_row(system: System, table: LawTable, state: State, row: int, scratch: Floats) -> None:
    """Bring one row to the present state of its laws: a rank-one update of all columns.

    `scratch` has room for the row's entries and, behind them, for one weight a mode and two modal
    vectors.
    """
    n_modes = system.eigenvalues.size
    start, stop = system.pattern_start[row], system.pattern_start[row + 1]
    width = stop - start
    entries = scratch[:width]
    shift = row_target(system, table, state, row, entries)
    changed = shift != state.shift[row]
    vanished = shift == 0.0 and system.pinned[row] == 0
    for k in range(width):
        if entries[k] != 0.0:
            vanished = False
        if entries[k] != state.entries[start + k]:
            changed = True
    if not changed:
        return
    slot = state.slot_of_row[row]
    if slot < 0:
        slot = activate(system, state, row)
    pivot = state.columns[n_modes + 1 + slot]
    denominator = 1.0
    for k in range(width):
        delta = entries[k] - state.entries[start + k]
        state.entries[start + k] = entries[k]
        entries[k] = delta
        denominator -= delta * pivot[system.pattern_list[start + k]]
    shift_delta = shift - state.shift[row]
    state.shift[row] = shift
    alpha = scratch[width : width + n_modes]
    for j in range(n_modes + 1 + state.counters[COUNT_ACTIVE]):
        if j == n_modes + 1 + slot:
            continue
        column = state.columns[j]
        weight = shift_delta if j == n_modes else 0.0
        for k in range(width):
            weight += entries[k] * column[system.pattern_list[start + k]]
        weight /= denominator
        if j < n_modes:
            alpha[j] = weight
        for i in range(column.size):
            column[i] += weight * pivot[i]
    modal_force = pivot[system.row_load.size :]
    modal = _update_inverse(state, alpha, modal_force, scratch[width + n_modes :])
    for i in range(pivot.size):
        pivot[i] /= denominator
    state.counters[COUNT_FLIPS] += 1
    state.counters[COUNT_RECENT] += 1
    state.drift[0] *= max(abs(denominator), 1.0 / abs(denominator))
    state.drift[0] *= max(abs(modal), 1.0 / abs(modal))
    if vanished:
        deactivate(system, state, row)


@compiled
def _update_inverse(state: State, alpha: Floats, force: Floats, scratch: Floats) -> float:
    """Subtract ``force alpha^T`` from the modal matrix by its inverse; return the divisor."""
    n_modes = alpha.size
    left = scratch[:n_modes]
    right = scratch[n_modes : 2 * n_modes]
    right[:] = 0.0
    denominator = 1.0
    for i in range(n_modes):
        total = 0.0
        row = state.inverse[i]
        for j in range(n_modes):
            total += row[j] * force[j]
            right[j] += alpha[i] * row[j]
        left[i] = total
        denominator -= alpha[i] * total
    for i in range(n_modes):
        weight = left[i] / denominator
        row = state.inverse[i]
        for j in range(n_modes):
            row[j] += weight * right[j]
    return denominator


@compiled
def refresh_inverse(system: System, state: State, inertia: float, viscosity: float) -> None:
    """Invert ``inertia I + viscosity C + Lambda - Phi^T D T``, the matrix of the implicit step."""
    n_rows, n_modes = system.row_load.size, system.eigenvalues.size
    matrix = np.empty((n_modes, n_modes))
    for i in range(n_modes):
        for j in range(n_modes):
            matrix[i, j] = viscosity * system.damping[i, j] - state.columns[j, n_rows + i]
        matrix[i, i] += inertia + system.eigenvalues[i]
    try:
        state.inverse[:, :] = np.linalg.inv(matrix)
    except Exception:  # the only kind a kernel can name; a body that floats, or NaN before it
        state.inverse[:, :] = np.nan


@compiled
def rebuild(
    system: System, table: LawTable, state: State, inertia: float, viscosity: float, scratch: Floats
) -> None:
    """Make every column anew from the base system; removes the drift of many updates."""
    n_rows, n_modes = system.row_load.size, system.eigenvalues.size
    state.drift[0] = 1.0
    state.entries[:] = 0.0
    state.shift[:] = 0.0
    state.slot_of_row[:] = -1
    state.row_of_slot[:] = -1
    state.counters[COUNT_ACTIVE] = 0
    state.columns[: n_modes + 1] = 0.0
    for j in range(n_modes):
        for i in range(n_rows):
            state.columns[j, i] = system.base[i, n_rows + j]
    state.columns[n_modes, :n_rows] = system.row_load
    state.inverse[:, :] = 0.0
    for row in range(n_rows):
        if system.pinned[row]:
            activate(system, state, row)
        update_row(system, table, state, row, scratch)
    refresh_inverse(system, state, inertia, viscosity)
    state.counters[COUNT_RECENT] = 0
    state.counters[COUNT_REBUILDS] += 1
