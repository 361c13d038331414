"""The flangeway behind a switch rail that is open at the end of a movement.

It is the gap at the nodes of the rail, and behind the planing also by how much the running edges
lie further apart than a full head is wide. At such an instant few rows bear a force, since no stop
presses an open rail. Only their columns are read, a tenth of the matrices.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.condense.condense import BlockModel
from turnout.core.lru_cache import LRUCache
from turnout.kernels.distances import DistanceColumns, lessen_distances
from turnout.kernels.lanes import empty_in_lines, whole_lines, zeros_in_lines
from turnout.kernels.shared_record import shared_record
from turnout.mechanism.mechanism import RailBody
from turnout.panel.model import Panel
from turnout.panel.profile import contact_height, running_edge_distance
from turnout.response.block_products import block_of, multiply_by_block
from turnout.response.gaps import bodies_at_gap, gap_rows, stock_gap
from turnout.response.recovery import Motion
from turnout.response.route import Throw, open_rail

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_Columns = tuple[Ints, Floats]
"""Number of a mode or row, and displacement of each point for it, shape (n_points, n)."""
_Bound = tuple[int, slice, Floats]

MOST_KEPT = 32
"""Flangeways of rails without objects in memory, the latest used."""


class _Flangeways(NamedTuple):
    """What the flangeways at the nodes of some rails are made of.

    Attributes
    ----------
    start : ndarray, shape (n_rails, n_points)
        Without modes and row forces; infinite beyond the nodes of a rail [m].
    columns : DistanceColumns
        By how much these lessen it.
    bounds : sequence of sequence of (int, slice, ndarray)
        For each rail and its stock rails the number of the block, where its coordinates are in it,
        and rows over these.
    """

    start: Floats
    columns: DistanceColumns
    bounds: Sequence[Sequence[_Bound]]


# Rails are shared by many throws. They are named by identity, and kept beside so that nothing else
# takes their place.
_flangeways = LRUCache[tuple[_Flangeways, list[object]]](MOST_KEPT)


def least_flangeway(
    panel: Panel, motion: Motion, ends: Sequence[tuple[Throw, int]]
) -> tuple[float, float, str]:
    """Return the least flangeway after some movements [m], its place [m] and its rail.

    Parameters
    ----------
    panel, motion
        Panel and run.
    ends : sequence of (Throw, int)
        Movements, and the index of the instant at which each is over.

    Returns
    -------
    tuple
        NaN and an empty name where the panel does not say what the flangeways of its open rails
        take.
    """
    opened = [(open_rail(panel, throw.to), at) for throw, at in ends]
    known = [(name, at) for name, at in opened if name and _head_width(panel, name) is not None]
    if not known:
        return np.nan, np.nan, ""
    names = list(dict.fromkeys([name for name, _ in known]))
    found, history = _flangeways_of(panel, motion, names), motion.history
    rails = np.array([names.index(name) for name, _ in known])
    instants = np.array([at for _, at in known])
    distances = empty_in_lines(len(known), found.start.shape[1])
    distances[:] = found.start[rails]
    force = history.g[instants] * motion.slope
    lessen_distances(
        distances,
        found.columns,
        rails,
        history.q[instants],
        history.laws.row,
        history.law_force[instants],
        history.laws.friction_row,
        history.friction_force[instants],
        force,
    )
    if any(part.before is not None for part in motion.condensed.parts):
        for rail, along, forces in zip(rails.tolist(), distances, force, strict=True):
            _subtract_added_ends(along, motion, found.bounds[rail], forces)
    end, place = divmod(int(distances.argmin()), distances.shape[1])
    name = known[end][0]
    return float(distances[end, place]), float(motion.rails[name].x[place]), name


def _head_width(panel: Panel, name: str) -> float | None:
    """Return the width of a full head [m]; None where the panel leaves out what flangeways take."""
    rail = panel.rail[name]
    known = rail.running_edge is not None and rail.has_stock_rail
    return rail.head_width if known else None


def _subtract_added_ends(
    along: Floats, motion: Motion, bounds: Sequence[_Bound], force: Floats
) -> None:
    """Subtract what forces at ends come to that objects added to the blocks of some rails."""
    for number, own, rows in bounds:
        part = motion.condensed.parts[number]
        if part.before is None:
            continue
        known = part.before.block.rows.size
        added = force[part.block.rows[known:]]
        if any(added.tolist()):
            along[: rows.shape[0]] -= rows @ (part.model.residual_shapes[own, known:] @ added)


def _flangeways_of(panel: Panel, motion: Motion, names: Sequence[str]) -> _Flangeways:
    """Return what the flangeways of some rails are made of, found once for all their throws."""
    named: list[object] = [panel.stop, panel.stud, panel.object_defaults]
    for name in names:
        faced, bodies = bodies_at_gap(panel, motion, name)
        named += [panel.rail[name], motion.shapes.get(name), *faced, *_blocks(motion, bodies)]
        for body in bodies:
            named += [body.recovery, body.x]
    key = tuple(map(id, named))
    kept = _flangeways.get(key)
    if kept is None:
        kept = _flangeways.put(key, (_build(panel, motion, names), named))
    return kept[0]


def _blocks(motion: Motion, bodies: Sequence[RailBody]) -> list[BlockModel]:
    """Return the blocks of some rails as they are without the ends that objects added."""
    blocks = motion.condensed.parts
    own = [blocks[block_of(blocks, body)[0]] for body in bodies]
    return [part.before or part for part in own]


def _build(panel: Panel, motion: Motion, names: Sequence[str]) -> _Flangeways:
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
    return _Flangeways(starts, shared_record(columns), bounds)


def _bounds(panel: Panel, motion: Motion, name: str) -> list[_Bound]:
    """Return what bounds the flangeway of a rail, see `_Flangeways`."""
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
    """Return where the columns of each rail begin, their numbers, and all of them as rows."""
    first = np.cumsum([0, *(numbers.size for numbers, _ in columns)])
    found = zeros_in_lines(int(first[-1]), width)
    for begin, (_, values) in zip(first.tolist(), columns, strict=False):
        found[begin : begin + values.shape[1], : values.shape[0]] = values.T
    return first, np.concatenate([numbers for numbers, _ in columns]), found


def compile_flangeways() -> None:
    """Compile or load the kernel of flangeways."""
    none, one = np.zeros(0, dtype=np.int64), np.zeros(1, dtype=np.int64)
    of_laws = none.copy()
    of_laws.flags.writeable = False
    nothing = np.zeros((1, 0))
    ends = np.zeros(2, dtype=np.int64)
    columns = DistanceColumns(ends, ends, none, none, np.zeros((0, 8)), np.zeros((0, 8)))
    forces = (of_laws, nothing, of_laws, nothing, nothing)
    lessen_distances(zeros_in_lines(1, 8), shared_record(columns), one, nothing, *forces)
