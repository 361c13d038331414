"""All modes of a structure up to a frequency, with a count that proves none is missing.

The number of eigenvalues of (K, M) below a shift is the number of negative pivots of K - shift M
(Sylvester's law of inertia). The modes themselves come from Lanczos iteration on the inverse.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from turnout.errors import MechanicsError

FloatArray = npt.NDArray[np.float64]

MOST_MODES = 2000
"""Modes that are sought below a frequency; matrices of as many as four times that are dense."""

_SINGULAR_PIVOT = 1e-13  # of a matrix scaled to unit diagonal
_DENSE_SHARE = 0.25  # from this share of all modes on, the dense solution is the faster one
_SIGN_SHARE = 0.3  # no sine of a rational angle has this value, so no entry sits on the edge


@dataclass(frozen=True, slots=True, eq=False)
class Factor:
    """Triangular factors of a symmetric matrix that was scaled from both sides.

    Parameters
    ----------
    decomposition : SuperLU
        Of ``diag(scale) A diag(scale)``, with pivots on the diagonal where that was possible.
    scale : ndarray, shape (n,)
        Makes the diagonal of the reference matrix one.
    """

    decomposition: spla.SuperLU
    scale: FloatArray

    def solve(self, right: FloatArray) -> FloatArray:
        """Solve for one right-hand side (n,) or several (n, m)."""
        scale = self.scale if right.ndim == 1 else self.scale[:, None]
        solution: FloatArray = scale * self.decomposition.solve(scale * right)
        return solution

    @property
    def pivots(self) -> FloatArray:
        """Pivots of the scaled matrix, in the order of elimination."""
        return self.decomposition.U.diagonal()

    @property
    def is_symmetric(self) -> bool:
        """Whether all pivots lie on the diagonal, so that their signs give the inertia."""
        return bool(np.array_equal(self.decomposition.perm_r, self.decomposition.perm_c))


def factorise(matrix: sp.csr_array, *, reference: sp.csr_array | None = None) -> Factor | None:
    """Factorise a symmetric sparse matrix.

    Parameters
    ----------
    matrix : csr_array, shape (n, n)
        Need not be positive definite.
    reference : csr_array, shape (n, n), optional
        Positive definite matrix whose diagonal gives the scale; by default `matrix`.

    Returns
    -------
    Factor or None
        None if the matrix is singular to working precision.

    Examples
    --------
    >>> factorise(sp.csr_array([[1.0, -1.0], [-1.0, 1.0]])) is None
    True
    >>> factorise(sp.csr_array([[2.0, -1.0], [-1.0, 1.0]])).solve(np.array([0.0, 1.0])).round(9)
    array([1., 2.])
    """
    diagonal = (matrix if reference is None else reference).diagonal()
    if not np.all(diagonal > 0.0):
        return None
    scale = 1.0 / np.sqrt(diagonal)
    scaled = sp.csc_array(matrix.multiply(scale[:, None]).multiply(scale[None, :]))
    try:
        decomposition = spla.splu(
            scaled,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError:  # SuperLU met a column without any pivot
        return None
    factor = Factor(decomposition, scale)
    return factor if np.abs(factor.pivots).min() > _SINGULAR_PIVOT else None


def count_below(stiffness: sp.csr_array, mass: sp.csr_array, *, frequency: float) -> int:
    """Count the modes of a structure below a frequency [Hz], by Sylvester's law of inertia.

    Examples
    --------
    >>> chain = sp.csr_array([[2.0, -1.0], [-1.0, 2.0]])  # 1 and sqrt(3) rad/s
    >>> count_below(chain, sp.eye_array(2, format="csr"), frequency=0.2)
    1
    """
    shift = (2.0 * np.pi * frequency) ** 2
    shifted = sp.csr_array(stiffness - shift * mass)
    factor = factorise(shifted, reference=sp.csr_array(stiffness + shift * mass))
    if factor is not None and factor.is_symmetric:
        return int(np.count_nonzero(factor.pivots < 0.0))
    # A leading block is singular exactly at the shift: rare, so the slow method will do.
    return int(np.count_nonzero(np.linalg.eigvalsh(shifted.toarray()) < 0.0))


def modes_below(
    stiffness: sp.csr_array, mass: sp.csr_array, *, cutoff_frequency: float, shift: float = 0.0
) -> tuple[FloatArray, FloatArray, float]:
    """Find all modes of a structure up to a frequency.

    Parameters
    ----------
    stiffness, mass : csr_array, shape (n, n)
        Symmetric; the mass may be semi-definite.
    cutoff_frequency : float
        Modes below it are found [Hz].
    shift : float
        The search starts at this eigenvalue, which must lie below all others [rad^2/s^2]. Give a
        negative one for a free body.

    Returns
    -------
    frequencies : ndarray, shape (m,)
        Increasing [Hz]; rigid-body modes have zero.
    modes : ndarray, shape (n, m)
        Mass-normalised. The first large entry of each is positive.
    first_omitted : float
        Lowest frequency above the cut-off [Hz]; NaN if there is none.

    Raises
    ------
    MechanicsError
        If the shifted stiffness is not positive definite, or there are more than `MOST_MODES`.
    """
    size = stiffness.shape[0]
    if size == 0 or mass.count_nonzero() == 0:
        return np.zeros(0), np.zeros((size, 0)), float("nan")
    count = count_below(stiffness, mass, frequency=cutoff_frequency)
    if count > MOST_MODES:
        msg = (
            f"{count} modes lie below {cutoff_frequency:g} Hz, at most {MOST_MODES} are kept; "
            "lower the cut-off, for a panel discretisation.superelement_cutoff"
        )
        raise MechanicsError(msg)
    wanted = min(count + 1, size)
    shifted = sp.csr_array(stiffness - shift * mass)
    # Both ways solve M x = theta (K - shift M) x for the greatest theta = 1 / (omega^2 - shift).
    dense = wanted > _DENSE_SHARE * size or size < 30
    methods = (_solve_dense,) if dense else (_solve_lanczos, _solve_dense)
    for method in methods:
        theta, modes = method(mass, shifted, wanted)
        frequencies = np.sqrt(np.maximum(1.0 / theta + shift, 0.0)) / (2.0 * np.pi)
        order = np.argsort(frequencies, kind="stable")
        frequencies, modes = frequencies[order], modes[:, order]
        # Lanczos may pass over one of several modes that lie close together.
        if frequencies.size >= count and frequencies[:count].max(initial=0.0) <= (
            cutoff_frequency * (1.0 + 1e-6)
        ):
            break
    else:
        msg = f"{count} modes lie below {cutoff_frequency} Hz, but not all were found"
        raise MechanicsError(msg)
    omitted = float(frequencies[count]) if frequencies.size > count else float("nan")
    return frequencies[:count], _normalise(modes[:, :count], mass), omitted


def _solve_dense(
    mass: sp.csr_array, shifted: sp.csr_array, wanted: int
) -> tuple[FloatArray, FloatArray]:
    size = mass.shape[0]
    try:
        theta, modes = scipy.linalg.eigh(
            mass.toarray(), shifted.toarray(), subset_by_index=[size - wanted, size - 1]
        )
    except np.linalg.LinAlgError as error:
        raise MechanicsError(_NOT_HELD) from error
    # A mode without mass has an infinite frequency: its theta is nothing but rounding.
    positive = theta > size * np.finfo(float).eps * theta.max()
    return theta[positive], modes[:, positive]


def _solve_lanczos(
    mass: sp.csr_array, shifted: sp.csr_array, wanted: int
) -> tuple[FloatArray, FloatArray]:
    factor = factorise(shifted)
    if factor is None:
        raise MechanicsError(_NOT_HELD)
    # A fixed start keeps the modes the same from run to run.
    start = np.random.default_rng(20240501).standard_normal(mass.shape[0])
    inverse = spla.LinearOperator(mass.shape, matvec=factor.solve, dtype=float)
    values, modes = spla.eigsh(
        shifted, k=wanted, M=mass, sigma=0.0, which="LM", OPinv=inverse, v0=start
    )
    return 1.0 / values, modes


def _normalise(modes: FloatArray, mass: sp.csr_array) -> FloatArray:
    if not modes.size:
        return modes
    scaled = modes / np.sqrt(np.einsum("ij,ij->j", modes, mass @ modes))
    size = np.abs(scaled)
    first = np.argmax(size > _SIGN_SHARE * size.max(axis=0), axis=0)
    signed: FloatArray = scaled * np.sign(scaled[first, np.arange(scaled.shape[1])])
    return signed


_NOT_HELD = "the structure is not held: its stiffness, less the shift times the mass, is singular"
