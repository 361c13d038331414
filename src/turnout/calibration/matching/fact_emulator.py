r"""Quadratic emulators of facts over the ranges, and points to try next where they leave it open.

.. math:: y(z) = b_0 + b^T z + z^T B z + e, \qquad b \sim N(0, t_1^2), B \sim N(0, t_2^2),
          e \sim N(0, s^2)

with every parameter scaled to -1 ... 1; the three spreads maximise the marginal likelihood
(Rasmussen and Williams 2006, section 2.3, doi 10.7551/mitpress/3206.001.0001). What the emulator
leaves open is the root mean square of its leave-one-out residuals, which also covers that facts are
not quadratic.
Implausibility is as in history matching (Craig et al. 1997; Vernon et al. 2010, doi
10.1214/10-BA524), with the distance to an interval in place of that to a value.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from scipy.stats import qmc

from turnout.calibration.matching.facts import Sum

Floats = NDArray[np.float64]

WALKERS, STEPS = 600, 120
"""Walkers of a wave, and steps of each after the region is reached."""
REGION_SHARE = 0.2
"""Share of the walkers that each narrower region starts from."""
CANDIDATES = 20_000
MOST_REGIONS = 40
MOST_FOR_SPREADS = 350
"""So many points are used to find the three spreads."""
LEAST_SPREAD, MOST_SPREAD = np.log(1e-3), np.log(100.0)
"""Bounds of the logarithms of the spreads, in standard deviations of the values."""
FEWEST = 30
"""Points below which no emulator is made."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Emulator:
    """A fact as a quadratic function of the scaled parameters.

    Attributes
    ----------
    coefficients : ndarray, shape (n_terms,)
        Of `monomials` [unit of the fact].
    error : float
        Root mean square of the leave-one-out residuals [unit of the fact].
    spread : float
        Standard deviation of the values that it was fitted to [unit of the fact].
    """

    coefficients: Floats
    error: float
    spread: float

    @property
    def explained(self) -> float:
        """Share of the variance that is predicted, from the leave-one-out residuals [-]."""
        return 1.0 - (self.error / self.spread) ** 2 if self.spread > 0 else 1.0


def monomials(points: Floats) -> Floats:
    """Return 1, each scaled parameter, and each product of two, at points of the unit cube.

    Examples
    --------
    >>> monomials(np.array([[1.0, 0.5]]))
    array([[1., 1., 0., 1., 0., 0.]])
    """
    z = 2.0 * points - 1.0
    rows, columns = np.triu_indices(z.shape[1])
    return np.column_stack([np.ones(len(z)), z, z[:, rows] * z[:, columns]])


def fit_emulator(points: Floats, values: Floats, *, rng: np.random.Generator) -> Emulator:
    """Fit an emulator to values at points of the unit cube.

    Parameters
    ----------
    points : ndarray, shape (n, n_parameters)
        Shares of the ranges.
    values : ndarray, shape (n,)
        Of a fact; all finite.
    rng : numpy.random.Generator
        Chooses the points for the spreads.
    """
    spread = float(values.std())
    features = monomials(points)
    if spread == 0.0:
        flat = np.zeros(features.shape[1])
        flat[0] = values[0]
        return Emulator(coefficients=flat, error=0.0, spread=0.0)
    y = (values - values.mean()) / spread
    count = points.shape[1]
    groups = (features[:, : 1 + count], features[:, 1 + count :])
    grams = tuple(group @ group.T for group in groups)
    some = rng.permutation(len(y))[:MOST_FOR_SPREADS]
    parts = tuple(gram[np.ix_(some, some)] for gram in grams)
    found = minimize(
        _misfit,
        np.log([0.3, 0.1, 0.2]),
        args=(parts, y[some]),
        method="Nelder-Mead",
        options={"maxfev": 80, "xatol": 0.05, "fatol": 0.1},
    )
    first, second, noise = _variances(found.x)
    factor = cho_factor(first * grams[0] + second * grams[1] + noise * np.eye(len(y)), lower=True)
    weights = cho_solve(factor, y)
    inverse = cho_solve(factor, np.eye(len(y)))
    left_out = weights / np.diag(inverse)
    coefficients = np.concatenate([first * groups[0].T @ weights, second * groups[1].T @ weights])
    coefficients *= spread
    coefficients[0] += values.mean()
    error = spread * float(np.sqrt(np.mean(left_out**2)))
    return Emulator(coefficients=coefficients, error=error, spread=spread)


def _variances(logs: Floats) -> Floats:
    """Return the squares of the three spreads; the noise is never so small that rounding counts."""
    return np.asarray(np.exp(2.0 * np.clip(logs, LEAST_SPREAD, MOST_SPREAD)))


