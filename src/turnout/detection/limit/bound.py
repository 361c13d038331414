r"""The linear-Gaussian bound: what no detector exceeds that knows place, size and signature.

Of two normal distributions with the covariance :math:`C` whose means differ by :math:`s`, the best
test (Neyman and Pearson 1933) detects, at a false-alarm rate :math:`\alpha`, the share

.. math:: \Phi(d - z), \qquad d^2 = s^T C^{-1} s, \quad z = \Phi^{-1}(1 - \alpha)

Real sound throws are not normal, and a detector does not know place and size: the bound is
optimistic.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.stats import binom, norm

from turnout.detection.conditioning import conditioned
from turnout.detection.population import Local

Floats = NDArray[np.float64]


def detection_index(signature: ArrayLike, covariance: Floats) -> Floats:
    """Return :math:`d` of signatures, shape (...,) [-].

    Parameters
    ----------
    signature : array_like, shape (..., n_features)
        Change of the features that an object causes [N].
    covariance : ndarray, shape (n_features, n_features)
        Of the features without an object [N^2].

    Examples
    --------
    >>> detection_index([3.0, 4.0], np.eye(2)).item()
    5.0
    """
    given = np.asarray(signature, dtype=np.float64)
    flat = given.reshape(-1, given.shape[-1])
    solved = cho_solve(cho_factor(covariance), flat.T)
    index = np.sqrt(np.einsum("ij,ji->i", flat, solved))
    return np.asarray(index.reshape(given.shape[:-1]))


def probability_of_detection(index: ArrayLike, *, false_alarm_rate: float) -> Floats:
    """Return the share of throws that the best test detects [-].

    Examples
    --------
    >>> probability_of_detection(0.0, false_alarm_rate=1e-3).round(6).item()
    0.001
    """
    threshold = norm.isf(false_alarm_rate)
    return np.asarray(norm.cdf(np.asarray(index, dtype=np.float64) - threshold))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Predictive:
    r"""Expectation of the next sound throw of a switch at each level.

    Attributes
    ----------
    covariances : tuple of ndarray, each of shape (n_features, n_features)
        About what the history says of the switch [N^2].
    shifts : tuple of ndarray, each of shape (n_features, r)
        :math:`B`: what a history says moves the mean by :math:`B u`, with :math:`u \sim N(0, I)`
        over switches [N]. Without a history r is 0.
    """

    covariances: tuple[Floats, ...]
    shifts: tuple[Floats, ...]


def predictive(
    models: Sequence[Local],
    *,
    discrepancy: Floats,
    noise: Floats,
    fixed_share: float,
    level_deviation: float,
    history: int,
    averaged: int = 1,
) -> Predictive:
    r"""Return what is expected of the next sound throw of a switch at each level.

    Exact conditioning of the linear-Gaussian model: what is fixed for a switch,
    :math:`(\theta, \delta)` with the fixed part of the discrepancy :math:`\delta`, has a normal
    prior; each throw of the history, at friction levels spread as in the population, gives
    :math:`y = m(l) + G(l)\,\theta + \delta + e`. Without a history the covariance is that of the
    population at that level.

    Parameters
    ----------
    models : sequence of Local
        At levels that share the history evenly.
    discrepancy, noise : ndarray, shape (n_features, n_features)
        Covariances [N^2].
    fixed_share : float
        Of the variance of the discrepancy, fixed for a switch [-].
    level_deviation : float
        Standard deviation of a level beside what forces show [-].
    history : int
        Sound throws that are known.
    averaged : int
        Throws whose mean is judged: what is fixed for a switch stays, the rest is divided.
    """
    fixed = fixed_share * discrepancy
    inputs = models[0].sensitivity.shape[1]
    maps = [np.hstack([item.sensitivity, np.eye(len(discrepancy))]) for item in models]
    own = [
        item.within
        + (1.0 - fixed_share) * discrepancy
        + noise
        + level_deviation**2 * np.outer(item.slope, item.slope)
        for item in models
    ]
    prior = np.zeros((inputs + len(fixed), inputs + len(fixed)))
    prior[:inputs, :inputs] = np.eye(inputs)
    prior[inputs:, inputs:] = fixed
    known = prior
    if history:
        share = history / len(models)
        for way, error in zip(maps, own, strict=True):
            known = conditioned(known, way=way, error=error / share)
    found = [way @ known @ way.T + error / averaged for way, error in zip(maps, own, strict=True)]
    said = _root(prior - known) if history else np.zeros((len(prior), 0))
    return Predictive(
        covariances=tuple(0.5 * (item + item.T) for item in found),
        shifts=tuple(way @ said for way in maps),
    )


def _root(covariance: Floats) -> Floats:
    """Return a matrix whose product with its own transpose is a covariance, shape (n, r)."""
    values, directions = np.linalg.eigh(covariance)
    kept = values > ROUNDING * values[-1]
    return np.asarray(directions[:, kept] * np.sqrt(values[kept]))


ROUNDING = 1e-15
"""Share of the largest eigenvalue below which one is rounding."""


def repeated_alarm_rate(correlation: ArrayLike, *, false_alarm_rate: float) -> Floats:
    r"""Return how often a sound switch gives two alarms in a row.

    .. math:: P(t_1 > z, t_2 > z), \qquad \mathrm{corr}(t_1, t_2) = \rho

    for two throws whose statistics are normal; independent throws would square the rate.

    Parameters
    ----------
    correlation : array_like
        Share of the variance of the statistic that is the same for both throws [-].
    false_alarm_rate : float
        Of one throw [-].

    Examples
    --------
    >>> repeated_alarm_rate([0.0, 1.0], false_alarm_rate=1e-3).round(9).tolist()
    [1e-06, 0.001]
    """
    threshold = norm.isf(false_alarm_rate)
    given = np.atleast_1d(np.asarray(correlation, dtype=np.float64))
    nodes, weights = np.polynomial.hermite_e.hermegauss(200)
    common, own = np.sqrt(given)[..., np.newaxis], np.sqrt(np.maximum(1.0 - given, 1e-12))
    once = norm.sf((threshold - common * nodes) / own[..., np.newaxis])
    found = once**2 @ (weights / weights.sum())
    exact = np.where(given > SAME, false_alarm_rate, found)
    return np.asarray(exact.reshape(np.shape(correlation)))


SAME = 1.0 - 1e-6
"""Correlation from which two throws count as one [-]."""


def excess_over_bound(detected: int, throws: int, *, bound: float) -> float:
    """Return how likely so many detections are where the bound holds: below 0.001 something is off.

    Parameters
    ----------
    detected, throws : int
        Of a detector, with objects.
    bound : float
        Probability of detection that cannot be exceeded [-].

    Examples
    --------
    >>> excess_over_bound(50, 100, bound=0.5) > 0.4
    True
    >>> excess_over_bound(80, 100, bound=0.5) < 1e-6
    True
    """
    return float(binom.sf(detected - 1, throws, bound))
