"""Compiled evaluation of the law table: arguments, segments, forces.

Arrays are float64; indices are int64. In the table for the
kernels, `turnout.solver.system.place_laws`, rows are places, and they and the normal laws of
frictions are unsigned. Arguments grow as a contact closes; `F` is the resisting force of the law,
so that ``-F`` acts on the structure along the law's row.
"""

import numpy as np

from turnout.kernels.compiled import compiled, compiled_loop
from turnout.kernels.lanes import (
    LANES,
    absolute,
    broadcast,
    greater,
    horizontal_sum,
    load,
    select,
)
from turnout.law.table import Floats, LawTable


@compiled
def law_argument(table: LawTable, law: int, g: Floats, inputs: Floats) -> float:
    """Return the argument ``e`` of one law [m]."""
    e: float = g[table.row[law]] - table.offset[law]
    if table.input_index[law] >= 0:
        e -= inputs[table.input_index[law]]
    return e


@compiled
def segment_for(table: LawTable, law: int, e: float, present: int, tolerance: float) -> int:
    """Return the segment that holds `e`; the `present` one is kept within `tolerance` [m]."""
    first: int = table.segment_start[law]
    last = table.segment_start[law + 1] - 1
    at: int = first + present
    while at < last and e > table.segment_upper[at] + tolerance:
        at += 1
    while at > first and e < table.segment_lower[at] - tolerance:
        at -= 1
    return at - first


@compiled
def law_force(table: LawTable, law: int, segment: int, e: float) -> float:
    """Return the force ``F`` of one law on its segment [N]."""
    at = table.segment_start[law] + segment
    force: float = table.slope[at] * e + table.intercept[at]
    return force


@compiled
def law_energy(table: LawTable, law: int, segment: int, e: float) -> float:
    """Return the potential energy of one law on its segment [J]."""
    at = table.segment_start[law] + segment
    energy: float = (0.5 * table.slope[at] * e + table.intercept[at]) * e + table.potential[at]
    return energy


@compiled_loop
def any_not_finite(values: Floats) -> bool:
    """Return True if a vector that fills whole cache lines holds NaN or infinity."""
    zero, one, infinite = broadcast(0.0), broadcast(1.0), broadcast(np.inf)
    a, b, c, d = zero, zero, zero, zero  # four counts, since each waits for its last addition
    whole = values.size - values.size % (4 * LANES)
    for i in range(0, whole, 4 * LANES):
        a = a + select(greater(infinite, absolute(load(values, i))), zero, one)
        b = b + select(greater(infinite, absolute(load(values, i + LANES))), zero, one)
        c = c + select(greater(infinite, absolute(load(values, i + 2 * LANES))), zero, one)
        d = d + select(greater(infinite, absolute(load(values, i + 3 * LANES))), zero, one)
    for i in range(whole, values.size, LANES):
        a = a + select(greater(infinite, absolute(load(values, i))), zero, one)
    return horizontal_sum((a + b) + (c + d)) > 0.0


@compiled
def share_until_zero(margin: float, margin_end: float) -> float:
    """Return the share of a path at which a margin becomes zero; 0 if it already is negative."""
    return margin / (margin - margin_end) if margin > 0.0 else 0.0
