"""The condensed system of a run, as arrays for the kernels.

Laws act on *rows*. The mechanism is split into blocks (rails that only laws join), and a row has an
*end* in each block that it reaches into: one, or two if it joins two of them. Ends are numbered
block by block. The linear system (beams, linear supports, and the base segment of the laws) is
solved once; a law away from its base segment adds a *deviation* ``lambda = D g + b`` on its row.
``D`` has few entries a row: the row itself and, for friction, the rows of the normal laws. See
`turnout.integrate.columns` for what is done with it.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.errors import MechanicsError
from turnout.law.shared import shared
from turnout.law.table import LawTable
from turnout.mechanism.condense import BlockModel, ModalModel, base_stiffness

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class System(NamedTuple):
    """What does not change during a run.

    Block `b` has the ends ``end_start[b]`` to ``end_stop[b]``; the numbers from there to
    ``end_start[b + 1]`` stand for its modes, so that one column tells what a force does to both.
    Modes by themselves are numbered from ``mode_start[b]``. Arrays with two indices hold, for each
    end or mode, the entries of its own block only, from the left: damping, the modes at the ends
    and the residual flexibility between ends. ``diagonal`` blocks damp each mode by itself. The
    pairs ``..._start`` / ``..._list`` are ragged lists in compressed form. ``pattern_at`` is the
    pattern as places in its block; -1 in ``row_ends`` stands for no second end. ``timed_law``
    lists the laws that do not act all the time.
    """

    eigenvalues: Floats
    load: Floats
    damping: Floats
    end_load: Floats
    end_modes: Floats
    flexibility: Floats
    end_start: Ints
    end_stop: Ints
    mode_start: Ints
    diagonal: Ints
    block_of_end: Ints
    row_ends: Ints
    joining_rows: Ints
    pattern_start: Ints
    pattern_list: Ints
    pattern_at: Ints
    row_law_start: Ints
    row_law_list: Ints
    row_friction_start: Ints
    row_friction_list: Ints
    normal_friction_start: Ints
    normal_friction_list: Ints
    base_slope: Floats
    pinned: Ints
    input_law: Ints
    input_row: Ints
    timed_law: Ints


def condensed_system(parts: Sequence[BlockModel], table: LawTable) -> System:
    """Arrange modal models and their laws for the kernels.

    Parameters
    ----------
    parts : sequence of BlockModel
        Of the linear system with the base segments of the laws; every row has an end or two.
    table : LawTable
        The laws.

    Returns
    -------
    System

    Raises
    ------
    MechanicsError
        If the normal law of a friction is driven or can pull.
    """
    _check_normals(table)
    n_rows = 1 + max((int(part.block.rows.max(initial=-1)) for part in parts), default=-1)
    models = [part.model for part in parts]
    mode_start = np.cumsum([0, *(model.eigenvalues.size for model in models)])
    end_stop = np.cumsum([part.block.rows.size for part in parts]) + mode_start[:-1]
    end_start = np.concatenate(([0], end_stop + np.diff(mode_start)))
    row_ends = np.full((n_rows, 2), -1, dtype=np.int64)
    for part, first in zip(parts, end_start[:-1], strict=True):
        for end, row in enumerate(part.block.rows, start=int(first)):
            row_ends[row, int(row_ends[row, 0] >= 0)] = end
    pattern: list[list[int]] = [[r] for r in range(n_rows)]
    for row, normal in zip(table.friction_row, table.row[table.friction_normal], strict=True):
        if normal not in pattern[row]:
            pattern[row].append(int(normal))
    pattern_start, pattern_list = _ragged(pattern)
    block_of_end = np.repeat(np.arange(len(models)), np.diff(end_start))
    first_ends = row_ends[pattern_list, 0]
    row_law = _ragged(_inverted(table.row, n_rows))
    row_friction = _ragged(_inverted(table.friction_row, n_rows))
    normal_friction = _ragged(_inverted(table.friction_normal, table.row.size))
    pinned = np.zeros(n_rows, dtype=np.int64)
    driven = np.flatnonzero(table.input_index >= 0)
    pinned[table.row[driven]] = 1
    return shared(
        System(
            eigenvalues=np.concatenate([model.eigenvalues for model in models]),
            load=np.concatenate([model.load for model in models]),
            damping=_stacked([model.damping for model in models]),
            end_load=np.concatenate([_with_modes(model.row_load, model) for model in models]),
            end_modes=_stacked([_with_modes(model.row_modes, model) for model in models]),
            flexibility=_stacked([_with_modes(model.flexibility, model) for model in models]),
            end_start=end_start,
            end_stop=end_stop,
            mode_start=mode_start,
            diagonal=np.array([_is_diagonal(model.damping) for model in models], dtype=np.int64),
            block_of_end=block_of_end,
            row_ends=row_ends,
            joining_rows=np.flatnonzero(row_ends[:, 1] >= 0),
            pattern_start=pattern_start,
            pattern_list=pattern_list,
            pattern_at=first_ends - end_start[block_of_end[first_ends]],
            row_law_start=row_law[0],
            row_law_list=row_law[1],
            row_friction_start=row_friction[0],
            row_friction_list=row_friction[1],
            normal_friction_start=normal_friction[0],
            normal_friction_list=normal_friction[1],
            base_slope=base_stiffness(table),
            pinned=pinned,
            input_law=driven.astype(np.int64),
            input_row=np.unique(table.row[driven]),
            timed_law=np.flatnonzero(
                np.isfinite(table.appears) | np.isfinite(table.disappears) | (table.waits == 1)
            ),
        )
    )


def _check_normals(table: LawTable) -> None:
    normals = table.friction_normal
    if np.any(table.input_index[normals] >= 0):
        msg = "the normal law of a friction row cannot be driven by a marker"
        raise MechanicsError(msg)
    lowest = table.segment_start[normals]
    if np.any(table.slope[lowest] != 0) or np.any(table.intercept[lowest] != 0):
        msg = "the normal law of a friction row must be a contact, which never pulls"
        raise MechanicsError(msg)


def _stacked(blocks: Sequence[Floats]) -> Floats:
    """Stack matrices, each filled up with zeros on the right."""
    widest = max(block.shape[1] for block in blocks)
    padded = [np.pad(block, ((0, 0), (0, widest - block.shape[1]))) for block in blocks]
    return np.ascontiguousarray(np.concatenate(padded))


def _with_modes(of_ends: Floats, model: ModalModel) -> Floats:
    """Append a row of zeros for each mode of a block."""
    below = [(0, model.eigenvalues.size)] + [(0, 0)] * (of_ends.ndim - 1)
    return np.pad(of_ends, below)


def _is_diagonal(damping: Floats) -> bool:
    """Tell whether modes are damped each by itself, but for rounding."""
    of_modes = np.diagonal(damping)
    return bool(np.all(np.abs(damping - np.diag(of_modes)) <= 1e-13 * of_modes.max(initial=0.0)))


def _inverted(targets: Ints, count: int) -> list[list[int]]:
    lists: list[list[int]] = [[] for _ in range(count)]
    for index, target in enumerate(targets):
        lists[target].append(index)
    return lists


def _ragged(lists: list[list[int]]) -> tuple[Ints, Ints]:
    start = np.concatenate(([0], np.cumsum([len(x) for x in lists]))).astype(np.int64)
    return start, np.array([i for x in lists for i in x], dtype=np.int64)
