"""Find the rows of a block that are linear combinations of others.

A stop, the foot on a slide chair and the edges of that foot are points of one rigid section, so the
displacement of one follows from those of the others. Only *leading* rows need columns of their own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from turnout.core.lru_cache import LRUCache

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

EXACT = 1e-12
"""Largest remainder of a row that follows, relative to its norm [-]."""
LARGEST_WEIGHT = 100.0
"""Largest weight of a row that follows [-]; beyond, it leads, since its terms would cancel."""


@dataclass(frozen=True, slots=True, eq=False)
class Leading:
    """Which rows lead, and how all rows follow from them.

    Attributes
    ----------
    leaders : ndarray of int, shape (n_leaders,)
        Indices of the leading rows, rising.
    weights : ndarray, shape (n_rows, n_leaders)
        ``rows = weights @ rows[leaders]``; those of a leader are a one and zeros.
    """

    leaders: Ints
    weights: Floats


_cache = LRUCache[Leading](48)


def leading_rows(rows: Floats, *, first: NDArray[np.bool_]) -> Leading:
    """Choose rows from which all others follow exactly.

    Parameters
    ----------
    rows : ndarray, shape (n_rows, n_coordinates)
        Displacements as combinations of coordinates.
    first : ndarray of bool, shape (n_rows,)
        Rows that lead if they can. Among the others those in front lead, so that one more row at
        the end changes nothing for the others.

    Returns
    -------
    Leading
        Read-only arrays.

    Examples
    --------
    >>> rows = np.array([[1.0, 0.0], [1.0, 0.0], [1.0, 2.0]])
    >>> found = leading_rows(rows, first=np.array([False, True, False]))
    >>> found.leaders.tolist(), found.weights.tolist()
    ([1, 2], [[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    """
    key = (rows.shape, rows.tobytes(), first.tobytes())
    found = _cache.get(key)
    return found if found is not None else _cache.put(key, _choose_leaders(rows, first))


def _choose_leaders(rows: Floats, first: NDArray[np.bool_]) -> Leading:
    count = rows.shape[0]
    basis, shares = np.zeros_like(rows), np.zeros((count, count))
    independent: list[int] = []
    for row in np.concatenate((np.flatnonzero(first), np.flatnonzero(~first))):
        left, found = rows[row].copy(), len(independent)
        for _ in range(2):  # once more, since what is left may be rounding
            share = basis[:found] @ left
            left -= share @ basis[:found]
            shares[row, :found] += share
        rest = float(np.linalg.norm(left))
        if rest > EXACT * float(np.linalg.norm(rows[row])):
            basis[found], shares[row, found] = left / rest, rest
            independent.append(int(row))
    shares = shares[:, : len(independent)]
    weights = solve_triangular(shares[independent].T, shares.T, lower=False).T
    heavy = np.flatnonzero(np.abs(weights).max(axis=1, initial=0.0) > LARGEST_WEIGHT)
    leaders = np.array(sorted({*independent, *heavy.tolist()}), dtype=np.int64)
    of_leaders = np.zeros((count, leaders.size))
    of_leaders[:, np.searchsorted(leaders, independent)] = weights
    of_leaders[leaders] = np.eye(leaders.size)
    for array in (leaders, of_leaders):
        array.flags.writeable = False
    return Leading(leaders, of_leaders)
