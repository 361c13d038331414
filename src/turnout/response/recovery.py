r"""Displacements of any point of a rail from the coordinates that a run has kept.

The condensed system gives the reduced coordinates of all rails as

.. math:: u = \Phi q + R \lambda + r

with the kept modes, the static shapes of the omitted part under the row forces :math:`\lambda`, and
their share of the constant load. :math:`\lambda` is what the laws add to the linear system:
``base_slope g - F`` summed over the laws of a row, less its friction forces. A rail's recovery
matrix then gives its nodes.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from turnout.condense.condense import (
    BlockModel,
    CondensedRails,
    folded_stiffness,
    sum_at_rows,
)
from turnout.core.lru_cache import LRUCache
from turnout.integrate.integration import History
from turnout.mechanism.mechanism import Mechanism, RailBody, RailShape

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

Parts = Sequence[tuple[RailBody, Floats]]
"""Rails, and rows over the reduced coordinates of each; what they come to is summed."""

UY, RX, PER_NODE = 1, 3, 6
PLACE_TOLERANCE = 1e-6
MOST_SEEN = 64
"""Sets of rows in terms of blocks in memory, the latest used."""
MOST_PRODUCTS = 256
"""Products of rows with blocks in memory, the latest used."""


@dataclass(frozen=True, slots=True)
class CondensedShapes:
    """What shapes are recovered from, but for the run.

    Attributes
    ----------
    rails : dict of str to RailBody
        Reduced rails by name.
    shapes : dict of str to RailShape
        Way of each switch rail from closed to open.
    condensed : CondensedRails
        With modes and static shapes of the whole mechanism.
    n_rows : int
        Of the mechanism.
    """

    rails: dict[str, RailBody]
    shapes: dict[str, RailShape]
    condensed: CondensedRails
    n_rows: int


@dataclass(frozen=True, slots=True)
class Motion(CondensedShapes):
    """All that shapes are recovered from.

    Attributes
    ----------
    history : History
        The run.
    slope : ndarray, shape (n_rows,)
        Stiffness at each row that the linear system holds already [N/m].
    seen : dict
        Rows that were recovered before, of this run at these or at other instants.
    """

    history: History
    slope: Floats
    seen: dict[Hashable, "tuple[Floats, Seen]"] = field(default_factory=dict)


def condensed_shapes(mechanism: Mechanism, condensed: CondensedRails) -> CondensedShapes:
    """Collect what the recovery of shapes needs before a run."""
    rails = {body.name: body for body in mechanism.rails}
    return CondensedShapes(rails, mechanism.shapes, condensed, mechanism.rows.shape[0])


def recover_motion(mechanism: Mechanism, history: History) -> Motion:
    """Collect what the recovery of shapes needs from a run."""
    laws, before = history.laws, condensed_shapes(mechanism, history.condensed)
    slope = sum_at_rows(laws, folded_stiffness(laws), before.n_rows)
    of_rails = before.rails, before.shapes, before.condensed, before.n_rows
    return Motion(*of_rails, history, slope)


def force_motion(motion: Motion, shapes: Floats, *, at: Ints | None = None) -> Floats:
    """Return what displacements by row forces come to under those of the laws over time.

    The force on a row is that of laws and frictions beyond the linear system. It is never formed
    for all rows and instants: each kind of force goes by its own columns.

    Parameters
    ----------
    motion : Motion
        The run.
    shapes : ndarray, shape (n, n_rows)
        Displacements for a unit force along each row [m/N].
    at : ndarray of int, optional
        Indices of the wanted instants; default all.

    Returns
    -------
    ndarray, shape (n, n_times)
        [m]
    """
    history, laws = motion.history, motion.history.laws
    moved: Floats = _weighted_sum(shapes * motion.slope, _at(history.g, at))
    moved -= _weighted_sum(shapes[:, laws.row], _at(history.law_force, at))
    moved -= _weighted_sum(shapes[:, laws.friction_row], _at(history.friction_force, at))
    return moved


def _weighted_sum(weights: Floats, values: Floats) -> Floats:
    """Return ``weights @ values.T`` without the columns in which all weights are zero.

    A rail feels the forces on its own rows, less than half of all.
    """
    used = np.flatnonzero(weights.any(axis=0))
    if not used.size:
        return np.zeros((weights.shape[0], values.shape[0]))
    columns: slice | Ints = slice(used[0], used[-1] + 1)
    if 2 * used.size < used[-1] + 1 - used[0]:
        columns = used
    found: Floats = weights[:, columns] @ values[:, columns].T
    return found


def lateral_rows(body: RailBody, x: Floats, z: Floats) -> Floats:
    """Return rows that take a rail's reduced coordinates to lateral displacements.

    A point at height z moves by ``u_y - r_x z``; between nodes both vary linearly.

    Parameters
    ----------
    body : RailBody
        The rail.
    x, z : ndarray, shape (n_points,)
        Places along the rail and heights above the reference line [m].

    Returns
    -------
    ndarray, shape (n_points, body.count)
        NaN where x lies beyond the rail.
    """
    left = np.clip(np.searchsorted(body.x, x, side="right") - 1, 0, body.x.size - 2)
    share = (x - body.x[left]) / (body.x[left + 1] - body.x[left])
    beyond = (x < body.x[0] - PLACE_TOLERANCE) | (x > body.x[-1] + PLACE_TOLERANCE)
    share = np.where(beyond, np.nan, np.clip(share, 0.0, 1.0))[:, np.newaxis]
    lateral, roll = body.recovery[UY::PER_NODE], body.recovery[RX::PER_NODE]
    at_left = lateral[left] - z[:, np.newaxis] * roll[left]
    at_right = lateral[left + 1] - z[:, np.newaxis] * roll[left + 1]
    rows: Floats = at_left + share * (at_right - at_left)
    return rows


def lateral_displacement(
    motion: Motion, rail: str, *, x: Floats, z: Floats, at: Ints | None = None
) -> Floats:
    """Return lateral displacements of points of a rail over time, positive in +y.

    Parameters
    ----------
    motion : Motion
        The run.
    rail : str
        Name of the rail.
    x, z : ndarray, shape (n_points,)
        Places and heights above the reference line [m].
    at : ndarray of int, optional
        Indices of the wanted instants; default all.

    Returns
    -------
    ndarray, shape (n_points, n_times)
        [m]; NaN beyond the rail.
    """
    body = motion.rails[rail]
    return row_motion(motion, [(body, lateral_rows(body, x, z))], at=at)


def row_motion(motion: Motion, parts: Parts, *, at: Ints | None = None) -> Floats:
    """Return what rows over the reduced coordinates of some rails come to over time.

    Parameters
    ----------
    motion : Motion
        The run.
    parts : sequence of (RailBody, ndarray)
        Rails, and rows over the coordinates of each, shape (n_rows, body.count), that are summed.
    at : ndarray of int, optional
        Indices of the wanted instants; default all.

    Returns
    -------
    ndarray, shape (n_rows, n_times)
    """
    # Whichever of rows and instants are fewer meet the large matrices first.
    if at is not None and at.size < parts[0][1].shape[0]:
        return _motion_at(motion, parts, at)
    return seen_motion(motion, seen_by(motion, parts), at=at)


@dataclass(frozen=True, slots=True)
class Seen:
    """Rows in terms of what a run has kept.

    Attributes
    ----------
    modes : ndarray, shape (n_rows, n_modes)
        For unit modal coordinates.
    shapes : ndarray, shape (n_rows, n_law_rows)
        For unit forces of the laws, above the modes.
    load : ndarray, shape (n_rows,)
        Under the constant load, above the modes.
    """

    modes: Floats
    shapes: Floats
    load: Floats


# Rails without objects and rows are shared by many throws; named by identity and kept beside.
_seen = LRUCache[tuple[Seen, object]](MOST_SEEN)


def seen_by(motion: CondensedShapes, parts: Parts) -> Seen:
    """Return rows of some rails in terms of what a run has kept."""
    blocks = motion.condensed.parts
    core = tuple(part.before or part for part in blocks)
    key = (motion.n_rows, *map(id, core), *((body.first, id(rows)) for body, rows in parts))
    kept = _seen.get(key)
    if kept is None:
        found = _seen_without_objects(core, parts, n_rows=motion.n_rows)
        if not any(rows.flags.writeable for _, rows in parts):
            _seen.put(key, (found, (core, parts)))
    else:
        found = kept[0]
    return replace(found, shapes=_with_objects(blocks, parts, found.shapes))


def _seen_without_objects(blocks: Sequence[BlockModel], parts: Parts, *, n_rows: int) -> Seen:
    """Return rows in terms of blocks to which nothing was added."""
    ends = np.cumsum([0, *(part.model.eigenvalues.size for part in blocks)])
    count = parts[0][1].shape[0]
    modes, load, shapes = np.zeros((count, ends[-1])), np.zeros(count), np.zeros((count, n_rows))
    for body, rows in parts:
        number, first = _block_of(blocks, body)
        part, own = blocks[number], slice(first, first + body.count)
        of_modes, of_shapes, of_load = _in_block(part, rows, own)
        modes[:, ends[number] : ends[number + 1]] += of_modes
        shapes[:, part.block.rows] += of_shapes
        load += of_load
    return Seen(modes, shapes, load)


def _with_objects(blocks: Sequence[BlockModel], parts: Parts, shapes: Floats) -> Floats:
    """Return static shapes with those of the ends that were added to the blocks."""
    found = shapes
    for body, rows in parts:
        number, first = _block_of(blocks, body)
        part = blocks[number]
        if part.before is None:
            continue
        if found is shapes:
            found = shapes.copy()
        known = part.before.block.rows.size
        further = part.model.residual_shapes[first : first + body.count, known:]
        found[:, part.block.rows[known:]] += rows @ further
    return found


def _block_of(blocks: Sequence[BlockModel], body: RailBody) -> tuple[int, int]:
    """Return the number of the block of a rail, and where in it its coordinates begin."""
    for number, part in enumerate(blocks):
        first = int(np.searchsorted(part.block.coordinates, body.first))
        if first < part.block.coordinates.size and part.block.coordinates[first] == body.first:
            return number, first
    message = f"rail {body.name} is in no block"
    raise KeyError(message)


# Blocks and rows are shared by many throws; both are named by identity and kept beside.
_products = LRUCache[tuple[tuple[Floats, Floats, Floats], object]](MOST_PRODUCTS)


def _in_block(part: BlockModel, rows: Floats, own: slice) -> tuple[Floats, Floats, Floats]:
    """Return what rows of a rail come to for the modes, row forces and load of its block."""
    key = (id(part), id(rows), own.start)
    found = _products.get(key)
    if found is not None:
        return found[0]
    model = part.model
    made = (
        rows @ model.modes[own],
        rows @ model.residual_shapes[own],
        rows @ model.residual_load[own],
    )
    if not rows.flags.writeable:
        _products.put(key, (made, (part, rows)))
    return made


def seen_motion(motion: Motion, seen: Seen, *, at: Ints | None = None) -> Floats:
    """Return what such rows come to over time, shape (n_rows, n_times)."""
    moved: Floats = _weighted_sum(seen.modes, _at(motion.history.q, at))
    moved += force_motion(motion, seen.shapes, at=at)
    moved += seen.load[:, np.newaxis]
    return moved


def _motion_at(motion: Motion, parts: Parts, at: Ints) -> Floats:
    """Return what many rows come to at a few instants, by the coordinates of the rails there."""
    history, laws = motion.history, motion.history.laws
    force = history.g[at].T * motion.slope[:, np.newaxis]
    np.subtract.at(force, laws.row, history.law_force[at].T)
    np.subtract.at(force, laws.friction_row, history.friction_force[at].T)
    modal, blocks = history.q[at].T, motion.condensed.parts
    ends = np.cumsum([0, *(part.model.eigenvalues.size for part in blocks)])
    moved = np.zeros((parts[0][1].shape[0], at.size))
    for body, rows in parts:
        number, first = _block_of(blocks, body)
        part, own = blocks[number], slice(first, first + body.count)
        coordinates = part.model.modes[own] @ modal[ends[number] : ends[number + 1]]
        coordinates += part.model.residual_shapes[own] @ force[part.block.rows]
        moved += rows @ (coordinates + part.model.residual_load[own, np.newaxis])
    return moved


def _at(values: Floats, at: Ints | None) -> Floats:
    return values if at is None else values[at]
