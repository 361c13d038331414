"""What a throw says of the object and of the end gaps: place, size, virtual sensors.

Signatures are samples: each says where its object was, how large, and by how much gaps changed.
Their weights after the throw make the distributions of all three. What a sound throw with these
forces leaves open is normal, and adds to the change.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from turnout.detection.detector.judging import View
from turnout.detection.likelihood import AMPLITUDE, Evidence

Floats = NDArray[np.float64]

OBJECT_WEIGHT = 1.0
"""Weight of objects against a sound switch before a throw, for gaps: as likely as not. A smaller
one makes intervals too narrow where an object is not noticed [-]."""
COVERAGE = 0.95
"""Of intervals [-]."""
TEMPER = 3.0
"""Log likelihoods of signatures are divided by this: a throw lies between samples, and the nearest
of them is not as much better than the next as its likelihood says."""
MOST_COMPONENTS = 400
NEGLIGIBLE = 9.0
"""Signatures whose logarithm lies so far below the highest do not count."""
BELOW = 75.0
"""Signatures whose logarithm lies so far below the highest weigh nothing in tempered sums."""
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
    gap_factor: float | Sequence[float] = 1.0,
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
    size_factor : float
        By which the interval of the size is widened about its median [-].
    gap_factor : float or sequence of float
        By which the distribution of all gaps, or of each, is widened about its median [-].
    """
    component = evidence.component[:, number] / TEMPER
    kinds = view.signatures.kind[evidence.number]
    objects = np.flatnonzero(kinds < view.objects)
    objects = objects[component[objects] > component[objects].max() - NEGLIGIBLE]
    share = np.exp(component[objects] - _log_sum(component[objects]))
    used = share > LEAST_WEIGHT
    objects, share = objects[used], share[used] / share[used].sum()
    signature = evidence.number[objects]
    sizes, places = view.signatures.size[signature], view.signatures.x[signature]
    spread = SMOOTHING + SMOOTHING_SHARE * sizes
    x, size = mixture_intervals(
        np.column_stack([places, sizes]),
        np.column_stack([np.full(len(places), PLACE_SPREAD), spread]),
        share,
    )
    means, variances, weights = _gaps(view, evidence, number, kinds)
    deviation = np.sqrt(variances)
    factor = np.broadcast_to(np.asarray(gap_factor, dtype=np.float64), means.shape[1:])
    found = mixture_intervals(means, deviation, weights)
    middle = np.array([item.middle for item in found])
    # wider about the median: that of a gap at its limit stays as likely above as below it
    above = weights @ ndtr((means - middle + (middle - limits) / factor) / deviation)
    return Posterior(
        place=np.asarray(np.bincount(kinds[objects], share, view.objects), dtype=np.float64),
        x=x,
        size=_widened(size, size_factor),
        gaps=tuple(
            _widened(item, float(by), least=-np.inf) for item, by in zip(found, factor, strict=True)
        ),
        above=above,
    )


def _gaps(
    view: View, evidence: Evidence, number: int, kinds: NDArray[np.intp]
) -> tuple[Floats, Floats, Floats]:
    """Return means, variances and weights of the normal parts that gaps are made of."""
    before = np.full(view.objects, np.log(OBJECT_WEIGHT / view.objects))
    logs = evidence.component[:, number] + np.concatenate([before, view.cause_weight])[kinds]
    for group in (np.flatnonzero(kinds < view.objects), np.flatnonzero(kinds >= view.objects)):
        logs[group] = _tempered(logs[group])
    sound = evidence.centre[:, number]
    kept = np.flatnonzero(logs > max(logs.max(), sound.max()) - NEGLIGIBLE)
    if len(kept) > MOST_COMPONENTS:
        kept = kept[np.argpartition(logs[kept], -MOST_COMPONENTS)[-MOST_COMPONENTS:]]
    place = np.concatenate([np.arange(len(view.centres)), evidence.place[kept]])
    joined = np.concatenate([sound, logs[kept]])
    weights = np.exp(joined - _log_sum(joined))
    own = np.s_[len(view.centres) :]
    factor = evidence.factor[kept, number]
    signature = evidence.number[kept]
    moved = np.zeros((len(place), view.signatures.gap.shape[1]))
    moved[own] = factor[:, np.newaxis] * view.signatures.gap[signature]
    square = np.concatenate([centre.square[:, 0] for centre in view.centres])[kept] * factor**2
    loose = np.zeros(len(place))
    loose[own] = AMPLITUDE**2 / (1.0 + AMPLITUDE**2 * square)
    explained = np.zeros_like(moved)
    change = np.zeros((len(place), view.signatures.change.shape[1]))
    change[own] = factor[:, np.newaxis] * view.signatures.change[signature]
    variances = loose[:, np.newaxis] * moved**2
    for at, centre in enumerate(view.centres):
        rows = np.flatnonzero(place == at)
        if weights[rows].max() > LEAST_WEIGHT:
            usual = centre.gap_mean + centre.gap_gain @ evidence.white[at, :, number]
            explained[rows] = usual - change[rows] @ centre.gap_of_change
            variances[rows] += centre.gap_variance
    used = weights > LEAST_WEIGHT
    share = weights[used] / weights[used].sum()
    return explained[used] + moved[used], np.maximum(variances[used], 1e-12), share


