r"""Condense a linear system: its low modes with their inertia, all above as flexibility.

With :math:`K \phi = \lambda M \phi`, :math:`\phi^T M \phi = 1`, modes up to a cut-off are kept as
coordinates `q`; the modes above respond statically:

.. math:: g = G^T u = \Phi q + R\,\lambda + r, \qquad R = \Phi_o \Lambda_o^{-1} \Phi_o^T

where the columns of `G` are the rows along which forces :math:`\lambda` act, index `o` marks the
modes above the cut-off projected on the rows, and `r` is the static share of the constant load.
This is mode-acceleration (static correction) in Craig's sense; without it a truncated basis misses
the local flexibility that contacts feel. `R` is a sum over the omitted modes and therefore positive
semi-definite, free of the cancellation of "static minus modal" flexibility.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.linalg.lapack import dpotrf, dpotrs, dsygvd, dtrtri

from turnout.core.errors import MechanicsError
from turnout.core.threads import one_blas_thread

Floats = NDArray[np.float64]
Rows = Floats | sp.csr_array

NEGATIVE = 1e-10
"""A damping below minus this share of the largest is more than rounding [-]."""


@dataclass(frozen=True, eq=False)
class ModalModel:
    """Kept modes and residual flexibility of one linear system.

    Attributes
    ----------
    stiffness, damping : ndarray, shape (n_modes, n_modes)
        In the columns of `modes` [1/s2, 1/s]; at most one of the two is not diagonal, see
        `diagonalise_damping`.
    modes : ndarray, shape (n_dof, n_modes)
        Mass-normalised shapes that span the kept modes [1/sqrt(kg)].
    row_modes : ndarray, shape (n_rows, n_modes)
        Displacements of the rows in these shapes.
    flexibility : ndarray, shape (n_rows, n_rows)
        Residual flexibility [m/N].
    residual_shapes : ndarray, shape (n_dof, n_rows)
        Static shape of the omitted part for a unit force along each row [m/N].
    load : ndarray, shape (n_modes,)
        Constant load, projected on the shapes.
    residual_load : ndarray, shape (n_dof,)
        Static shape of the omitted part under the constant load [m].
    row_load : ndarray, shape (n_rows,)
        The same at the rows [m].
    """

    stiffness: Floats
    damping: Floats
    modes: Floats
    row_modes: Floats
    flexibility: Floats
    residual_shapes: Floats
    load: Floats
    residual_load: Floats
    row_load: Floats

    @cached_property
    def eigenvalues(self) -> Floats:
        """Squared angular frequencies of the kept modes, shape (n_modes,) [1/s2].

        Those of single columns of `modes` where the stiffness is diagonal, else rising.
        """
        own = np.diagonal(self.stiffness)
        if np.count_nonzero(self.stiffness) == np.count_nonzero(own):
            return own
        with one_blas_thread():
            return np.asarray(np.linalg.eigvalsh(self.stiffness), dtype=np.float64)

    @property
    def frequencies(self) -> Floats:
        """Natural frequencies of the kept modes [Hz]."""
        return np.sqrt(np.maximum(self.eigenvalues, 0.0)) / (2.0 * np.pi)


@dataclass(frozen=True, slots=True, eq=False)
class Omitted:
    """Flexibility of the modes above the cut-off, and the lowest of them.

    Attributes
    ----------
    flexibility : ndarray, shape (n_dof, n_dof)
        Static displacements for unit forces, symmetric [m/N].
    modes : ndarray, shape (n_dof, n)
        Mass-normalised shapes, at most `FURTHER_MODES` [1/sqrt(kg)].
    """

    flexibility: Floats
    modes: Floats


class LinearSystem(NamedTuple):
    """A linear system with the rows along which forces act and displacements are read.

    Attributes
    ----------
    stiffness, mass, damping : ndarray, shape (n_dof, n_dof)
        Symmetric; stiffness and mass positive definite.
    load : ndarray, shape (n_dof,)
        Constant load [N].
    rows : ndarray or csr_array, shape (n_rows, n_dof)
        Displacements of the rows.
    """

    stiffness: Floats
    mass: Floats
    damping: Floats
    load: Floats
    rows: Rows


def split_modes(linear: LinearSystem, cutoff_frequency: float) -> tuple[ModalModel, Omitted]:
    """Condense a linear system at a cut-off frequency.

    Parameters
    ----------
    linear : LinearSystem
        Stiffness, mass, damping, load and rows.
    cutoff_frequency : float
        Modes up to here keep their inertia [Hz].

    Returns
    -------
    ModalModel
        With the modes up to the cut-off.
    Omitted
        Of all others.

    Raises
    ------
    MechanicsError
        If the stiffness is not positive definite, so that a rail could float away.
    """
    eigenvalues, shapes = eigh(linear.stiffness, linear.mass, check_finite=True)
    if eigenvalues[0] <= 10.0 * np.finfo(float).eps * eigenvalues[-1]:
        msg = (
            "a rail is not held: the supports leave a rigid-body motion free; "
            "clamp the heel or add fastenings"
        )
        raise MechanicsError(msg)
    shapes = _fix_signs(shapes)
    limit = (2.0 * np.pi * cutoff_frequency) ** 2
    kept = max(int(np.searchsorted(eigenvalues, limit, side="right")), 1)
    low, high = shapes[:, :kept], shapes[:, kept:]
    scaled = high / eigenvalues[kept:]
    yielding = scaled @ high.T
    flexibility = 0.5 * (yielding + yielding.T)
    residual_load = scaled @ (high.T @ linear.load)
    of_modes = _in_modes(linear, eigenvalues[:kept], low)
    model = model_of(of_modes, low, flexibility, residual_load, linear.rows)
    return model, Omitted(flexibility, high[:, :FURTHER_MODES].copy())


def _in_modes(
    linear: LinearSystem, eigenvalues: Floats, low: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return stiffness, damping and load of a linear system in its low modes."""
    return np.diag(eigenvalues), low.T @ linear.damping @ low, low.T @ linear.load


