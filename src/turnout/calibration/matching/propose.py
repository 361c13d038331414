"""Points to try next: evenly over the ranges at first, then over what the emulators leave open."""

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from turnout.calibration.matching.fact_emulator import Emulation

Floats = NDArray[np.float64]

WALKERS, STEPS = 600, 120
"""Walkers of a wave, and steps of each after the region is reached."""
REGION_SHARE = 0.2
"""Share of the walkers that each narrower region starts from."""
CANDIDATES = 20_000
MOST_REGIONS = 40


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