LEAST_WEIGHT = 1e-4
"""Normal parts that weigh less are left out."""
PLACE_SPREAD = 0.15
"""Deviation by which the place of a signature is spread [m]."""


def _log_sum(logs: Floats) -> float:
    """Return the logarithm of the sum of exponentials, without the checks of scipy."""
    highest = float(logs.max())
    return highest + float(np.log(np.exp(logs - highest).sum()))


def _tempered(logs: Floats) -> Floats:
    """Return logarithms of weights that are evener, with the same sum.

    Examples
    --------
    >>> np.exp(_tempered(np.log([1.0, 8.0]))).round(6).tolist()
    [3.0, 6.0]
    """
    highest = logs.max(initial=-np.inf)
    if not np.isfinite(highest):
        return logs
    counted = logs[logs > highest - BELOW]
    return np.asarray(logs / TEMPER - _log_sum(counted / TEMPER) + _log_sum(counted))


def mixture_intervals(means: Floats, deviations: Floats, weights: Floats) -> tuple[Interval, ...]:
    """Return median and central interval of some mixtures of normal distributions.

    By Newton's method, halved where it would leave the bracket.

    Parameters
    ----------
    means, deviations : ndarray, shape (n, n_mixtures)
        Of the parts.
    weights : ndarray, shape (n,)
        Of the parts, the same in every mixture; they sum to 1.

    Examples
    --------
    >>> (found,) = mixture_intervals(np.array([[1.0]]), np.array([[0.5]]), np.array([1.0]))
    >>> round(found.middle, 3), round(found.low, 3), round(found.high, 3)
    (1.0, 0.02, 1.98)
    """
    wanted = np.array([0.5, 0.5 - 0.5 * COVERAGE, 0.5 + 0.5 * COVERAGE])[:, np.newaxis]
    count = (3, 1)
    low = np.tile((means - REACH * deviations).min(axis=0), count)
    high = np.tile((means + REACH * deviations).max(axis=0), count)
    narrow = TOLERANCE * (high - low)
    centre = weights @ means
    spread = np.sqrt(weights @ (deviations**2 + (means - centre) ** 2))
    at = centre + ndtri(wanted) * spread
    steepness = 1.0 / (np.sqrt(2.0 * np.pi) * deviations.T)
    for _ in range(MOST_STEPS):
        z = (at[:, :, np.newaxis] - means.T) / deviations.T
        over = ndtr(z) @ weights - wanted
        density = (steepness * np.exp(-0.5 * z**2)) @ weights
        low, high = np.where(over < 0.0, at, low), np.where(over < 0.0, high, at)
        following = at - over / np.maximum(density, 1e-300)
        outside = (following <= low) | (following >= high)
        following = np.where(outside, 0.5 * (low + high), following)
        done = bool(np.all(np.abs(following - at) <= narrow))
        at = following
        if done:
            break
    return tuple(
        Interval(middle=float(middle), low=float(below), high=float(above))
        for middle, below, above in at.T
    )


REACH = 8.0
"""Quantiles are sought within so many deviations of the outermost parts [-]."""
TOLERANCE = 1e-6
"""Of quantiles, as a share of where they are sought [-]."""
MOST_STEPS = 60


def _widened(interval: Interval, factor: float, *, least: float = 0.0) -> Interval:
    middle = interval.middle
    return Interval(
        middle=middle,
        low=max(least, middle - factor * (middle - interval.low)),
        high=middle + factor * (interval.high - middle),
    )