FURTHER_MODES = 8
"""Modes above the cut-off that iteration takes along, so that those below it converge fast."""
MODE_ERROR = 2e-5
"""Largest relative change of an eigenvalue in the last iteration, far above its error [-]."""
MOST_ITERATIONS = 10


def split_modes_near(
    linear: LinearSystem, cutoff_frequency: float, *, start: Floats
) -> tuple[ModalModel, Omitted] | None:
    r"""Condense a linear system as `split_modes` does, from the modes of one that is much like it.

    The low modes :math:`\Phi` follow by subspace iteration (Bathe and Wilson, International Journal
    for Numerical Methods in Engineering 6, 1973). With :math:`K = U^T U` the flexibility of all
    others is that of

    .. math:: K^{-1} - \Phi \Lambda^{-1} \Phi^T = V V^T, \qquad
              V = U^{-1} - \Phi \Lambda^{-1} (U \Phi)^T,

    so that no other mode is needed, at an eighth of the time.

    Parameters
    ----------
    linear, cutoff_frequency
        As for `split_modes`.
    start : ndarray, shape (n_dof, n)
        Modes of the other system up to the cut-off and some above it.

    Returns
    -------
    tuple or None
        None where the iteration does not converge, or the stiffness is not positive definite.
    """
    upper, failed = dpotrf(linear.stiffness)
    if failed:
        return None
    found = _iterate_subspace(upper, linear.mass, start, cutoff_frequency=cutoff_frequency)
    if found is None:
        return None
    eigenvalues, low = found
    inverse, _ = dtrtri(upper)
    high = inverse - (low / eigenvalues) @ (upper @ low).T
    flexibility = high @ high.T
    of_modes = _in_modes(linear, eigenvalues, low)
    model = model_of(of_modes, low, flexibility, flexibility @ linear.load, linear.rows)
    return model, Omitted(flexibility, low[:, :0])


