"""The condensed system of a run, as arrays for the kernels.

Laws act on *rows*. The mechanism is split into blocks (rails that only laws join), and a row has an
*end* in each block that it reaches into: one, or two if it joins two blocks. All ends, modes and
rows have a place in one vector of displacements, and are numbered by it. The linear system (beams,
linear supports, and the base segments of the laws) is solved once; a law away from its base segment
adds a *deviation* ``lambda = D g + b`` on its row. A row of ``D`` has few entries: at the row
itself and, for friction, at the rows of the normal laws. How the system is solved is described in
`turnout.solver.columns`.

The vector of displacements holds, block by block, the leading ends and then the modes of the block;
these are the *solved* places. The ends that follow from leading ones come next, and last the rows
that join two blocks. A row with one end has the place of that end. Each block is padded to whole
cache lines, and so are the following ends and the joining rows; the padding is finite and means
nothing. The vector ends with one cache line of zeros.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import MechanicsError
from turnout.kernels.lanes import LANES, copy_in_lines, whole_lines, zeros_in_lines
from turnout.kernels.shared_record import clone_record, shared_record
from turnout.law.table import LawTable
from turnout.solver.condense import BlockModel, folded_stiffness

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


class System(NamedTuple):
    """Constants of a run: blocks, modes, ends and rows of the linear system, by place.

    Blocks: block `b` has the leading ends ``end_start[b]`` to ``end_stop[b]``; the places from
    there to ``end_start[b + 1]`` are its modes, so that one column holds the response of both. Its
    other ends, which follow, are ``follower_start[b]`` to ``follower_start[b + 1]``; its columns
    have the slots from ``slot_start[b]``. Modes are numbered from ``mode_start[b]`` when counted
    without ends, and their places are ``mode_place``.

    Matrices with two indices hold, for each end or mode, the entries of its own block only, from
    the left: ``stiffness`` [1/s2], ``end_modes`` (modes at the ends) and its transpose
    ``mode_ends``, and ``flexibility``, the residual one to leading ends [m/N]. ``damping`` [1/s] is
    one number for each mode. ``end_load`` is the static displacement of an end from the constant
    load beyond the modes [m]; ``law_load`` and ``friction_load`` are the same at the rows of laws
    and frictions.

    Rows: ``row_place`` are the places of the rows of the mechanism, ``row_ends`` the ends of the
    row at a place (-1 for none). A following end is the sum over the rows of ``follower_list`` with
    ``follower_weight``, a column for each such end; a joining row is the sum over ``joining_ends``.
    The pairs ``..._start`` / ``..._list`` are ragged lists in compressed form: the rows that the
    deviation of a row depends on (``term``), and the same as leading ends (``pattern``), with
    weights and indices within the block; the laws and frictions of a row; the frictions of a
    normal law. ``pinned`` rows stay active.

    Inputs: ``input_law`` are the driven laws and ``input_row`` their rows; ``input_end`` are those
    of the rows that are an end. ``timed_law`` lists the laws that do not always act.
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
    input_end: Ints
    timed_law: Ints


def condensed_system(
    parts: Sequence[BlockModel],
    laws: LawTable,
    places: Places | None = None,
) -> System:
    """Assemble modal models and their laws for the kernels.

    Parameters
    ----------
    parts : sequence of BlockModel
        Of the linear system with the base segments of the laws; every row has one end or two.
    laws : LawTable
        All laws, by rows of the mechanism.
    places : Places, optional
        Of the parts.

    Returns
    -------
    System
        As a shared record.
    """
    places = number_places(parts) if places is None else places
    count = places.row_ends.shape[0]
    row_place = places.of_row
    models = [part.model for part in parts]
    row_law = _compress(_invert(row_place[laws.row], count))
    row_friction = _compress(_invert(row_place[laws.friction_row], count))
    normal_friction = _compress(_invert(laws.friction_normal, laws.row.size))
    of_ends = _assemble_ends(parts, places)
    pinned = np.zeros(count, dtype=np.int64)
    driven = np.flatnonzero(laws.input_index >= 0)
    driven_rows = np.unique(row_place[laws.row[driven]])
    pinned[driven_rows] = 1
    system = System(
        load=np.concatenate([model.load for model in models]),
        stiffness=_stack_padded([model.stiffness for model in models]),
        damping=np.concatenate([np.diagonal(model.damping) for model in models]),
        **of_ends,
        end_start=places.end_start,
        end_stop=places.end_stop,
        mode_start=places.mode_start,
        mode_place=_number_mode_places(places),
        follower_start=places.follower_start,
        slot_start=_cumulate([part.block.rows.size for part in parts]),
        block_of_end=_number_blocks(places),
        row_ends=places.row_ends,
        row_place=as_unsigned(row_place),
        **_assemble_followers(places),
        joining_ends=_joining_ends(places),
        **_assemble_patterns(laws, places),
        row_law_start=row_law[0],
        row_law_list=row_law[1],
        row_friction_start=row_friction[0],
        row_friction_list=row_friction[1],
        normal_friction_start=normal_friction[0],
        normal_friction_list=normal_friction[1],
        base_slope=folded_stiffness(laws),
        law_load=np.empty(laws.row.size),
        friction_load=np.empty(laws.friction_row.size),
        stick_flexibility=1.0 / laws.stick_stiffness,
        pinned=pinned,
        input_law=driven.astype(np.int64),
        input_row=driven_rows,
        input_end=np.sort(driven_rows[places.row_ends[driven_rows, 1] < 0]),
        timed_law=np.flatnonzero(
            np.isfinite(laws.appears) | np.isfinite(laws.disappears) | (laws.waits == 1)
        ),
    )
    found = shared_record(system)
    _fill_loads(found, laws, places)
    return found


