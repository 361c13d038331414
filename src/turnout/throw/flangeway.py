"""The flangeway behind a switch rail that is open at the end of a movement.

It is the gap at the nodes of the rail, and behind the planing also by how much the running edges
lie further apart than a full head is wide. At such an instant few rows bear a force, since no stop
presses an open rail. Only their columns are read, a tenth of the matrices.
"""

import operator
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from turnout.core.lru_cache import LRUCache
from turnout.kernels.gap_history import DistanceColumns, lessen_distances
from turnout.kernels.lanes import empty_in_lines, whole_lines, zeros_in_lines
from turnout.kernels.shared_record import shared_record
from turnout.mechanism.mechanism import RailBody
from turnout.panel.model import Panel
from turnout.panel.profile import contact_height, running_edge_distance
from turnout.solver.condense import BlockModel, CondensedRails
from turnout.throw.gaps import bodies_at_gap, gap_rows, stock_gap
from turnout.throw.recovery import Motion, block_of, multiply_by_block
from turnout.throw.route import DirectedMovement, open_rail

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_Columns = tuple[Ints, Floats]
"""Number of a mode or row, and displacement of each point for it, shape (n_points, n)."""
_Bound = tuple[int, slice, Floats]
"""Of a rail or stock rail: number of the block, slice of its coordinates, rows over these."""
_Bounds = Sequence[Sequence[_Bound]]
"""Of several rails, each with its stock rails."""


class _Flangeways(NamedTuple):
    """Parts from which the flangeways at the nodes of some rails are computed.

    Attributes
    ----------
    start : ndarray, shape (n_rails, n_points)
        Without modes and row forces; infinite beyond the nodes of a rail [m].
    columns : DistanceColumns
        By how much these lessen it.
    """

    start: Floats
    columns: DistanceColumns


class _AddedEnds(NamedTuple):
    """Decrease of the flangeway of a rail by forces at ends that objects added.

    `rows` are theirs in the mechanism, `columns` hold displacements for unit forces, shape
    (n_points, n_added) [m/N].
    """

    rail: int
    rows: Ints
    columns: Floats


@dataclass(frozen=True, slots=True, eq=False)
class _OpenRails:
    """Flangeways of the rails that movements leave open, in the parts they are computed from.

    `names` and `x` are those of the rails and of their nodes; `opened` is the number of the rail
    that is open after a movement to a position. Where objects stand is in `added` and `slope`, the
    stiffness at each row that the linear system holds.
    """

    names: tuple[str, ...]
    x: tuple[Floats, ...]
    opened: Mapping[str, int]
    flangeways: _Flangeways
    added: tuple[_AddedEnds, ...]
    slope: Floats


@dataclass(frozen=True, slots=True, eq=False)
class MovementEnds:
    """Data for the flangeways at the ends of the movements of a run.

    Attributes
    ----------
    known : _OpenRails
        What throws of the same rails share.
    rails : list of int
        Number of the open rail at each end.
    modal, law_force, friction_force : ndarray, shapes (n_ends, n_modes), (n_ends, n_laws) and
        (n_ends, n_frictions)
        Modal coordinates, forces of laws and frictions [N].
    force : ndarray, shape (n_ends, n_rows)
        What the linear system holds at each row [N].
    law_row, friction_row : ndarray of int, shapes (n_laws,), (n_frictions,)
        Rows of laws and frictions.
    """

    known: _OpenRails
    rails: list[int]
    modal: Floats
    law_force: Floats
    friction_force: Floats
    force: Floats
    law_row: Ints
    friction_row: Ints


class LeastFlangeway(NamedTuple):
    """A flangeway [m], its place [m] and its rail; NaN and an empty name if none is known."""

    width: float
    x: float
    rail: str


_UNKNOWN = LeastFlangeway(np.nan, np.nan, "")

# Rails are shared by many throws. They are named by identity, and kept beside so that nothing else
# takes their place.
_flangeways = LRUCache[tuple[_Flangeways, _Bounds, list[object]]](32)
# Condensed rails are so where objects stand in the same places.
_open_rails: WeakKeyDictionary[CondensedRails, tuple[_OpenRails | None, list[object]]] = (
    WeakKeyDictionary()
)


def movement_ends(
    panel: Panel, motion: Motion, ends: Sequence[tuple[DirectedMovement, int]]
) -> MovementEnds | None:
    """Return the data for the flangeways after some movements.

    Parameters
    ----------
    panel, motion
        Panel and run.
    ends : sequence of (Throw, int)
        Movements, and the index of the instant at which each is over.

    Returns
    -------
    MovementEnds or None
        None where the panel does not say what the flangeways of its open rails take.
    """
    known, history = _known_rails(panel, motion), motion.history
    if known is None:
        return None
    opened = [(known.opened[throw.to], at) for throw, at in ends if throw.to in known.opened]
    if not opened:
        return None
    instants = np.array([at for _, at in opened])
    return MovementEnds(
        known=known,
        rails=[rail for rail, _ in opened],
        modal=history.q[instants],
        law_force=history.law_force[instants],
        friction_force=history.friction_force[instants],
        force=history.g[instants] * known.slope,
        law_row=history.laws.row,
        friction_row=history.laws.friction_row,
    )


