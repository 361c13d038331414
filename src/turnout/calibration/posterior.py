"""Posterior of a fit: importance sampling, a chain as check, profiles of the cost."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from turnout.calibration.covariance import Spread
from turnout.calibration.emulator import Emulator, emulate, monomial_slopes, reach_of
from turnout.calibration.fit import Fit
from turnout.calibration.parameter import flat_information
from turnout.core.errors import SolverError

Floats = NDArray[np.float64]
SAMPLES = 20_000
# Heavier tails than the normal distribution that is drawn about.
FREEDOM = 5
# Fewer effective samples than this give no ends of a 95 % interval: a chain is tried instead.
LEAST_EFFECTIVE = 400.0
# Steps of a chain at a time, how often it goes on at most, and its walkers; the first quarter is
# left out. It has mixed where it is so many times as long as its correlation.
CHAIN_STEPS, CHAIN_ROUNDS, CHAIN_WALKERS, BURNT, MIXED = 2000, 4, 32, 0.25, 50.0
# Samples and chain disagree where their means are so many standard errors apart [-].
DISAGREE = 5.0
# A mean further from the fit than this is said [standard deviations of the fit].
AWAY = 1.0
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
        95 %, equal tails, with the errors that all movements share, as those of the fit.
    profiles : ndarray, shape (p, 2)
        Where the cost, least over all other parameters, rises by 3.84: by the movements alone.
    effective : float
        Effective number of independent samples, by the method.
    apart : float
        Largest distance of the chain's mean from that of the samples, in standard deviations; NaN
        without a chain that has mixed.
    away : float
        Largest distance of the mean from the fit, in standard deviations of the fit.
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
    away: float
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
            "away_from_fit": self.away,
            "outside_bounds": self.outside,
            "emulator_error": self.emulator.error,
            "emulator_worst": self.emulator.worst,
            "emulator_points": self.emulator.points,
        }


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Samples:
    """Standardised points with weights that add up to 1, and how many independent ones they are."""

    method: str
    standard: Floats
    weights: Floats
    effective: float
    outside: float = 0.0

    @property
    def moments(self) -> tuple[Floats, Floats]:
        """Mean and standard deviation of each standardised coordinate, shape (p,)."""
        mean = self.weights @ self.standard
        return mean, np.sqrt(self.weights @ (self.standard - mean) ** 2)


def posterior_of(found: Fit, spread: Spread, *, seed: int = 0) -> Posterior:
    """Sample the posterior distribution about a fit.

    A quadratic emulator of the residuals is proved on fresh throws. Points are drawn from a
    Student distribution about its least cost, as wide as the movements alone leave the values, and
    weighted by their likelihood. Where emcee is installed, a chain checks them, and replaces them
    where too few are effective. To each sample an error is added that all movements share, of the
    covariance that the fit states of it, and a parameter that scatters is as far off as the number
    of movements that showed its scatter allows.

    Parameters
    ----------
    found : Fit
        At its end.
    spread : Spread
        Covariance of the fit, with the errors that all movements share.
    seed : int
        Of all that is drawn.

    Returns
    -------
    Posterior

    Raises
    ------
    SolverError
        When the emulator moves values by more than a tenth of a standard deviation on new throws,
        when its least cost lies beyond the points that it was made from, or when too few samples
        are effective to state intervals.
    """
    rng = np.random.default_rng(seed)
    emulator = emulate(found, rng=rng)
    if not emulator.proved:
        message = (
            f"posterior: the emulator moves values by {emulator.worst:.2g} standard deviations on "
            "new throws, allowed is 0.1; the intervals of the fit stand, as the posterior is far "
            "from normal or the solver too coarse for them"
        )
        raise SolverError(message)
    drawn, apart = _believed(found, emulator, rng)
    values = _values(found, _with_common_errors(found, spread, emulator, drawn, rng))
    mean, deviation, intervals = _summary(values, drawn.weights)
    fitted = np.array([found.values[item.name] for item in found.parameters])
    slopes = np.array([item.slope(found.values[item.name]) for item in found.parameters])
    stated = np.sqrt(np.diag(spread.coordinate_covariance)) * slopes
    return Posterior(
        names=tuple(item.name for item in found.parameters),
        method=drawn.method,
        mean=mean,
        deviation=deviation,
        intervals=intervals,
        profiles=_profiles(found, emulator),
        effective=drawn.effective,
        apart=apart,
        away=float(np.max(np.abs(mean - fitted) / stated)),
        outside=drawn.outside,
        emulator=emulator,
    )


def posterior_record(found: Fit, spread: Spread) -> tuple[dict[str, object], list[str]]:
    """Return a posterior as plain data, empty where there is none, with warnings about it."""
    try:
        drawn = posterior_of(found, spread)
    except SolverError as error:
        return {}, [str(error)]
    if drawn.away <= AWAY:
        return drawn.record(), []
    return drawn.record(), [
        f"posterior: its mean is {drawn.away:.1f} standard deviations from the fit, which has not "
        "ended at the likeliest values or is far from normal; calibrate again from what came out "
        "(--set)"
    ]


def _believed(found: Fit, emulator: Emulator, rng: np.random.Generator) -> tuple[_Samples, float]:
    """Return samples that are enough to state intervals, and how far apart a chain's mean is."""
    centre, root = _proposal(found, emulator)
    drawn = _importance(found, emulator, rng, centre, root)
    chain = _chain(found, emulator, rng, centre, root)
    if chain is None or chain.effective < LEAST_EFFECTIVE:
        if drawn.effective >= LEAST_EFFECTIVE:
            return drawn, float("nan")
        most = max(drawn.effective, chain.effective if chain is not None else 0.0)
        remedy = "" if chain is not None else 'install turnout with the extra "uq" for a chain, '
        message = (
            f"posterior: {most:.0f} effective samples, {LEAST_EFFECTIVE:.0f} are needed, so it "
            f"gives no intervals and those of the fit stand; {remedy}keep parameters that are "
            "strongly correlated or not identified (--fix), or measure what separates them "
            "(--advise)"
        )
        raise SolverError(message)
    if drawn.effective < LEAST_EFFECTIVE:
        return chain, float("nan")
    (one, deviation), (other, _) = drawn.moments, chain.moments
    apart = float(np.max(np.abs(other - one) / deviation))
    error = np.sqrt(1.0 / drawn.effective + 1.0 / chain.effective)
    if apart > DISAGREE * error:
        message = (
            f"posterior: a chain and {drawn.effective:.0f} effective samples differ by {apart:.2g} "
            "standard deviations, so it gives no intervals and those of the fit stand; it has "
            "several maxima: calibrate from other starts (--set), or keep a parameter (--fix)"
        )
        raise SolverError(message)
    return drawn, apart


