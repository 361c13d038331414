"""What a throw says of the object and of the end gaps: place, size, virtual sensors.

Signatures are samples: each says where its object was, how large, and by how much gaps changed.
Their weights after the throw make the distributions of all three. What a sound throw with these
forces leaves open is normal, and adds to the change.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, ndtr

from turnout.detection.judging import View
from turnout.detection.likelihood import AMPLITUDE, Evidence

Floats = NDArray[np.float64]

OBJECT_WEIGHT = 0.01
"""Weight of objects against a sound switch before a throw, for gaps [-]."""
COVERAGE = 0.95
"""Of intervals [-]."""
TEMPER = 3.0
"""Log likelihoods of signatures are divided by this: a throw lies between samples, and the nearest
of them is not as much better than the next as its likelihood says."""
MOST_COMPONENTS = 200
NEGLIGIBLE = 9.0
"""Signatures whose logarithm lies so far below the highest do not count."""
SMOOTHING = 0.3e-3
"""Deviation by which the size of a signature is spread, beside a share of it [m]."""
SMOOTHING_SHARE = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """A median and an interval that holds it with a probability of 95 %."""

    middle: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Posterior:
    """What one throw says, where there is an object and in any case.

    Attributes
    ----------
    place : ndarray, shape (n_places,)
        Probability of each place, were there an object [-].
    x : Interval
        Of the object [m].
    size : Interval
        Of the object [m].
    gaps : tuple of Interval
        At the end [m].
    above : ndarray, shape (n_gaps,)
        Probability that each is above its limit [-].
    """

    place: Floats
    x: Interval
    size: Interval
    gaps: tuple[Interval, ...]
    above: Floats


def posterior_of(
    view: View,
    evidence: Evidence,
    number: int,
    *,
    limits: Floats,
    size_factor: float = 1.0,
    gap_factor: float = 1.0,
) -> Posterior:
    """Return what one of the throws of some evidence says.

    Parameters
    ----------
    view : View
        That it was weighed with.
    evidence : Evidence
        Of some throws.
    number : int
        Which one.
    limits : ndarray, shape (n_gaps,)
        [m]
    size_factor, gap_factor : float
        By which intervals are widened [-].
    """
    component = evidence.component[:, number] / TEMPER
    kinds = view.signatures.kind[evidence.number]
    objects = np.flatnonzero(kinds < view.objects)
    objects = objects[component[objects] > component[objects].max() - NEGLIGIBLE]
    share = np.exp(component[objects] - logsumexp(component[objects]))
    signature = evidence.number[objects]
    sizes, places = view.signatures.size[signature], view.signatures.x[signature]
    spread = SMOOTHING + SMOOTHING_SHARE * sizes
    means, variances, weights = _gaps(view, evidence, number, kinds)
    deviation = np.sqrt(variances) * gap_factor
    gaps = tuple(
        mixture_interval(means[:, gap], deviation[:, gap], weights) for gap in range(means.shape[1])
    )
    above = weights @ ndtr((means - limits) / np.maximum(deviation, 1e-9))
    return Posterior(
        place=np.asarray(np.bincount(kinds[objects], share, view.objects), dtype=np.float64),
        x=mixture_interval(places, np.full(len(places), 0.15), share),
        size=_widened(mixture_interval(sizes, spread, share), size_factor),
        gaps=gaps,
        above=above,
    )


def _gaps(
    view: View, evidence: Evidence, number: int, kinds: NDArray[np.intp]
) -> tuple[Floats, Floats, Floats]:
    """Return means, variances and weights of the normal parts that gaps are made of."""
    before = np.full(view.objects, np.log(OBJECT_WEIGHT / view.objects))
    logs = evidence.component[:, number] + np.concatenate([before, view.cause_weight])[kinds]
    logs = np.where(
        kinds < view.objects, *(_tempered(logs, group) for group in _groups(view, kinds))
    )
    sound = evidence.centre[:, number]
    kept = np.flatnonzero(logs > max(logs.max(), sound.max()) - NEGLIGIBLE)
    kept = kept[np.argsort(logs[kept])[-MOST_COMPONENTS:]]
    parts = [np.arange(len(view.centres)), evidence.place[kept]]
    place = np.concatenate(parts)
    change = np.zeros((len(place), view.signatures.change.shape[1]))
    gap = np.zeros((len(place), view.signatures.gap.shape[1]))
    loose = np.zeros(len(place))
    own = slice(len(view.centres), None)
    factor = evidence.factor[kept, number][:, np.newaxis]
    change[own] = factor * view.signatures.change[evidence.number[kept]]
    gap[own] = factor * view.signatures.gap[evidence.number[kept]]
    means, variances = np.zeros_like(gap), np.full_like(gap, 1e-12)
    joined = np.concatenate([sound, logs[kept]])
    weights = np.exp(joined - logsumexp(joined))
    for at, centre in enumerate(view.centres):
        rows = np.flatnonzero(place == at)
        if not np.any(weights[rows] > 1e-9):
            continue
        left = evidence.white[at, :, number] - change[rows] @ centre.way.T
        means[rows] = centre.gap_mean + left @ centre.gap_gain.T + gap[rows]
        square = np.einsum("ij,ij->i", change[rows] @ centre.way.T, change[rows] @ centre.way.T)
        loose[rows] = AMPLITUDE**2 / (1.0 + AMPLITUDE**2 * square)
        variances[rows] = centre.gap_variance + loose[rows, np.newaxis] * gap[rows] ** 2
    return means, variances, weights


def _groups(view: View, kinds: NDArray[np.intp]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which components are objects, and which are other causes."""
    return kinds < view.objects, kinds >= view.objects


def _tempered(logs: Floats, group: NDArray[np.bool_]) -> Floats:
    """Return logarithms of weights that are evener within a group, with the same sum.

    Examples
    --------
    >>> found = np.exp(_tempered(np.log([1.0, 8.0]), np.array([True, True])))
    >>> found.round(6).tolist()
    [3.0, 6.0]
    """
    own = np.where(group, logs, -np.inf)
    total = logsumexp(own)
    if not np.isfinite(total):
        return own
    return np.asarray(own / TEMPER - logsumexp(own / TEMPER) + total)


def mixture_interval(means: Floats, deviations: Floats, weights: Floats) -> Interval:
    """Return median and central interval of a mixture of normal distributions, shapes (n,).

    Examples
    --------
    >>> found = mixture_interval(np.array([1.0]), np.array([0.5]), np.array([1.0]))
    >>> round(found.middle, 3), round(found.low, 3), round(found.high, 3)
    (1.0, 0.02, 1.98)
    """
    used = weights > 1e-5
    mean, deviation, weight = means[used], deviations[used], weights[used] / weights[used].sum()
    wanted = np.array([0.5, 0.5 - 0.5 * COVERAGE, 0.5 + 0.5 * COVERAGE])
    low = np.full(3, float(np.min(mean - 8.0 * deviation)))
    high = np.full(3, float(np.max(mean + 8.0 * deviation)))
    for _ in range(24):
        middle = 0.5 * (low + high)
        share = ndtr((middle[:, np.newaxis] - mean) / deviation) @ weight
        low, high = np.where(share < wanted, middle, low), np.where(share < wanted, high, middle)
    found = 0.5 * (low + high)
    return Interval(middle=float(found[0]), low=float(found[1]), high=float(found[2]))


def _widened(interval: Interval, factor: float) -> Interval:
    middle = interval.middle
    return Interval(
        middle=middle,
        low=max(0.0, middle - factor * (middle - interval.low)),
        high=middle + factor * (interval.high - middle),
    )
