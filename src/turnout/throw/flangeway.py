"""Distances along a rail at the ends of movements, such as the flangeway of the open rail.

The flangeway is the gap at the nodes of the rail, and behind the planing also by how much the
running edges lie further apart than a full head is wide. At such an instant few rows bear a force,
since no stop presses an open rail. Only their columns are read, a tenth of the matrices. The gauge
beside the closed rail is another such distance, `turnout.throw.gauge`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.core.lru_cache import SharedResults
from turnout.kernels.lanes import empty_in_lines, whole_lines, zeros_in_lines
from turnout.kernels.shared_record import shared_record
from turnout.mechanism.mechanism import RailBody
from turnout.panel.model import Panel
from turnout.panel.profile import contact_height, running_edge_distance
from turnout.solver.condense import BlockModel
from turnout.throw.gap_history import DistanceColumns, lessen_distances
from turnout.throw.gaps import gap_rows, gaps_key
from turnout.throw.recovery import (
    Bound,
    Motion,
    Parts,
    added_ends,
    block_of,
    bound,
    core_blocks,
    multiply_by_block,
)
from turnout.throw.route import DirectedMovement, open_rail

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_Columns = tuple[Ints, Floats]
"""Number of a mode or row, and displacement of each point for it, shape (n_points, n)."""
_Bounds = Sequence[Sequence[Bound]]
"""Of several rails, each with its stock rails."""


@dataclass(frozen=True, slots=True)
class EndDistance:
    """A distance at each node of a rail at the end of a movement.

    Attributes
    ----------
    name : str
        Its own name.
    rail : callable
        From a panel and the position after a movement to the rail, or None where the panel does
        not say what the distance takes.
    along : callable
        From panel, motion, rail and places, shape (n,), to the distance of the unloaded rails [m],
        shape (n,), and the rows by which coordinates of rails lessen it.
    """

    name: str
    rail: Callable[[Panel, str], str | None]
    along: Callable[[Panel, Motion, str, Floats], tuple[Floats, Parts]]


class _Distances(NamedTuple):
    """Parts from which the distances at the nodes of some rails are computed.

    Attributes
    ----------
    start : ndarray, shape (n_rails, n_points)
        Without modes and row forces; infinite beyond the nodes of a rail [m].
    columns : DistanceColumns
        By how much these lessen it.
    """

    start: Floats
    columns: DistanceColumns


@dataclass(frozen=True, slots=True, eq=False)
class _KnownRails:
    """Distances along the rails that movements leave, in the parts they are computed from.

    `of`, `names` and `x` are the name of each distance, its rail and the nodes of this; `after` are
    the numbers of those that count after a movement to a position, `bounds` what bounds each.
    """

    of: tuple[str, ...]
    names: tuple[str, ...]
    x: tuple[Floats, ...]
    after: Mapping[str, list[int]]
    distances: _Distances
    bounds: _Bounds


@dataclass(frozen=True, slots=True, eq=False)
class MovementEnds:
    """Data for distances at the ends of the movements of a run.

    Attributes
    ----------
    known : _KnownRails
        Shared values of throws of the same rails.
    parts : tuple of BlockModel
        Blocks of the run, with the ends that its objects added.
    rails : list of int
        Number of each distance with its rail, one after the other.
    modal, law_force, friction_force : ndarray, shapes (n, n_modes), (n, n_laws), (n, n_frictions)
        Modal coordinates, forces of laws and frictions [N] at its end of a movement.
    force : ndarray, shape (n, n_rows)
        Force of the linear system at each row [N].
    law_row, friction_row : ndarray of int, shapes (n_laws,), (n_frictions,)
        Rows of laws and frictions.
    """

    known: _KnownRails
    parts: tuple[BlockModel, ...]
    rails: list[int]
    modal: Floats
    law_force: Floats
    friction_force: Floats
    force: Floats
    law_row: Ints
    friction_row: Ints


class LeastDistance(NamedTuple):
    """A distance [m], its place [m] and its rail; NaN and an empty name if none is known."""

    width: float
    x: float
    rail: str


class DistancesFound(NamedTuple):
    """The least of each distance at the ends of the movements of a run, by its name."""

    least: dict[str, LeastDistance]


UNKNOWN = LeastDistance(np.nan, np.nan, "")
"""Values of distances that the panel does not state."""

_known = SharedResults[tuple[_KnownRails | None]](32)


def movement_ends(
    panel: Panel,
    motion: Motion,
    ends: Sequence[tuple[DirectedMovement, int]],
    *,
    of: Sequence[EndDistance],
) -> "MovementEnds | DistancesFound | None":
    """Return the data for distances after some movements; of rails of a single throw these alone.

    Parameters
    ----------
    panel, motion
        Panel and run.
    ends : sequence of (DirectedMovement, int)
        Movements, and the index of the instant at which each is over.
    of : sequence of EndDistance
        The distances, such as `FLANGEWAY`; the same ones for all throws of the same rails.

    Returns
    -------
    MovementEnds, DistancesFound or None
        None where the panel does not say what they take.
    """
    if motion.condensed.alone:
        return DistancesFound(_distances_directly(panel, motion, ends, of))
    known, history = _known_rails(panel, motion, of), motion.history
    if known is None:
        return None
    found = [(number, at) for throw, at in ends for number in known.after[throw.to]]
    if not found:
        return None
    instants = np.array([at for _, at in found])
    return MovementEnds(
        known=known,
        parts=motion.condensed.parts,
        rails=[rail for rail, _ in found],
        modal=history.q[instants],
        law_force=history.law_force[instants],
        friction_force=history.friction_force[instants],
        force=history.g[instants] * motion.slope,
        law_row=history.laws.row,
        friction_row=history.laws.friction_row,
    )


def _distances_directly(
    panel: Panel,
    motion: Motion,
    ends: Sequence[tuple[DirectedMovement, int]],
    of: Sequence[EndDistance],
) -> "dict[str, LeastDistance]":
    """Return the least of each distance by the displacements of its rails at the ends."""
    history, blocks = motion.history, motion.condensed.parts
    first = np.cumsum([0, *(part.model.load.size for part in blocks)])
    moved = dict[tuple[str, int], Floats]()

    def displaced(body: RailBody, at: int) -> Floats:
        """Return the reduced coordinates of a rail at an instant."""
        if (body.name, at) not in moved:
            number, own = block_of(blocks, body)
            part, place = blocks[number], slice(own, own + body.count)
            force = motion.slope * history.g[at]
            np.subtract.at(force, history.laws.row, history.law_force[at])
            np.subtract.at(force, history.laws.friction_row, history.friction_force[at])
            modal = history.q[at, first[number] : first[number + 1]]
            model = part.model
            moved[body.name, at] = (
                model.modes[place] @ modal
                + model.residual_shapes[place] @ force[part.block.rows]
                + model.residual_load[place]
            )
        return moved[body.name, at]

    found = dict[str, LeastDistance]()
    for distance in of:
        for throw, at in ends:
            name = distance.rail(panel, throw.to)
            if name is None:
                continue
            x = motion.rails[name].x
            along, parts = distance.along(panel, motion, name, x)
            for body, rows in parts:
                along = along - rows @ displaced(body, at)
            place = int(along.argmin())
            if distance.name not in found or along[place] < found[distance.name].width:
                width = float(along[place])
                found[distance.name] = LeastDistance(width, float(x[place]), name)
    return found


def least_distances(
    runs: "Sequence[MovementEnds | DistancesFound | None]",
) -> list[dict[str, LeastDistance]]:
    """Return the least of each distance after the movements of each of some runs, by its name.

    Parameters
    ----------
    runs : sequence of MovementEnds, DistancesFound or None
        From `movement_ends`; those of the same rails take one call of a kernel.
    """
    found = [dict[str, LeastDistance]() for _ in runs]
    alike = dict[tuple[int, ...], list[int]]()
    for number, run in enumerate(runs):
        if isinstance(run, DistancesFound):
            found[number] = run.least
        elif run is not None:
            arrays = (run.modal, run.law_force, run.friction_force, run.force)
            key = (id(run.known.distances), *[array.shape[1] for array in arrays])
            alike.setdefault(key, []).append(number)
    for numbers in alike.values():
        together = _least_of_alike(
            [run for number in numbers if isinstance(run := runs[number], MovementEnds)]
        )
        for number, least in zip(numbers, together, strict=True):
            found[number] = least
    return found


def _least_of_alike(runs: Sequence[MovementEnds]) -> list[dict[str, LeastDistance]]:
    """Return the least distances of runs of the same rails, with laws of the same number."""
    known = runs[0].known.distances
    rails = np.array([rail for run in runs for rail in run.rails])
    distances = empty_in_lines(rails.size, known.start.shape[1])
    distances[:] = known.start[rails]
    force = np.concatenate([run.force for run in runs])
    lessen_distances(
        distances,
        known.columns,
        rails,
        np.repeat(np.arange(len(runs)), [len(run.rails) for run in runs]),
        np.concatenate([run.modal for run in runs]),
        np.array([run.law_row for run in runs]),
        np.concatenate([run.law_force for run in runs]),
        np.array([run.friction_row for run in runs]),
        np.concatenate([run.friction_force for run in runs]),
        force,
    )
    found, first = list[dict[str, LeastDistance]](), 0
    for run in runs:
        own = slice(first, first := first + len(run.rails))
        along = distances[own]
        _subtract_objects(along, run, force[own])
        found.append(_least_by_name(run, along))
    return found


def _least_by_name(run: MovementEnds, along: Floats) -> dict[str, LeastDistance]:
    """Return the least of each distance of a run, of which `along` has a row each."""
    found, known = dict[str, LeastDistance](), run.known
    for rail, at, row in zip(run.rails, along.argmin(axis=1).tolist(), along, strict=True):
        name, width = known.of[rail], float(row[at])
        if name not in found or width < found[name].width:
            found[name] = LeastDistance(width, float(known.x[rail][at]), known.names[rail])
    return found


def _subtract_objects(along: Floats, run: MovementEnds, force: Floats) -> None:
    """Subtract the displacements by forces at ends that objects added to the blocks of rails."""
    for end, rail in enumerate(run.rails):
        for numbers, rows, shapes in added_ends(run.parts, run.known.bounds[rail]):
            on_objects = force[end, numbers]
            if any(on_objects.tolist()):
                along[end, : len(rows)] -= (rows @ shapes.T) @ on_objects


def _known_rails(panel: Panel, motion: Motion, of: Sequence[EndDistance]) -> _KnownRails | None:
    """Return the rails of a panel for some distances, found once for throws that share them.

    None where the panel does not say what these take.
    """
    named = [motion.shapes, *core_blocks(motion.condensed)]
    values = (*gaps_key(panel), *[distance.name for distance in of])
    return _known.get(named, values, lambda: (_make_known_rails(panel, motion, of),))[0]


def _make_known_rails(
    panel: Panel, motion: Motion, of: Sequence[EndDistance]
) -> _KnownRails | None:
    after = dict[str, list[int]](open=[], closed=[])
    found: list[tuple[EndDistance, str]] = []
    for distance in of:
        for position, numbers in after.items():
            name = distance.rail(panel, position)
            if name is not None:
                one = (distance, name)
                numbers.append(found.index(one) if one in found else len(found))
                found += [one] if one not in found else []
    if not found:
        return None
    distances, bounds = _build(panel, motion, found)
    return _KnownRails(
        of=tuple(distance.name for distance, _ in found),
        names=tuple(name for _, name in found),
        x=tuple(motion.rails[name].x for _, name in found),
        after=after,
        distances=distances,
        bounds=bounds,
    )


def _head_width(panel: Panel, name: str) -> float | None:
    """Return the width of a full head [m], or None if the panel lacks inputs of flangeways."""
    rail = panel.rail[name]
    known = rail.running_edge is not None and rail.has_stock_rail
    return rail.head_width if known else None


def _opened_rail(panel: Panel, position: str) -> str | None:
    """Return the rail that wheel flanges pass, if the panel has the inputs of its flangeway."""
    name = open_rail(panel, position)
    return None if name is None or _head_width(panel, name) is None else name


def _flangeway_along(panel: Panel, motion: Motion, name: str, x: Floats) -> tuple[Floats, Parts]:
    """Return the flangeway of unloaded rails, and the rows that lessen it."""
    start, parts = gap_rows(panel, motion, name, x, contact_height(panel, name, x))
    edge, width = panel.rail[name].running_edge, _head_width(panel, name)
    if edge is not None and width is not None:
        start = start + np.maximum(running_edge_distance(edge, x) - width, 0.0)
    return start, parts


FLANGEWAY = EndDistance("flangeway", _opened_rail, _flangeway_along)
"""Free distance between the open rail and its stock rail."""


def _build(
    panel: Panel, motion: Motion, wanted: Sequence[tuple[EndDistance, str]]
) -> tuple[_Distances, _Bounds]:
    """Return distances and bounds of some rails."""
    width = whole_lines(max(motion.rails[name].x.size for _, name in wanted))
    starts, of_modes, of_rows = np.full((len(wanted), width), np.inf), [], []
    bounds = list[list[Bound]]()
    for (distance, name), to in zip(wanted, starts, strict=True):
        start, parts = distance.along(panel, motion, name, motion.rails[name].x)
        bounds.append([bound(motion.condensed.parts, body, rows) for body, rows in parts])
        start, modes, rows = _rail_columns(motion, start, bounds[-1])
        to[: start.size] = start
        of_modes.append(modes)
        of_rows.append(rows)
    first_mode, mode, columns_of_mode = _pad_columns(of_modes, width)
    first_row, row, columns_of_row = _pad_columns(of_rows, width)
    columns = DistanceColumns(first_mode, first_row, mode, row, columns_of_mode, columns_of_row)
    return _Distances(starts, shared_record(columns)), bounds


def _rail_columns(
    motion: Motion, start: Floats, bounds: Sequence[Bound]
) -> tuple[Floats, _Columns, _Columns]:
    """Return start, columns of modes and columns of rows of the distance along a rail."""
    blocks = motion.condensed.parts
    ends = np.cumsum([0, *(part.model.load.size for part in blocks)])
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


def compile_distances() -> None:
    """Compile or load the kernel of distances at the ends of movements."""
    none, one = np.zeros(0, dtype=np.int64), np.zeros(1, dtype=np.int64)
    nothing, no_rows = np.zeros((1, 0)), np.zeros((1, 0), dtype=np.int64)
    ends = np.zeros(2, dtype=np.int64)
    columns = DistanceColumns(ends, ends, none, none, np.zeros((0, 8)), np.zeros((0, 8)))
    forces = (no_rows, nothing, no_rows, nothing, nothing)
    lessen_distances(zeros_in_lines(1, 8), shared_record(columns), one, one, nothing, *forces)