def _iterate_subspace(
    upper: Floats, mass: Floats, start: Floats, *, cutoff_frequency: float
) -> tuple[Floats, Floats] | None:
    """Return eigenvalues and modes up to a cut-off, or None if they do not converge.

    `upper` is the Cholesky factor of the stiffness.
    """
    shapes, before = start, np.zeros(start.shape[1])
    limit = (2.0 * np.pi * cutoff_frequency) ** 2
    for _ in range(MOST_ITERATIONS):
        with_mass = mass @ shapes
        shapes, _ = dpotrs(upper, with_mass)
        values, turn, failed = dsygvd(shapes.T @ with_mass, shapes.T @ (mass @ shapes))
        if failed:
            return None
        shapes = shapes @ turn
        kept = max(int(np.searchsorted(values, limit, side="right")), 1)
        if kept == values.size:
            return None
        if np.all(np.abs(values - before)[:kept] <= MODE_ERROR * values[:kept]):
            return values[:kept], _fix_signs(shapes[:, :kept])
        before = values
    return None


def model_of(
    of_modes: tuple[Floats, Floats, Floats],
    low: Floats,
    flexibility: Floats,
    residual_load: Floats,
    rows: Rows,
) -> ModalModel:
    """Return the model of a system with some rows.

    Parameters
    ----------
    of_modes : tuple of ndarray
        Stiffness, damping and load in the kept modes, as of `ModalModel`.
    low : ndarray, shape (n_dof, n_modes)
        Shapes of the kept modes [1/sqrt(kg)].
    flexibility : ndarray, shape (n_dof, n_dof)
        That of all others [m/N].
    residual_load : ndarray, shape (n_dof,)
        As of `ModalModel`.
    rows : ndarray or csr_array, shape (n_rows, n_dof)
        Rows along which forces act and displacements are read.
    """
    stiffness, damping, load = of_modes
    of_rows = _sparse(rows)
    residual_shapes = (of_rows @ flexibility).T
    return ModalModel(
        stiffness=stiffness,
        damping=damping,
        modes=np.ascontiguousarray(low),
        row_modes=of_rows @ low,
        flexibility=of_rows @ residual_shapes,
        residual_shapes=np.ascontiguousarray(residual_shapes),
        load=load,
        residual_load=residual_load,
        row_load=of_rows @ residual_load,
    )


class AddedRows(NamedTuple):
    """Displacements and flexibility of further rows of a model.

    Attributes
    ----------
    modes : ndarray, shape (n_added, n_modes)
        Their displacements in the shapes of the kept modes.
    beside, among : ndarray, shape (n_added, n_rows), (n_added, n_added)
        Residual flexibility to the rows of the model, and between these [m/N].
    shapes : ndarray, shape (n_added, n_dof)
        Static shapes of the omitted part for a unit force along each [m/N].
    load : ndarray, shape (n_added,)
        Displacements of the omitted part under the constant load [m].
    """

    modes: Floats
    beside: Floats
    among: Floats
    shapes: Floats
    load: Floats


def added_rows(model: ModalModel, flexibility: Floats, rows: Floats) -> AddedRows:
    """Return further rows of a model, none of which changes a bit of another.

    Parameters
    ----------
    model : ModalModel
        In any shapes of its kept modes.
    flexibility : ndarray, shape (n_dof, n_dof)
        That of the modes that it leaves out, see `Omitted`.
    rows : ndarray, shape (n_added, n_dof)
        Displacements of the further rows.
    """
    shapes = np.array([flexibility @ row for row in rows])
    return AddedRows(
        modes=np.array([row @ model.modes for row in rows]),
        beside=np.array([row @ model.residual_shapes for row in rows]),
        among=np.array([[shape @ row for shape in shapes] for row in rows]),
        shapes=shapes,
        load=np.array([row @ model.residual_load for row in rows]),
    )


