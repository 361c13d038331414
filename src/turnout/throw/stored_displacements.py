r"""Displacements that are sums of a few which a run has stored.

A run stores the displacements of its rows: of the feet on chairs, along the rods of drives, and
those by which stops and studs close. Most channels lie where such rows are. With the rows C of a
mechanism over its reduced coordinates u, a run holds g = C u, and a wanted displacement w u is

.. math:: w u = a g, \qquad a C = w,

wherever such weights a exist: at a chair for any height, since its feet show how the rail is
displaced and rolled. What they cannot give, such as a stock rail between stops, is recovered
from modes and row forces (`turnout.throw.recovery`).

Rows and wanted displacements have few coordinates where nodes are kept in the reduction, so that a
place is found by what shares coordinates with it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.core.lru_cache import LRUCache
from turnout.solver.condense import LARGEST_WEIGHT

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_COORDINATES = 12
"""A displacement of more coordinates lies at no kept node."""
MOST_ROWS = 24
"""Rows that are tried for one displacement; those at a place are three to six."""
ROUNDING = 1e-12
"""Tolerance of the weights for a displacement of size 1."""


@dataclass(frozen=True, slots=True, eq=False)
class StoredRows:
    """Rows whose displacements a run stores, by the coordinates that they share.

    Attributes
    ----------
    rows : ndarray, shape (n_rows, n_coordinates)
        Over the reduced coordinates of the mechanism.
    coordinates : dict of int to tuple of int
        Of each row that may be used.
    touching : dict of int to tuple of int
        Rows by coordinate.
    """

    rows: Floats
    coordinates: dict[int, tuple[int, ...]]
    touching: dict[int, tuple[int, ...]]


# By the identity of the rows, which the cache keeps alive so that no others can have it.
_stored = LRUCache[StoredRows](32)


def stored_rows(rows: Floats, usable: Ints) -> StoredRows:
    """Sort rows by their coordinates.

    Parameters
    ----------
    rows : ndarray, shape (n_rows, n_coordinates)
        Of a mechanism.
    usable : ndarray of int
        Those that may be used, rising.
    """
    key = (id(rows), usable.tobytes())
    found = _stored.get(key)
    if found is not None:
        return found
    coordinates: dict[int, list[int]] = {row: [] for row in usable.tolist()}
    touching: dict[int, list[int]] = {}
    for row, coordinate in np.argwhere(rows).tolist():
        if row in coordinates:
            coordinates[row].append(coordinate)
            touching.setdefault(coordinate, []).append(row)
    found = StoredRows(
        rows,
        {row: tuple(own) for row, own in coordinates.items()},
        {coordinate: tuple(own) for coordinate, own in touching.items()},
    )
    return found if rows.flags.writeable else _stored.put(key, found)


def stored_share(
    stored: StoredRows, rails: Sequence[tuple[int, int]], wanted: Floats
) -> tuple[Floats, Floats]:
    """Return the weights of stored displacements, and the remainder of a wanted one.

    Where it lies on a rail with many rows, what is left may lie on rails with fewer, which cost
    less to recover: a rod's end is where the stop beside it is, and that follows the stock rail.

    Parameters
    ----------
    stored : StoredRows
        Displacements that a run stores.
    rails : sequence of tuple of int
        First coordinate and number of coordinates of each rail.
    wanted : ndarray, shape (n_coordinates,)
        Over all reduced coordinates.

    Returns
    -------
    weights : ndarray, shape (n_rows,)
    rest : ndarray, shape (n_coordinates,)
    """
    places = np.flatnonzero(wanted)
    together = stored_weights(stored, places, wanted[places])
    if together is not None:
        return together, np.zeros(wanted.size)
    weights, rest = np.zeros(stored.rows.shape[0]), wanted.copy()
    for rail in rails:
        own = slice(rail[0], rail[0] + rail[1])
        places = rail[0] + np.flatnonzero(rest[own])
        found = stored_weights(stored, places, rest[places])
        if found is None:
            found = stored_weights(stored, places, rest[places], within=rail)
            if found is None or not _eases(stored, rails, rail, found):
                continue
            rest -= found @ stored.rows
        weights += found
        rest[own] = 0.0
    return weights, rest


def _eases(
    stored: StoredRows, rails: Sequence[tuple[int, int]], rail: tuple[int, int], weights: Floats
) -> bool:
    """Return True if all other rails that some rows touch have fewer rows than this one."""
    touched = stored.rows[weights != 0.0].any(axis=0)

    def count(of: tuple[int, int]) -> int:
        return sum(len(stored.touching.get(place, ())) for place in range(of[0], of[0] + of[1]))

    others = [of for of in rails if of != rail and touched[of[0] : of[0] + of[1]].any()]
    return all(count(of) < count(rail) for of in others)


def stored_weights(
    stored: StoredRows, places: Ints, values: Floats, *, within: tuple[int, int] | None = None
) -> Floats | None:
    """Return the weights of stored displacements that make up a wanted one.

    Parameters
    ----------
    stored : StoredRows
        Rows of which a run stores the displacements.
    places : ndarray of int, shape (n,)
        Coordinates of the wanted displacement.
    values : ndarray, shape (n,)
        Their coefficients.
    within : tuple of int, optional
        First coordinate and number of those of one rail; the sum elsewhere does not count.

    Returns
    -------
    ndarray, shape (n_rows,), or None
        Nearly all are 0; None where stored displacements do not give it.

    Examples
    --------
    Feet at heights 0 and 1 of a section that is displaced and rolls, and the point at height 3:

    >>> feet = stored_rows(np.array([[1.0, 0.0], [1.0, -1.0]]), np.arange(2))
    >>> stored_weights(feet, np.array([0, 1]), np.array([1.0, -3.0])).round(9).tolist()
    [-2.0, 3.0]
    """
    if not 0 < places.size <= MOST_COORDINATES or not np.isfinite(values).all():
        return None if places.size else np.zeros(stored.rows.shape[0])
    first, count = within or (0, stored.rows.shape[1])
    tried = _rows_around(stored, places.tolist(), range(first, first + count))
    if not tried:
        return None
    used = sorted({c for row in tried for c in stored.coordinates[row]} | set(places.tolist()))
    wanted = np.zeros(len(used))
    wanted[np.searchsorted(used, places)] = values
    of_rows = stored.rows[np.ix_(tried, used)]
    counts = np.array([first <= place < first + count for place in used])
    found = np.linalg.lstsq(of_rows.T[counts], wanted[counts], rcond=ROUNDING)[0]
    size = max(np.abs(found).max(), 1.0)
    whole = np.rint(found)  # a stored displacement itself, as that of a stop, has the weight 1
    found = np.where(np.abs(found - whole) < ROUNDING * size, whole, found)
    missed = np.abs(found @ of_rows - wanted)[counts].max()
    if size > LARGEST_WEIGHT or missed > ROUNDING * np.abs(wanted).max() * size:
        return None
    weights = np.zeros(stored.rows.shape[0])
    weights[tried] = found
    return weights


def _rows_around(stored: StoredRows, places: list[int], within: range) -> list[int]:
    """Return the rows that share coordinates with a place, or with one of those, up to a number."""
    rows: set[int] = set()
    seen, ahead = set(places), list(places)
    while ahead and len(rows) < MOST_ROWS:
        found = set(stored.touching.get(ahead.pop(0), ())) - rows
        rows |= found
        further = {c for row in found for c in stored.coordinates[row] if c in within} - seen
        seen |= further
        ahead += sorted(further)
    return sorted(rows)
