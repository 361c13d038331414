"""Condense a mechanism to the modes of its blocks and the residual flexibility above them.

The stiffness of the laws on their base segments is part of the linear system; for modes and
flexibility see `turnout.solver.modal`. Of a driven law (the bushing of a drive) it is not its own
stiffness but the *home* one next to it, so that drives of many stiffnesses share one condensation;
the difference is a deviation like that of any law off its base segment.

Rails that only laws outside the linear system join (a link, a stop against a stock rail that bends,
a foreign object) are *blocks* of their own: their modes, flexibility and columns stay small. A row
that reaches into two blocks has an *end* in each; all other rows have one end. A stop, the foot on
a slide chair and the edges of that foot are points of one rigid section, so the displacement of one
follows from those of the others. Only *leading* rows need columns of their own.
"""

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import eigh, solve_triangular

from turnout.core.content_cache import digest
from turnout.core.lru_cache import LRUCache
from turnout.law.table import LawTable
from turnout.mechanism.mechanism import Matrices, Mechanism, ReducedRail
from turnout.mechanism.varied_rails import VariedRail
from turnout.solver.modal import (
    AddedRows,
    LinearSystem,
    ModalModel,
    Omitted,
    added_rows,
    diagonalise_damping,
    model_of,
    split_modes,
    split_modes_near,
    with_rows,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """A group of rails of a mechanism that is solved on its own.

    Attributes
    ----------
    coordinates : ndarray of int, shape (n,)
        Indices of its coordinates in the mechanism.
    rows : ndarray of int, shape (n_ends,)
        Indices of the rows that have an end in it.
    """

    coordinates: Ints
    rows: Ints


def split_blocks(mechanism: Mechanism, laws: LawTable) -> tuple[Block, ...]:
    """Split a mechanism into blocks.

    Parameters
    ----------
    mechanism : Mechanism
        A mechanism without rails, or with only one, is one block.
    laws : LawTable
        Its laws; rails that a base segment, or a friction with its normal law, joins are one block.

    Returns
    -------
    tuple of Block
        Each row has an end in one of them, or in two.
    """
    n_rows, size = mechanism.rows.shape
    if len(mechanism.rails) < 2:
        return (Block(np.arange(size), np.arange(n_rows)),)
    touched = _find_touched_rails(mechanism)
    groups = _group_rails(touched, laws)
    first_touched = np.where(touched.any(axis=1), groups[touched.argmax(axis=1)], 0)
    blocks = []
    for group in range(groups.max() + 1):
        members = [
            rail for rail, mine in zip(mechanism.rails, groups, strict=True) if mine == group
        ]
        inside = touched[:, groups == group].any(axis=1)
        idle = ~touched.any(axis=1) & (first_touched == group)
        own = [np.arange(rail.first, rail.first + rail.count) for rail in members]
        blocks.append(Block(np.concatenate(own), np.flatnonzero(inside | idle)))
    return tuple(blocks)


def drop_joining_bases(mechanism: Mechanism, laws: LawTable) -> LawTable:
    """Return the laws with no base segment where a law joins two rails."""
    if len(mechanism.rails) < 2:
        return laws
    joins = _find_touched_rails(mechanism).sum(axis=1)[laws.row] > 1
    return laws._replace(base_segment=np.where(joins, -1, laws.base_segment))


def _find_touched_rails(mechanism: Mechanism) -> Flags:
    """Return which rails each row reaches into, shape (n_rows, n_rails)."""
    used = mechanism.rows != 0.0
    of_rails = [used[:, rail.first : rail.first + rail.count] for rail in mechanism.rails]
    return np.array([of_rail.any(axis=1) for of_rail in of_rails]).T


def _group_rails(touched: Flags, laws: LawTable) -> Ints:
    """Return the block of every rail; rails that must be solved together share one."""
    together = np.concatenate(
        (
            touched[laws.row[laws.base_segment >= 0]],
            touched[laws.friction_row] | touched[laws.row[laws.friction_normal]],
            touched[touched.sum(axis=1) > 2],
        )
    )
    group = np.arange(touched.shape[1])
    bits = np.unique(together @ (1 << group))  # of the rails that must be, once each
    for rails in (bits[:, np.newaxis] >> group) & 1 == 1:
        if rails.any():
            group[np.isin(group, group[rails])] = group[rails].min()
    return np.unique(group, return_inverse=True)[1].astype(np.int64)


EXACT = 1e-12
"""Largest remainder of a row that follows, relative to its norm [-]."""
LARGEST_WEIGHT = 100.0
"""Largest weight of a row that follows [-]; beyond, it leads, since its terms would cancel."""


@dataclass(frozen=True, slots=True, eq=False)
class Leading:
    """Which rows lead, and how all rows follow from them.

    Attributes
    ----------
    leaders : ndarray of int, shape (n_leaders,)
        Indices of the leading rows, rising.
    weights : ndarray, shape (n_rows, n_leaders)
        ``rows = weights @ rows[leaders]``; those of a leader are a one and zeros.
    """

    leaders: Ints
    weights: Floats


_leading = LRUCache[Leading](48)


def leading_rows(rows: Floats, *, first: NDArray[np.bool_]) -> Leading:
    """Choose rows from which all others follow exactly.

    Parameters
    ----------
    rows : ndarray, shape (n_rows, n_coordinates)
        Displacements as combinations of coordinates.
    first : ndarray of bool, shape (n_rows,)
        Rows that lead if they can. Among the others those in front lead, so that one more row at
        the end changes nothing for the others.

    Returns
    -------
    Leading
        Read-only arrays.

    Examples
    --------
    >>> rows = np.array([[1.0, 0.0], [1.0, 0.0], [1.0, 2.0]])
    >>> found = leading_rows(rows, first=np.array([False, True, False]))
    >>> found.leaders.tolist(), found.weights.tolist()
    ([1, 2], [[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    """
    key = (rows.shape, rows.tobytes(), first.tobytes())
    found = _leading.get(key)
    return found if found is not None else _leading.put(key, _choose_leaders(rows, first))


def _choose_leaders(rows: Floats, first: NDArray[np.bool_]) -> Leading:
    count = rows.shape[0]
    basis, shares = np.zeros_like(rows), np.zeros((count, count))
    independent: list[int] = []
    for row in np.concatenate((np.flatnonzero(first), np.flatnonzero(~first))):
        left, found = rows[row].copy(), len(independent)
        for _ in range(2):  # once more, since what is left may be rounding
            share = basis[:found] @ left
            left -= share @ basis[:found]
            shares[row, :found] += share
        rest = float(np.linalg.norm(left))
        if rest > EXACT * float(np.linalg.norm(rows[row])):
            basis[found], shares[row, found] = left / rest, rest
            independent.append(int(row))
    shares = shares[:, : len(independent)]
    weights = solve_triangular(shares[independent].T, shares.T, lower=False).T
    heavy = np.flatnonzero(np.abs(weights).max(axis=1, initial=0.0) > LARGEST_WEIGHT)
    leaders = np.array(sorted({*independent, *heavy.tolist()}), dtype=np.int64)
    of_leaders = np.zeros((count, leaders.size))
    of_leaders[:, np.searchsorted(leaders, independent)] = weights
    of_leaders[leaders] = np.eye(leaders.size)
    for array in (leaders, of_leaders):
        array.flags.writeable = False
    return Leading(leaders, of_leaders)


@dataclass(frozen=True, eq=False)
class _Given:
    """Data behind the modal model of a block, and the rail that it is if it is one alone.

    `linear` is without laws, whose stiffnesses `at_rows` act at its rows [N/m]; the rows that are
    `first` lead if they can.
    """

    linear: LinearSystem
    rows: Floats
    at_rows: Floats
    first: NDArray[np.bool_]
    rail: ReducedRail | None

    @cached_property
    def of_laws(self) -> Floats:
        """Stiffness of the laws in the coordinates of the block."""
        return (self.rows.T * self.at_rows) @ self.rows

    def of_other_laws(self, at_rows: Floats) -> Floats:
        """Return the stiffness of laws with others at the rows."""
        other = np.flatnonzero(at_rows != self.at_rows)
        if not other.size:
            return self.of_laws
        rows = self.rows[other]
        found: Floats = self.of_laws + (rows.T * (at_rows - self.at_rows)[other]) @ rows
        return found

    @cached_property
    def beside(self) -> str:
        """Digest of rows and laws."""
        return digest((self.rows, self.at_rows, self.first))

    def key(self, cutoff_frequency: float) -> tuple[object, ...]:
        """Return what names this: a rail is known by identity, all else by its content."""
        matrices = self.linear[:-1]
        name = digest(matrices) if self.rail is None else tuple(map(id, matrices))
        return name, self.beside, cutoff_frequency


_models = LRUCache[tuple[ModalModel, Leading, Omitted, ReducedRail | None]](32)


def _cached_model(given: _Given, *, cutoff_frequency: float) -> tuple[ModalModel, Leading, Omitted]:
    """Return the modal model of a block, leading rows, and other modes, all read-only.

    Its damping is diagonal. Throws that differ in friction, objects or motion only share them.
    """
    key = given.key(cutoff_frequency)
    found = _models.get(key)
    if found is None:
        held = given.linear._replace(stiffness=given.linear.stiffness + given.of_laws)
        model, omitted = split_modes(held, cutoff_frequency)
        model = diagonalise_damping(model)
        for record in (model, omitted):
            for item in fields(record):
                getattr(record, item.name).flags.writeable = False
        leading = leading_rows(given.rows, first=given.first)
        found = _models.put(key, (model, leading, omitted, given.rail))
    return found[:3]


def _varied_model(
    nominal: "BlockModel",
    rail: VariedRail,
    at_rows: Floats,
    *,
    cutoff_frequency: float,
    at_homes: bool,
) -> tuple[ModalModel, Leading, Omitted] | None:
    """Return the model of a block from that of the nominal one; None where it is not near.

    `at_homes` says that only driven laws differ from the nominal ones, which have few homes.
    """
    given, omitted = nominal.given, nominal.omitted
    if given is None or omitted is None:
        return None
    if at_homes:
        model = _smooth_model(given, nominal.model, rail, at_rows, cutoff_frequency)
        if model is not None:
            return diagonalise_damping(model[0]), nominal.leading, model[1]
    stiffness = rail.stiffness + given.of_other_laws(at_rows)
    held = LinearSystem(stiffness, rail.mass, rail.damping, rail.load, given.linear.rows)
    start = np.hstack((nominal.model.modes, omitted.modes))
    found = split_modes_near(held, cutoff_frequency, start=start)
    if found is None:
        return None
    return diagonalise_damping(found[0]), nominal.leading, found[1]


def _smooth_model(
    given: _Given, nominal: ModalModel, rail: VariedRail, at_rows: Floats, cutoff_frequency: float
) -> tuple[ModalModel, Omitted] | None:
    """Return the model of a block from a surface of its family; None where there is none.

    Modes are turned so that they are as near to the nominal ones as can be: what they span varies
    smoothly, even where their frequencies cross.
    """
    count = given.linear.load.size
    weight, limit = float(np.linalg.norm(given.linear.load)), (2.0 * np.pi * cutoff_frequency) ** 2

    def split(matrices: Matrices) -> tuple[Floats, ...]:
        stiffness = matrices.stiffness + given.of_other_laws(at_rows)
        eigenvalues, shapes = eigh(stiffness, matrices.mass)
        kept = int(np.searchsorted(eigenvalues, limit, side="right"))
        if kept != nominal.load.size:
            return (eigenvalues[:kept],)
        low, high = shapes[:, :kept], shapes[:, kept:]
        left, _, right = np.linalg.svd(low.T @ given.linear.mass @ nominal.modes)
        turn, load = left @ right, matrices.load / weight
        stiffness, low = (turn.T * eigenvalues[:kept]) @ turn, low @ turn
        flexible = (high / eigenvalues[kept:]) @ high.T
        of_load = flexible @ load
        return (
            stiffness,
            low.T @ matrices.damping @ low,
            np.vstack((low, low.T @ load)),
            np.column_stack((flexible, of_load)),
        )

    key = ("modes", given.beside, at_rows.tobytes(), cutoff_frequency)
    found = rail.follow(key, split) if weight > 0.0 else None
    if found is None:
        return None
    stiffness, damping, low, flexible = found
    flexibility = flexible[:, :count]
    of_modes, residual_load = (stiffness, damping, weight * low[count]), weight * flexible[:, count]
    model = model_of(of_modes, low[:count], flexibility, residual_load, given.linear.rows)
    return model, Omitted(flexibility, low[:count, :0])


@dataclass(frozen=True)
class BlockModel:
    """A block of a mechanism with its modal model, whose rows are the ends of the block.

    `own_model` and `own_leading` are without the ends that were `added`; `before` is the block
    without these. `omitted` are the modes above the cut-off, where further ends are wanted, `given`
    what the model follows from.
    """

    block: Block
    own_model: ModalModel
    own_leading: Leading
    omitted: Omitted | None = None
    given: _Given | None = None
    before: "BlockModel | None" = None
    added: AddedRows | None = None

    @cached_property
    def model(self) -> ModalModel:
        """Modal model of all ends."""
        return self.own_model if self.added is None else with_rows(self.own_model, self.added)

    @cached_property
    def leading(self) -> Leading:
        """Ends that the others follow from; added ones all lead."""
        known = self.own_leading
        if self.added is None:
            return known
        count, n_added = known.weights.shape[0], self.added.load.size
        weights = np.zeros((count + n_added, known.leaders.size + n_added))
        weights[:count, :-n_added] = known.weights
        weights[count:, -n_added:] = np.eye(n_added)
        leaders = np.concatenate((known.leaders, count + np.arange(n_added)))
        return Leading(leaders, weights)

    def with_ends(self, numbers: Ints, rows: Floats) -> "BlockModel":
        """Return the block with further ends, which all lead.

        Parameters
        ----------
        numbers : ndarray of int, shape (n_added,)
            Of their rows, beyond those of the block.
        rows : ndarray, shape (n_added, n_coordinates)
            In the coordinates of the block.
        """
        if self.omitted is None:
            message = "a block without its omitted modes takes no further ends"
            raise ValueError(message)
        block = Block(self.block.coordinates, np.concatenate((self.block.rows, numbers)))
        added = added_rows(self.own_model, self.omitted.flexibility, rows)
        return BlockModel(block, self.own_model, self.own_leading, before=self, added=added)


@dataclass(frozen=True, eq=False)
class CondensedRails:
    """All blocks of a mechanism; `model` puts them together on first use.

    Attributes
    ----------
    parts : tuple of BlockModel
        The blocks.
    n_coordinates : int
        Of the mechanism.
    row_stiffness : ndarray, shape (n_rows,)
        Stiffness at each row of the mechanism that the linear system holds [N/m].
    alone : bool
        Whether they are of a single throw, as rails that vary are.
    """

    parts: tuple[BlockModel, ...]
    n_coordinates: int
    row_stiffness: Floats
    alone: bool

    @cached_property
    def kept(self) -> dict[Hashable, Any]:
        """Results for these rails and the places of their objects, by the key of what asks."""
        return {}

    @cached_property
    def model(self) -> ModalModel:
        """The modal model of the whole mechanism, its modes in the order of the blocks."""
        parts, n, n_rows = self.parts, self.n_coordinates, self.row_stiffness.size
        modes = np.cumsum([0, *(part.model.load.size for part in parts)])
        whole = ModalModel(
            stiffness=np.zeros((modes[-1], modes[-1])),
            damping=np.zeros((modes[-1], modes[-1])),
            modes=np.zeros((n, modes[-1])),
            row_modes=np.zeros((n_rows, modes[-1])),
            flexibility=np.zeros((n_rows, n_rows)),
            residual_shapes=np.zeros((n, n_rows)),
            load=np.concatenate([part.model.load for part in parts]),
            residual_load=np.zeros(n),
            row_load=np.zeros(n_rows),
        )
        for part, first, last in zip(parts, modes[:-1], modes[1:], strict=True):
            rows, at, model = part.block.rows, part.block.coordinates, part.model
            whole.stiffness[first:last, first:last] = model.stiffness
            whole.damping[first:last, first:last] = model.damping
            whole.modes[at, first:last] = model.modes
            whole.row_modes[rows, first:last] = model.row_modes
            whole.flexibility[np.ix_(rows, rows)] += model.flexibility
            whole.residual_shapes[np.ix_(at, rows)] = model.residual_shapes
            whole.residual_load[at] = model.residual_load
            whole.row_load[rows] += model.row_load
        return whole


def condense_blocks(
    mechanism: Mechanism,
    laws: LawTable,
    *,
    cutoff_frequency: float,
    nominal: Sequence[BlockModel] = (),
) -> tuple[BlockModel, ...]:
    """Return the modal model of each block, the base segments of its laws included.

    `nominal` are the blocks of `mechanism.nominal`, if its laws act on the same rows.

    Raises
    ------
    MechanicsError
        If a block is not held.
    """
    at_rows = sum_at_rows(laws, folded_stiffness(laws), mechanism.rows.shape[0])
    rubs = np.zeros(at_rows.size, dtype=bool)
    rubs[laws.friction_row] = rubs[laws.row[laws.friction_normal]] = True
    driven = np.zeros(at_rows.size, dtype=bool)
    driven[laws.row[laws.input_index >= 0]] = True
    varied = {r.body.first: r for r in mechanism.reduced if isinstance(r, VariedRail)}
    known = {part.block: part for part in nominal}
    found = []
    for block in known or split_blocks(mechanism, laws):
        own, made, part = at_rows[block.rows], None, known.get(block)
        if part is not None and part.given is not None:
            rail = varied.get(int(block.coordinates[0]))
            other = own != part.given.at_rows
            if part.given.rail is not None and rail is not None:
                made = _varied_model(
                    part,
                    rail,
                    own,
                    cutoff_frequency=cutoff_frequency,
                    at_homes=not (other & ~driven[block.rows]).any(),
                )
            elif part.given.rail in mechanism.reduced and not other.any():
                found.append(part)
                continue
        given = None
        if made is None:
            given = _of_block(mechanism, block, at_rows=own, first=rubs[block.rows])
            made = _cached_model(given, cutoff_frequency=cutoff_frequency)
        model, leading, omitted = made
        found.append(BlockModel(block, model, leading, omitted, given=given))
    return tuple(found)


def _of_block(
    mechanism: Mechanism, block: Block, *, at_rows: Floats, first: NDArray[np.bool_]
) -> _Given:
    """Return what the model of a block follows from, in its coordinates."""
    at = block.coordinates
    own: slice | Ints = at
    if at.size and at[-1] - at[0] == at.size - 1 and np.all(np.diff(at) == 1):
        own = slice(int(at[0]), int(at[-1]) + 1)
    rows = mechanism.rows[block.rows][:, own]
    for rail in mechanism.reduced:
        alone = rail.body.first == at[0] and rail.body.count == at.size
        if alone and not rail.load.flags.writeable:
            given = rail.stiffness, rail.mass, rail.damping, rail.load
            break
    else:
        rail, square = None, (own, own) if isinstance(own, slice) else np.ix_(at, at)
        whole = mechanism.stiffness, mechanism.mass, mechanism.damping
        stiffness, mass, damping = (matrix[square] for matrix in whole)
        given = stiffness, mass, damping, mechanism.load[own]
    linear = LinearSystem(*given, sp.csr_array(rows))  # most rows reach few coordinates
    return _Given(linear, rows, at_rows, first, rail)


def condense(mechanism: Mechanism, *, cutoff_frequency: float) -> ModalModel:
    """Return the modal model of a whole mechanism, the base segments of its laws included."""
    rows, laws = mechanism.rows, mechanism.laws
    at_rows = sum_at_rows(laws, base_stiffness(laws), rows.shape[0])
    stiffness = mechanism.stiffness + (rows.T * at_rows) @ rows
    given = mechanism.mass, mechanism.damping, mechanism.load, rows
    return split_modes(LinearSystem(stiffness, *given), cutoff_frequency)[0]


def base_stiffness(table: LawTable) -> Floats:
    """Return the stiffness of each law on its base segment [N/m], zero for none."""
    laws = np.flatnonzero(table.base_segment >= 0)
    slope = np.zeros(table.row.size)
    slope[laws] = table.slope[table.segment_start[laws] + table.base_segment[laws]]
    return slope


MOST_HOMES = 256
"""Stiffnesses whose homes are in memory, the latest used."""
HOMES = (750e3, 810e3)
"""Home stiffnesses of one octave, those of the published drives, so that throws of library panels
are condensed as they are [N/m]."""


@lru_cache(maxsize=MOST_HOMES)
def home_stiffness(stiffness: float) -> float:
    """Return the home next to a stiffness by ratio: `HOMES` times a power of two [N/m].

    It depends on the stiffness alone, so that a throw does not depend on those before it. What is
    not positive is its own home.

    Examples
    --------
    >>> home_stiffness(750e3), home_stiffness(790e3), home_stiffness(81e3), home_stiffness(0.0)
    (750000.0, 810000.0, 93750.0, 0.0)
    """
    if not 0.0 < stiffness < math.inf:
        return stiffness
    octave = math.floor(math.log2(stiffness / HOMES[0]))
    homes = [home * 2.0 ** (octave + more) for more in (-1, 0, 1) for home in HOMES]
    return min(homes, key=lambda home: abs(math.log(stiffness / home)))


def folded_stiffness(table: LawTable) -> Floats:
    """Return the stiffness of each law in the condensed linear system [N/m], zero for none.

    It is `base_stiffness` but for driven laws, which have that of their home.
    """
    slope = base_stiffness(table)
    for law in np.flatnonzero(table.input_index >= 0).tolist():
        slope[law] = home_stiffness(float(slope[law]))
    return slope


def sum_at_rows(table: LawTable, stiffness: Floats, n_rows: int) -> Floats:
    """Return the sum of the stiffnesses of all laws at each row [N/m]."""
    found: Floats = np.bincount(table.row, stiffness, n_rows).astype(np.float64)
    return found
