"""Numbering of ends, modes and rows in the vector of displacements.

The vector holds, block by block, the leading ends and then the modes of the block; these are the
*solved* places. The ends that follow from leading ones come next, and last the rows that join two
blocks. A row with one end has the place of that end. Each block is padded to whole cache lines, and
so are the following ends and the joining rows; the padding is finite and means nothing. The vector
ends with one cache line of zeros.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from turnout.kernels.lanes import LANES, whole_lines
from turnout.law.table import LawTable
from turnout.solver.condense import BlockModel

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Terms = list[tuple[int, float]]


def as_unsigned(indices: Ints) -> Ints:
    """Return indices as unsigned integers, so that kernels skip the check for negative ones.

    Use them for indexing only: NumPy promotes sums of unsigned and signed integers to floats, so
    that a kernel run as a plain function would fail.
    """
    return cast("Ints", indices.astype(np.uint64))


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Places of ends, modes and rows, as numbers.

    Attributes
    ----------
    end_start, end_stop : ndarray of int, shape (n_blocks + 1,), (n_blocks,)
        Leading ends of a block, which its modes follow.
    mode_start : ndarray of int, shape (n_blocks + 1,)
        Modes of a block, counted without ends.
    follower_start : ndarray of int, shape (n_blocks + 1,)
        Ends that follow, block by block.
    of_row : ndarray of int, shape (n_rows,)
        Place of every row of the mechanism.
    row_ends : ndarray of int, shape (n_places, 2)
        Ends of the row that stands there; -1 for none.
    of_end : tuple of ndarray of int
        For each block, the places of its ends in the order of the block.
    terms : list of list of (int, float)
        Every end and mode as a sum of solved places with weights.
    """

    end_start: Ints
    end_stop: Ints
    mode_start: Ints
    follower_start: Ints
    of_row: Ints
    row_ends: Ints
    of_end: tuple[Ints, ...]
    terms: list[Terms]

    @property
    def solved(self) -> int:
        """Number of solved places."""
        return int(self.end_start[-1])

    @property
    def zero(self) -> int:
        """Number of a place whose displacement is always zero."""
        return int(self.row_ends.shape[0]) - LANES


def number_places(parts: Sequence[BlockModel]) -> Places:
    """Assign a place to every end, mode and row of the blocks.

    Leading ends that others follow come first: those of the first terms of these, then those of the
    second, and so on, so that eight terms side by side are neighbours.
    """
    leading = np.array([part.leading.leaders.size for part in parts])
    ends = np.array([part.block.rows.size for part in parts])
    mode_start = _cumulate([part.model.load.size for part in parts])
    end_start = _cumulate(whole_lines(leading + np.diff(mode_start)))
    follower_start = end_start[-1] + _cumulate(ends - leading)
    follower_start[-1] = whole_lines(follower_start[-1:])[0]
    of_end = []
    for block, part in enumerate(parts):
        follows = np.ones(part.block.rows.size, dtype=bool)
        follows[part.leading.leaders] = False
        places = follower_start[block] + np.cumsum(follows) - 1
        ordered = part.leading.leaders[_order_by_terms(part.leading.weights[follows])]
        places[ordered] = end_start[block] + np.arange(leading[block])
        of_end.append(places)
    n_rows = 1 + max((int(part.block.rows.max(initial=-1)) for part in parts), default=-1)
    row_ends = np.full((n_rows, 2), -1, dtype=np.int64)
    for part, places in zip(parts, of_end, strict=True):
        second = row_ends[part.block.rows, 0] >= 0
        row_ends[part.block.rows, second.astype(int)] = places
    joins = row_ends[:, 1] >= 0
    of_row = np.where(joins, follower_start[-1] + np.cumsum(joins) - 1, row_ends[:, 0])
    count = int(follower_start[-1] + whole_lines(joins.sum(keepdims=True))[0]) + LANES
    ends_at_place = np.full((count, 2), -1, dtype=np.int64)
    ends_at_place[of_row] = row_ends
    return Places(
        end_start=end_start,
        end_stop=end_start[:-1] + leading,
        mode_start=mode_start,
        follower_start=follower_start,
        of_row=of_row,
        row_ends=ends_at_place,
        of_end=tuple(of_end),
        terms=_assemble_terms(parts, of_end, int(end_start[-1]), int(follower_start[-1])),
    )


def _order_by_terms(weights: Floats) -> Ints:
    """Return the columns of a matrix: those of first entries of rows, of second ones, and so on."""
    terms = [np.flatnonzero(row) for row in weights]
    most = max((row.size for row in terms), default=0)
    listed = [row[k] for k in range(most) for row in terms if k < row.size]
    order = dict.fromkeys([*listed, *range(weights.shape[1])])
    return np.array(list(order), dtype=np.int64)


PLACED = ("row", "friction_row", "friction_normal")
"""Fields in which laws differ whose rows are places."""


def place_laws(laws: LawTable, of_row: Ints) -> LawTable:
    """Return the laws for the kernels, whose rows are places; `of_row` is the place of each row."""
    return laws._replace(
        row=as_unsigned(of_row[laws.row]),
        friction_row=as_unsigned(of_row[laws.friction_row]),
        friction_normal=as_unsigned(laws.friction_normal),
    )


def _cumulate(counts: Sequence[int] | Ints) -> Ints:
    """Return running sums that begin with zero."""
    return np.concatenate(([0], np.cumsum(np.asarray(counts, dtype=np.int64)))).astype(np.int64)


def _assemble_terms(
    parts: Sequence[BlockModel], of_end: Sequence[Ints], solved: int, count: int
) -> list[Terms]:
    """Return every end and mode as a sum of solved places."""
    terms: list[Terms] = [[(place, 1.0)] for place in range(solved)]
    terms += [[] for _ in range(count - solved)]
    for part, places in zip(parts, of_end, strict=True):
        leaders = places[part.leading.leaders]
        for end in np.flatnonzero(places >= solved):
            weights = part.leading.weights[end]
            used = np.flatnonzero(weights)
            terms[places[end]] = list(
                zip(leaders[used].tolist(), weights[used].tolist(), strict=True)
            )
    return terms
