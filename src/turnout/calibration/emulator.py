"""A quadratic emulator of simulations near a fit, tested on new throws."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from turnout.calibration.fit import Fit
from turnout.calibration.parameter import prior_information, prior_residuals, values_at

Floats = NDArray[np.float64]
# Throws for each coefficient of the quadratic, and fresh ones for its proof.
PER_COEFFICIENT, FRESH = 2, 20
# Share of a normal posterior that lies within the points.
WITHIN = 0.99
# A stand-in that misses more than this share of a standard deviation is not used [-].
LARGEST_ERROR = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Emulator:
    """Whitened residuals as quadratic functions of the standardised parameters.

    Attributes
    ----------
    centre : ndarray, shape (p,)
        Coordinates of the fit.
    root : ndarray, shape (p, p)
        Lower Cholesky factor of the covariance that movements and priors give, without the errors
        that no residual shows: coordinates are centre + root z.
    gram : ndarray, shape (c, c)
        Inner products of the coefficients, from which the cost follows at once.
    error, worst : float
        How far emulated less simulated residuals of fresh throws move a value, in its standard
        deviations: root mean square and largest over all fresh points and values.
    points : int
        That were thrown.
    """

    centre: Floats
    root: Floats
    gram: Floats
    error: float
    worst: float
    points: int

    @property
    def proved(self) -> bool:
        """Whether every fresh point was met."""
        return self.worst < LARGEST_ERROR

    def cost(self, standard: Floats) -> Floats:
        """Return the sum of squared residuals at standardised points, shape (n, p)."""
        terms = monomials(standard)
        return np.asarray(np.einsum("ni,ij,nj->n", terms, self.gram, terms))

    def coordinates(self, standard: Floats) -> Floats:
        """Return coordinates of standardised points, shape (n, p)."""
        return np.asarray(self.centre + standard @ self.root.T)


def monomial_slopes(standard: Floats) -> Floats:
    """Return the change of each monomial with each coordinate at a point of shape (p,), (p, c).

    Examples
    --------
    >>> monomial_slopes(np.array([2.0, 3.0]))
    array([[0., 1., 0., 4., 3., 0.],
           [0., 0., 1., 0., 2., 6.]])
    """
    count = standard.size
    rows, columns = np.triu_indices(count)
    unit = np.eye(count)
    products = unit[:, rows] * standard[columns] + unit[:, columns] * standard[rows]
    return np.hstack([np.zeros((count, 1)), unit, products])


def reach_of(count: int) -> float:
    """Return how far out points are drawn, in standard deviations: further with more parameters.

    Examples
    --------
    >>> [round(reach_of(count), 2) for count in (1, 2, 5, 10)]
    [2.58, 3.03, 3.88, 4.82]
    """
    return float(np.sqrt(chdtri(count, 1.0 - WITHIN)))


def points_needed(count: int) -> int:
    """Return how many points are thrown for an emulator of `count` parameters.

    Examples
    --------
    >>> points_needed(5)
    63
    """
    return 1 + PER_COEFFICIENT * _coefficients(count) + FRESH


def _coefficients(count: int) -> int:
    """Return how many coefficients a quadratic has."""
    return 1 + count + count * (count + 1) // 2


def monomials(standard: Floats) -> Floats:
    """Return 1, every coordinate and every product of two, for points of shape (n, p).

    Examples
    --------
    >>> monomials(np.array([[2.0, 3.0]]))
    array([[1., 2., 3., 4., 6., 9.]])
    """
    count = standard.shape[1]
    rows, columns = np.triu_indices(count)
    products = standard[:, rows] * standard[:, columns]
    return np.column_stack([np.ones(standard.shape[0]), standard, products])


def emulate(found: Fit, *, rng: np.random.Generator) -> Emulator:
    r"""Throw points about a fit and put a quadratic through their residuals.

    Points are drawn as far out as residuals let values go, however wide errors make the intervals
    that no residual shows: over a far wider range the quadratic would be less exact than the
    movements are. It is judged by what it does to values: an error `e` of the residuals moves
    them by :math:`L^T J^T e` standard deviations, with the slopes `J` and the factor `L` of their
    covariance.

    Parameters
    ----------
    found : Fit
        At its end; its frame and its finer throws are kept.
    rng : numpy.random.Generator
        Of the points.

    Returns
    -------
    Emulator
    """
    count, J = len(found.parameters), found.jacobian
    information = J.T @ J + np.diag(prior_information(found.parameters))
    root: Floats = np.asarray(np.linalg.cholesky(np.linalg.inv(information)), dtype=np.float64)
    number = PER_COEFFICIENT * _coefficients(count)
    learnt = _cloud(number, count, rng)
    fresh = _cloud(FRESH, count, rng)
    rows = _simulate_points(found, root, np.concatenate([np.zeros((1, count)), learnt, fresh]))
    taught, proof = rows[: 1 + number], rows[1 + number :]
    terms = monomials(np.concatenate([np.zeros((1, count)), learnt]))
    good = np.isfinite(taught).all(axis=1)
    coefficients = np.linalg.lstsq(terms[good], taught[good], rcond=None)[0]
    missed = (monomials(fresh) @ coefficients - proof)[:, : J.shape[0]]
    moves = missed @ J @ root
    return Emulator(
        centre=found.point,
        root=root,
        gram=coefficients @ coefficients.T,
        error=float(np.sqrt(np.mean(moves**2))),
        worst=float(np.abs(moves).max()) if np.isfinite(moves).all() else float("inf"),
        points=rows.shape[0],
    )


def _cloud(number: int, count: int, rng: np.random.Generator) -> Floats:
    """Draw points evenly over directions and, by radius, out to the reach."""
    raw = rng.standard_normal((number, count))
    radius = reach_of(count) * rng.uniform(0.2, 1.0, size=(number, 1))
    return np.asarray(radius * raw / np.linalg.norm(raw, axis=1, keepdims=True))


def _simulate_points(found: Fit, root: Floats, standard: Floats) -> Floats:
    """Return the whitened residuals at standardised points.

    A parameter that scatters keeps its own value in each movement, which identifies it sharply; the
    common one acts through the expected scatter alone, and that is linear.
    """
    misfit = found.misfit
    points = found.point + standard @ root.T
    common = [misfit.comparison.scatter.get(item.name, 0.0) > 0 for item in found.parameters]
    held = np.where(common, found.point, points)
    whole = [{**found.values, **values_at(found.parameters, point)} for point in held]
    rows = [misfit.residuals_of(row, found.frame) for row in misfit.responses(whole)]
    whitened = np.array(rows) + (points - held) @ found.jacobian.T
    return np.hstack([whitened, prior_residuals(found.parameters, points)])