def _misfit(logs: Floats, grams: tuple[Floats, ...], y: Floats) -> float:
    """Return the negative logarithm of the marginal likelihood, without its constant."""
    first, second, noise = _variances(logs)
    matrix = first * grams[0] + second * grams[1] + noise * np.eye(len(y))
    lower, _ = factor = cho_factor(matrix, lower=True)
    return float(0.5 * y @ cho_solve(factor, y) + np.log(np.diag(lower)).sum())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Emulation:
    """Emulators of several facts, evaluated together.

    Attributes
    ----------
    coefficients : ndarray, shape (n_terms, n_facts)
        Column by column.
    error, least, most : ndarray, shape (n_facts,)
        Of the emulators, and bounds of the facts.
    """

    coefficients: Floats
    error: Floats
    least: Floats
    most: Floats

    @classmethod
    def of(cls, emulators: Sequence[Emulator], facts: Sequence[Sum]) -> "Emulation":
        """Put emulators and bounds side by side."""
        return cls(
            coefficients=np.column_stack([item.coefficients for item in emulators]),
            error=np.array([item.error for item in emulators]),
            least=np.array([fact.least for fact in facts]),
            most=np.array([fact.most for fact in facts]),
        )

    def implausibility(self, points: Floats) -> Floats:
        """Return the largest distance to a bound, in errors of its emulator, shape (n,).

        Negative where all predictions lie within their bounds: then by how many errors.
        """
        predicted = monomials(points) @ self.coefficients
        beyond = np.maximum(self.least - predicted, predicted - self.most)
        floor = 1e-9 * (1.0 + np.abs(predicted).max(axis=0))
        return np.asarray((beyond / np.maximum(self.error, floor)).max(axis=1))


def latin_hypercube(count: int, dimensions: int, *, rng: np.random.Generator) -> Floats:
    """Return points spread evenly over the unit cube, shape (count, dimensions)."""
    return np.asarray(qmc.LatinHypercube(dimensions, rng=rng).random(count))


def plausible_points(
    emulation: Emulation,
    count: int,
    *,
    start: Floats,
    limit: float,
    rng: np.random.Generator,
) -> tuple[Floats, float]:
    """Return points evenly drawn from where the implausibility is below a limit.

    Regions of falling implausibility are sampled one within the other, each by random walks that
    start from the most plausible fifth of the last (subset simulation, Au and Beck 2001, doi
    10.1016/S0266-8920(01)00019-4). The share of the unit cube follows as a product of shares.

    Parameters
    ----------
    emulation : Emulation
        Of all facts.
    count : int
        Points wanted.
    start : ndarray, shape (n, n_parameters)
        Points that are known to be plausible, from which walks start too; may be none.
    limit : float
        Of the implausibility, in errors of the emulators.
    rng : numpy.random.Generator
        Of the walks.

    Returns
    -------
    points : ndarray, shape (count, n_parameters)
        Within the unit cube.
    share : float
        Of the unit cube that is below the limit, estimated [-].
    """
    dimensions = start.shape[1]
    walkers = np.concatenate([latin_hypercube(CANDIDATES, dimensions, rng=rng), start])
    values = emulation.implausibility(walkers)
    share, level = 1.0, np.inf
    for _ in range(MOST_REGIONS):
        inside = values <= limit
        if inside.mean() >= REGION_SHARE:
            share *= float(inside.mean())
            walkers, values, level = walkers[inside], values[inside], limit
            break
        level = max(float(np.quantile(values, REGION_SHARE)), limit)
        kept = values <= level
        share *= float(kept.mean())
        walkers, values = walkers[kept], values[kept]
        chosen = rng.integers(len(walkers), size=WALKERS)
        walkers, values = _walk(
            emulation, walkers[chosen], values[chosen], level, STEPS // 3, rng=rng
        )
    chosen = rng.integers(len(walkers), size=WALKERS)
    walkers, values = walkers[chosen], values[chosen]
    walkers, values = _walk(emulation, walkers, values, max(level, limit), STEPS, rng=rng)
    return walkers[rng.permutation(len(walkers))[:count]], share


def _walk(
    emulation: Emulation,
    walkers: Floats,
    values: Floats,
    level: float,
    steps: int,
    *,
    rng: np.random.Generator,
) -> tuple[Floats, Floats]:
    """Walk at random within a region; steps follow the spread of the walkers."""
    count, dimensions = walkers.shape
    spread = np.cov(walkers.T) + 1e-8 * np.eye(dimensions)
    root = np.linalg.cholesky(spread)
    length = 2.38 / np.sqrt(dimensions)
    for _ in range(steps):
        size = length * np.exp(rng.normal(size=(count, 1)))
        trial = walkers + size * (rng.normal(size=(count, dimensions)) @ root.T)
        within = ((trial >= 0.0) & (trial <= 1.0)).all(axis=1)
        found = np.full(count, np.inf)
        if within.any():
            found[within] = emulation.implausibility(trial[within])
        moved = found <= level
        walkers = np.where(moved[:, np.newaxis], trial, walkers)
        values = np.where(moved, found, values)
    return walkers, values


def farthest_points(points: Floats, count: int) -> list[int]:
    """Return the numbers of points that lie far from each other, the most central one first.

    Each next point is the one farthest from all chosen before (Gonzalez 1985, doi
    10.1016/0304-3975(85)90224-5).

    Examples
    --------
    >>> farthest_points(np.array([[0.5], [0.0], [1.0], [0.6], [0.4]]), 3)
    [0, 1, 2]
    """
    middle = np.median(points, axis=0)
    chosen = [int(np.argmin(np.linalg.norm(points - middle, axis=1)))]
    distance = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return chosen
