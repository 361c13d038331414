"""Obstructions with memory: laws that dent, split, crumble or break away, and their state.

An obstruction is a law of the table with the segments

- 0: free, no force;
- 1: elastic, on the way in and on the way back;
- 2 and further: the envelope, which a deeper compression follows.

While a rail moves within a step the law is piecewise linear and elastic. What it remembers changes
between steps only: a compression on the envelope leaves a *dent*, so that segment 1 becomes the
line of unloading through the deepest point; on the plateau of a brittle obstruction (slope zero)
it *breaks*, and what is left of it is smaller or weaker. The energy that this takes from the law is
dissipated. Steps are shortened until one ends where an obstruction fails, `passes_failure`.
"""

from typing import NamedTuple

import numpy as np

from turnout.kernels.compiled import compiled
from turnout.law.table import Floats, Ints, LawTable

NEVER, SPLITS, CRUMBLES, BREAKS_AWAY = range(4)
"""Failure modes of an obstruction: none, it dents; into a piece; from its highest force to a lower
one, at which it dents from then on; as a bond between two bodies."""

LARGEST_OVERRUN = 1e-3
"""Overrun of a failure that needs no shorter step, over the compression that reaches it [-]."""


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
    limit : ndarray, shape (n,)
        Crumbles: compression at which it fails [m].
    crushed : ndarray, shape (n,)
        Crumbles: force at which it dents once it has failed [N].
    least : ndarray, shape (n,)
        Splits: a smaller piece falls out; crumbles: this size remains [m].
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
    crushed: Floats
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
        crushed=numbers(),
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
    obstructions.deepest[row] = 0.0
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
    """Let the force of ice at the compression `e` [m] fall to that of crushing, which dents it.

    The dent ends where the least size is left, as before the failure.
    """
    law: int = obstructions.law[row]
    first: int = table.segment_start[law]
    stiffness: float = obstructions.unloading[row]
    force: float = obstructions.crushed[row]
    reach = force / stiffness
    whole = obstructions.size[row] - obstructions.least[row]
    free = min(e - reach, whole)
    deepest, last = free + reach, whole + reach
    table.segment_upper[first] = free
    table.segment_lower[first + 1], table.segment_upper[first + 1] = free, deepest
    table.segment_lower[first + 2], table.segment_upper[first + 2] = deepest, last
    table.segment_lower[first + 3] = last
    table.slope[first + 1] = stiffness
    table.intercept[first + 1] = -stiffness * free
    table.potential[first + 1] = 0.5 * stiffness * free * free
    table.intercept[first + 2] = force
    table.potential[first + 2] = 0.5 * force * reach - force * deepest
    table.intercept[first + 3] = -stiffness * whole
    crushing = force * (whole - free)
    table.potential[first + 3] = 0.5 * stiffness * whole * whole + crushing
    obstructions.breaks[row] = NEVER
    obstructions.broken[row] += 1
    obstructions.deepest[row] = deepest


@compiled
def failure(table: LawTable, obstructions: Obstructions, row: int) -> float:
    """Return the compression beyond which an obstruction fails, infinite for none [m]."""
    breaks = obstructions.breaks[row]
    if breaks == NEVER:
        return np.inf
    if breaks == CRUMBLES:
        return float(obstructions.limit[row])
    return float(table.segment_lower[table.segment_start[obstructions.law[row]] + 2])


@compiled
def overrun(table: LawTable, obstructions: Obstructions, row: int, e: float) -> float:
    """Return how far the compression `e` lies beyond the failure [m]; negative before it."""
    if obstructions.breaks[row] == BREAKS_AWAY:
        e = abs(e)
    return e - failure(table, obstructions, row)


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