def refill_system(
    system: System, parts: Sequence[BlockModel], laws: LawTable, places: Places
) -> System:
    """Return a system of rails of other sections.

    Parameters
    ----------
    system : System
        From `condensed_system`.
    parts : sequence of BlockModel
        With as many modes and ends, of which the same lead, as those that it was assembled from.
    laws : LawTable
        All laws; they differ from those of the system in values alone.
    places : Places
        Of the parts.
    """
    of_ends = _assemble_ends(parts, places)
    models = [part.model for part in parts]
    kept = ("row_ends", "follower_list", "follower_weight", "joining_ends")
    matrices = {name: getattr(system, name) for name in kept}
    matrices |= {name: of_ends[name] for name in ("end_modes", "mode_ends", "flexibility")}
    matrices["stiffness"] = _stack_padded([model.stiffness for model in models])
    found = clone_record(system, **matrices)
    found.load[:] = np.concatenate([model.load for model in models])
    found.damping[:] = np.concatenate([np.diagonal(model.damping) for model in models])
    found.end_load[:] = of_ends["end_load"]
    _fill_loads(found, laws, places)
    return found


def with_objects_elsewhere(
    system: System, parts: Sequence[BlockModel], laws: LawTable, places: Places
) -> System:
    """Return a system of the same rails with objects elsewhere, of which each joins the same two.

    Parameters
    ----------
    system : System
        From `condensed_system` or `refill_system`.
    parts, laws, places
        As of `refill_system`; `parts` differ in the ends that were added alone.
    """
    changed = ("end_modes", "mode_ends", "flexibility")
    kept = ("row_ends", "follower_list", "follower_weight", "joining_ends", "stiffness")
    matrices = {name: getattr(system, name) for name in kept}
    matrices |= {name: copy_in_lines(getattr(system, name)) for name in changed}
    found = clone_record(system, **matrices)
    for block, part in enumerate(parts):
        if part.added is None:
            continue
        added, at, count = part.added, places.of_end[block], part.added.beside.shape[1]
        new, own, leaders = at[count:], at[:count], part.own_leading.leaders
        columns, of_leaders = new - places.end_start[block], own[leaders] - places.end_start[block]
        modes = slice(places.mode_start[block], places.mode_start[block + 1])
        found.end_load[new] = added.load
        found.end_modes[new, : added.modes.shape[1]] = added.modes
        found.mode_ends[modes, columns] = added.modes.T
        found.flexibility[own[:, np.newaxis], columns] = added.beside.T
        found.flexibility[new[:, np.newaxis], of_leaders] = added.beside[:, leaders]
        found.flexibility[new[:, np.newaxis], columns] = added.among
    _fill_loads(found, laws, places)
    return found


def _fill_loads(system: System, laws: LawTable, places: Places) -> None:
    """Fill the loads of joining rows, laws and frictions from those of ends."""
    joins, load = places.row_ends[:, 1] >= 0, system.end_load
    load[joins] = load[places.row_ends[joins]].sum(axis=1)
    system.law_load[:] = load[places.of_row[laws.row]]
    system.friction_load[:] = load[places.of_row[laws.friction_row]]


