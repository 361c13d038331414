r"""Keep the low modes of a linear system with their inertia, everything above as flexibility.

With :math:`K \phi = \lambda M \phi`, :math:`\phi^T M \phi = 1`, modes up to a cut-off are kept as
coordinates `q`; what lies above follows the forces statically:

.. math:: g = G^T u = \Phi q + R\,\lambda + r, \qquad R = \Phi_o \Lambda_o^{-1} \Phi_o^T

where the columns of `G` are the rows along which forces :math:`\lambda` act, index `o` marks the
modes above the cut-off projected on the rows, and `r` is the static share of the constant load.
This is mode-acceleration (static correction) in Craig's sense; without it a truncated basis misses
the local flexibility that contacts feel. `R` is a sum over the omitted modes and therefore positive
semi-definite, free of the cancellation of "static minus modal" flexibility.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from turnout.errors import MechanicsError
from turnout.law.table import LawTable
from turnout.mechanism.blocks import Block, split_blocks
from turnout.mechanism.cache import remembered
from turnout.mechanism.followers import Leading, leading_rows
from turnout.mechanism.mechanism import Mechanism

Floats = NDArray[np.float64]

RIGID = 1e-12
"""Eigenvalues below this share of the largest are those of rigid-body modes."""


@dataclass(frozen=True, slots=True)
class ModalModel:
    """Kept modes and residual flexibility of one linear system.

    Attributes
    ----------
    eigenvalues : ndarray, shape (n_modes,)
        Squared angular frequencies of the kept modes [1/s2].
    stiffness, damping : ndarray, shape (n_modes, n_modes)
        Stiffness and damping matrix in the shapes that span the kept modes; at most one of them is
        not diagonal, `damped_apart` [1/s2, 1/s].
    modes : ndarray, shape (n_dof, n_modes)
        Mass-normalised shapes.
    row_modes : ndarray, shape (n_rows, n_modes)
        The modes at the rows.
    flexibility : ndarray, shape (n_rows, n_rows)
        Residual flexibility [m/N].
    residual_shapes : ndarray, shape (n_dof, n_rows)
        Static shape of the omitted part for a unit force along each row [m/N].
    load : ndarray, shape (n_modes,)
        Constant load in kept modes.
    residual_load : ndarray, shape (n_dof,)
        Static shape of the omitted part under the constant load [m].
    row_load : ndarray, shape (n_rows,)
        The same at the rows [m].
    """

    eigenvalues: Floats
    stiffness: Floats
    damping: Floats
    modes: Floats
    row_modes: Floats
    flexibility: Floats
    residual_shapes: Floats
    load: Floats
    residual_load: Floats
    row_load: Floats

    @property
    def frequencies(self) -> Floats:
        """Natural frequencies of the kept modes [Hz]."""
        return np.sqrt(np.maximum(self.eigenvalues, 0.0)) / (2.0 * np.pi)


def modal_model(
    stiffness: Floats,
    mass: Floats,
    *,
    damping: Floats,
    rows: Floats,
    load: Floats,
    cutoff_frequency: float,
) -> ModalModel:
    """Split a linear system at a frequency.

    Parameters
    ----------
    stiffness, mass, damping : ndarray, shape (n_dof, n_dof)
        Symmetric; stiffness and mass positive definite.
    rows : ndarray, shape (n_rows, n_dof)
        Rows along which forces act and displacements are read.
    load : ndarray, shape (n_dof,)
        Constant load.
    cutoff_frequency : float
        Modes up to here keep their inertia [Hz].

    Returns
    -------
    ModalModel

    Raises
    ------
    MechanicsError
        If the stiffness is not positive definite, so that a rail could float away.
    """
    eigenvalues, shapes = eigh(stiffness, mass, check_finite=True)
    if eigenvalues[0] <= 10.0 * np.finfo(float).eps * eigenvalues[-1]:
        msg = (
            "a rail is not held: the supports leave a rigid-body motion free; "
            "clamp the heel or add fastenings"
        )
        raise MechanicsError(msg)
    shapes = _upright(shapes)
    limit = (2.0 * np.pi * cutoff_frequency) ** 2
    kept = max(int(np.searchsorted(eigenvalues, limit, side="right")), 1)
    low, high = shapes[:, :kept], shapes[:, kept:]
    high_rows = _each_by_itself(rows, high.T)
    scaled = high / eigenvalues[kept:]
    residual_load = scaled @ (high.T @ load)
    return ModalModel(
        eigenvalues=eigenvalues[:kept].copy(),
        stiffness=np.diag(eigenvalues[:kept]),
        damping=low.T @ damping @ low,
        modes=np.ascontiguousarray(low),
        row_modes=_each_by_itself(rows, low.T),
        flexibility=_each_by_itself(high_rows / eigenvalues[kept:], high_rows),
        residual_shapes=np.ascontiguousarray(scaled @ high_rows.T),
        load=low.T @ load,
        residual_load=residual_load,
        row_load=_each_by_itself(rows, residual_load[np.newaxis])[:, 0].copy(),
    )


def damped_apart(model: ModalModel) -> ModalModel:
    """Return a model in other shapes of the same modes, each of which is damped by itself.

    Kept modes may be combined at will as long as they stay orthogonal in the mass. Stiffness is
    asked for once for each length of a step, damping in every step.

    Examples
    --------
    >>> spring = np.array([[2.0, -1.0], [-1.0, 2.0]])
    >>> given = {"rows": np.eye(2), "load": np.zeros(2), "cutoff_frequency": 10.0}
    >>> model = modal_model(spring, np.eye(2), damping=np.diag([0.0, 0.5]), **given)
    >>> damped_apart(model).damping.round(9).tolist()
    [[0.0, 0.0], [0.0, 0.5]]
    """
    of_shapes = np.diagonal(model.damping)
    if np.all(np.abs(model.damping - np.diag(of_shapes)) <= 1e-13 * of_shapes.max(initial=0.0)):
        return replace(model, damping=np.diag(of_shapes))
    of_shapes, turn = eigh(model.damping, check_finite=True)
    turn = _upright(turn)
    stiffness = (turn.T * model.eigenvalues) @ turn
    return replace(
        model,
        stiffness=0.5 * (stiffness + stiffness.T),
        damping=np.diag(np.maximum(of_shapes, 0.0)),
        modes=np.ascontiguousarray(model.modes @ turn),
        row_modes=_each_by_itself(model.row_modes, turn.T),
        load=turn.T @ model.load,
    )


def _upright(shapes: Floats) -> Floats:
    """Return shapes with the sign that makes the largest entry of each positive."""
    at = np.argmax(np.abs(shapes), axis=0)
    found: Floats = shapes * np.sign(shapes[at, np.arange(shapes.shape[1])])
    return found


def _each_by_itself(a: Floats, b: Floats) -> Floats:
    """Return ``a @ b.T`` entry by entry, so that a row more changes no bit of the others."""
    found: Floats = np.einsum("ik,jk->ij", np.ascontiguousarray(a), np.ascontiguousarray(b))
    return found


def _remembered_model(
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
    """Return `modal_model` with stiffnesses at the rows folded in [N/m], and `leading_rows`.

    Its shapes are damped each by itself.

    They are computed once for throws that differ in friction, objects or motion only.
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
        model = damped_apart(model)
        leading = leading_rows(rows, first=first)
        found = {item.name: getattr(model, item.name) for item in fields(model)}
        of_rows = {"leaders": leading.leaders.astype(np.float64), "weights": leading.weights}
        return found | of_rows

    parts = (stiffness, mass, damping, rows, at_rows, first, load, cutoff_frequency)
    kept = dict(remembered("modes", parts, compute, on_disk=False))
    leading = Leading(kept.pop("leaders").astype(np.int64), kept.pop("weights"))
    return ModalModel(**kept), leading


