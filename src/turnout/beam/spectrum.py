"""All modes of a structure up to a frequency, with a count that proves none is missing.

The number of eigenvalues of (K, M) below a shift is the number of negative pivots of K - shift M
(Sylvester's law of inertia). The modes themselves come from block Lanczos iteration on the inverse
of that same matrix, with the shift at the cut-off: modes below it then have negative eigenvalues,
far from the crowd of modes high above it, which all lie next to zero (the spectral
transformation of Nour-Omid, Parlett, Ericsson and Jensen, Mathematics of Computation 48, 1987).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from turnout.core.errors import MechanicsError

FloatArray = npt.NDArray[np.float64]

MOST_MODES = 2000
"""Modes that are sought below a frequency; matrices of as many as four times that are dense."""

_SINGULAR_PIVOT = 1e-13  # of a matrix scaled to unit diagonal
_SMALL = 30  # coordinates; fewer are solved densely
_DENSE_SHARE = 0.25  # from this share of all modes on, the dense solution is the faster one
_HOLD_SHARE = 0.0025  # of the square of the cut-off
_BLOCKS = (8, 16)  # least and greatest number of vectors in a block
_MOST_DIRECTIONS = 4  # so many times the modes that are wanted are tried, and some blocks
_CONVERGED = 1e-6  # residual of a mode of the inverse, as a share; the share squared is its error
_DEPENDENT = 1e-14  # of the squares in a block: directions below this are nothing but rounding
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
        """True if all pivots lie on the diagonal, so that their signs give the inertia."""
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
    return _count_and_factor(stiffness, mass, frequency)[0]


def _count_and_factor(
    stiffness: sp.csr_array, mass: sp.csr_array, frequency: float
) -> tuple[int, Factor | None]:
    """Count the modes below a frequency [Hz]; return the factor that counted, if one could."""
    shift = (2.0 * np.pi * frequency) ** 2
    moved = shift * mass
    shifted = sp.csr_array(stiffness - moved)
    factor = factorise(shifted, reference=sp.csr_array(stiffness + moved))
    if factor is not None and factor.is_symmetric:
        return int(np.count_nonzero(factor.pivots < 0.0)), factor
    # A leading block is singular exactly at the shift: rare, so the slow method will do.
    return int(np.count_nonzero(np.linalg.eigvalsh(shifted.toarray()) < 0.0)), None


def modes_below(
    stiffness: sp.csr_array, mass: sp.csr_array, *, cutoff_frequency: float
) -> tuple[FloatArray, FloatArray, float]:
    """Find all modes of a structure up to a frequency.

    Parameters
    ----------
    stiffness, mass : csr_array, shape (n, n)
        Symmetric; the mass may be semi-definite, and the body free if the cut-off is above zero.
    cutoff_frequency : float
        Modes below it are found [Hz].

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
        If a motion has neither stiffness nor mass, or there are more than `MOST_MODES`.
    """
    size = stiffness.shape[0]
    if size == 0 or mass.count_nonzero() == 0:
        return np.zeros(0), np.zeros((size, 0)), float("nan")
    count, factor = _count_and_factor(stiffness, mass, cutoff_frequency)
    if count > MOST_MODES:
        msg = (
            f"{count} modes lie below {cutoff_frequency:g} Hz, at most {MOST_MODES} are kept; "
            "lower the cut-off, for a panel discretisation.superelement_cutoff"
        )
        raise MechanicsError(msg)
    shift = (2.0 * np.pi * cutoff_frequency) ** 2
    for found in _attempts(stiffness, mass, factor, count=count, shift=shift):
        frequencies = np.sqrt(np.maximum(found[0], 0.0)) / (2.0 * np.pi)
        order = np.argsort(frequencies, kind="stable")
        frequencies, modes = frequencies[order], found[1][:, order]
        if frequencies.size >= count and frequencies[:count].max(initial=0.0) <= (
            cutoff_frequency * (1.0 + 1e-6)
        ):
            break
    else:
        raise MechanicsError(_NOT_HELD)
    omitted = float(frequencies[count]) if frequencies.size > count else float("nan")
    return frequencies[:count], _normalise(modes[:, :count], mass), omitted


def _attempts(
    stiffness: sp.csr_array,
    mass: sp.csr_array,
    factor: Factor | None,
    *,
    count: int,
    shift: float,
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield eigenvalues and modes by one method after the other, the quickest first."""
    size = mass.shape[0]
    wanted = min(count + 1, size)
    if factor is not None and size >= _SMALL and wanted <= _DENSE_SHARE * size:
        found = _solve_lanczos(mass, factor, count, shift=shift)
        if found is not None:
            yield found
    for hold in (0.0, _HOLD_SHARE * shift):
        found = _solve_dense(mass, stiffness, wanted, hold=hold)
        if found is not None:
            yield found