def least_flangeways(runs: Sequence[MovementEnds | None]) -> list[LeastFlangeway]:
    """Return the least flangeway after the movements of each of some runs.

    Parameters
    ----------
    runs : sequence of MovementEnds or None
        From `movement_ends`; those of the same rails take one call of a kernel.
    """
    found, alike = [_UNKNOWN] * len(runs), dict[tuple[int, ...], list[int]]()
    for number, run in enumerate(runs):
        if run is not None:
            arrays = (run.modal, run.law_force, run.friction_force, run.force)
            key = (id(run.known.flangeways), *[array.shape[1] for array in arrays])
            alike.setdefault(key, []).append(number)
    for numbers in alike.values():
        together = _least_of_alike([run for number in numbers if (run := runs[number])])
        for number, flangeway in zip(numbers, together, strict=True):
            found[number] = flangeway
    return found


def _least_of_alike(runs: Sequence[MovementEnds]) -> list[LeastFlangeway]:
    """Return the least flangeways of runs of the same rails, with laws of the same number."""
    flangeways = runs[0].known.flangeways
    rails = np.array([rail for run in runs for rail in run.rails])
    distances = empty_in_lines(rails.size, flangeways.start.shape[1])
    distances[:] = flangeways.start[rails]
    force = np.concatenate([run.force for run in runs])
    lessen_distances(
        distances,
        flangeways.columns,
        rails,
        np.repeat(np.arange(len(runs)), [len(run.rails) for run in runs]),
        np.concatenate([run.modal for run in runs]),
        np.array([run.law_row for run in runs]),
        np.concatenate([run.law_force for run in runs]),
        np.array([run.friction_row for run in runs]),
        np.concatenate([run.friction_force for run in runs]),
        force,
    )
    found, first = list[LeastFlangeway](), 0
    for run in runs:
        own = slice(first, first := first + len(run.rails))
        along = distances[own]
        for added in run.known.added:
            _subtract_added_ends(along, run.rails, added, force[own])
        end, place = divmod(int(along.argmin()), along.shape[1])
        rail = run.rails[end]
        width, x = float(along[end, place]), float(run.known.x[rail][place])
        found.append(LeastFlangeway(width, x, run.known.names[rail]))
    return found


def _subtract_added_ends(
    along: Floats, rails: Sequence[int], added: _AddedEnds, force: Floats
) -> None:
    """Subtract the displacements by forces at ends that objects added to the blocks of a rail."""
    for end, rail in enumerate(rails):
        if rail == added.rail:
            own = force[end, added.rows]
            if any(own.tolist()):
                along[end, : added.columns.shape[0]] -= added.columns @ own


def _known_rails(panel: Panel, motion: Motion) -> _OpenRails | None:
    """Return the open rails of a panel for its flangeways, found once for throws that share it.

    None where the panel does not say what they take.
    """
    families = (panel.rail, panel.stock_rail, panel.stop, panel.stud, panel.object_defaults)
    named: list[object] = [panel.instrumented_rail, motion.shapes, *families]
    kept = _open_rails.get(motion.condensed)
    if kept is not None and all(map(operator.is_, kept[1], named)):
        return kept[0]
    made = _make_open_rails(panel, motion)
    _open_rails[motion.condensed] = made, named
    return made


def _make_open_rails(panel: Panel, motion: Motion) -> _OpenRails | None:
    opened: dict[str, int] = {}
    names: list[str] = []
    for position in ("open", "closed"):
        name = open_rail(panel, position)
        if name is not None and _head_width(panel, name) is not None:
            opened[position] = names.index(name) if name in names else len(names)
            names += [name] if name not in names else []
    if not names:
        return None
    flangeways, bounds = _flangeways_of(panel, motion, names)
    return _OpenRails(
        names=tuple(names),
        x=tuple(motion.rails[name].x for name in names),
        opened=opened,
        flangeways=flangeways,
        added=tuple(_added_ends(motion, bounds)),
        slope=motion.slope,
    )


def _added_ends(motion: Motion, bounds: _Bounds) -> Iterator[_AddedEnds]:
    """Find the ends that objects added to the blocks of some rails."""
    for rail, of_rail in enumerate(bounds):
        for number, own, rows in of_rail:
            part = motion.condensed.parts[number]
            if part.before is not None:
                count = part.before.block.rows.size
                columns = rows @ part.model.residual_shapes[own, count:]
                yield _AddedEnds(rail, part.block.rows[count:], columns)


def _head_width(panel: Panel, name: str) -> float | None:
    """Return the width of a full head [m], or None if the panel lacks inputs of flangeways."""
    rail = panel.rail[name]
    known = rail.running_edge is not None and rail.has_stock_rail
    return rail.head_width if known else None