def _proposal(found: Fit, emulator: Emulator) -> tuple[Floats, Floats]:
    """Return where the emulated cost is least, and the factor of the covariance there."""
    count = len(found.parameters)
    best, _ = _least(lambda z: _cost(z, emulator), count)
    away = float(np.linalg.norm(best))
    if away > reach_of(count):
        message = (
            f"posterior: the likeliest values lie {away:.1f} standard deviations from the fit, "
            "beyond its throws, so it gives no intervals; calibrate again from what came out "
            "(--set)"
        )
        raise SolverError(message)
    slopes = monomial_slopes(best)
    flat = emulator.root.T @ np.diag(flat_information(found.parameters)) @ emulator.root
    information = slopes @ emulator.gram @ slopes.T + flat
    return best, np.asarray(np.linalg.cholesky(np.linalg.inv(information)), dtype=np.float64)


def _importance(
    found: Fit, emulator: Emulator, rng: np.random.Generator, centre: Floats, root: Floats
) -> _Samples:
    """Draw from a Student distribution and weigh by the likelihood."""
    from scipy.stats import multivariate_t  # loads slowly, and few fits sample

    count = centre.size
    drawn = multivariate_t(np.zeros(count), np.eye(count), df=FREEDOM)
    raw = np.asarray(drawn.rvs(SAMPLES, random_state=rng)).reshape(SAMPLES, count)
    standard = centre + raw @ root.T
    inside = _inside(found, emulator, standard)
    logs = np.where(inside, -0.5 * emulator.cost(standard) - drawn.logpdf(raw), -np.inf)
    if not inside.any():
        message = "posterior: no sample lies within the bounds; widen them"
        raise SolverError(message)
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    return _Samples(
        method="importance sampling",
        standard=standard,
        weights=weights,
        effective=float(1.0 / np.sum(weights**2)),
        outside=1.0 - float(inside.mean()),
    )


