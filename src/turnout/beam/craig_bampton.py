r"""Craig-Bampton reduction: static shapes of the interface and modes of the rest.

With interface DOFs i and all others b,

.. math::

    \begin{pmatrix} u_i \\ u_b \end{pmatrix} =
    \begin{pmatrix} I & 0 \\ -K_{bb}^{-1} K_{bi} & \Phi \end{pmatrix}
    \begin{pmatrix} u_i \\ \eta \end{pmatrix}, \qquad
    K_{bb} \Phi = M_{bb} \Phi \Omega^2, \quad \Phi^T M_{bb} \Phi = I .

The reduced structure answers static loads at its interface exactly, and loads below the cut-off
frequency nearly so. Source: Craig and Bampton, AIAA Journal 6(7), 1968, doi:10.2514/3.4741.
The matrices may be singular (a free body) as long as its interface, once fixed, holds the body.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from turnout.beam.spectrum import factorise, modes_below
from turnout.core.errors import MechanicsError

MOST_INTERFACE = 3000
"""Coordinates that a reduction keeps; the interface of the reduced structure is dense."""

MOST_NUMBERS = 50_000_000
"""Numbers of the static shapes: coordinates of the structure by those of its interface."""

FloatArray = npt.NDArray[np.float64]
Matrix = sp.sparray | FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Superelement:
    """A reduced structure: r reduced DOFs, the interface first, then modal amplitudes.

    Parameters
    ----------
    stiffness : ndarray, shape (r, r)
        Block-diagonal: condensed interface stiffness, then squared angular frequencies.
    mass : ndarray, shape (r, r)
        The modal block is the identity.
    transformation : ndarray, shape (n, r)
        Reduced to full displacement.
    interface : ndarray of int, shape (n_interface,)
        Indices of the interface DOFs in the full structure, in the order of the reduced ones.
    frequencies_kept : ndarray, shape (r - n_interface,)
        Fixed-interface frequencies kept [Hz], increasing.
    frequency_first_omitted : float
        Lowest frequency left out [Hz]; NaN if none was.
    cutoff_frequency : float
        Modes up to here were requested [Hz].
    """

    stiffness: FloatArray
    mass: FloatArray
    transformation: FloatArray
    interface: npt.NDArray[np.intp]
    frequencies_kept: FloatArray
    frequency_first_omitted: float
    cutoff_frequency: float

    @property
    def n_interface(self) -> int:
        """Number of interface DOFs."""
        return int(self.interface.size)


def craig_bampton(
    stiffness: Matrix,
    mass: Matrix,
    interface: Sequence[int] | npt.NDArray[np.intp],
    *,
    cutoff_frequency: float,
) -> Superelement:
    """Reduce a structure to its interface DOFs and its fixed-interface modes below a cut-off.

    Parameters
    ----------
    stiffness, mass : sparse array or ndarray, shape (n, n)
        Symmetric; supports to rigid ground are already taken out or added as springs.
    interface : sequence of int, shape (n_interface,)
        DOFs to keep as they are. They must hold the body when fixed.
    cutoff_frequency : float
        Modes up to this frequency are kept [Hz].

    Returns
    -------
    Superelement
        n_interface DOFs and as many modes as lie below the cut-off.

    Raises
    ------
    MechanicsError
        If indices repeat or are out of range, the cut-off is negative or the interface does not
        hold the body.

    Examples
    --------
    >>> chain = sp.diags_array([[-1.0] * 3, [1.0, 2.0, 2.0, 1.0], [-1.0] * 3], offsets=[-1, 0, 1])
    >>> reduced = craig_bampton(chain, sp.eye_array(4), [0, 3], cutoff_frequency=0.2)
    >>> reduced.frequencies_kept.round(4).tolist()  # sqrt(1) / 2 pi; sqrt(3) / 2 pi is left out
    [0.1592]
    >>> reduced.stiffness.round(4).tolist()[0]
    [0.3333, -0.3333, 0.0]
    """
    full_stiffness, full_mass = _as_sparse(stiffness), _as_sparse(mass)
    shapes = inner_shapes(full_stiffness, full_mass, interface, cutoff_frequency=cutoff_frequency)
    return superelement_in(shapes, full_stiffness, full_mass)


@dataclass(frozen=True, slots=True, eq=False)
class InnerShapes:
    """Shapes that a structure is reduced to, unaffected by parts at its interface alone.

    Attributes
    ----------
    transformation : ndarray, shape (n, r)
        Reduced to full displacement: static shapes of the interface, then modes.
    interface : ndarray of int, shape (n_interface,)
        Indices of the interface DOFs.
    frequencies : ndarray, shape (r - n_interface,)
        Fixed-interface frequencies [Hz], increasing.
    frequency_first_omitted, cutoff_frequency : float
        As of a `Superelement`.
    """

    transformation: FloatArray
    interface: npt.NDArray[np.intp]
    frequencies: FloatArray
    frequency_first_omitted: float
    cutoff_frequency: float


def inner_shapes(
    stiffness: sp.csr_array,
    mass: sp.csr_array,
    interface: Sequence[int] | npt.NDArray[np.intp],
    *,
    cutoff_frequency: float,
) -> InnerShapes:
    """Find the shapes for `superelement_in`; parameters and errors are those of `craig_bampton`."""
    size = stiffness.shape[0]
    kept = _check_interface(interface, size)
    if not cutoff_frequency >= 0.0:
        msg = f"cutoff_frequency is {cutoff_frequency} Hz, allowed is 0 or more"
        raise MechanicsError(msg)
    if kept.size > MOST_INTERFACE or size * kept.size > MOST_NUMBERS:
        msg = (
            f"{kept.size} interface coordinates of {size} are too many, at most {MOST_INTERFACE} "
            f"and {MOST_NUMBERS // size} of so many; take fewer supports, or for a panel a longer "
            "discretisation.element_length"
        )
        raise MechanicsError(msg)
    inner = np.setdiff1d(np.arange(size), kept)
    of_inner = stiffness[inner]
    own = sp.csr_array(of_inner[:, inner])
    static = _solve_static_shapes(own, of_inner[:, kept].toarray())
    frequencies, modes, omitted = modes_below(
        own, sp.csr_array(mass[inner][:, inner]), cutoff_frequency=cutoff_frequency
    )
    transformation = np.zeros((size, kept.size + frequencies.size))
    transformation[kept, np.arange(kept.size)] = 1.0
    transformation[inner, : kept.size] = static
    transformation[inner, kept.size :] = modes
    return InnerShapes(transformation, kept, frequencies, omitted, cutoff_frequency)


def superelement_in(
    shapes: InnerShapes, stiffness: sp.csr_array, mass: sp.csr_array
) -> Superelement:
    """Reduce a structure to given shapes.

    Parameters
    ----------
    shapes : InnerShapes
        Of a structure that differs from this one in springs at its interface at most.
    stiffness, mass : csr_array, shape (n, n)
        Symmetric.
    """
    transformation, kept = shapes.transformation, shapes.interface
    reduced_stiffness = np.diag(
        np.concatenate([np.zeros(kept.size), (2.0 * np.pi * shapes.frequencies) ** 2])
    )
    condensed = stiffness[kept] @ transformation[:, : kept.size]
    reduced_stiffness[: kept.size, : kept.size] = 0.5 * (condensed + condensed.T)
    reduced_mass: FloatArray = transformation.T @ (mass @ transformation)
    reduced_mass = 0.5 * (reduced_mass + reduced_mass.T)
    reduced_mass[kept.size :, kept.size :] = np.eye(shapes.frequencies.size)
    return Superelement(
        stiffness=reduced_stiffness,
        mass=reduced_mass,
        transformation=transformation,
        interface=kept,
        frequencies_kept=shapes.frequencies,
        frequency_first_omitted=shapes.frequency_first_omitted,
        cutoff_frequency=shapes.cutoff_frequency,
    )


def reduce_matrix(superelement: Superelement, matrix: Matrix) -> FloatArray:
    """Reduce a further matrix of the full structure, such as damping or supports.

    Parameters
    ----------
    superelement : Superelement
        Of the same structure, n full DOFs and r reduced ones.
    matrix : sparse array or ndarray, shape (n, n)
        Symmetry is not needed.

    Returns
    -------
    ndarray, shape (r, r)
    """
    transformation = superelement.transformation
    reduced: FloatArray = transformation.T @ (_as_sparse(matrix) @ transformation)
    return reduced


def reduce_vector(superelement: Superelement, vector: FloatArray) -> FloatArray:
    """Reduce loads on the full structure, or rows that act on its displacements.

    Parameters
    ----------
    superelement : Superelement
        Of the same structure, n full DOFs and r reduced ones.
    vector : ndarray, shape (n,) or (n, m)
        One load, or one a column.

    Returns
    -------
    ndarray, shape (r,) or (r, m)
    """
    return superelement.transformation.T @ vector


def _as_sparse(matrix: Any) -> sp.csr_array:
    sparse: sp.csr_array = sp.csr_array(matrix)
    return sparse


def _check_interface(
    interface: Sequence[int] | npt.NDArray[np.intp], size: int
) -> npt.NDArray[np.intp]:
    kept = np.asarray(interface, dtype=np.intp)
    if kept.ndim != 1 or np.any((kept < 0) | (kept >= size)):
        msg = f"interface indices must be a list of numbers from 0 to {size - 1}"
        raise MechanicsError(msg)
    values, counts = np.unique(kept, return_counts=True)
    if values.size != kept.size:
        msg = f"interface indices repeat: {values[counts > 1].tolist()}"
        raise MechanicsError(msg)
    return kept


def _solve_static_shapes(inner_stiffness: sp.csr_array, coupling: FloatArray) -> FloatArray:
    """Return inner displacements for unit interface displacements, (n_b, n_i), of K_bb and K_bi."""
    if not coupling.size:
        return np.zeros(coupling.shape)
    factor = factorise(inner_stiffness)
    if factor is None:
        msg = (
            f"the {coupling.shape[1]} interface DOFs do not hold the body when fixed; add DOFs to "
            "the interface or springs to the stiffness"
        )
        raise MechanicsError(msg)
    return -factor.solve(coupling)
