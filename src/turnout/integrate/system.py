"""The condensed system of a run, as arrays for the kernels.

Laws act on *rows*. The mechanism is split into blocks (rails that only laws join), and a row has an
*end* in each block that it reaches into: one, or two if it joins two of them. Ends, modes and rows
stand in one vector of displacements, see `turnout.integrate.places`; a number of a row or an end is
its place there. The linear system (beams, linear supports, and the base segment of the laws) is
solved once; a law away from its base segment adds a *deviation* ``lambda = D g + b`` on its row.
``D`` has few entries a row: those of the row itself and, for friction, of the rows of the normal
laws. See `turnout.integrate.columns` for what is done with it.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.condense.condense import BlockModel, base_stiffness
from turnout.errors import MechanicsError
from turnout.integrate.places import Places, Terms, number_places, unsigned
from turnout.kernels.lanes import LANES
from turnout.kernels.records import shared_record
from turnout.law.table import LawTable

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class System(NamedTuple):
    """What does not change during a run.

    Block `b` has the leading ends ``end_start[b]`` to ``end_stop[b]``; the places from there to
    ``end_start[b + 1]`` are its modes, so that one column tells what a force does to both. Its
    other ends are ``follower_start[b]`` to ``follower_start[b + 1]``. Modes by themselves are
    numbered from ``mode_start[b]``, stand at ``mode_place``, and each is damped by itself. Arrays
    with two indices hold, for each end or mode, the entries of its own block only, from the left:
    stiffness, the modes at the ends (and, transposed, ``mode_ends``), and the residual flexibility
    to leading ends. What follows from leading ends is the sum over the rows of ``follower_list``
    with ``follower_weight``, a column for each end that follows; rows that join blocks are the sum
    over ``joining_ends``. ``pushed_end`` are the ends that inputs push on, but for rows that join
    blocks; ``input_place`` is the number of a law's input, from one, or zero, and ``input_group``
    where eights of laws begin that have any. The pairs ``..._start`` / ``..._list`` are ragged
    lists in compressed form: which rows the deviation of a row depends on (``term``), and the same
    as leading ends (``pattern``), with weights and their places in the block. -1 in ``row_ends``
    stands for no end. ``row_place`` are the places of the mechanism's rows, ``law_load`` and
    ``friction_load`` the static share of the constant load there; ``timed_law`` lists the laws that
    do not act all the time.
    """

    load: Floats
    stiffness: Floats
    damping: Floats
    end_load: Floats
    end_modes: Floats
    mode_ends: Floats
    flexibility: Floats
    end_start: Ints
    end_stop: Ints
    mode_start: Ints
    mode_place: Ints
    follower_start: Ints
    slot_start: Ints
    block_of_end: Ints
    row_ends: Ints
    row_place: Ints
    follower_list: Ints
    follower_weight: Floats
    joining_ends: Ints
    term_start: Ints
    term_list: Ints
    pattern_start: Ints
    pattern_list: Ints
    pattern_at: Ints
    pattern_term: Ints
    pattern_weight: Floats
    row_law_start: Ints
    row_law_list: Ints
    row_friction_start: Ints
    row_friction_list: Ints
    normal_friction_start: Ints
    normal_friction_list: Ints
    base_slope: Floats
    law_load: Floats
    friction_load: Floats
    stick_flexibility: Floats
    pinned: Ints
    input_law: Ints
    input_row: Ints
    input_place: Ints
    input_group: Ints
    pushed_end: Ints
    timed_law: Ints


def condensed_system(parts: Sequence[BlockModel], laws: LawTable) -> System:
    """Arrange modal models and their laws for the kernels.

    Parameters
    ----------
    parts : sequence of BlockModel
        Of the linear system with the base segments of the laws; every row has an end or two.
    laws : LawTable
        The laws.

    Returns
    -------
    System
    """
    places = number_places(parts)
    count = places.row_ends.shape[0]
    row_place = places.of_row
    models = [part.model for part in parts]
    row_law = _ragged(_inverted(row_place[laws.row], count))
    row_friction = _ragged(_inverted(row_place[laws.friction_row], count))
    normal_friction = _ragged(_inverted(laws.friction_normal, laws.row.size))
    of_ends = _of_ends(parts, places)
    pinned = np.zeros(count, dtype=np.int64)
    driven = np.flatnonzero(laws.input_index >= 0)
    driven_rows = np.unique(row_place[laws.row[driven]])
    pinned[driven_rows] = 1
    system = System(
        load=np.concatenate([model.load for model in models]),
        stiffness=_stacked([model.stiffness for model in models]),
        damping=np.concatenate([np.diagonal(model.damping) for model in models]),
        **of_ends,
        end_start=places.end_start,
        end_stop=places.end_stop,
        mode_start=places.mode_start,
        mode_place=_mode_places(places),
        follower_start=places.follower_start,
        slot_start=np.concatenate(([0], np.cumsum([p.block.rows.size for p in parts]))),
        block_of_end=_blocks(places),
        row_ends=places.row_ends,
        row_place=unsigned(row_place),
        **_followers(places),
        joining_ends=_joining_ends(places),
        **_patterns(laws, places),
        row_law_start=row_law[0],
        row_law_list=row_law[1],
        row_friction_start=row_friction[0],
        row_friction_list=row_friction[1],
        normal_friction_start=normal_friction[0],
        normal_friction_list=normal_friction[1],
        base_slope=base_stiffness(laws),
        law_load=of_ends["end_load"][row_place[laws.row]],
        friction_load=of_ends["end_load"][row_place[laws.friction_row]],
        stick_flexibility=1.0 / laws.stick_stiffness,
        pinned=pinned,
        input_law=driven.astype(np.int64),
        input_row=driven_rows,
        input_place=unsigned(laws.input_index + 1),
        input_group=np.unique(driven // LANES) * LANES,
        pushed_end=np.sort(driven_rows[places.row_ends[driven_rows, 1] < 0]),
        timed_law=np.flatnonzero(
            np.isfinite(laws.appears) | np.isfinite(laws.disappears) | (laws.waits == 1)
        ),
    )
    return shared_record(system)


def _of_ends(parts: Sequence[BlockModel], places: Places) -> dict[str, Any]:
    """Return what the linear system is at the ends, by place."""
    n_modes = [part.model.eigenvalues.size for part in parts]
    widest = max(part.leading.leaders.size for part in parts)
    found = {
        "end_load": np.zeros(places.row_ends.shape[0]),
        "end_modes": np.zeros((places.row_ends.shape[0], max(n_modes))),
        "mode_ends": np.zeros((sum(n_modes), widest)),
        "flexibility": np.zeros((places.row_ends.shape[0], widest)),
    }
    for block, part in enumerate(parts):
        at, model, leaders = places.of_end[block], part.model, part.leading.leaders
        modes = slice(places.mode_start[block], places.mode_start[block + 1])
        found["end_load"][at] = model.row_load
        found["end_modes"][at, : n_modes[block]] = model.row_modes
        found["mode_ends"][modes, : leaders.size] = model.row_modes[leaders].T
        found["flexibility"][at, : leaders.size] = model.flexibility[:, leaders]
    joins = places.row_ends[:, 1] >= 0
    found["end_load"][joins] = found["end_load"][places.row_ends[joins]].sum(axis=1)
    return found


def _mode_places(places: Places) -> Ints:
    """Return where modes stand; for what fills up their line a place of zero."""
    pairs = zip(places.end_stop, np.diff(places.mode_start), strict=True)
    listed = [np.arange(stop, stop + count) for stop, count in pairs]
    padding = -int(places.mode_start[-1]) % LANES
    return unsigned(np.concatenate([*listed, np.full(padding, places.zero)]))


def _blocks(places: Places) -> Ints:
    """Return the block of every end and mode."""
    blocks = np.arange(places.end_stop.size)
    return np.concatenate(
        (
            np.repeat(blocks, np.diff(places.end_start)),
            np.repeat(blocks, np.diff(places.follower_start)),
        )
    )


def _followers(places: Places) -> dict[str, Any]:
    """Return what ends that follow are sums of, with a term of no weight where there are fewer."""
    sums = places.terms[places.solved :]
    most, count = max((len(terms) for terms in sums), default=0), len(sums)
    listed, weights = np.zeros((most, count), dtype=np.int64), np.zeros((most, count))
    for end, terms in enumerate(sums):
        for k, (leader, weight) in enumerate(terms):
            listed[k, end], weights[k, end] = leader, weight
    return {"follower_list": unsigned(listed), "follower_weight": weights}


def _joining_ends(places: Places) -> Ints:
    """Return both ends of every row that joins blocks; for what is left over any place."""
    joining = places.row_ends[int(places.follower_start[-1]) : places.zero]
    return unsigned(np.ascontiguousarray(np.maximum(joining.T, 0)))


def _patterns(laws: LawTable, places: Places) -> dict[str, Any]:
    """Return the rows and leading ends that the deviation of every row depends on."""
    rows: list[list[int]] = [[] for _ in range(places.row_ends.shape[0])]
    for row in places.of_row.tolist():
        rows[row].append(row)
    normals = places.of_row[laws.row[laws.friction_normal]]
    of_frictions = places.of_row[laws.friction_row]
    for row, normal in zip(of_frictions.tolist(), normals.tolist(), strict=True):
        if normal not in rows[row]:
            rows[row].append(normal)
    patterns: list[Terms] = []
    number: list[int] = []
    for members in rows:
        pattern: Terms = []
        for term, row in enumerate(members):
            joins = places.row_ends[row, 1] >= 0
            of_row = [(row, 1.0)] if joins else places.terms[row]
            pattern += of_row
            number += [term] * len(of_row)
        patterns.append(pattern)
    start, flat = _ragged_terms(patterns)
    ends = np.array([end for end, _ in flat], dtype=np.int64)
    block = np.searchsorted(places.end_start, ends, side="right") - 1
    term_start, term_list = _ragged(rows)
    return {
        "term_start": term_start,
        "term_list": term_list,
        "pattern_start": start,
        "pattern_list": ends,
        "pattern_at": np.where(ends < places.solved, ends - places.end_start[block], -1),
        "pattern_term": np.array(number, dtype=np.int64),
        "pattern_weight": np.array([weight for _, weight in flat], dtype=np.float64),
    }


def check_normals(table: LawTable) -> None:
    """Refuse frictions whose normal law is no contact.

    Raises
    ------
    MechanicsError
        If the normal law of a friction is driven or can pull.
    """
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


def _inverted(targets: Ints, count: int) -> list[list[int]]:
    lists: list[list[int]] = [[] for _ in range(count)]
    for index, target in enumerate(targets):
        lists[target].append(index)
    return lists


def _ragged(lists: list[list[int]]) -> tuple[Ints, Ints]:
    start = np.concatenate(([0], np.cumsum([len(x) for x in lists]))).astype(np.int64)
    return start, np.array([i for x in lists for i in x], dtype=np.int64)


def _ragged_terms(lists: Sequence[Terms]) -> tuple[Ints, Terms]:
    start = np.concatenate(([0], np.cumsum([len(x) for x in lists]))).astype(np.int64)
    return start, [term for terms in lists for term in terms]
