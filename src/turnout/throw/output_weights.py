"""Rows over time as sums and products of the columns of histories.

Throws of the same rails share their weights, which are made once (`turnout.throw.rows_over_time`
writes the rows).
"""

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.core.lru_cache import LRUCache
from turnout.throw.rows_over_time import Product, WeightedRows, clear_layouts, rows_in_lines

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LONGEST_GAP = 24
"""Columns without a weight between others, above which a product is made in parts."""


def evenly_spaced(places: Ints) -> slice | Ints:
    """Return indices as a slice, which copies nothing, if they rise evenly.

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


class RowWeights(NamedTuple):
    """Terms of rows, as in `WeightedRows`, without the array they are written to."""

    products: tuple[Product, ...]
    start: Floats | None = None
    minus: bool = False
    near: bool = False
    unknown: Sequence[int] = ()

    def into(self, out: Floats) -> WeightedRows:
        """Return the rows, to be written somewhere; the `unknown` ones are NaN from now on."""
        if self.unknown:
            out[list(self.unknown)] = np.nan
        return WeightedRows(self.products, out, self.start, self.minus, self.near)


class RowBlock(NamedTuple):
    """Rows over time in one piece of memory, the larger the fewer pages it takes.

    Attributes
    ----------
    weights : sequence of (RowWeights, int)
        Weights of the rows, and how many rows each of them makes.
    parts : mapping of str to (int, tuple of int)
        First row and shape of what they are named, without the axis of time.
    """

    weights: Sequence[tuple[RowWeights, int]]
    parts: Mapping[str, tuple[int, tuple[int, ...]]]

    def lay_out(self, count: int) -> tuple[dict[str, Floats], list[WeightedRows]]:
        """Return arrays over `count` instants by name, and the rows to be written there."""
        memory = rows_in_lines(sum([size for _, size in self.weights]), count)
        wanted, first = list[WeightedRows](), 0
        for item, size in self.weights:
            wanted.append(item.into(memory[first : first + size]))
            first += size
        arrays = {
            name: memory[first : first + math.prod(shape)].reshape(*shape, count)
            for name, (first, shape) in self.parts.items()
        }
        return arrays, wanted


def merge_blocks(blocks: Sequence[RowBlock]) -> RowBlock:
    """Merge blocks into one with one piece of memory, which is freed once no part is in use."""
    weights, first = list[tuple[RowWeights, int]](), 0
    parts: dict[str, tuple[int, tuple[int, ...]]] = {}
    for block in blocks:
        weights += block.weights
        parts |= {name: (first + row, shape) for name, (row, shape) in block.parts.items()}
        first += sum(size for _, size in block.weights)
    return RowBlock(weights, parts)


# What weights depend on is named by identity, and kept beside them so that nothing else takes its
# place.
_blocks = LRUCache[tuple[tuple[RowBlock, ...], Sequence[object]]](16)


def kept_row_blocks(
    named: Sequence[object], values: Sequence[Hashable], make: Callable[[], Sequence[RowBlock]]
) -> tuple[RowBlock, ...]:
    """Return blocks of rows, made once for the same objects and values.

    Parameters
    ----------
    named : sequence of object
        Objects that they depend on and throws share, known by identity and not changed any more.
    values : sequence of hashable
        Further values that they depend on.
    make : callable
        Makes them.
    """
    key = (*map(id, named), *values)
    kept = _blocks.get(key)
    if kept is None:
        kept = _blocks.put(key, (tuple(make()), named))
    return kept[0]


def clear_row_blocks() -> None:
    """Forget all weights, and the rails that they keep in memory."""
    _blocks.clear()
    clear_layouts()


def sums_of_columns(history: str, columns: Ints, *, rows: Ints) -> list[Product]:
    """Return rows as sums of columns.

    Parameters
    ----------
    history : str
        Of the columns.
    columns : ndarray of int, shape (n, n_summed)
        For each row the columns that are added, in this order.
    rows : ndarray of int, shape (n,)
        Rows that the sums are written to.
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
    apart = (np.diff(several) > 2) | (np.abs(np.diff(first_column)) > LONGEST_GAP)
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
        Rows that they are written to.
    begun : bool
        Whether they hold something to which the products are added.
    """
    used = np.flatnonzero(weights.any(axis=0))
    if not used.size:
        nothing = Product(history, slice(0, 0), rows, weights[:, :0])
        return [] if begun else [nothing]
    ends = np.flatnonzero(np.diff(used) > LONGEST_GAP) + 1
    runs = [slice(int(run[0]), int(run[-1]) + 1) for run in np.split(used, ends)]
    return [
        Product(history, run, rows, weights[:, run].copy(), added=begun or number > 0)
        for number, run in enumerate(runs)
    ]
