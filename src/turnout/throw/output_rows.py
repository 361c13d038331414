"""Rows over time as weighted sums of the columns of histories.

A history holds an instant after the other, a channel a place after the other. All linear outputs
of a run are ``start + weights @ history``, with few weights in each row; throws of the same rails
share them.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from turnout.core.lru_cache import SharedResults
from turnout.kernels.lanes import LANES, whole_lines, zeros_in_lines
from turnout.kernels.shared_record import address_of, shared_record
from turnout.solver.state import lines_from_buffer
from turnout.throw.row_sums import LINE, TILE, RowSums, write_row_sums

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

HISTORIES = ("q", "g", "law_force", "friction_force")
"""Histories of a run whose columns are summed, by their attributes."""


@dataclass(frozen=True, eq=False)
class OutputRows:
    """Rows over time: a start, and weighted columns of histories.

    Attributes
    ----------
    start : ndarray, shape (n_rows,)
        NaN where nothing is known of a row.
    row, history, column : ndarray of int, shape (n_terms,)
        Row of each term, its place in `HISTORIES`, and its column there.
    weight : ndarray, shape (n_terms,)
        Weight of each term.
    """

    start: Floats
    row: Ints
    history: Ints
    column: Ints
    weight: Floats

    @cached_property
    def sums(self) -> RowSums:
        """Terms by row as a kernel takes them."""
        order = np.lexsort((self.column, self.history, self.row))
        window, span = self.column // LANES, int(self.column.max(initial=0)) + 1
        used, number = np.unique((self.history * span + window)[order], return_inverse=True)
        return shared_record(
            RowSums(
                window_history=used // span,
                window_column=used % span * LANES,
                row_start=np.searchsorted(self.row[order], np.arange(self.start.size + 1)),
                place=(number.reshape(-1) * LANES + self.column[order] % LANES) * LINE,
                weight=self.weight[order],
                start=self.start,
            )
        )

    def over_time(self, histories: Mapping[str, Floats]) -> Floats:
        """Return the rows over the instants of some histories.

        Parameters
        ----------
        histories : mapping of str to ndarray, each of shape (n_times, n_columns)
            By the names in `HISTORIES`.

        Returns
        -------
        ndarray, shape (n_rows, n_times)

        Raises
        ------
        ValueError
            If a history has too few columns or other instants than the first one.

        Examples
        --------
        >>> histories = dict.fromkeys(HISTORIES, np.arange(12.0).reshape(3, 4))
        >>> sums_of_columns("g", [[0, 1], [2, 3]]).over_time(histories).tolist()
        [[1.0, 9.0, 17.0], [5.0, 13.0, 21.0]]
        """
        given = [histories[name] for name in HISTORIES]
        count = given[0].shape[0]
        for number, (name, values) in enumerate(zip(HISTORIES, given, strict=True)):
            needed = self.column[self.history == number].max(initial=-1)
            if values.shape[0] != count or values.shape[1] <= needed:
                message = f"the history {name} must hold {count} instants and {needed + 1} columns"
                raise ValueError(message)
        given = [_in_lines(values) for values in given]
        written = -(-count // TILE) * TILE
        out = lines_from_buffer(self.start.size * written)
        write_row_sums(
            self.sums,
            np.array([address_of(values) for values in given]),
            np.array([values.strides[0] // 8 for values in given]),
            np.zeros(self.sums.window_column.size * LANES * LINE),
            out,
            count,
        )
        return out.reshape(self.start.size, written)[:, :count]


def _in_lines(values: Floats) -> Floats:
    """Return a history whose instants each lie in whole cache lines, as those of runs do."""
    if values.dtype == np.float64 and values.strides[1] == 8 and values.strides[0] % 64 == 0:
        return values
    count, width = values.shape
    found = zeros_in_lines(count, whole_lines(width))[:, :width]
    found[:] = values
    return found


def sums_of_columns(
    history: str, columns: Iterable[Sequence[int]], *, sign: float = 1.0
) -> OutputRows:
    """Return rows as sums of columns of a history.

    Parameters
    ----------
    history : str
        One of `HISTORIES`.
    columns : iterable of sequence of int
        Columns of each row; of a row without any nothing is known.
    sign : float
        Weight of all columns.
    """
    columns = [*columns]
    counts = np.array([len(own) for own in columns], dtype=np.int64)
    column = np.array([number for own in columns for number in own], dtype=np.int64)
    return OutputRows(
        start=np.where(counts > 0, 0.0, np.nan),
        row=np.repeat(np.arange(counts.size), counts),
        history=np.full(column.size, HISTORIES.index(history)),
        column=column,
        weight=np.full(column.size, sign),
    )


def weighted_columns(start: Floats, weights: Mapping[str, Floats]) -> OutputRows:
    """Return rows by matrices of weights, in which most are 0.

    Parameters
    ----------
    start : ndarray, shape (n_rows,)
    weights : mapping of str to ndarray, shape (n_rows, n_columns)
        By history.
    """
    found = [np.nonzero(matrix) for matrix in weights.values()]
    return OutputRows(
        start,
        row=np.concatenate([row for row, _ in found]),
        history=np.repeat([HISTORIES.index(name) for name in weights], [r.size for r, _ in found]),
        column=np.concatenate([column for _, column in found]),
        weight=np.concatenate([m[at] for m, at in zip(weights.values(), found, strict=True)]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class RowBlock:
    """Named rows over time, which come in one piece of memory.

    Attributes
    ----------
    rows : OutputRows
    parts : mapping of str to (int, tuple of int)
        First row and shape of what they are named, without the axis of time.
    """

    rows: OutputRows
    parts: Mapping[str, tuple[int, tuple[int, ...]]]

    def over_time(self, histories: Mapping[str, Floats]) -> dict[str, Floats]:
        """Return the rows over time by name."""
        made = self.rows.over_time(histories)
        return {
            name: made[first : first + math.prod(shape)].reshape(*shape, made.shape[1])
            for name, (first, shape) in self.parts.items()
        }


def merge_blocks(blocks: Sequence[RowBlock]) -> RowBlock:
    """Merge blocks into one."""
    parts: dict[str, tuple[int, tuple[int, ...]]] = {}
    first = 0
    for block in blocks:
        parts |= {name: (first + row, shape) for name, (row, shape) in block.parts.items()}
        first += block.rows.start.size
    return RowBlock(stack_rows([block.rows for block in blocks]), parts)


def stack_rows(rows: Sequence[OutputRows]) -> OutputRows:
    """Return rows one below the other."""
    firsts = np.cumsum([0, *(item.start.size for item in rows)])
    return OutputRows(
        start=np.concatenate([item.start for item in rows]),
        row=np.concatenate([first + r.row for first, r in zip(firsts, rows, strict=False)]),
        history=np.concatenate([item.history for item in rows]),
        column=np.concatenate([item.column for item in rows]),
        weight=np.concatenate([item.weight for item in rows]),
    )


row_blocks = SharedResults[RowBlock](16)
"""Blocks of rows, with the rails that they keep in memory."""
