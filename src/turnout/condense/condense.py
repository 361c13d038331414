"""Condense a mechanism to the modes of its blocks and the residual flexibility above them.

The stiffness of the laws on their base segments is part of the linear system; for modes and
flexibility see `turnout.condense.modal`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from turnout.condense.blocks import Block, split_blocks
from turnout.condense.followers import Leading, leading_rows
from turnout.condense.modal import ModalModel, diagonalise_damping, modal_model
from turnout.core.content_cache import cached_arrays
from turnout.law.table import LawTable
from turnout.mechanism.mechanism import Mechanism

Floats = NDArray[np.float64]


def _cached_model(
    stiffness: Floats,
    mass: Floats,
    *,
    damping: Floats,
    rows: Floats,
    at_rows: Floats,
    first: NDArray[np.bool_],
    load: Floats,
    cutoff_frequency: float,
) -> tuple[ModalModel, Leading]:
    """Return the modal model with stiffnesses `at_rows` added [N/m], and the leading rows.

    Its damping is diagonal. Both are cached: throws that differ in friction, objects or motion only
    share them.
    """

    def compute() -> dict[str, Floats]:
        model = modal_model(
            stiffness + (rows.T * at_rows) @ rows,
            mass,
            damping=damping,
            rows=rows,
            load=load,
            cutoff_frequency=cutoff_frequency,
        )
        model = diagonalise_damping(model)
        leading = leading_rows(rows, first=first)
        found = {item.name: getattr(model, item.name) for item in fields(model)}
        of_rows = {"leaders": leading.leaders.astype(np.float64), "weights": leading.weights}
        return found | of_rows

    parts = (stiffness, mass, damping, rows, at_rows, first, load, cutoff_frequency)
    kept = dict(cached_arrays("modes", parts, compute, on_disk=False))
    leading = Leading(kept.pop("leaders").astype(np.int64), kept.pop("weights"))
    return ModalModel(**kept), leading


@dataclass(frozen=True, slots=True)
class BlockModel:
    """A block of a mechanism with its modal model, whose rows are the ends of the block.

    `leading` holds the ends that the others follow from.
    """

    block: Block
    model: ModalModel
    leading: Leading


def condense_blocks(
    mechanism: Mechanism, laws: LawTable, *, cutoff_frequency: float
) -> tuple[BlockModel, ...]:
    """Return the modal model of each block, the base segments of its laws included.

    Raises
    ------
    MechanicsError
        If a block is not held.
    """
    at_rows = _sum_base_stiffness(mechanism.rows.shape[0], laws)
    rubs = np.zeros(at_rows.size, dtype=bool)
    rubs[laws.friction_row] = rubs[laws.row[laws.friction_normal]] = True
    found = []
    for block in split_blocks(mechanism, laws):
        square = np.ix_(block.coordinates, block.coordinates)
        model, leading = _cached_model(
            mechanism.stiffness[square],
            mechanism.mass[square],
            damping=mechanism.damping[square],
            rows=mechanism.rows[np.ix_(block.rows, block.coordinates)],
            at_rows=at_rows[block.rows],
            first=rubs[block.rows],
            load=mechanism.load[block.coordinates],
            cutoff_frequency=cutoff_frequency,
        )
        found.append(BlockModel(block, model, leading))
    return tuple(found)


def assemble_model(parts: Sequence[BlockModel], mechanism: Mechanism) -> ModalModel:
    """Return the modal model of the whole mechanism, its modes in the order of the blocks."""
    n, n_rows = mechanism.stiffness.shape[0], mechanism.rows.shape[0]
    modes = np.cumsum([0, *(part.model.eigenvalues.size for part in parts)])
    whole = ModalModel(
        eigenvalues=np.concatenate([part.model.eigenvalues for part in parts]),
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


def condense(mechanism: Mechanism, *, cutoff_frequency: float) -> ModalModel:
    """Return the modal model of a whole mechanism, the base segments of its laws included."""
    return modal_model(
        linear_stiffness(mechanism.stiffness, mechanism.rows, mechanism.laws),
        mechanism.mass,
        damping=mechanism.damping,
        rows=mechanism.rows,
        load=mechanism.load,
        cutoff_frequency=cutoff_frequency,
    )


def base_stiffness(table: LawTable) -> Floats:
    """Return the stiffness of each law in the linear system [N/m], zero for none."""
    chosen = table.base_segment >= 0
    slope = np.zeros(table.row.size)
    slope[chosen] = table.slope[(table.segment_start[:-1] + table.base_segment)[chosen]]
    return slope


def linear_stiffness(stiffness: Floats, rows: Floats, table: LawTable) -> Floats:
    """Return the stiffness matrix with the base segment of every law added."""
    folded: Floats = stiffness + (rows.T * _sum_base_stiffness(rows.shape[0], table)) @ rows
    return folded


def _sum_base_stiffness(n_rows: int, table: LawTable) -> Floats:
    """Return the sum of the base segments of all laws at each row [N/m]."""
    found: Floats = np.bincount(table.row, base_stiffness(table), n_rows).astype(np.float64)
    return found
