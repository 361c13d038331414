"""Histories turned to channels: columns of stored instants become rows over time.

Histories hold an instant after the other, channels a place after the other. What is wanted of them
is collected here, and written by one kernel (`turnout.kernels.transpose`).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.core.lru_cache import LRUCache
from turnout.kernels.lanes import LANES, whole_lines
from turnout.kernels.shared_record import address_of, shared_record
from turnout.kernels.transpose import (
    LINE,
    MINUS,
    PAIR,
    PLAIN,
    PLUS,
    RowSums,
    write_row_sums,
)
from turnout.solver.scratch import lines_from_buffer

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def rows_in_lines(*shape: int) -> Floats:
    """Return uninitialised rows over time that begin at cache lines, as is quickest to write.

    Parameters
    ----------
    *shape : int
        The last one is the number of instants.
    """
    *before, count = shape
    return lines_from_buffer(*before, whole_lines(count))[..., :count]


@dataclass(frozen=True, slots=True, eq=False)
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


class WeightedRows(NamedTuple):
    """Wanted rows over time: their starts, plus or minus some products.

    Attributes
    ----------
    products : sequence of Product
        In this order; all rows are written by them.
    out : ndarray, shape (n_rows, n_times)
        Array that the rows are written to.
    start : ndarray, shape (n_rows,), optional
        Default 0.
    minus : bool
        Whether the products are subtracted.
    near : bool
        Whether the rows are read soon, and therefore stay in the processor's caches.
    """

    products: Sequence[Product]
    out: Floats
    start: Floats | None = None
    minus: bool = False
    near: bool = False


def write_rows(wanted: Sequence[WeightedRows], histories: Mapping[str, Floats]) -> None:
    """Write rows over time; histories are read once.

    Parameters
    ----------
    wanted : sequence of Rows
        All over the same instants.
    histories : mapping of str to ndarray, each of shape (n_times, n_columns)
        By the names in the products; all of the same instants.

    Raises
    ------
    ValueError
        If something is not of these shapes, not of floats, or cannot be written: the kernel gets
        addresses and cannot know.

    Examples
    --------
    >>> products = [Product("g", slice(0, 3, 2), slice(0, 2), beside=(slice(1, 4, 2),))]
    >>> found = np.empty((2, 3))
    >>> write_rows([WeightedRows(products, found)], {"g": np.arange(12.0).reshape(3, 4)})
    >>> found.tolist()
    [[1.0, 9.0, 17.0], [5.0, 13.0, 21.0]]
    """
    count = max((rows.out.shape[1] for rows in wanted), default=0)
    _check_arrays(wanted, histories, count)
    wanted = [rows for rows in wanted if rows.products and rows.out.size]
    if not wanted:
        return
    turned = {name: _with_a_window(values) for name, values in histories.items()}
    layout = _layout(wanted, histories, turned)
    sums = layout.sums
    first, place = _addresses(turned.values()), _addresses([rows.out for rows in wanted])
    apart = np.array([rows.out.strides[0] for rows in wanted], dtype=np.int64)
    windows = first[sums.window_history] + layout.window_offset
    lines = lines_from_buffer(layout.lines * LINE)
    rows_at = place[layout.part] + apart[layout.part] * layout.number
    write_row_sums(sums, windows, rows_at, lines, count)


def _with_a_window(values: Floats) -> Floats:
    """Return a history of eight columns or more whose neighbours are neighbours in memory."""
    if values.shape[1] >= LANES and values.strides[1] == 8:
        return values
    return np.pad(values, ((0, 0), (0, max(LANES - values.shape[1], 0))))


def _check_arrays(
    wanted: Sequence[WeightedRows], histories: Mapping[str, Floats], count: int
) -> None:
    """Refuse arrays that a kernel with addresses alone would misread or overwrite."""
    for rows in wanted:
        out, start = rows.out, rows.start
        if out.size and not (out.flags.writeable and out.strides[1] == 8):
            message = "rows over time must be writeable and lie in memory without gaps"
            raise ValueError(message)
        fits = out.shape[1] == count and (start is None or start.shape == out.shape[:1])
        if out.size and not (fits and out.dtype == np.float64):
            message = f"rows over time must be floats of {count} instants, a start for each row"
            raise ValueError(message)
    for name, values in histories.items():
        if values.shape[0] < count or values.dtype != np.float64:
            message = f"the history {name} must be floats of {count} instants"
            raise ValueError(message)


class _Layout(NamedTuple):
    """Rows laid out for the kernel, without the addresses of a run.

    Attributes
    ----------
    sums : RowSums
        A record of `turnout.kernels.shared_record`.
    window_offset : ndarray of int
        From the first number of its history to each window [B].
    lines : int
        Number of lines that the kernel needs.
    part, number : ndarray of int, shape (n_rows,)
        `WeightedRows` of each row of which something is known, and its number in them.
    named : sequence of object
        Products and starts, by which layouts are known.
    """

    sums: RowSums
    window_offset: Ints
    lines: int
    part: Ints
    number: Ints
    named: Sequence[object]


_layouts = LRUCache[_Layout](8)


def clear_layouts() -> None:
    """Forget all layouts."""
    _layouts.clear()


def _layout(
    wanted: Sequence[WeightedRows], histories: Mapping[str, Floats], turned: Mapping[str, Floats]
) -> _Layout:
    """Return the layout of rows for the kernel, made once for the weights that throws share.

    `turned` are the histories with a window at least.
    """
    of_rows = tuple([(id(rows.products), id(rows.start), *_shape(rows)) for rows in wanted])
    key = (
        of_rows,
        *((name, values.shape[1], turned[name].strides) for name, values in histories.items()),
    )
    layout = _layouts.get(key)
    if layout is None:
        layout = _lay_out(wanted, histories, turned)
        if all(isinstance(rows.products, tuple) for rows in wanted):  # else not there to stay
            _layouts.put(key, layout)
    return layout


def _shape(rows: WeightedRows) -> tuple[int, int, bool]:
    """Return the number of rows, the way a sum becomes one, and True if they stay near."""
    return rows.out.shape[0], _kind(rows), rows.near


def _lay_out(
    wanted: Sequence[WeightedRows], histories: Mapping[str, Floats], turned: Mapping[str, Floats]
) -> _Layout:
    """Return the terms of all products, by row and product."""
    first_column = np.cumsum([0, *(values.shape[1] for values in histories.values())])
    terms, groups = _collected(wanted, histories, first_column.tolist())
    row, group, order, column, weight = terms
    of_group, in_order, weighted = groups
    history = np.searchsorted(first_column, column, side="right") - 1
    own = column - first_column[history]
    window_history, window_column, window = _windows(history, own, list(turned.values()))
    sorted_rows, pair_row, last = _in_pairs(np.unique(of_group), row, window, window_history.size)
    line = _reuse_lines(last)
    place = (line[window] + own - window_column[window]) * LINE
    counts = [rows.out.shape[0] for rows in wanted]
    rank = np.empty(sum(counts), dtype=np.int64)
    rank[sorted_rows] = np.arange(sorted_rows.size)
    row, of_group = rank[row], rank[of_group]
    by_group, by_row = np.lexsort((in_order, of_group)), np.lexsort((order, group, row))
    # Groups in the order of rows and products have one number that rises.
    span = int(in_order.max(initial=0)) + 1
    begins = np.searchsorted((row * span + group)[by_row], (of_group * span + in_order)[by_group])
    steps = np.array([values.strides[0] // 8 for values in turned.values()])
    sums = RowSums(
        window_step=steps[window_history],
        window_history=window_history,
        window_line=line * LINE,
        pair_row=pair_row,
        row_kind=np.repeat([_kind(rows) for rows in wanted], counts)[sorted_rows],
        row_near=np.repeat([int(rows.near) for rows in wanted], counts)[sorted_rows],
        row_start=np.concatenate([_starts(rows) for rows in wanted])[sorted_rows],
        group_start=np.searchsorted(of_group[by_group], np.arange(sorted_rows.size + 1)),
        group_weighted=weighted[by_group],
        term_start=np.append(begins, row.size),
        term_place=place[by_row],
        term_weight=weight[by_row],
    )
    return _Layout(
        sums=shared_record(sums),
        window_offset=8 * window_column,
        lines=int(line.max(initial=-LANES)) + LANES + 1,
        part=np.repeat(np.arange(len(counts)), counts)[sorted_rows],
        number=np.concatenate([np.arange(count) for count in counts])[sorted_rows],
        named=[(rows.products, rows.start) for rows in wanted],
    )


def _collected(
    wanted: Sequence[WeightedRows], histories: Mapping[str, Floats], first_column: Sequence[int]
) -> tuple["_Terms", tuple[Ints, Ints, Ints]]:
    """Return the terms of all products that rows are left with, and row, product and kind of these.

    `first_column` is that of each history among the columns of all. A product that is not added
    takes the place of those before it.
    """
    first_of = dict(zip(histories, first_column, strict=False))
    first_row = np.cumsum([0, *(rows.out.shape[0] for rows in wanted)])
    terms, groups, number = list[_Terms](), list[tuple[Ints, int, int, bool]](), 0
    for rows, begin in zip(wanted, first_row.tolist(), strict=False):
        for product in rows.products:
            number += 1
            own = begin + _numbers(product.rows, rows.out.shape[0])
            width = histories[product.history].shape[1]
            columns = [
                first_of[product.history] + _numbers(taken, width)
                for taken in (product.columns, *product.beside)
            ]
            terms.append(_terms_of(product, own, columns, number))
            groups.append((own, number, int(product.weights is not None), product.added))
    row, group, order, column, weight = (np.concatenate(part) for part in zip(*terms, strict=True))
    of_group = np.concatenate([own for own, *_ in groups])
    sizes = [own.size for own, *_ in groups]
    in_order, weighted, added = (np.repeat([item[k] for item in groups], sizes) for k in (1, 2, 3))
    begun = np.zeros(int(first_row[-1]), dtype=np.int64)  # the last product that is not added
    np.maximum.at(begun, of_group[~added], in_order[~added])
    kept, left = group >= begun[row], in_order >= begun[of_group]
    found = row[kept], group[kept], order[kept], column[kept], weight[kept]
    return found, (of_group[left], in_order[left], weighted[left])


def _windows(history: Ints, column: Ints, turned: Sequence[Floats]) -> tuple[Ints, Ints, Ints]:
    """Return history and first column of the windows of some columns, and the window of each.

    The last window of a history ends with it, so that nothing beyond it is read.
    """
    widths = np.array([values.shape[1] for values in turned])
    first, span = np.minimum(column // LANES * LANES, widths[history] - LANES), widths.max()
    used, number = np.unique(history * span + first, return_inverse=True)
    return used // span, used % span, number


def _in_pairs(known: Ints, row: Ints, window: Ints, count: int) -> tuple[Ints, Ints, Ints]:
    """Return known rows by the pair with the last window of their terms, and the start of each.

    Last comes the last pair that needs each window. `row` and `window` are those of all terms,
    `count` is the number of windows.
    """
    last = np.zeros(int(known.max(initial=-1)) + 1, dtype=np.int64)
    np.maximum.at(last, row, window // PAIR)
    order = np.argsort(last[known], kind="stable")
    pairs = np.arange(max(-(-count // PAIR), 1) + 1)
    needed = np.arange(count) // PAIR
    np.maximum.at(needed, window, last[row])
    return known[order], np.searchsorted(last[known[order]], pairs), needed


def _reuse_lines(last: Ints) -> Ints:
    """Return the first line of each window, given the last pair that needs it.

    Lines are reused once no later row needs them, those freed last first.

    Examples
    --------
    >>> _reuse_lines(np.array([0, 2, 1, 2, 2, 2])).tolist()
    [0, 8, 0, 16, 0, 24]
    """
    lines, free, count = list[int](), list[int](), 0
    for window in range(last.size):
        if window % PAIR == 0:
            before = window // PAIR - 1
            free += [lines[k] for k in range(window) if last[k] == before]
        if not free:
            free.append(LANES * count)
            count += 1
        lines.append(free.pop())
    return np.array(lines, dtype=np.int64)


_Terms = tuple[Ints, Ints, Ints, Ints, Floats]


def _terms_of(product: Product, own: Ints, columns: Sequence[Ints], number: int) -> _Terms:
    """Return row, product, order, column and weight of the terms of a product."""
    if product.weights is None:
        row = np.tile(own, len(columns))
        column = np.concatenate(columns)
        order = np.repeat(np.arange(len(columns)), own.size)
        weight = np.ones(column.size)
    else:
        at, order = np.nonzero(product.weights)
        row, column, weight = own[at], columns[0][order], product.weights[at, order]
    return row, np.full(row.size, number), order, column, weight


def _numbers(places: slice | Ints, size: int) -> Ints:
    """Return places as indices; like NumPy refuse those beyond the end."""
    return np.arange(size)[places]


def _addresses(arrays: Iterable[Floats]) -> Ints:
    """Return the address of the first number of each array of rows that lie in one piece each."""
    return np.array([address_of(values[0]) for values in arrays], dtype=np.int64)


def _kind(rows: WeightedRows) -> int:
    """Return the way in which a sum becomes rows."""
    return MINUS if rows.minus else PLAIN if rows.start is None else PLUS


def _starts(rows: WeightedRows) -> Floats:
    """Return the start of each row, 0 by default."""
    return np.zeros(rows.out.shape[0]) if rows.start is None else rows.start
