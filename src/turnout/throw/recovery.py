r"""Displacements of any point of a rail from the coordinates that a run has kept.

The condensed system gives the reduced coordinates of all rails as

.. math:: u = \Phi q + R \lambda + r

with the kept modes, the static shapes of the omitted part under the row forces :math:`\lambda`, and
their share of the constant load. :math:`\lambda` is what the laws add to the linear system:
``base_slope g - F`` summed over the laws of a row, less its friction forces. A rail's recovery
matrix then gives its nodes. Where displacements that the run has stored say the same, they are
used instead (`turnout.throw.stored_displacements`), which is ten times as fast.
"""

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from turnout.core.lru_cache import LRUCache
from turnout.mechanism.mechanism import Mechanism, RailBody, RailShape
from turnout.solver.condense import (
    BlockModel,
    CondensedRails,
)
from turnout.solver.integration import History
from turnout.throw.output_rows import (
    HISTORIES,
    OutputRows,
    RowBlock,
    row_blocks,
    weighted_columns,
)
from turnout.throw.stored_displacements import stored_rows, stored_share

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

Parts = Sequence[tuple[RailBody, Floats]]
"""Rails, and rows over the reduced coordinates of each; the products are summed."""
Bound = tuple[int, slice, Floats]
"""Of a rail: number of its block, its coordinates in it, and rows over these."""

UY, RX, PER_NODE = 1, 3, 6
PLACE_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class CondensedShapes:
    """Inputs of the recovery of shapes, except for the run.

    Attributes
    ----------
    rails : dict of str to RailBody
        Reduced rails by name.
    shapes : dict of str to RailShape
        Way of each switch rail from closed to open.
    condensed : CondensedRails
        With modes and static shapes of the whole mechanism.
    rows : ndarray, shape (n, n_coordinates)
        Of the mechanism, without those of objects.
    """

    rails: dict[str, RailBody]
    shapes: dict[str, RailShape]
    condensed: CondensedRails
    rows: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Motion(CondensedShapes):
    """Inputs of the recovery of shapes, with the run.

    Attributes
    ----------
    history : History
        Stored results of the run.
    """

    history: History

    @property
    def slope(self) -> Floats:
        """Stiffness at each row that the linear system holds already, shape (n_rows,) [N/m]."""
        return self.condensed.row_stiffness


def condensed_shapes(mechanism: Mechanism, condensed: CondensedRails) -> CondensedShapes:
    """Collect the inputs of the recovery of shapes before a run."""
    rails = {body.name: body for body in mechanism.rails}
    return CondensedShapes(rails, mechanism.shapes, condensed, mechanism.core)


def recover_motion(mechanism: Mechanism, history: History) -> Motion:
    """Collect the inputs of the recovery of shapes from a run."""
    condensed = history.condensed
    before = condensed_shapes(mechanism, condensed)
    return Motion(before.rails, before.shapes, condensed, before.rows, history)


def histories_of(history: History, at: Ints | None = None) -> dict[str, Floats]:
    """Return the histories for rows over time, at some instants or all."""
    found = {name: getattr(history, name) for name in HISTORIES}
    return found if at is None else {name: values[at] for name, values in found.items()}


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


