"""What a unit force on an end or a mode does to the ends and modes of its block.

It depends on the length of the step alone; see `turnout.integrate.columns`. Sums run entry by entry
in an order that does not depend on how many ends there are, so that an end more changes no bit of
the others.
"""

import numpy as np

from turnout.integrate.state import State
from turnout.integrate.system import Floats, System
from turnout.integrate.vector import add_rows, copy
from turnout.law.compiled import compiled, compiled_with_memory


@compiled_with_memory
def make_level(system: System, state: State, level: int, inertia: float, viscosity: float) -> None:
    """Invert ``inertia I + viscosity C + K`` block by block, and what follows from it.

    Once for each length of a step. Where the matrix is singular everything is NaN.
    """
    if state.made[level]:
        return
    state.made[level] = 1
    compliance = state.compliance[level]
    for block in range(system.end_stop.size):
        first, last = system.mode_start[block], system.mode_start[block + 1]
        n = last - first
        matrix = system.stiffness[first:last, :n].copy()
        for i in range(n):
            matrix[i, i] += inertia + viscosity * system.damping[first + i]
        inverse = np.full_like(matrix, np.nan)
        try:
            inverse[:] = np.linalg.inv(matrix)
        except Exception:  # the only kind a kernel can name; a body that floats, or NaN before it
            inverse[:] = np.nan
        start, stop = system.end_start[block], system.end_stop[block]
        width = stop - start
        modes = system.mode_ends[first:last]
        for end in range(start, stop):
            column = compliance[end]
            _write_column(system, end, inverse, modes, column[: width + n])
            for i in range(n):
                compliance[stop + i, end - start] = column[width + i]
        for end in range(system.follower_start[block], system.follower_start[block + 1]):
            _write_column(system, end, inverse, modes, compliance[end, : width + n])
        compliance[stop : stop + n, width : width + n] = inverse


@compiled
def _write_column(system: System, end: int, inverse: Floats, modes: Floats, column: Floats) -> None:
    """Write what a unit force on an end does to leading ends and modes."""
    n = inverse.shape[0]
    width = column.size - n
    of_ends, of_modes = column[:width], column[width:]
    of_modes[:] = 0.0
    add_rows(system.end_modes[end, :n], inverse, of_modes)
    copy(system.flexibility[end], of_ends)
    add_rows(of_modes, modes, of_ends)
