"""Which rails can be solved apart from each other, and where laws touch each of them.

Rails that only laws outside the linear system join (a link, a stop against a stock rail that bends,
a foreign object) are *blocks* of their own: their modes, flexibility and columns stay small. A row
that reaches into two blocks has an *end* in each; all other rows have one end.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from turnout.law.table import LawTable
from turnout.mechanism.mechanism import Mechanism

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


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
    touched = np.array(
        [
            np.any(mechanism.rows[:, rail.first : rail.first + rail.count] != 0.0, axis=1)
            for rail in mechanism.rails
        ]
    ).T
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
    count = sum(
        np.any(mechanism.rows[:, rail.first : rail.first + rail.count] != 0.0, axis=1).astype(int)
        for rail in mechanism.rails
    )
    joins = np.asarray(count)[laws.row] > 1
    return laws._replace(base_segment=np.where(joins, -1, laws.base_segment))


def _groups(touched: NDArray[np.bool_], laws: LawTable) -> Ints:
    """Return the block of every rail; rails that must be solved together share one."""
    together = np.concatenate(
        (
            touched[laws.row[laws.base_segment >= 0]],
            touched[laws.friction_row] | touched[laws.row[laws.friction_normal]],
            touched[touched.sum(axis=1) > 2],
        )
    )
    joined = np.eye(touched.shape[1], dtype=bool)
    for rails in np.unique(together, axis=0):
        joined[np.ix_(rails, rails)] = True
    return np.asarray(connected_components(csr_array(joined), directed=False)[1], dtype=np.int64)
