"""Which rails can be solved apart from each other, and where laws touch each of them.

Rails that only laws outside the linear system join (a link, a stop against a stock rail that bends,
a foreign object) are *blocks* of their own: their modes, flexibility and columns stay small. A row
that reaches into two blocks has an *end* in each; all other rows have one end.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.core.lru_cache import LRUCache
from turnout.law.table import LawTable
from turnout.mechanism.mechanism import Mechanism

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

MOST_KEPT = 32
"""So many mechanisms are known by their rows, the latest made."""


@dataclass(frozen=True, slots=True)
class Block:
    """One part of a mechanism.

    Attributes
    ----------
    coordinates : ndarray of int, shape (n,)
        Its coordinates in the mechanism's.
    rows : ndarray of int, shape (n_ends,)
        The rows that have an end in it.
    """

    coordinates: Ints
    rows: Ints


def split_blocks(mechanism: Mechanism, laws: LawTable) -> tuple[Block, ...]:
    """Split a mechanism into blocks.

    Parameters
    ----------
    mechanism : Mechanism
        A mechanism without rails, or with only one, is one block.
    laws : LawTable
        Its laws; rails that a base segment, or a friction with its normal law, joins are one block.

    Returns
    -------
    tuple of Block
        Each row has one end or two in all.
    """
    size, n_rows = mechanism.stiffness.shape[0], mechanism.rows.shape[0]
    if len(mechanism.rails) < 2:
        return (Block(np.arange(size), np.arange(n_rows)),)
    touched = _touched(mechanism)
    groups = _groups(touched, laws)
    first_touched = np.where(touched.any(axis=1), groups[touched.argmax(axis=1)], 0)
    blocks = []
    for group in range(groups.max() + 1):
        members = [
            rail for rail, mine in zip(mechanism.rails, groups, strict=True) if mine == group
        ]
        inside = touched[:, groups == group].any(axis=1)
        idle = ~touched.any(axis=1) & (first_touched == group)
        blocks.append(
            Block(
                coordinates=np.concatenate(
                    [np.arange(rail.first, rail.first + rail.count) for rail in members]
                ),
                rows=np.flatnonzero(inside | idle),
            )
        )
    return tuple(blocks)


def without_joining_bases(mechanism: Mechanism, laws: LawTable) -> LawTable:
    """Return the laws with no base segment where a law joins two rails."""
    if len(mechanism.rails) < 2:
        return laws
    joins = _touched(mechanism).sum(axis=1)[laws.row] > 1
    return laws._replace(base_segment=np.where(joins, -1, laws.base_segment))


# Rows are shared by many throws, and kept here so that no others take their place.
_memory = LRUCache[tuple[Floats, Flags]](MOST_KEPT)


def _touched(mechanism: Mechanism) -> Flags:
    """Return which rails each row reaches into, shape (n_rows, n_rails)."""
    places = tuple((rail.first, rail.count) for rail in mechanism.rails)
    key = (id(mechanism.rows), places)
    if (kept := _memory.get(key)) is not None:
        return kept[1]
    used = mechanism.rows != 0.0
    found = np.array([used[:, first : first + count].any(axis=1) for first, count in places]).T
    if not mechanism.rows.flags.writeable:
        _memory.put(key, (mechanism.rows, found))
    return found


def _groups(touched: Flags, laws: LawTable) -> Ints:
    """Return the block of every rail; rails that must be solved together share one."""
    together = np.concatenate(
        (
            touched[laws.row[laws.base_segment >= 0]],
            touched[laws.friction_row] | touched[laws.row[laws.friction_normal]],
            touched[touched.sum(axis=1) > 2],
        )
    )
    group = np.arange(touched.shape[1])
    bits = np.unique(together @ (1 << group))  # of the rails that must be, once each
    for rails in (bits[:, np.newaxis] >> group) & 1 == 1:
        if rails.any():
            group[np.isin(group, group[rails])] = group[rails].min()
    return np.unique(group, return_inverse=True)[1].astype(np.int64)
