"""The flangeway behind a switch rail that is open at the end of a movement.

It is the gap at the nodes of the rail, and behind the planing also by how much the running edges
lie further apart than a full head is wide. At such an instant few rows bear a force, no stop of the
rail for one, so that it follows from a tenth of what displacements over time are made of.
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
from turnout.response.gaps import bodies_at_gap, gap_rows
from turnout.response.recovery import Motion, Parts
from turnout.response.route import Throw, open_rail

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_KEPT = 32
"""Flangeways of rails without objects in memory, the latest used."""


class _Flangeway(NamedTuple):
    """What the flangeway at the nodes of a rail is made of.

    Attributes
    ----------
    start : ndarray, shape (n_points,)
        Without modes and row forces, up to whole cache lines [m].
    columns : DistanceColumns
        By how much these lessen it.
    parts : sequence of (RailBody, ndarray)
        The rails that bound it, with rows over the coordinates of each.
    """

    start: Floats
    columns: DistanceColumns
    parts: Parts


# Rails are shared by many throws. They are named by identity, and kept beside so that nothing else
# takes their place.
_flangeways = LRUCache[tuple[_Flangeway, list[object]]](MOST_KEPT)


def least_flangeway(
    panel: Panel, motion: Motion, throw: Throw, *, at: int
) -> tuple[float, float, str] | None:
    """Return the least flangeway after a throw [m], its place [m] and its rail.

    Parameters
    ----------
    panel, motion
        Panel and run.
    throw : Throw
        The movement.
    at : int
        Index of the instant at which it is over.

    Returns
    -------
    tuple or None
        None where the panel does not say what the flangeway of the open rail takes.
    """
    name = open_rail(panel, throw.to)
    if name is None:
        return None
    rail, x = panel.rail[name], motion.rails[name].x
    if rail.running_edge is None or rail.head_width is None or not rail.has_stock_rail:
        return None
    found, history = _flangeway(panel, motion, name), motion.history
    distances, force = empty_in_lines(found.start.size), np.empty(motion.slope.size)
    distances[:] = found.start
    lessen_distances(
        distances,
        found.columns,
        history.q[at],
        history.g[at],
        motion.slope,
        history.laws.row,
        history.law_force[at],
        history.laws.friction_row,
        history.friction_force[at],
        force,
    )
    flangeway = distances[: x.size]
    _lessen_by_added_ends(flangeway, motion, found.parts, force)
    place = int(flangeway.argmin())
    return float(flangeway[place]), float(x[place]), name


def _lessen_by_added_ends(flangeway: Floats, motion: Motion, parts: Parts, force: Floats) -> None:
    """Subtract what forces at ends come to that objects added to the blocks of some rails."""
    blocks = motion.condensed.parts
    for body, rows in parts:
        number, first = block_of(blocks, body)
        part = blocks[number]
        if part.before is None:
            continue
        known = part.before.block.rows.size
        own = force[part.block.rows[known:]]
        if own.any():
            shapes = part.model.residual_shapes[first : first + body.count, known:]
            flangeway -= rows @ (shapes @ own)


def _flangeway(panel: Panel, motion: Motion, name: str) -> _Flangeway:
    """Return what the flangeway of a rail is made of, found once for all throws of the rails."""
    rail, x = panel.rail[name], motion.rails[name].x
    faced, bodies = bodies_at_gap(panel, motion, name)
    named: list[object] = [panel.stop, panel.stud, panel.object_defaults, rail, x]
    named += [motion.shapes.get(name), motion.rows, *faced, *(body.recovery for body in bodies)]
    named += _blocks(motion, bodies)
    key = tuple(map(id, named))
    kept = _flangeways.get(key)
    if kept is None:
        kept = _flangeways.put(key, (_made(panel, motion, name), named))
    return kept[0]


def _blocks(motion: Motion, bodies: Sequence[RailBody]) -> list[BlockModel]:
    """Return the blocks of some rails as they are without the ends that objects added."""
    blocks = motion.condensed.parts
    own = [blocks[block_of(blocks, body)[0]] for body in bodies]
    return [part.before or part for part in own]


def _made(panel: Panel, motion: Motion, name: str) -> _Flangeway:
    rail, x = panel.rail[name], motion.rails[name].x
    beyond = np.zeros(x.shape)
    if rail.running_edge is not None and rail.head_width is not None:
        beyond = running_edge_distance(rail.running_edge, x) - rail.head_width
    start, parts = gap_rows(panel, motion, name, x, contact_height(panel, name, x))
    blocks = motion.condensed.parts
    ends = np.cumsum([0, *(part.model.eigenvalues.size for part in blocks)])
    found = list[tuple[Ints, Ints, Floats, Floats]]()
    for (body, rows), part in zip(parts, _blocks(motion, [body for body, _ in parts]), strict=True):
        number, first = block_of(blocks, body)
        own = slice(first, first + body.count)
        of_modes, of_rows, of_load = multiply_by_block(part, rows, own)
        start = start - of_load
        modes = np.arange(ends[number], ends[number + 1])
        found.append((modes, part.block.rows, _in_lines(of_modes), _in_lines(of_rows)))
    columns = DistanceColumns(*(np.concatenate(item) for item in zip(*found, strict=True)))
    clear = _in_lines((start + np.maximum(beyond, 0.0))[:, np.newaxis])[0]
    return _Flangeway(clear, shared_record(columns), parts)


def _in_lines(columns: Floats) -> Floats:
    """Return columns one after the other, each filled up to whole cache lines."""
    count, number = columns.shape
    found = zeros_in_lines(number, whole_lines(count))
    found[:, :count] = columns.T
    return found
