"""Obstructions with memory: laws that dent, split, crumble or break away, and their state.

An obstruction is a law of the table with the segments

- 0: free, no force;
- 1: elastic, on the way in and on the way back;
- 2 and further: the envelope, which a deeper compression follows.

While a rail moves within a step the law is piecewise linear and elastic. What it remembers changes
between steps only: a compression on the envelope leaves a *dent*, so that segment 1 becomes the
line of unloading through the deepest point; on the plateau of a brittle obstruction (slope zero)
it *breaks*, and what is left of it is smaller. The energy that this takes from the law is
dissipated.
"""

from typing import NamedTuple

import numpy as np

from turnout.kernels.compiled import compiled
from turnout.law.table import Floats, Ints, LawTable

NEVER, SPLITS, CRUMBLES, BREAKS_AWAY, SPENT = range(5)
"""Failure modes of an obstruction: none, it dents; into a piece; in layers; as a bond between two
bodies; or no longer, and it does not dent either."""


ROUNDING = 1e-9
"""Of sizes from which layers were taken [m]."""


class Obstructions(NamedTuple):
    """Obstructions of a mechanism, one row each; those from ``size`` on change during a run.

    Attributes
    ----------
    law : ndarray of int, shape (n,)
        Law of each.
    breaks : ndarray of int, shape (n,)
        How it breaks.
    unloading : ndarray, shape (n,)
        Stiffness on the way back [N/m].
    piece : ndarray, shape (n,)
        Splits: share of the size that stays [-].
    limit, layer : ndarray, shape (n,)
        Crumbles: compression at which it fails, and thickness that one failure takes away [m].
    least : ndarray, shape (n,)
        Splits: a smaller piece falls out; crumbles: no failure below this size [m].
    size : ndarray, shape (n,)
        Extent across the gap without what has broken off [m].
    deepest : ndarray, shape (n,)
        Largest compression of what is left [m].
    dissipated : ndarray, shape (n,)
        Energy taken so far [J].
    broken : ndarray of int, shape (n,)
        How often it broke.
    """

    law: Ints
    breaks: Ints
    unloading: Floats
    piece: Floats
    limit: Floats
    layer: Floats
    least: Floats
    size: Floats
    deepest: Floats
    dissipated: Floats
    broken: Ints


def no_obstructions(count: int = 0) -> Obstructions:
    """Return rows without content, for a mechanism without obstructions or to be filled."""

    def numbers() -> Floats:
        return np.zeros(count)

    def counts() -> Ints:
        return np.zeros(count, dtype=np.int64)

    return Obstructions(
        law=counts(),
        breaks=counts(),
        unloading=numbers(),
        piece=numbers(),
        limit=numbers(),
        layer=numbers(),
        least=numbers(),
        size=numbers(),
        deepest=numbers(),
        dissipated=numbers(),
        broken=counts(),
    )


@compiled
def dent(table: LawTable, law: int, segment: int, e: float, unloading: float) -> float:
    """Make a point of the envelope the deepest one; return the energy dissipated [J].

    Parameters
    ----------
    table : LawTable
        Its segments of the law are written.
    segment : int
        Segment of the envelope that holds `e`, 2 or more.
    e : float
        Compression [m].
    unloading : float
        Stiffness on the way back [N/m].
    """
    first: int = table.segment_start[law]
    at: int = first + segment
    force: float = table.slope[at] * e + table.intercept[at]
    free = e - force / unloading
    energy: float = (0.5 * table.slope[at] * e + table.intercept[at]) * e + table.potential[at]
    lost = energy - 0.5 * force * force / unloading
    for s in range(at, table.segment_start[law + 1]):
        table.potential[s] -= lost
    for s in range(first + 1, at):
        table.slope[s] = unloading
        table.intercept[s] = -unloading * free
        table.potential[s] = 0.5 * unloading * free * free
        table.segment_lower[s] = e
        table.segment_upper[s] = e
    table.segment_upper[first] = free
    table.segment_lower[first + 1] = free
    table.segment_lower[at] = e
    return lost


@compiled
def split(table: LawTable, obstructions: Obstructions, row: int) -> bool:
    """Leave a piece of a stone, or nothing; return True if any is left.

    The load of splitting is proportional to the square of the size.
    """
    law: int = obstructions.law[row]
    whole: float = obstructions.size[row]
    left = obstructions.piece[row] * whole
    obstructions.broken[row] += 1
    if left < obstructions.least[row]:
        obstructions.size[row] = 0.0
        return False
    obstructions.size[row] = left
    table.offset[law] += whole - left
    first: int = table.segment_start[law]
    force: float = table.intercept[first + 2] * obstructions.piece[row] ** 2
    stiffness: float = table.slope[first + 1]
    table.segment_upper[first + 1] = force / stiffness
    table.segment_lower[first + 2] = force / stiffness
    table.intercept[first + 2] = force
    table.potential[first + 2] = -0.5 * force * force / stiffness
    return True


@compiled
def crumble(table: LawTable, obstructions: Obstructions, row: int, e: float) -> None:
    """Take away as many layers as bring the compression `e` [m] back below failure.

    What is left has no dent; below the least size it fails no more.
    """
    law: int = obstructions.law[row]
    first: int = table.segment_start[law]
    count = 1 + int((e - obstructions.limit[row]) / obstructions.layer[row])
    lost = count * obstructions.layer[row]
    obstructions.size[row] -= lost
    obstructions.broken[row] += count
    obstructions.deepest[row] = 0.0
    table.offset[law] += lost
    stiffness: float = obstructions.unloading[row]
    force: float = table.intercept[first + 2]
    reach = force / stiffness
    table.segment_upper[first] = 0.0
    table.segment_lower[first + 1] = 0.0
    table.segment_upper[first + 1] = reach
    table.segment_lower[first + 2] = reach
    table.intercept[first + 1] = 0.0
    table.potential[first + 1] = 0.0
    table.potential[first + 2] = -0.5 * force * reach
    if obstructions.size[row] <= obstructions.least[row] + ROUNDING:
        obstructions.breaks[row] = SPENT
        table.slope[first + 2] = stiffness
        table.intercept[first + 2] = 0.0
        table.potential[first + 2] = 0.0


@compiled
def remember(table: LawTable, obstructions: Obstructions) -> None:
    """Give laws that have just been set up the dents that they had before."""
    for row in range(obstructions.law.size):
        law: int = obstructions.law[row]
        e: float = obstructions.deepest[row]
        segment, count = 2, table.segment_start[law + 1] - table.segment_start[law]
        if e <= 0.0 or count < 3 or e <= table.segment_lower[table.segment_start[law] + 2]:
            continue
        while segment < count - 1 and e > table.segment_upper[table.segment_start[law] + segment]:
            segment += 1
        dent(table, law, segment, e, obstructions.unloading[row])
