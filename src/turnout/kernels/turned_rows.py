"""Rows over time from histories: a stored instant lies in one piece there, a row here.

Columns of a tile of instants are turned, eight neighbours at eight instants at a time, into lines
that stay in the processor's caches; rows are sums of such lines. Histories are read once and rows
written once.
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

TILE = 64
"""Instants of a tile."""
LINE = TILE + LANES
"""Floats from one line to the next; lines as long as a power of two meet in the same cache sets."""
PASS = 4 * LANES
"""Instants that are summed at once: four sums keep the processor busy."""
PLAIN, PLUS, MINUS = 0, 1, 2
"""A row is its sum, its start plus the sum, or its start minus the sum."""


class RowSums(NamedTuple):
    """Which columns come to which rows.

    Columns are turned in windows of eight neighbours, which may overlap.

    Attributes
    ----------
    window_step, window_history : ndarray of int, shape (n_windows,)
        Floats from one instant of a window to the next, and the number of its history.
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
    term_line : ndarray of int, shape (n_terms,)
        Line of the column of each term: eight for each window.
    term_weight : ndarray, shape (n_terms,)
        Its weight.
    """

    window_step: Ints
    window_history: Ints
    row_kind: Ints
    row_near: Ints
    row_start: Floats
    group_start: Ints
    group_weighted: Ints
    term_start: Ints
    term_line: Ints
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
    lines : ndarray, shape ((8 n_windows + 1) LINE,)
        Memory for the turned columns, and for a sum.
    count : int
        Number of instants.
    """
    total = lines[LANES * windows.size * LINE :]
    for first in range(0, count, TILE):
        size = min(TILE, count - first)
        _turn_tile(sums, windows, first, size, lines)
        for row in range(rows.size):
            if sums.group_start[row] == sums.group_start[row + 1]:  # nothing is known of it
                continue
            for i in range(0, size, PASS):
                address = rows[row] + 8 * (first + i)
                out = vector_at(address, min(PASS, size - i))
                part = out.size < PASS
                past = not part and sums.row_near[row] == 0 and address % (8 * LANES) == 0
                _write_pass(sums, row, lines, i, total if part else out, past)
                if part:
                    for k in range(out.size):
                        out[k] = total[k]


@compiled_part
def _turn_tile(sums: RowSums, windows: Ints, first: int, size: int, lines: Floats) -> None:
    """Write some instants of all windows to lines, eight at a time: these are eight streams."""
    whole = size - size % LANES
    for t in range(0, whole, LANES):
        for w in range(windows.size):
            step = sums.window_step[w]
            address = windows[w] + 8 * step * (first + t)
            # The processor foresees lines of one instant, but not those of the next eight.
            for k in range(LANES, 2 * LANES):
                prefetch(vector_at(address + 8 * step * k, 1))
            turn(vector_at(address, 7 * step + LANES), step, lines[LANES * w * LINE + t :], LINE)
    for t in range(whole, size):
        for w in range(windows.size):
            step = sums.window_step[w]
            eight = vector_at(windows[w] + 8 * step * (first + t), LANES)
            for k in range(LANES):
                lines[(LANES * w + k) * LINE + t] = eight[k]


@compiled_part
def _write_pass(sums: RowSums, row: int, lines: Floats, i: int, out: Floats, past: bool) -> None:
    """Write a row over the instants of a pass; past the caches where it begins at a line of them.

    `i` is the first of these instants in the lines.
    """
    begin, end = sums.group_start[row], sums.group_start[row + 1]
    a, b, c, d = _sum_group(sums, begin, lines, i)
    for group in range(begin + 1, end):
        e, f, g, h = _sum_group(sums, group, lines, i)
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
def _sum_group(
    sums: RowSums, group: int, lines: Floats, i: int
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the sum of the columns of a group over a pass."""
    begin, end = sums.term_start[group], sums.term_start[group + 1]
    if sums.group_weighted[group]:
        a, b, c, d = broadcast(0.0), broadcast(0.0), broadcast(0.0), broadcast(0.0)
        for term in range(begin, end):
            at, weight = sums.term_line[term] * LINE + i, broadcast(sums.term_weight[term])
            a = multiply_add(weight, load(lines, at), a)
            b = multiply_add(weight, load(lines, at + LANES), b)
            c = multiply_add(weight, load(lines, at + 2 * LANES), c)
            d = multiply_add(weight, load(lines, at + 3 * LANES), d)
        return a, b, c, d
    at = sums.term_line[begin] * LINE + i
    a, b = load(lines, at), load(lines, at + LANES)
    c, d = load(lines, at + 2 * LANES), load(lines, at + 3 * LANES)
    for term in range(begin + 1, end):
        at = sums.term_line[term] * LINE + i
        a = a + load(lines, at)
        b = b + load(lines, at + LANES)
        c = c + load(lines, at + 2 * LANES)
        d = d + load(lines, at + 3 * LANES)
    return a, b, c, d
