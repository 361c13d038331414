"""Histories turned to channels: columns of stored instants become rows over time.

Histories hold an instant after the other, channels a place after the other. Turned as a whole, a
value costs a memory access of its own; in blocks of instants that fit into the processor's caches
it costs a tenth.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

INSTANTS = 250
"""In a block: histories of these fit into the second cache."""
APART = 24
"""Columns without a weight between others, above which a product is made in parts."""


def evenly_spaced(places: Ints) -> slice | Ints:
    """Return indices as a slice, which copies nothing, where they rise evenly.

    Examples
    --------
    >>> evenly_spaced(np.array([3, 5, 7]))
    slice(3, 8, 2)
    >>> evenly_spaced(np.array([3, 5, 6])).tolist()
    [3, 5, 6]
    """
    if places.size < 2:
        return slice(int(places[0]), int(places[0]) + 1) if places.size else slice(0, 0)
    step = int(places[1] - places[0])
    if step < 1 or np.any(np.diff(places) != step):
        return places
    return slice(int(places[0]), int(places[-1]) + 1, step)


@dataclass(frozen=True, slots=True)
class Product:
    """Rows as weighted sums of columns of a history.

    Attributes
    ----------
    history : str
        Which of those given to `write_rows`.
    columns : slice or ndarray of int
        Columns that are taken.
    rows : slice or ndarray of int
        Rows that are written.
    weights : ndarray, shape (n_rows, n_columns), optional
        Of the columns; without them each row is its own column.
    beside : tuple of (slice or ndarray of int)
        Without weights, further columns that are added to the first ones, in this order.
    added : bool
        Whether the rows hold something to which this is added.
    """

    history: str
    columns: slice | Ints
    rows: slice | Ints
    weights: Floats | None = None
    beside: tuple[slice | Ints, ...] = ()
    added: bool = False


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows over time that are wanted: where they start, plus or minus some products.

    Attributes
    ----------
    products : sequence of Product
        In this order; all rows are written by them.
    out : ndarray, shape (n_rows, n_times)
        Where the rows are written.
    start : ndarray, shape (n_rows,), optional
        Default 0.
    minus : bool
        Whether the products are subtracted.
    """

    products: Sequence[Product]
    out: Floats
    start: Floats | None = None
    minus: bool = False


def sums_of_columns(history: str, columns: Ints, *, rows: Ints) -> list[Product]:
    """Return rows as sums of columns.

    Parameters
    ----------
    history : str
        Of the columns.
    columns : ndarray of int, shape (n, n_summed)
        For each row the columns that are added, in this order.
    rows : ndarray of int, shape (n,)
        Where the sums are written.
    """
    if not columns.size:
        return []
    first, *others = (evenly_spaced(column) for column in columns.T)
    return [Product(history, first, evenly_spaced(rows), beside=tuple(others))]


def products_of(weights: Floats, history: str) -> list[Product]:
    """Return rows as products with few columns each.

    Parameters
    ----------
    weights : ndarray, shape (n_rows, n_columns)
        Nearly all of them 0, those of neighbouring rows in neighbouring columns.
    history : str
        Of the columns.
    """
    used, number = np.nonzero(weights)
    single = np.bincount(used, minlength=weights.shape[0]) == 1
    single[single] = weights[single].sum(axis=1) == 1.0
    several, found = np.flatnonzero(~single), list[Product]()
    first_column = (weights != 0.0).argmax(axis=1)[several] if weights.size else several * 0
    apart = (np.diff(several) > 2) | (np.abs(np.diff(first_column)) > APART)
    others = np.where(single[:, np.newaxis], 0.0, weights)
    for group in np.split(several, np.flatnonzero(apart) + 1):
        if group.size:  # single rows between them are written twice
            rows = slice(int(group[0]), int(group[-1]) + 1)
            found += products_with(others[rows], history, rows=rows, begun=False)
    own = number[single[used]][:, np.newaxis]
    return found + sums_of_columns(history, own, rows=np.flatnonzero(single))


def products_with(
    weights: Floats, history: str, *, rows: slice | Ints, begun: bool = True
) -> list[Product]:
    """Return rows as products with the columns whose weights are not 0.

    Parameters
    ----------
    weights : ndarray, shape (n_rows, n_columns)
    history : str
        Of the columns.
    rows : slice or ndarray of int, shape (n_rows,)
        Where they are written.
    begun : bool
        Whether they hold something to which the products are added.
    """
    used = np.flatnonzero(weights.any(axis=0))
    if not used.size:
        nothing = Product(history, slice(0, 0), rows, weights[:, :0])
        return [] if begun else [nothing]
    ends = np.flatnonzero(np.diff(used) > APART) + 1
    runs = [slice(int(run[0]), int(run[-1]) + 1) for run in np.split(used, ends)]
    return [
        Product(history, run, rows, weights[:, run].copy(), added=begun or number > 0)
        for number, run in enumerate(runs)
    ]


def write_rows(wanted: Sequence[Rows], histories: Mapping[str, Floats]) -> None:
    """Write rows over time, block by block of instants.

    Parameters
    ----------
    wanted : sequence of Rows
        All over the same instants.
    histories : mapping of str to ndarray, each of shape (n_times, n_columns)
        By the names in the products.

    Examples
    --------
    >>> products = sums_of_columns("g", np.array([[0, 1], [2, 3]]), rows=np.arange(2))
    >>> found = np.empty((2, 3))
    >>> write_rows([Rows(products, found)], {"g": np.arange(12.0).reshape(3, 4)})
    >>> found.tolist()
    [[1.0, 9.0, 17.0], [5.0, 13.0, 21.0]]
    """
    starts = [None if rows.start is None else rows.start[:, np.newaxis] for rows in wanted]
    count = max((rows.out.shape[1] for rows in wanted), default=0)
    for begin in range(0, count, INSTANTS):
        own = slice(begin, begin + INSTANTS)
        stored = {name: values[own] for name, values in histories.items()}
        for rows, start in zip(wanted, starts, strict=True):
            block = rows.out[:, own]
            for product in rows.products:
                _write(product, stored[product.history], block)
            if rows.minus:
                np.subtract(0.0 if start is None else start, block, out=block)
            elif start is not None:
                block += start


def _write(product: Product, values: Floats, block: Floats) -> None:
    """Write the rows of a product, or add to them, for some instants of a history."""
    taken, rows = values[:, product.columns].T, product.rows
    if product.weights is not None:
        if product.added:
            block[rows] += product.weights @ taken
        elif isinstance(rows, slice):
            np.matmul(product.weights, taken, out=block[rows])
        else:
            block[rows] = product.weights @ taken
    elif not product.beside:
        block[rows] = taken
    else:
        found = taken + values[:, product.beside[0]].T
        for columns in product.beside[1:]:
            found += values[:, columns].T
        block[rows] = found