def with_rows(model: ModalModel, added: AddedRows) -> ModalModel:
    """Return a model with further rows, which come last.

    Examples
    --------
    >>> spring = np.array([[2.0, -1.0], [-1.0, 2.0]])
    >>> linear = LinearSystem(spring, np.eye(2), 0.0 * spring, np.ones(2), np.eye(2))
    >>> both, _ = split_modes(linear, 0.2)
    >>> model, omitted = split_modes(linear._replace(rows=np.eye(2)[:1]), 0.2)
    >>> found = with_rows(model, added_rows(model, omitted.flexibility, np.eye(2)[1:]))
    >>> bool(np.allclose(found.flexibility, both.flexibility, rtol=1e-14))
    True
    """
    count, size = model.row_load.size, model.row_load.size + added.load.size
    flexibility = np.empty((size, size))
    flexibility[:count, :count], flexibility[count:, count:] = model.flexibility, added.among
    flexibility[count:, :count], flexibility[:count, count:] = added.beside, added.beside.T
    return replace(
        model,
        row_modes=np.concatenate((model.row_modes, added.modes)),
        flexibility=flexibility,
        residual_shapes=np.hstack((model.residual_shapes, added.shapes.T)),
        row_load=np.concatenate((model.row_load, added.load)),
    )


def diagonalise_damping(model: ModalModel) -> ModalModel:
    """Return the same model in shapes that make its damping diagonal.

    Any rotation of the kept modes stays orthonormal in the mass. The stiffness matrix is needed
    once for each length of a step, damping in every step, so it is damping that is diagonalised.

    Raises
    ------
    MechanicsError
        If the damping matrix is not positive semidefinite.

    Examples
    --------
    >>> spring = np.array([[2.0, -1.0], [-1.0, 2.0]])
    >>> linear = LinearSystem(spring, np.eye(2), np.diag([0.0, 0.5]), np.zeros(2), np.eye(2))
    >>> model, _ = split_modes(linear, 10.0)
    >>> diagonalise_damping(model).damping.round(9).tolist()
    [[0.0, 0.0], [0.0, 0.5]]
    """
    of_shapes, turn = np.diagonal(model.damping), None
    if np.any(
        np.abs(model.damping - np.diag(of_shapes)) > 1e-13 * np.abs(of_shapes).max(initial=0)
    ):
        of_shapes, turn = eigh(model.damping, check_finite=True)
    if np.min(of_shapes, initial=0.0) < -NEGATIVE * np.abs(of_shapes).max(initial=0.0):
        msg = (
            "the damping matrix of a rail is not positive semidefinite, it would add energy; "
            "check its sign"
        )
        raise MechanicsError(msg)
    damping = np.diag(np.maximum(of_shapes, 0.0))
    if turn is None:
        return replace(model, damping=damping)
    turn = _fix_signs(turn)
    stiffness = turn.T @ model.stiffness @ turn
    return replace(
        model,
        stiffness=0.5 * (stiffness + stiffness.T),
        damping=damping,
        modes=np.ascontiguousarray(model.modes @ turn),
        row_modes=_multiply_by_rows(model.row_modes, turn.T),
        load=turn.T @ model.load,
    )


def _sparse(rows: Rows) -> sp.csr_array:
    """Return rows, of which most reach few coordinates, as a sparse matrix.

    Its products are summed row by row: one more row changes no bit of the others.
    """
    return rows if isinstance(rows, sp.csr_array) else sp.csr_array(rows)


def _fix_signs(shapes: Floats) -> Floats:
    """Return shapes with signs that make the largest entry of each positive."""
    at = np.argmax(np.abs(shapes), axis=0)
    found: Floats = shapes * np.sign(shapes[at, np.arange(shapes.shape[1])])
    return found


def _multiply_by_rows(a: Floats, b: Floats) -> Floats:
    """Return ``a @ b.T`` summed entry by entry: one more row changes no bit of the others."""
    found: Floats = np.einsum("ik,jk->ij", np.ascontiguousarray(a), np.ascontiguousarray(b))
    return found