def row_motion(motion: Motion, parts: Parts, *, at: Ints | None = None) -> Floats:
    """Return rows over the reduced coordinates of some rails, evaluated over time.

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
    return output_rows(motion, row_terms(motion, parts)).over_time(histories_of(motion.history, at))


@dataclass(frozen=True, slots=True, eq=False)
class RowTerms:
    """Rows in terms of the stored results of a run.

    Attributes
    ----------
    modes : ndarray, shape (n_rows, n_modes)
        For unit modal coordinates.
    shapes : ndarray, shape (n_rows, n_law_rows)
        For unit forces of the laws, above the modes.
    load : ndarray, shape (n_rows,)
        Under the constant load, above the modes.
    stored : ndarray, shape (n_rows, n), optional
        For unit stored displacements of the laws' rows but those of objects; what these give is in
        no other attribute.
    """

    modes: Floats
    shapes: Floats
    load: Floats
    stored: Floats | None = None

    def of(self, own: slice | Ints) -> "RowTerms":
        """Return some of the rows."""
        stored = None if self.stored is None else self.stored[own]
        return RowTerms(self.modes[own], self.shapes[own], self.load[own], stored)


# Rails without objects and rows are shared by many throws; named by identity and kept beside.
_terms = LRUCache[tuple[RowTerms, Sequence[Bound], object]](64)
_shares = LRUCache[tuple[Floats, Parts, object]](64)


def row_terms(motion: CondensedShapes, parts: Parts, *, with_stored: bool = True) -> RowTerms:
    """Return rows of some rails in terms of the stored results of a run.

    `with_stored` says whether the run stores the displacements of all rows of its laws.
    """
    return with_objects(motion, *terms_without_objects(motion, parts, with_stored=with_stored))


def with_objects(motion: CondensedShapes, terms: RowTerms, rest: Sequence[Bound]) -> RowTerms:
    """Return the terms of rows with forces at the rows of objects, which displace the `rest`."""
    of_objects = object_shapes(motion, rest)
    if not of_objects.size:
        return terms
    shapes = terms.shapes.copy()
    shapes[:, -of_objects.shape[1] :] = of_objects
    return replace(terms, shapes=shapes)


def terms_without_objects(
    motion: CondensedShapes, parts: Parts, *, with_stored: bool = True
) -> tuple[RowTerms, Sequence[Bound]]:
    """Return `row_terms` but for forces at rows of objects, and the rows that these displace."""
    core = core_blocks(motion.condensed)
    n_rows = motion.condensed.row_stiffness.size
    of_parts = ((body.first, id(rows)) for body, rows in parts)
    key = (n_rows, with_stored, *map(id, core), *of_parts)
    kept = _terms.get(key)
    if kept is not None:
        return kept[:2]
    stored, left = _stored_share(motion, core, parts) if with_stored else (None, parts)
    rest = [bound(core, body, rows) for body, rows in left]
    found = replace(_terms_of_blocks(core, rest, n_rows=n_rows), stored=stored)
    if not any(rows.flags.writeable for _, rows in parts):
        _terms.put(key, (found, rest, (core, parts)))
    return found, rest


def core_blocks(condensed: CondensedRails) -> tuple[BlockModel, ...]:
    """Return the blocks of condensed rails without the ends that objects added."""
    return tuple([part.before or part for part in condensed.parts])


def object_shapes(motion: CondensedShapes, bounds: Sequence[Bound]) -> Floats:
    """Return displacements of some rows for unit forces at the rows of objects.

    Shape (n_rows, n_objects), above the modes [m/N].
    """
    condensed, first = motion.condensed, motion.rows.shape[0]
    found = np.zeros((bounds[0][2].shape[0], condensed.row_stiffness.size - first))
    for numbers, rows, shapes in added_ends(condensed.parts, bounds if found.size else ()):
        found[:, numbers - first] += rows @ shapes.T
    return found


def added_ends(
    parts: Sequence[BlockModel], bounds: Sequence[Bound]
) -> Iterator[tuple[NDArray[np.int64], Floats, Floats]]:
    """Yield the ends that objects added to the blocks of some rows.

    Numbers of the rows of objects, the given rows, and static shapes in the coordinates of these.
    """
    for number, own, rows in bounds:
        part = parts[number]
        if part.added is not None:
            yield part.block.rows[-part.added.load.size :], rows, part.added.shapes[:, own]


def _stored_share(
    motion: CondensedShapes, core: Sequence[BlockModel], parts: Parts
) -> tuple[Floats, Parts]:
    """Return the weights of stored displacements, and the remainder of the rows."""
    named = [motion.rows, *(rows for _, rows in parts)]
    counts = (part.block.rows.size for part in core)
    key = (*map(id, named), *(body.first for body, _ in parts), *counts)
    kept = _shares.get(key)
    if kept is not None:
        return kept[:2]
    usable = np.unique(np.concatenate([part.block.rows for part in core]))
    stored, rails = stored_rows(motion.rows, usable), tuple(motion.rails.values())
    wanted = np.zeros((parts[0][1].shape[0], motion.rows.shape[1]))
    for body, rows in parts:
        wanted[:, body.first : body.first + body.count] += rows
    shares = [stored_share(stored, [(b.first, b.count) for b in rails], row) for row in wanted]
    weights, rest = np.array([share[0] for share in shares]), np.array([s[1] for s in shares])
    found = [(body, rest[:, body.first : body.first + body.count]) for body in rails]
    left = [part for part in found if part[1].any()] or found[:1]
    weights.flags.writeable = False
    if not any(array.flags.writeable for array in named):
        _shares.put(key, (weights, left, named))
    return weights, left


def _terms_of_blocks(
    blocks: Sequence[BlockModel], bounds: Sequence[Bound], *, n_rows: int
) -> RowTerms:
    """Return rows in terms of blocks to which nothing was added."""
    ends = np.cumsum([0, *(part.model.load.size for part in blocks)])
    count = bounds[0][2].shape[0]
    modes, load, shapes = np.zeros((count, ends[-1])), np.zeros(count), np.zeros((count, n_rows))
    for number, own, rows in bounds:
        part = blocks[number]
        of_modes, of_shapes, of_load = multiply_by_block(part, rows, own)
        modes[:, ends[number] : ends[number + 1]] += of_modes
        shapes[:, part.block.rows] += of_shapes
        load += of_load
    return RowTerms(modes, shapes, load)


def stack_terms(terms: Sequence[RowTerms]) -> RowTerms:
    """Return several rows as one."""
    stored = [item.stored for item in terms if item.stored is not None]
    return RowTerms(
        np.concatenate([item.modes for item in terms]),
        np.concatenate([item.shapes for item in terms]),
        np.concatenate([item.load for item in terms]),
        np.concatenate(stored) if stored else None,
    )


def output_rows(
    motion: Motion, terms: RowTerms, *, start: Floats | float = 0.0, sign: float = 1.0
) -> OutputRows:
    """Return rows over time, as their `start` plus or minus some terms."""
    laws = motion.history.laws
    displaced = terms.shapes * motion.slope
    if terms.stored is not None:
        displaced[:, : terms.stored.shape[1]] += terms.stored
    weights = {
        "q": sign * terms.modes,
        "g": sign * displaced,
        "law_force": -sign * terms.shapes[:, laws.row],
        "friction_force": -sign * terms.shapes[:, laws.friction_row],
    }
    return weighted_columns(start + sign * terms.load, weights)


def row_block_of(
    motion: Motion,
    values: Sequence[Hashable],
    make: Callable[[], RowBlock],
) -> RowBlock:
    """Return a block that depends on the rails and the laws of a run too, see `row_blocks`."""
    laws = motion.history.laws
    of_rails = (motion.shapes, motion.rows, motion.condensed)
    of_laws = (part.tobytes() for part in (motion.slope, laws.row, laws.friction_row))
    return row_blocks.get(of_rails, (*values, *of_laws), make)


def block_of(blocks: Sequence[BlockModel], body: RailBody) -> tuple[int, int]:
    """Return the number of the block of a rail, and the index of its first coordinate in it."""
    for number, part in enumerate(blocks):
        first = int(np.searchsorted(part.block.coordinates, body.first))
        if first < part.block.coordinates.size and part.block.coordinates[first] == body.first:
            return number, first
    message = f"rail {body.name} is in no block"
    raise KeyError(message)


def bound(blocks: Sequence[BlockModel], body: RailBody, rows: Floats) -> Bound:
    """Return rows over the coordinates of a rail with their place in its block."""
    number, first = block_of(blocks, body)
    return number, slice(first, first + body.count), rows


def multiply_by_block(part: BlockModel, rows: Floats, own: slice) -> tuple[Floats, Floats, Floats]:
    """Return rows of a rail in terms of the modes, row forces and load of its block.

    Parameters
    ----------
    part : BlockModel
        The block.
    rows : ndarray, shape (n, n_coordinates)
        Over the coordinates of the rail.
    own : slice
        These among the coordinates of the block.

    Returns
    -------
    tuple of ndarray, shapes (n, n_modes), (n, n_rows), (n,)
    """
    model = part.model
    return (
        rows @ model.modes[own],
        rows @ model.residual_shapes[own],
        rows @ model.residual_load[own],
    )