def _flangeways_of(
    panel: Panel, motion: Motion, names: Sequence[str]
) -> tuple[_Flangeways, _Bounds]:
    """Return flangeways and bounds of some rails, found once for all their throws."""
    named: list[object] = [panel.stop, panel.stud, panel.object_defaults]
    for name in names:
        faced, bodies = bodies_at_gap(panel, motion, name)
        named += [panel.rail[name], motion.shapes.get(name), *faced, *_blocks(motion, bodies)]
        for body in bodies:
            named += [body.recovery, body.x]
    key = tuple(map(id, named))
    kept = _flangeways.get(key)
    if kept is None:
        kept = _flangeways.put(key, (*_build(panel, motion, names), named))
    return kept[:2]


def _blocks(motion: Motion, bodies: Sequence[RailBody]) -> list[BlockModel]:
    """Return the blocks of some rails as they are without the ends that objects added."""
    blocks = motion.condensed.parts
    own = [blocks[block_of(blocks, body)[0]] for body in bodies]
    return [part.before or part for part in own]


def _build(panel: Panel, motion: Motion, names: Sequence[str]) -> tuple[_Flangeways, _Bounds]:
    width = whole_lines(max(motion.rails[name].x.size for name in names))
    starts, of_modes, of_rows = np.full((len(names), width), np.inf), [], []
    bounds = [_bounds(panel, motion, name) for name in names]
    for name, own, to in zip(names, bounds, starts, strict=True):
        start, modes, rows = _rail_columns(panel, motion, name, own)
        to[: start.size] = start
        of_modes.append(modes)
        of_rows.append(rows)
    first_mode, mode, columns_of_mode = _pad_columns(of_modes, width)
    first_row, row, columns_of_row = _pad_columns(of_rows, width)
    columns = DistanceColumns(first_mode, first_row, mode, row, columns_of_mode, columns_of_row)
    return _Flangeways(starts, shared_record(columns)), bounds


def _bounds(panel: Panel, motion: Motion, name: str) -> list[_Bound]:
    """Return the bounds of the flangeway of a rail."""
    x, found = motion.rails[name].x, list[_Bound]()
    _, parts = gap_rows(panel, motion, name, x, contact_height(panel, name, x))
    for body, rows in parts:
        number, first = block_of(motion.condensed.parts, body)
        found.append((number, slice(first, first + body.count), rows))
    return found


def _rail_columns(
    panel: Panel, motion: Motion, name: str, bounds: Sequence[_Bound]
) -> tuple[Floats, _Columns, _Columns]:
    """Return start, columns of modes and columns of rows of the flangeway of a rail."""
    rail, x, blocks = panel.rail[name], motion.rails[name].x, motion.condensed.parts
    start = stock_gap(panel, motion, name, x)
    width = _head_width(panel, name)
    if rail.running_edge is not None and width is not None:
        start = start + np.maximum(running_edge_distance(rail.running_edge, x) - width, 0.0)
    ends = np.cumsum([0, *(part.model.eigenvalues.size for part in blocks)])
    modes, rows = list[_Columns](), list[_Columns]()
    for number, own, weights in bounds:
        part = blocks[number].before or blocks[number]
        of_modes, of_rows, of_load = multiply_by_block(part, weights, own)
        start = start - of_load
        modes.append((np.arange(ends[number], ends[number + 1]), of_modes))
        rows.append((part.block.rows, of_rows))
    return start, _join_columns(modes), _join_columns(rows)


def _join_columns(columns: Sequence[_Columns]) -> _Columns:
    """Return columns of the same points beside each other."""
    numbers, values = zip(*columns, strict=True)
    return np.concatenate(numbers), np.concatenate(values, axis=1)


def _pad_columns(columns: Sequence[_Columns], width: int) -> tuple[Ints, Ints, Floats]:
    """Return the first column of each rail, the numbers of all columns, and the columns as rows."""
    first = np.cumsum([0, *(numbers.size for numbers, _ in columns)])
    found = zeros_in_lines(int(first[-1]), width)
    for begin, (_, values) in zip(first.tolist(), columns, strict=False):
        found[begin : begin + values.shape[1], : values.shape[0]] = values.T
    return first, np.concatenate([numbers for numbers, _ in columns]), found


def compile_flangeways() -> None:
    """Compile or load the kernel of flangeways."""
    none, one = np.zeros(0, dtype=np.int64), np.zeros(1, dtype=np.int64)
    nothing, no_rows = np.zeros((1, 0)), np.zeros((1, 0), dtype=np.int64)
    ends = np.zeros(2, dtype=np.int64)
    columns = DistanceColumns(ends, ends, none, none, np.zeros((0, 8)), np.zeros((0, 8)))
    forces = (no_rows, nothing, no_rows, nothing, nothing)
    lessen_distances(zeros_in_lines(1, 8), shared_record(columns), one, one, nothing, *forces)
