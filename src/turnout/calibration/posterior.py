"""Posterior of a fit: importance sampling, a chain as check, profiles of the cost."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import multivariate_t

from turnout.calibration.covariance import Spread
from turnout.calibration.emulator import Emulator, emulate
from turnout.calibration.fit import Fit
from turnout.errors import SolverError

Floats = NDArray[np.float64]
SAMPLES = 20_000
# Heavier tails than the normal distribution that is drawn about.
FREEDOM = 5
# Fewer effective samples than this: the chain is believed instead.
LEAST_EFFECTIVE = 400.0
CHAIN_STEPS, CHAIN_BURNT, CHAIN_WALKERS = 2000, 500, 32
# Rise of the cost at the ends of a 95 % interval of one parameter: chi-square with one freedom.
RISE_95 = 3.841


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Posterior:
    """Posterior under flat priors within the bounds.

    Attributes
    ----------
    names : tuple of str
        The p parameters.
    method : str
        "importance sampling" or "chain".
    mean, deviation : ndarray, shape (p,)
        Mean and standard deviation of each parameter in SI.
    intervals : ndarray, shape (p, 2)
        95 %, equal tails.
    profiles : ndarray, shape (p, 2)
        Where the cost, least over all other parameters, rises by 3.84.
    effective : float
        Effective number of independent samples.
    apart : float
        Largest distance of the chain's mean from that of the samples, in standard deviations; NaN
        without a chain.
    outside : float
        Share of the samples that bounds cut off.
    emulator : Emulator
        That it was drawn with.
    """

    names: tuple[str, ...]
    method: str
    mean: Floats
    deviation: Floats
    intervals: Floats
    profiles: Floats
    effective: float
    apart: float
    outside: float
    emulator: Emulator

    def record(self) -> dict[str, object]:
        """Return plain data for the file of a calibration."""
        return {
            "names": list(self.names),
            "method": self.method,
            "mean": self.mean.tolist(),
            "deviation": self.deviation.tolist(),
            "interval_95": self.intervals.tolist(),
            "profile_95": self.profiles.tolist(),
            "effective_samples": self.effective,
            "chain_apart": self.apart if np.isfinite(self.apart) else None,
            "outside_bounds": self.outside,
            "emulator_error": self.emulator.error,
            "emulator_worst": self.emulator.worst,
            "emulator_points": self.emulator.points,
        }


def posterior_of(found: Fit, spread: Spread, *, seed: int = 0) -> Posterior:
    """Sample the posterior distribution about a fit.

    A quadratic emulator of the residuals is proved on fresh throws. Points are drawn from a
    Student distribution about the fit and weighted by their likelihood. Where emcee is installed, a
    chain checks them, and replaces them where too few are effective.

    Parameters
    ----------
    found : Fit
        At its end.
    spread : Spread
        Covariance of the fit, from which samples are drawn.
    seed : int
        Of all that is drawn.

    Returns
    -------
    Posterior

    Raises
    ------
    SolverError
        When the emulator differs from new throws by more than a tenth of a standard deviation.
    """
    rng = np.random.default_rng(seed)
    emulator = emulate(found, spread, rng=rng)
    if not emulator.proved:
        message = (
            f"posterior: the emulator differs from new throws by {emulator.worst:.2g} standard "
            "deviations, allowed is 0.1; the intervals of the fit stand, as the posterior is far "
            "from normal or the solver too coarse for them"
        )
        raise SolverError(message)
    count = len(found.parameters)
    drawn = multivariate_t(np.zeros(count), np.eye(count), df=FREEDOM)
    standard = np.asarray(drawn.rvs(SAMPLES, random_state=rng)).reshape(SAMPLES, count)
    inside = _inside(found, emulator, standard)
    logs = -0.5 * emulator.cost(standard) - drawn.logpdf(standard)
    logs = np.where(inside, logs, -np.inf)
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    effective = float(1.0 / np.sum(weights**2))
    outside = 1.0 - float(inside.mean())
    chain = _chain(found, emulator, rng)
    mean, deviation, intervals = _summary(_values(found, emulator, standard), weights)
    apart, method = float("nan"), "importance sampling"
    if chain is not None:
        even = np.full(chain.shape[0], 1.0 / chain.shape[0])
        other = _summary(_values(found, emulator, chain), even)
        apart = float(np.max(np.abs(other[0] - mean) / deviation))
        if effective < LEAST_EFFECTIVE:
            method, (mean, deviation, intervals) = "chain", other
    return Posterior(
        names=tuple(item.name for item in found.parameters),
        method=method,
        mean=mean,
        deviation=deviation,
        intervals=intervals,
        profiles=_profiles(found, emulator),
        effective=effective,
        apart=apart,
        outside=outside,
        emulator=emulator,
    )


def _bounds(found: Fit) -> tuple[Floats, Floats]:
    low = np.array([item.coordinate(item.lower) for item in found.parameters])
    high = np.array([item.coordinate(item.upper) for item in found.parameters])
    return low, high


def _inside(found: Fit, emulator: Emulator, standard: Floats) -> NDArray[np.bool_]:
    low, high = _bounds(found)
    points = emulator.coordinates(standard)
    return np.asarray(((points >= low) & (points <= high)).all(axis=1))


def _values(found: Fit, emulator: Emulator, standard: Floats) -> Floats:
    """Return values in SI of standardised points, shape (n, p)."""
    points = emulator.coordinates(standard)
    columns = [
        np.exp(points[:, n]) if item.transform == "log" else points[:, n] * item.scale
        for n, item in enumerate(found.parameters)
    ]
    return np.column_stack(columns)


def _summary(values: Floats, weights: Floats) -> tuple[Floats, Floats, Floats]:
    """Return mean, standard deviation and 95 % intervals of weighted samples."""
    mean = weights @ values
    deviation = np.sqrt(weights @ (values - mean) ** 2)
    intervals = []
    for column in values.T:
        order = np.argsort(column)
        total = np.cumsum(weights[order])
        ends = np.searchsorted(total, [0.025, 0.975]).clip(0, column.size - 1)
        intervals.append(column[order][ends])
    return mean, deviation, np.array(intervals)


def _chain(found: Fit, emulator: Emulator, rng: np.random.Generator) -> Floats | None:
    """Return the points of an ensemble chain, or None where emcee is not installed."""
    try:
        import emcee
    except ImportError:
        return None
    count = len(found.parameters)
    walkers = max(CHAIN_WALKERS, 4 * count)

    def log_probability(standard: Floats) -> Floats:
        logs = -0.5 * emulator.cost(standard)
        return np.where(_inside(found, emulator, standard), logs, -np.inf)

    start = 0.1 * rng.standard_normal((walkers, count))
    sampler = emcee.EnsembleSampler(walkers, count, log_probability, vectorize=True)
    sampler.random_state = np.random.RandomState(int(rng.integers(2**31))).get_state()  # noqa: NPY002
    sampler.run_mcmc(start, CHAIN_STEPS)
    return np.asarray(sampler.get_chain(discard=CHAIN_BURNT, flat=True), dtype=np.float64)


def _profiles(found: Fit, emulator: Emulator) -> Floats:
    """Return where the profile of the cost rises by 3.84, for each parameter."""
    count = len(found.parameters)
    best, least = _least(lambda z: _cost(z, emulator), count)
    low, high = _bounds(found)
    rows = []
    for number in range(count):
        step = float(np.sqrt((emulator.root @ emulator.root.T)[number, number]))
        ends = []
        for side in (-1.0, 1.0):
            reach = _reach(emulator, best, number, side * step, least)
            place = emulator.coordinates(best[None, :])[0, number] + side * step * reach
            ends.append(float(np.clip(place, low[number], high[number])))
        item = found.parameters[number]
        rows.append([item.value(end) for end in ends])
    return np.array(rows)


def _least(function: Callable[[Floats], float], count: int) -> tuple[Floats, float]:
    """Return where a smooth function is least, from the origin, and its value there."""
    found: Any = minimize(function, np.zeros(count), method="BFGS")
    return np.asarray(found.x, dtype=np.float64), float(found.fun)


def _cost(standard: Floats, emulator: Emulator) -> float:
    return float(emulator.cost(standard[None, :])[0])


def _reach(emulator: Emulator, best: Floats, number: int, step: float, least: float) -> float:
    """Return how many steps along one coordinate the profile takes to rise by 3.84."""
    inverse = np.linalg.inv(emulator.root)
    # The others follow along the directions that leave this coordinate alone.
    free = inverse @ np.delete(np.eye(best.size), number, axis=1)
    shift = inverse[:, number] * step

    def rise(reach: float) -> float:
        def along(others: Floats) -> float:
            return _cost(best + reach * shift + free @ others, emulator)

        if free.shape[1] == 0:
            return along(np.zeros(0)) - least
        sizes = np.linalg.norm(free, axis=0)
        return _least(lambda u: along(u / sizes), free.shape[1])[1] - least

    inner, outer = 0.0, 1.0
    while rise(outer) < RISE_95 and outer < 8.0:
        inner, outer = outer, 2.0 * outer
    for _ in range(12):
        middle = 0.5 * (inner + outer)
        inner, outer = (middle, outer) if rise(middle) < RISE_95 else (inner, middle)
    return 0.5 * (inner + outer)
