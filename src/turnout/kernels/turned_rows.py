"""Rows over time from histories: a stored instant lies in one piece there, a row here.

Columns of a tile of instants are turned, eight neighbours of a cache line at a time, into lines
that stay in the processor's caches; rows are sums of such lines. Histories are read once and rows
written once.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.kernels.compiled import compiled
from turnout.kernels.lanes import (
    LANES,
    broadcast,
    gather,
    load,
    multiply_add,
    prefetch,
    store,
    store_nontemporal,
)
from turnout.kernels.memory import vector_at

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TILE = 64
"""Instants of a tile."""
PLAIN, PLUS, MINUS = 0, 1, 2
"""A row is its sum, its start plus the sum, or its start minus the sum."""


class RowSums(NamedTuple):
    """Which columns come to which rows.

    Attributes
    ----------
    column_address, column_step, column_history : ndarray of int, shape (n_columns,)
        Address of the first instant of a column, floats from one instant to the next, and the
        number of its history.
    place : ndarray of int, shape (8 n_histories,)
        Where eight instants of a history lie, in floats.
    row_address, row_kind : ndarray of int, shape (n_rows,)
        Address of the first instant of a row, and `PLAIN`, `PLUS` or `MINUS`.
    row_start : ndarray, shape (n_rows,)
        Where rows start.
    group_start : ndarray of int, shape (n_rows + 1,)
        First group of each row; groups are summed one by one.
    group_weighted : ndarray of int, shape (n_groups,)
        Whether its columns have weights; their products are added without being rounded before.
    term_start : ndarray of int, shape (n_groups + 1,)
        First term of each group.
    term_column : ndarray of int, shape (n_terms,)
        Column of each term.
    term_weight : ndarray, shape (n_terms,)
        Its weight.
    """

    column_address: Ints
    column_step: Ints
    column_history: Ints
    place: Ints
    row_address: Ints
    row_kind: Ints
    row_start: Floats
    group_start: Ints
    group_weighted: Ints
    term_start: Ints
    term_column: Ints
    term_weight: Floats


@compiled
def write_row_sums(sums: RowSums, lines: Floats, count: int) -> None:
    """Write rows over `count` instants.

    Parameters
    ----------
    sums : RowSums
        A record of `turnout.kernels.shared_record`.
    lines : ndarray, shape (n_columns + 2, TILE)
        Memory for the turned columns, and for two sums.
    count : int
        Number of instants.
    """
    n_columns = sums.column_address.size
    total, part = lines[n_columns], lines[n_columns + 1]
    for first in range(0, count, TILE):
        size = min(TILE, count - first)
        _turn(sums, first, size, lines)
        for row in range(sums.row_address.size):
            begin, end = sums.group_start[row], sums.group_start[row + 1]
            if begin == end:  # nothing is known of it
                continue
            for group in range(begin, end):
                _sum_group(sums, group, lines, total if group == begin else part)
                if group > begin:
                    for i in range(0, TILE, LANES):
                        store(load(total, i) + load(part, i), total, i)
            out = vector_at(sums.row_address[row] + 8 * first, size)
            past = sums.row_address[row] % (8 * LANES) == 0
            _write_row(sums.row_kind[row], sums.row_start[row], total, out, past)


@compiled
def _turn(sums: RowSums, first: int, size: int, lines: Floats) -> None:
    """Write some instants of all columns to lines, eight at a time: these are eight streams."""
    whole = size - size % LANES
    for t in range(0, whole, LANES):
        for c in range(sums.column_address.size):
            step = sums.column_step[c]
            address = sums.column_address[c] + 8 * step * (first + t)
            # The processor foresees lines of one instant, but not those of the next eight.
            prefetch(vector_at(address + 8 * step * (LANES + c % LANES), 1))
            column = vector_at(address, 7 * step + 1)
            store(gather(column, sums.place, LANES * sums.column_history[c]), lines[c], t)
    for t in range(whole, size):
        for c in range(sums.column_address.size):
            step = sums.column_step[c]
            lines[c, t] = vector_at(sums.column_address[c] + 8 * step * (first + t), 1)[0]


@compiled
def _sum_group(sums: RowSums, group: int, lines: Floats, to: Floats) -> None:
    """Write the sum of the columns of a group to a line."""
    begin, end = sums.term_start[group], sums.term_start[group + 1]
    if sums.group_weighted[group]:
        for i in range(0, TILE, LANES):
            store(broadcast(0.0), to, i)
        for term in range(begin, end):
            line, weight = lines[sums.term_column[term]], broadcast(sums.term_weight[term])
            for i in range(0, TILE, LANES):
                store(multiply_add(weight, load(line, i), load(to, i)), to, i)
        return
    line = lines[sums.term_column[begin]]
    for i in range(0, TILE, LANES):
        store(load(line, i), to, i)
    for term in range(begin + 1, end):
        line = lines[sums.term_column[term]]
        for i in range(0, TILE, LANES):
            store(load(to, i) + load(line, i), to, i)


@compiled
def _write_row(kind: int, start: float, total: Floats, out: Floats, past: bool) -> None:
    """Write a line to a row, from where it starts; past the caches where it begins at a line."""
    if kind == MINUS:
        for i in range(0, TILE, LANES):
            store(broadcast(start) - load(total, i), total, i)
    elif kind == PLUS:
        for i in range(0, TILE, LANES):
            store(load(total, i) + broadcast(start), total, i)
    whole = out.size - out.size % LANES
    if past:
        for i in range(0, whole, LANES):
            store_nontemporal(load(total, i), out, i)
    else:
        for i in range(0, whole, LANES):
            store(load(total, i), out, i)
    for i in range(whole, out.size):
        out[i] = total[i]
