"""Split a mechanism into blocks of rails that can be solved apart from each other.

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


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """A group of rails of a mechanism that is solved on its own.

    Attributes
    ----------
    coordinates : ndarray of int, shape (n,)
        Indices of its coordinates in the mechanism.
    rows : ndarray of int, shape (n_ends,)
        Indices of the rows that have an end in it.
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
        Each row has an end in one of them, or in two.
    """
    n_rows, size = mechanism.rows.shape
    if len(mechanism.rails) < 2:
        return (Block(np.arange(size), np.arange(n_rows)),)
    touched = _find_touched_rails(mechanism)
    groups = _group_rails(touched, laws)
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


def drop_joining_bases(mechanism: Mechanism, laws: LawTable) -> LawTable:
    """Return the laws with no base segment where a law joins two rails."""
    if len(mechanism.rails) < 2:
        return laws
    joins = _find_touched_rails(mechanism).sum(axis=1)[laws.row] > 1
    return laws._replace(base_segment=np.where(joins, -1, laws.base_segment))


# By the identity of the rows, which the cache keeps alive so that no others can have it.
_cache = LRUCache[tuple[Floats, Flags]](32)


def _find_touched_rails(mechanism: Mechanism) -> Flags:
    """Return which rails each row reaches into, shape (n_rows, n_rails)."""
    places = tuple((rail.first, rail.count) for rail in mechanism.rails)
    key = (id(mechanism.rows), places)
    if (cached := _cache.get(key)) is not None:
        return cached[1]
    used = mechanism.rows != 0.0
    found = np.array([used[:, first : first + count].any(axis=1) for first, count in places]).T
    if not mechanism.rows.flags.writeable:
        _cache.put(key, (mechanism.rows, found))
    return found


def _group_rails(touched: Flags, laws: LawTable) -> Ints:
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
