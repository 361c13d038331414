"""A short fit from a good start, and how likely its residuals are under a state of noise."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from turnout.study.calibration.local import Local
from turnout.study.calibration.misfit import Misfit, framed, jacobian
from turnout.study.calibration.noise import Noise, missed_by_model
from turnout.study.calibration.observed import Movement
from turnout.study.calibration.parameter import Parameter, coordinates, values_at
from turnout.study.calibration.view import Key

Floats = NDArray[np.float64]
# Two solvers agree to this share of a channel's peak, for about this long [-], [s]: less than that
# says nothing about a law.
AGREEMENT, AGREEMENT_TIME = 3e-3, 0.1
ROUNDS, HALVINGS = 5, 2
# Longest step, the longest after which slopes are kept, and the shortest worth a throw.
LONGEST, SAME_SLOPE, SHORTEST = 0.3, 0.03, 1e-3
# How many movements the expected scatter counts for beside those that were measured.
SCATTER_WEIGHT = 2.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Descent:
    """Where a short fit ended.

    Attributes
    ----------
    misfit : Misfit
        With the scatter that it ended with.
    names : tuple of str
        Parameters that it changed.
    values : dict of str to float
        Of all parameters.
    local : Local
        Responses there.
    """

    misfit: Misfit
    names: tuple[str, ...]
    values: dict[str, float]
    local: Local


def descended(misfit: Misfit, vary: Sequence[Parameter], values: Mapping[str, float]) -> Descent:
    """Fit parameters by a few Gauss-Newton steps, slopes taken anew only after long ones.

    Parameters
    ----------
    misfit : Misfit
        Movements and how they are compared.
    vary : sequence of Parameter
        To change.
    values : mapping of str to float
        A good start, of all parameters.

    Raises
    ------
    SolverError
        When a movement cannot be simulated.
    """
    names = [item.name for item in vary]
    local = misfit.local(values, names)
    for _ in range(ROUNDS):
        frame = framed(local, misfit)
        residuals = misfit.residuals_of(local.here, frame)
        step = _bounded(residuals, jacobian(local, frame, names), vary, local.values)
        if np.abs(step).max() < SHORTEST:
            break
        for _ in range(1 + HALVINGS):
            trial = {
                **local.values,
                **values_at(vary, coordinates(vary, local.values) + step),
            }
            here = tuple(misfit.responses([trial])[0])
            ahead = misfit.residuals_of(here, frame)
            if np.isfinite(ahead).all() and ahead @ ahead < residuals @ residuals:
                break
            step = 0.4 * step
        else:
            break
        near = np.abs(step).max() <= SAME_SLOPE
        local = replace(local, values=trial, here=here) if near else misfit.local(trial, names)
    return Descent(
        misfit=_with_learned_scatter(misfit, local),
        names=tuple(names),
        values=dict(local.values),
        local=local,
    )


def floored(noise: Mapping[Key, Noise], movements: Sequence[Movement]) -> dict[Key, Noise]:
    """Return noise that holds what solvers of the same mechanics may differ by."""
    peaks: dict[Key, float] = {}
    for movement in movements:
        for signal in movement.signals:
            key = (signal.channel, signal.drive)
            peaks[key] = max(peaks.get(key, 0.0), float(np.nanmax(np.abs(signal.values))))
    return {
        key: replace(item, missed=AGREEMENT * peaks[key], missed_length=AGREEMENT_TIME)
        for key, item in noise.items()
    }


def learned_noise(found: Descent, floor: Mapping[Key, Noise]) -> dict[Key, Noise]:
    """Return noise that also holds what the law of a fit misses; never below the floor."""
    frame = framed(found.local, found.misfit)
    series: dict[Key, list[Floats]] = {}
    for view, response in zip(frame.views, found.local.here, strict=True):
        for (signal, _), row in zip(view.parts, view.left_over(response), strict=True):
            series.setdefault((signal.channel, signal.drive), []).append(row)
    learned = dict(floor)
    for key, rows in series.items():
        bare = replace(floor[key], missed=0.0)
        size, length = missed_by_model(rows, bare)
        if size > floor[key].missed:
            learned[key] = replace(bare, missed=size, missed_length=length)
    return learned


def deviance(found: Descent, noise: Mapping[Key, Noise]) -> float:
    r"""Return minus twice the logarithm of the likelihood of a fit under a state of noise.

    .. math:: D = r^T C^{-1} r + \ln \det C

    with the covariance `C` of noise, doubts of onset and zero, and what scatters.
    """
    comparison = replace(found.misfit.comparison, noise=noise)
    misfit = replace(found.misfit, comparison=comparison, frame=None)
    frame = framed(found.local, misfit)
    residuals = misfit.residuals_of(found.local.here, frame)
    total = float(residuals @ residuals)
    for view in frame.views:
        for factor in view.factors:
            total += 2.0 * float(np.log(np.diag(factor)).sum())
        total -= 2.0 * float(np.log1p(-view.shrink).sum())
    return total


def effective_samples(found: Descent, noise: Mapping[Key, Noise]) -> float:
    """Return how many independent samples the movements of a fit are worth."""
    frame = framed(found.local, found.misfit)
    return sum(
        noise[signal.channel, signal.drive].effective(signal.time[bins])
        for view in frame.views
        for signal, bins in view.parts
    )


def criteria(deviance: float, *, parameters: int, samples: float) -> tuple[float, float]:
    r"""Return the criteria of Akaike, corrected for few samples, and of Schwarz.

    .. math::

        \mathrm{AICc} = D + 2 k + \frac{2 k (k + 1)}{n - k - 1}, \quad
        \mathrm{BIC} = D + k \ln n

    with the deviance `D`, `k` parameters and `n` effective samples. Sources: Hurvich and Tsai 1989,
    doi 10.1093/biomet/76.2.297; Schwarz 1978, doi 10.1214/aos/1176344136.

    Examples
    --------
    >>> akaike, schwarz = criteria(100.0, parameters=2, samples=50)
    >>> round(akaike, 3), round(schwarz, 3)
    (104.255, 107.824)
    """
    rest = samples - parameters - 1
    correction = 2.0 * parameters * (parameters + 1) / rest if rest > 0 else float("inf")
    akaike = deviance + 2.0 * parameters + correction
    return akaike, deviance + parameters * float(np.log(samples))


def _bounded(
    residuals: Floats,
    slopes: Floats,
    vary: Sequence[Parameter],
    values: Mapping[str, float],
) -> Floats:
    """Return the step to the least squares within bounds."""
    here = coordinates(vary, values)
    low = np.array([item.coordinate(item.lower) for item in vary]) - here
    high = np.array([item.coordinate(item.upper) for item in vary]) - here
    low = np.minimum(np.maximum(low, -LONGEST), -1e-12)
    high = np.maximum(np.minimum(high, LONGEST), 1e-12)
    return np.asarray(lsq_linear(slopes, -residuals, bounds=(low, high)).x, dtype=np.float64)


def _with_learned_scatter(misfit: Misfit, local: Local) -> Misfit:
    """Return a misfit whose scatter is what the movements show, beside what was expected."""
    views = framed(local, misfit).views
    scatter = {}
    for name, expected in misfit.comparison.scatter.items():
        estimates = [view.estimates[name] for view in views if name in view.estimates]
        squares = sum(mean**2 + deviation**2 for mean, deviation in estimates)
        total = squares + SCATTER_WEIGHT * expected**2
        scatter[name] = float(np.sqrt(total / (len(estimates) + SCATTER_WEIGHT)))
    return replace(misfit, comparison=replace(misfit.comparison, scatter=scatter), frame=None)