def _assemble_ends(parts: Sequence[BlockModel], places: Places) -> dict[str, Any]:
    """Assemble load, modes and residual flexibility at the ends, by place."""
    n_modes = [part.model.load.size for part in parts]
    widest = int(whole_lines(max(part.leading.leaders.size for part in parts)))
    found = {
        "end_load": np.zeros(places.row_ends.shape[0]),
        "end_modes": np.zeros((places.row_ends.shape[0], max(n_modes))),
        "mode_ends": zeros_in_lines(sum(n_modes), widest),
        "flexibility": zeros_in_lines(places.row_ends.shape[0], widest),
    }
    for block, part in enumerate(parts):
        at, model = places.of_end[block], part.model
        leaders = np.argsort(at)[: part.leading.leaders.size]  # by place; others come after them
        modes = slice(places.mode_start[block], places.mode_start[block + 1])
        found["end_load"][at] = model.row_load
        found["end_modes"][at, : n_modes[block]] = model.row_modes
        found["mode_ends"][modes, : leaders.size] = model.row_modes[leaders].T
        found["flexibility"][at, : leaders.size] = model.flexibility[:, leaders]
    return found


def _number_mode_places(places: Places) -> Ints:
    """Return the places of the modes, padded to whole cache lines with a place of zero."""
    pairs = zip(places.end_stop, np.diff(places.mode_start), strict=True)
    listed = [np.arange(stop, stop + count) for stop, count in pairs]
    n_modes = int(places.mode_start[-1])
    padding = whole_lines(n_modes) - n_modes
    return as_unsigned(np.concatenate([*listed, np.full(padding, places.zero)]))


def _number_blocks(places: Places) -> Ints:
    """Return the number of the block of every end and mode."""
    counts = np.concatenate((np.diff(places.end_start), np.diff(places.follower_start)))
    return np.repeat(np.tile(np.arange(places.end_stop.size), 2), counts)


def _assemble_followers(places: Places) -> dict[str, Any]:
    """Assemble leading ends and weights of the following ends, padded with terms of zero weight."""
    sums = places.terms[places.solved :]
    most, count = max((len(terms) for terms in sums), default=0), len(sums)
    listed, weights = np.zeros((most, count), dtype=np.int64), np.zeros((most, count))
    for end, terms in enumerate(sums):
        for k, (leader, weight) in enumerate(terms):
            listed[k, end], weights[k, end] = leader, weight
    return {"follower_list": as_unsigned(listed), "follower_weight": weights}


def _joining_ends(places: Places) -> Ints:
    """Return both ends of every row that joins blocks; the padding may be any place."""
    joining = places.row_ends[int(places.follower_start[-1]) : places.zero]
    return as_unsigned(np.ascontiguousarray(np.maximum(joining.T, 0)))


def _assemble_patterns(laws: LawTable, places: Places) -> dict[str, Any]:
    """Assemble the rows and leading ends that the deviation of every row depends on."""
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
    start, flat = _cumulate([len(x) for x in patterns]), [one for x in patterns for one in x]
    ends = np.array([end for end, _ in flat], dtype=np.int64)
    block = np.searchsorted(places.end_start, ends, side="right") - 1
    term_start, term_list = _compress(rows)
    return {
        "term_start": term_start,
        "term_list": term_list,
        "pattern_start": start,
        "pattern_list": ends,
        "pattern_at": as_unsigned(
            np.where(ends < places.solved, ends - places.end_start[block], 0)
        ),
        "pattern_term": np.array(number, dtype=np.int64),
        "pattern_weight": np.array([weight for _, weight in flat], dtype=np.float64),
    }


def check_normals(table: LawTable) -> None:
    """Refuse frictions whose normal law is not a contact.

    Raises
    ------
    MechanicsError
        If the normal law of a friction is driven or can pull.
    """
    normals = table.friction_normal
    if (table.input_index[normals] >= 0).any():
        msg = "the normal law of a friction row cannot be driven by a marker"
        raise MechanicsError(msg)
    lowest = table.segment_start[normals]
    if table.slope[lowest].any() or table.intercept[lowest].any():
        msg = "the normal law of a friction row must be a contact, which never pulls"
        raise MechanicsError(msg)


def _stack_padded(blocks: Sequence[Floats]) -> Floats:
    """Stack matrices, each padded with zeros on the right."""
    ends = np.cumsum([0, *(block.shape[0] for block in blocks)]).tolist()
    found = np.zeros((ends[-1], max(block.shape[1] for block in blocks)))
    for block, first, last in zip(blocks, ends[:-1], ends[1:], strict=True):
        found[first:last, : block.shape[1]] = block
    return found


def _invert(targets: Ints, count: int) -> list[list[int]]:
    """Return, for each of `count` targets, the indices that name it."""
    lists: list[list[int]] = [[] for _ in range(count)]
    for index, target in enumerate(targets):
        lists[target].append(index)
    return lists


def _compress(lists: list[list[int]]) -> tuple[Ints, Ints]:
    """Return a ragged list in compressed form: starts, then all entries."""
    start = _cumulate([len(x) for x in lists])
    return start, np.array([i for x in lists for i in x], dtype=np.int64)