@dataclass(frozen=True, slots=True)
class BlockModel:
    """A block of a mechanism and its modal model, whose rows are the block's ends.

    `leading` are those ends from which the others follow.
    """

    block: Block
    model: ModalModel
    leading: Leading


def condense_blocks(
    mechanism: Mechanism, laws: LawTable, *, cutoff_frequency: float
) -> tuple[BlockModel, ...]:
    """Return the modes and residual flexibility of each block with its base segments closed.

    Raises
    ------
    MechanicsError
        If a block is not held.
    """
    at_rows = _row_stiffness(mechanism.rows.shape[0], laws)
    rubs = np.zeros(at_rows.size, dtype=bool)
    rubs[laws.friction_row] = rubs[laws.row[laws.friction_normal]] = True
    found = []
    for block in split_blocks(mechanism, laws):
        square = np.ix_(block.coordinates, block.coordinates)
        model, leading = _remembered_model(
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


def joined_model(parts: Sequence[BlockModel], mechanism: Mechanism) -> ModalModel:
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
    """Return modes and residual flexibility of a mechanism with its base law segments closed."""
    return modal_model(
        linear_stiffness(mechanism.stiffness, mechanism.rows, mechanism.laws),
        mechanism.mass,
        damping=mechanism.damping,
        rows=mechanism.rows,
        load=mechanism.load,
        cutoff_frequency=cutoff_frequency,
    )


def free_model(stiffness: Floats, mass: Floats, *, damping: Floats) -> ModalModel:
    """Return all modes of a body by itself, which need not be held; it has no rows and no load.

    Parameters
    ----------
    stiffness, mass, damping : ndarray, shape (n_dof, n_dof)
        Symmetric; the mass positive definite.

    Returns
    -------
    ModalModel
        The eigenvalue of a rigid-body mode is zero.

    Examples
    --------
    >>> spring = np.array([[1.0, -1.0], [-1.0, 1.0]])
    >>> free_model(spring, np.eye(2), damping=0 * spring).eigenvalues.round(9).tolist()
    [0.0, 2.0]
    """
    eigenvalues, shapes = eigh(stiffness, mass, check_finite=True)
    eigenvalues[eigenvalues < RIGID * eigenvalues[-1]] = 0.0
    none = np.zeros((0, eigenvalues.size))
    return ModalModel(
        eigenvalues=eigenvalues,
        stiffness=np.diag(eigenvalues),
        damping=shapes.T @ damping @ shapes,
        modes=shapes,
        row_modes=none,
        flexibility=np.zeros((0, 0)),
        residual_shapes=np.zeros((eigenvalues.size, 0)),
        load=np.zeros(eigenvalues.size),
        residual_load=np.zeros(eigenvalues.size),
        row_load=np.zeros(0),
    )


def base_stiffness(table: LawTable) -> Floats:
    """Return the slope that each law has in the linear system [N/m], zero for none."""
    chosen = table.base_segment >= 0
    slope = np.zeros(table.row.size)
    slope[chosen] = table.slope[(table.segment_start[:-1] + table.base_segment)[chosen]]
    return slope


def linear_stiffness(stiffness: Floats, rows: Floats, table: LawTable) -> Floats:
    """Return the stiffness with the base segment of every law folded in."""
    folded: Floats = stiffness + (rows.T * _row_stiffness(rows.shape[0], table)) @ rows
    return folded


def _row_stiffness(n_rows: int, table: LawTable) -> Floats:
    """Return what the base segments of all laws are together at each row [N/m]."""
    found: Floats = np.bincount(table.row, base_stiffness(table), n_rows).astype(np.float64)
    return found