def _with_common_errors(
    found: Fit, spread: Spread, emulator: Emulator, drawn: _Samples, rng: np.random.Generator
) -> Floats:
    """Return coordinates of samples, shape (n, p), with errors that no residual shows."""
    points = emulator.coordinates(drawn.standard)
    middle = drawn.weights @ points
    for column, item in enumerate(found.parameters):
        if found.misfit.comparison.scatter.get(item.name, 0.0) > 0.0:
            # Normal over the root of chi-square is Student's distribution, as of the fit.
            ratio = rng.chisquare(spread.freedom, points.shape[0]) / spread.freedom
            points[:, column] = middle[column] + (points[:, column] - middle[column]) / ratio**0.5
    variances, vectors = np.linalg.eigh(spread.common_covariance)
    sizes = np.sqrt(np.maximum(variances, 0.0))
    points = points + (sizes * rng.standard_normal(points.shape)) @ vectors.T
    low, high = _bounds(found)
    return np.asarray(np.clip(points, low, high))


def _bounds(found: Fit) -> tuple[Floats, Floats]:
    low = np.array([item.coordinate(item.lower) for item in found.parameters])
    high = np.array([item.coordinate(item.upper) for item in found.parameters])
    return low, high


def _inside(found: Fit, emulator: Emulator, standard: Floats) -> NDArray[np.bool_]:
    low, high = _bounds(found)
    points = emulator.coordinates(standard)
    return np.asarray(((points >= low) & (points <= high)).all(axis=1))


def _values(found: Fit, points: Floats) -> Floats:
    """Return values in SI of coordinates, shape (n, p)."""
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


def _chain(
    found: Fit, emulator: Emulator, rng: np.random.Generator, centre: Floats, root: Floats
) -> _Samples | None:
    """Return an ensemble chain, as long as it takes; None where emcee is not installed.

    One that has not mixed after the most steps is worth no sample.
    """
    try:
        import emcee
    except ImportError:
        return None
    count = centre.size
    walkers = max(CHAIN_WALKERS, 4 * count)

    def log_probability(standard: Floats) -> Floats:
        logs = -0.5 * emulator.cost(standard)
        return np.where(_inside(found, emulator, standard), logs, -np.inf)

    state: Any = centre + rng.standard_normal((walkers, count)) @ root.T
    sampler = emcee.EnsembleSampler(walkers, count, log_probability, vectorize=True)
    sampler.random_state = np.random.RandomState(int(rng.integers(2**31))).get_state()  # noqa: NPY002
    for turn in range(1, CHAIN_ROUNDS + 1):
        state = sampler.run_mcmc(state, CHAIN_STEPS)
        left_out = int(BURNT * turn * CHAIN_STEPS)
        kept = turn * CHAIN_STEPS - left_out
        correlation = float(np.max(sampler.get_autocorr_time(discard=left_out, tol=0)))
        if kept > MIXED * correlation and walkers * kept / correlation > LEAST_EFFECTIVE:
            break
    else:
        correlation = float("inf")
    points = np.asarray(sampler.get_chain(discard=left_out, flat=True), dtype=np.float64)
    return _Samples(
        method="chain",
        standard=points,
        weights=np.full(points.shape[0], 1.0 / points.shape[0]),
        effective=points.shape[0] / correlation,
    )


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