def _solve_dense(
    mass: sp.csr_array, stiffness: sp.csr_array, wanted: int, *, hold: float
) -> tuple[FloatArray, FloatArray] | None:
    """Return eigenvalues and modes of the lowest few; None if the matrix on the right is singular.

    They solve M x = theta (K + hold M) x; a little mass on the right holds a free body.
    """
    size = mass.shape[0]
    held = stiffness + hold * mass
    try:
        theta, modes = scipy.linalg.eigh(
            mass.toarray(), held.toarray(), subset_by_index=[size - wanted, size - 1]
        )
    except np.linalg.LinAlgError:
        return None
    # A mode without mass has an infinite frequency: its theta is nothing but rounding.
    positive = theta > size * np.finfo(float).eps * theta.max()
    return 1.0 / theta[positive] - hold, modes[:, positive]


def _solve_lanczos(
    mass: sp.csr_array, factor: Factor, count: int, *, shift: float
) -> tuple[FloatArray, FloatArray] | None:
    """Return eigenvalues and modes of the `count` below a shift and of one above it.

    Parameters
    ----------
    mass : csr_array, shape (n, n)
        Of the structure.
    factor : Factor
        Of K - shift M; its inverse times M has the eigenvalues theta = 1 / (omega^2 - shift).
    count : int
        Modes below the shift: so many thetas are negative.
    shift : float
        Of the factor [rad^2/s^2].

    Returns
    -------
    tuple or None
        None where they do not converge within some times as many directions.
    """
    size, width = mass.shape[0], int(np.clip((count + 1) // 3, *_BLOCKS))
    most = min(size // 2, _MOST_DIRECTIONS * count + 24 * width)
    basis, with_mass = np.empty((2, most, size)).transpose(0, 2, 1)
    inverse = np.zeros((most, most))
    # A fixed start keeps the modes the same from run to run.
    start = np.random.default_rng(20240501).standard_normal((size, width))
    block, block_mass, _ = _orthonormal(factor.solve(mass @ start), mass)
    here, check = 0, 2 * count + 6 * width
    while block.shape[1] and here + block.shape[1] <= most:
        before, here = here, here + block.shape[1]
        basis[:, before:here], with_mass[:, before:here] = block, block_mass
        image = factor.solve(block_mass)
        inverse[:here, before:here] = with_mass[:, :here].T @ image
        image -= basis[:, :here] @ inverse[:here, before:here]
        image -= basis[:, :here] @ (with_mass[:, :here].T @ image)
        block, block_mass, links = _orthonormal(image, mass)
        if here <= count or (here < check and block.shape[1]):
            continue
        theta, shares = np.linalg.eigh(inverse[:here, :here], UPLO="U")
        chosen = np.append(np.arange(count), here - 1)
        residual = np.linalg.norm(links @ shares[before:here, chosen], axis=0)
        found = int(np.count_nonzero(theta < 0.0)) == count
        if found and np.all(residual <= _CONVERGED * np.abs(theta[chosen])):
            return shift + 1.0 / theta[chosen], basis[:, :here] @ shares[:, chosen]
        check = here + width
    return None


def _orthonormal(
    vectors: FloatArray, mass: sp.csr_array
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return an orthonormal basis of some vectors with respect to the mass.

    Returns
    -------
    basis, with_mass : ndarray, shape (n, m)
        The basis, and the mass times it; fewer vectors than given where these depend on each other.
    shares : ndarray, shape (m, n_vectors)
        ``vectors = basis @ shares``.
    """
    shares = np.eye(vectors.shape[1])
    with_mass = mass @ vectors
    for _ in range(2):  # once more, since the squares lose half of the digits
        squares, turn = np.linalg.eigh(vectors.T @ with_mass)
        kept = squares > _DEPENDENT * max(squares[-1], 0.0)
        length = np.sqrt(squares[kept])
        scaled = turn[:, kept] / length
        vectors, with_mass = vectors @ scaled, with_mass @ scaled
        shares = (length[:, None] * turn[:, kept].T) @ shares
    return vectors, with_mass, shares


def _normalise(modes: FloatArray, mass: sp.csr_array) -> FloatArray:
    if not modes.size:
        return modes
    scaled = modes / np.sqrt(np.einsum("ij,ij->j", modes, mass @ modes))
    size = np.abs(scaled)
    first = np.argmax(size > _SIGN_SHARE * size.max(axis=0), axis=0)
    signed: FloatArray = scaled * np.sign(scaled[first, np.arange(scaled.shape[1])])
    return signed


_NOT_HELD = "the structure is not held: a motion of it has neither stiffness nor mass"
