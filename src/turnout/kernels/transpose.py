"""Rows over time from histories: a stored instant lies in one piece there, a row here.

Columns of a tile of instants are turned, eight neighbours at eight instants at a time, into lines
that stay in the processor's caches; rows are sums of such lines. Histories are read once and rows
written once: a row is summed as soon as all its columns are turned, so that the processor turns
and sums while it waits for what is turned next.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.kernels.compiled import compiled, compiled_part
from turnout.kernels.lanes import (
    LANES,
    broadcast,
    load,
    multiply_add,
    prefetch,
    store,
    store_nontemporal,
    turn,
)
from turnout.kernels.memory import vector_at

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TILE = 4 * LANES
"""Instants of a tile, which are summed at once: four sums keep the processor busy."""
LINE = TILE + LANES
"""Floats from one line to the next; lines as long as a power of two meet in the same cache sets."""
PAIR = 2
"""Windows that are turned before rows are summed: processors fetch lines of memory in pairs."""
PLAIN, PLUS, MINUS = 0, 1, 2
"""A row is its sum, its start plus the sum, or its start minus the sum."""


class RowSums(NamedTuple):
    """Columns to be summed for each row.

    Columns are turned in windows of eight neighbours, which may overlap, a `PAIR` at a time. Rows
    come in the order in which their columns are turned.

    Attributes
    ----------
    window_step, window_history : ndarray of int, shape (n_windows,)
        Floats from one instant of a window to the next, and the number of its history.
    window_line : ndarray of int, shape (n_windows,)
        Where the lines of its columns begin. Lines are reused once no later row needs them, so that
        nearly all stay in the nearest cache.
    pair_row : ndarray of int, shape (n_pairs + 1,)
        First row of each pair: of those whose last column is among it.
    row_kind, row_near : ndarray of int, shape (n_rows,)
        `PLAIN`, `PLUS` or `MINUS`, and whether a row is soon read and stays in the caches.
    row_start : ndarray, shape (n_rows,)
        Where rows start.
    group_start : ndarray of int, shape (n_rows + 1,)
        First group of each row; groups are summed one by one.
    group_weighted : ndarray of int, shape (n_groups,)
        Whether its columns have weights; their products are added without being rounded before.
    term_start : ndarray of int, shape (n_groups + 1,)
        First term of each group.
    term_place : ndarray of int, shape (n_terms,)
        Where the line of the column of each term begins.
    term_weight : ndarray, shape (n_terms,)
        Its weight.
    """

    window_step: Ints
    window_history: Ints
    window_line: Ints
    pair_row: Ints
    row_kind: Ints
    row_near: Ints
    row_start: Floats
    group_start: Ints
    group_weighted: Ints
    term_start: Ints
    term_place: Ints
    term_weight: Floats


@compiled
def write_row_sums(sums: RowSums, windows: Ints, rows: Ints, lines: Floats, count: int) -> None:
    """Write rows over `count` instants.

    Parameters
    ----------
    sums : RowSums
        A record of `turnout.kernels.shared_record`.
    windows : ndarray of int, shape (n_windows,)
        Addresses of the first instant of each window.
    rows : ndarray of int, shape (n_rows,)
        Addresses of the first instant of each row.
    lines : ndarray, shape (n_lines LINE,)
        Memory for the turned columns, and in its last line for a sum.
    count : int
        Number of instants.
    """
    total = lines[lines.size - LINE :]
    for first in range(0, count, TILE):
        size = min(TILE, count - first)
        for pair in range(sums.pair_row.size - 1):
            _turn_pair(sums, windows, pair, first, size, lines)
            for row in range(sums.pair_row[pair], sums.pair_row[pair + 1]):
                address = rows[row] + 8 * first
                out = vector_at(address, size)
                if size == TILE:
                    past = sums.row_near[row] == 0 and address % (8 * LANES) == 0
                    _write_row(sums, row, lines, out, past)
                else:
                    _write_row(sums, row, lines, total, False)
                    for k in range(size):
                        out[k] = total[k]


@compiled_part
def _turn_pair(
    sums: RowSums, windows: Ints, pair: int, first: int, size: int, lines: Floats
) -> None:
    """Write some instants of a pair of windows to lines, and bring those of the next one close."""
    whole = size - size % LANES
    for w in range(PAIR * pair, min(PAIR * (pair + 1), windows.size)):
        ahead, later = w + PAIR, first
        if ahead >= windows.size:
            ahead, later = ahead % windows.size, first + TILE
        step, apart, begin = sums.window_step[w], 8 * sums.window_step[ahead], sums.window_line[w]
        near = windows[ahead] + apart * later
        for t in range(0, whole, LANES):
            # The processor foresees lines of one instant, but not those of others.
            for k in range(t, t + LANES):
                prefetch(vector_at(near + apart * k, 1))
            eight = vector_at(windows[w] + 8 * step * (first + t), 7 * step + LANES)
            turn(eight, step, lines[begin + t :], LINE)
        for t in range(whole, size):
            one = vector_at(windows[w] + 8 * step * (first + t), LANES)
            for k in range(LANES):
                lines[begin + k * LINE + t] = one[k]


@compiled_part
def _write_row(sums: RowSums, row: int, lines: Floats, out: Floats, past: bool) -> None:
    """Write a row over the instants of a tile; past the caches only to the begin of a line."""
    begin, end = sums.group_start[row], sums.group_start[row + 1]
    a, b, c, d = _sum_group(sums, begin, lines)
    for group in range(begin + 1, end):
        e, f, g, h = _sum_group(sums, group, lines)
        a, b, c, d = a + e, b + f, c + g, d + h
    start = broadcast(sums.row_start[row])
    if sums.row_kind[row] == MINUS:
        a, b, c, d = start - a, start - b, start - c, start - d
    elif sums.row_kind[row] == PLUS:
        a, b, c, d = a + start, b + start, c + start, d + start
    if past:
        store_nontemporal(a, out, 0)
        store_nontemporal(b, out, LANES)
        store_nontemporal(c, out, 2 * LANES)
        store_nontemporal(d, out, 3 * LANES)
    else:
        store(a, out, 0)
        store(b, out, LANES)
        store(c, out, 2 * LANES)
        store(d, out, 3 * LANES)


@compiled_part
def _sum_group(sums: RowSums, group: int, lines: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the sum of the columns of a group over a tile."""
    begin, end = sums.term_start[group], sums.term_start[group + 1]
    if sums.group_weighted[group]:
        a, b, c, d = broadcast(0.0), broadcast(0.0), broadcast(0.0), broadcast(0.0)
        for term in range(begin, end):
            at, weight = sums.term_place[term], broadcast(sums.term_weight[term])
            a = multiply_add(weight, load(lines, at), a)
            b = multiply_add(weight, load(lines, at + LANES), b)
            c = multiply_add(weight, load(lines, at + 2 * LANES), c)
            d = multiply_add(weight, load(lines, at + 3 * LANES), d)
        return a, b, c, d
    at = sums.term_place[begin]
    a, b = load(lines, at), load(lines, at + LANES)
    c, d = load(lines, at + 2 * LANES), load(lines, at + 3 * LANES)
    for term in range(begin + 1, end):
        at = sums.term_place[term]
        a = a + load(lines, at)
        b = b + load(lines, at + LANES)
        c = c + load(lines, at + 2 * LANES)
        d = d + load(lines, at + 3 * LANES)
    return a, b, c, d
