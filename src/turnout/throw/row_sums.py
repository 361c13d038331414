"""Rows over time as weighted sums of columns of histories, in which an instant lies in one piece.

Columns are turned, eight neighbours over some instants at a time, into lines that stay in the
processor's caches; rows are sums of such lines, so that histories are read and rows written once.

Stands alone: kernels are compiled again when one of their files changes.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.kernels.compiled import compiled
from turnout.kernels.lanes import LANES, broadcast, load, multiply_add, store_nontemporal, turn
from turnout.kernels.native import vector_at

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TILE = 4 * LANES
"""Instants that are summed at once: four sums keep the processor busy."""
LINE = TILE + LANES
"""Floats from one line to the next; lines as long as a power of two meet in the same cache sets."""


class RowSums(NamedTuple):
    """Columns to be summed for each row.

    Attributes
    ----------
    window_history, window_column : ndarray of int, shape (n_windows,)
        History and first column of each window of eight columns; a window begins at a cache line.
    row_start : ndarray of int, shape (n_rows + 1,)
        First term of each row.
    place : ndarray of int, shape (n_terms,)
        Where the line of the column of each term begins.
    weight : ndarray, shape (n_terms,)
        Its weight.
    start : ndarray, shape (n_rows,)
        Value of each row to which its terms are added in their order, each rounded once.
    """

    window_history: Ints
    window_column: Ints
    row_start: Ints
    place: Ints
    weight: Floats
    start: Floats


@compiled
def write_row_sums(
    sums: RowSums, first: Ints, step: Ints, lines: Floats, out: Floats, count: int
) -> None:
    """Write rows over time.

    Parameters
    ----------
    sums : RowSums
        A record of `turnout.kernels.shared_record`.
    first, step : ndarray of int, shape (n_histories,)
        Address of the first number of each history, and floats from one instant to the next.
    lines : ndarray, shape (8 n_windows LINE,)
        Memory for the turned columns, which holds numbers.
    out : ndarray, shape (n_rows n_written,)
        Memory of all rows, each as long as `count` rounded up to whole tiles.
    count : int
        Number of instants.
    """
    written = -(-count // TILE) * TILE
    for begin in range(0, count, TILE):
        size = min(TILE, count - begin)
        whole = size - size % LANES
        for w in range(sums.window_column.size):
            apart, line = step[sums.window_history[w]], w * LANES * LINE
            at = first[sums.window_history[w]] + 8 * (apart * begin + sums.window_column[w])
            for t in range(0, whole, LANES):
                eight = vector_at(at + 8 * apart * t, 7 * apart + LANES)
                turn(eight, apart, lines[line + t :], LINE)
            for t in range(whole, size):
                one = vector_at(at + 8 * apart * t, LANES)
                for k in range(LANES):
                    lines[line + k * LINE + t] = one[k]
        for row in range(sums.start.size):
            a = broadcast(sums.start[row])
            b, c, d = a, a, a
            for term in range(sums.row_start[row], sums.row_start[row + 1]):
                at, weight = sums.place[term], broadcast(sums.weight[term])
                a = multiply_add(weight, load(lines, at), a)
                b = multiply_add(weight, load(lines, at + LANES), b)
                c = multiply_add(weight, load(lines, at + 2 * LANES), c)
                d = multiply_add(weight, load(lines, at + 3 * LANES), d)
            to = row * written + begin
            store_nontemporal(a, out, to)
            store_nontemporal(b, out, to + LANES)
            store_nontemporal(c, out, to + 2 * LANES)
            store_nontemporal(d, out, to + 3 * LANES)
