"""Posterior of the object and of the end gaps of a throw: place, size, virtual sensors.

Signatures are samples: each says where its object was, how large, and by how much gaps changed.
Their weights after the throw make the distributions of all three. What a sound throw with these
forces leaves open is normal, and adds to the change.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from turnout.detection.detector.judging import CAUSE_WEIGHT, View
from turnout.detection.detector.nearest_samples import Samples, samples_near
from turnout.detection.likelihood import AMPLITUDE, TEMPER, Evidence, log_sum

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

OBJECT_WEIGHT = 1.0
"""Weight of objects against a sound switch before a throw, for gaps: as likely as not. A smaller
one makes intervals too narrow where an object is not noticed [-]."""
COVERAGE = 0.95
"""Of intervals [-]."""
MOST_COMPONENTS = 400
NEGLIGIBLE = 9.0
"""Signatures whose logarithm lies so far below the highest do not count."""
SMOOTHING = 0.3e-3
"""Deviation by which the size of a signature is spread, beside a share of it [m]."""
SMOOTHING_SHARE = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """A median, or a mean, and an interval that holds the value with a probability of 95 %."""

    middle: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrappedObject:
    """Posterior of an object by one throw, were there one.

    Attributes
    ----------
    place : ndarray, shape (n_places,)
        Probability of each place [-].
    x, size : Interval
        [m]; the middle of the place is its mean, in place of the median.
    """

    place: Floats
    x: Interval
    size: Interval


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EndGaps:
    """Posterior of the gaps at the end by one throw, with an object or without.

    Attributes
    ----------
    gaps : tuple of Interval
        [m]
    above : ndarray, shape (n_gaps,)
        Probability that each is above its limit [-].
    """

    gaps: tuple[Interval, ...]
    above: Floats


def objects_near(view: View, evidence: Evidence, number: int) -> Samples:
    """Return the signatures of objects nearest to one of the throws of some evidence."""
    return samples_near(view, evidence, number, slice(evidence.hypotheses.before(view.objects)))


def object_of(
    view: View,
    evidence: Evidence,
    number: int,
    *,
    near: Samples,
    size_factor: float = 1.0,
    x_factor: float = 1.0,
) -> TrappedObject:
    """Return what one of the throws of some evidence says of an object, were there one.

    Parameters
    ----------
    view : View
        That it was weighed with.
    evidence : Evidence
        Of some throws.
    number : int
        Which one.
    near : Samples
        From `objects_near`, of the same throw.
    size_factor, x_factor : float
        By which the intervals of size and place are widened about their medians [-].
    """
    signature = evidence.hypotheses.number[near.components]
    known = np.column_stack([view.signatures.x[signature], view.signatures.size[signature]])
    moved, spread = near.moved(known)
    smooth = np.column_stack(
        [np.full(len(known), PLACE_SPREAD), SMOOTHING + SMOOTHING_SHARE * known[:, 1]]
    )
    x, size = mixture_intervals(moved, np.hypot(smooth, spread), near.share)
    # the mean lies nearer to the true place than the median: samples of a place are few
    middle = np.clip(near.share @ moved[:, 0], known[:, 0].min(), known[:, 0].max())
    x = replace(x, middle=float(np.clip(middle, x.low, x.high)))
    tempered = evidence.tempered[: view.objects, number]
    return TrappedObject(
        place=np.asarray(np.exp(tempered - log_sum(tempered))),
        x=_widened(x, x_factor, x_factor),
        size=_widened(size, size_factor, size_factor),
    )


def gaps_of(
    view: View,
    evidence: Evidence,
    number: int,
    *,
    limits: Floats,
    factor: ArrayLike = 1.0,
    near: Samples | None = None,
) -> EndGaps:
    """Return what one of the throws of some evidence says of the end gaps.

    Parameters
    ----------
    view, evidence, number
        As of `object_of`.
    limits : ndarray, shape (n_gaps,)
        [m]
    factor : array_like, shape (), (n_gaps,) or (n_gaps, 2)
        By which the distribution of all gaps, or of each, or below and above the median of each, is
        widened about its median [-].
    near : Samples, optional
        From `objects_near`, for a throw with an object, whose gaps lie between theirs. Finding them
        takes a millisecond, and without an alarm they change little.
    """
    means, variances, weights = _gaps(view, evidence, number, near)
    deviation = np.sqrt(variances)
    given = np.asarray(factor, dtype=np.float64)
    given = given if given.ndim > 1 else given[..., np.newaxis]
    each = np.broadcast_to(given, (means.shape[1], 2))
    found = mixture_intervals(means, deviation, weights)
    middle = np.array([item.middle for item in found])
    side = np.where(limits > middle, each[:, 1], each[:, 0])
    # wider about the median: that of a gap at its limit stays as likely above as below it
    return EndGaps(
        gaps=tuple(
            _widened(item, float(low), float(high), least=-np.inf)
            for item, (low, high) in zip(found, each, strict=True)
        ),
        above=weights @ ndtr((means - middle + (middle - limits) / side) / deviation),
    )


def _gaps(
    view: View, evidence: Evidence, number: int, near: Samples | None
) -> tuple[Floats, Floats, Floats]:
    """Return means, variances and weights of the normal parts that gaps are made of."""
    kept, logs = _likely(view, evidence, number, near)
    sound = evidence.centre[:, number]
    joined = np.concatenate([sound, logs])
    weights = np.exp(joined - log_sum(joined))
    usual = np.flatnonzero(weights[: len(sound)] > LEAST_WEIGHT)
    kept = kept[weights[len(sound) :] > LEAST_WEIGHT]
    share = weights[weights > LEAST_WEIGHT]
    place = np.concatenate([usual, evidence.hypotheses.place[kept]])
    moved, variances = (np.zeros((len(place), view.signatures.gap.shape[1])) for _ in range(2))
    own = np.s_[len(usual) :]
    moved[own], variances[own] = _changed_gaps(view, evidence, kept, number, near)
    used, of = np.unique(place, return_inverse=True)
    centres = [view.centres[at] for at in used]
    seen = [evidence.white[at, :, number] for at in used]
    usual_gaps = [c.gap_mean + c.gap_gain @ white for c, white in zip(centres, seen, strict=True)]
    moved += np.array(usual_gaps)[of]
    variances += np.array([centre.gap_variance for centre in centres])[of]
    return moved, np.maximum(variances, 1e-12), share / share.sum()


def _likely(
    view: View, evidence: Evidence, number: int, near: Samples | None
) -> tuple[Ints, Floats]:
    """Return the components that gaps depend on, and the logarithms of their weights."""
    parts = []
    objects = evidence.hypotheses.before(view.objects)
    for group, kinds, weight in (
        (slice(0, objects), slice(0, view.objects), OBJECT_WEIGHT / view.objects),
        (slice(objects, None), slice(view.objects, None), CAUSE_WEIGHT),
    ):
        logs = evidence.component[group, number]
        if not logs.size:
            continue
        whole = log_sum(evidence.kind[kinds, number]) + np.log(weight)
        if near is not None and kinds.start == 0:
            parts.append((near.components, whole + np.log(near.share)))
            continue
        # evener, with the same sum
        counted = np.flatnonzero(logs > logs.max() - TEMPER * NEGLIGIBLE)
        evener = logs[counted] / TEMPER - log_sum(evidence.tempered[kinds, number])
        parts.append((counted + group.start, evener + whole))
    kept, logs = (np.concatenate(item) for item in zip(*parts, strict=True))
    close = logs > max(logs.max(initial=-np.inf), evidence.centre[:, number].max()) - NEGLIGIBLE
    kept, logs = kept[close], logs[close]
    if len(kept) > MOST_COMPONENTS:
        most = np.argpartition(logs, -MOST_COMPONENTS)[-MOST_COMPONENTS:]
        kept, logs = kept[most], logs[most]
    return kept, logs


def _changed_gaps(
    view: View, evidence: Evidence, kept: Ints, number: int, near: Samples | None
) -> tuple[Floats, Floats]:
    """Return what each of some components adds to the gaps of a sound switch, and its variance.

    Less what features say of them in a sound switch, shape (n, n_gaps).
    """
    hypotheses = evidence.hypotheses
    gaps = view.signatures.gap[hypotheses.number[kept]]
    factor = evidence.factors(kept, number)[:, np.newaxis]
    square = hypotheses.square[kept] * factor**2
    loose = AMPLITUDE**2 / (1.0 + AMPLITUDE**2 * square)
    changes = factor * (gaps - view.gap_seen[kept])
    variances = (loose + GAP_SHARE**2) * (factor * gaps) ** 2
    if near is not None:
        order = np.argsort(near.components)
        own = kept < hypotheses.before(view.objects)
        rows = order[np.searchsorted(near.components[order], kept[own])]
        known = view.signatures.gap[hypotheses.number[near.components]]
        between, deviation = near.moved(known - view.gap_seen[near.components])
        changes[own] = between[rows]
        variances[own] = deviation**2 + (GAP_SHARE * gaps[own]) ** 2
    return changes, variances


GAP_SHARE = 0.1
"""Deviation by which the change of a gap in a signature is spread, a share of it: samples of large
objects lie further apart. On held-back throws intervals of these miss as seldom then as those of
small ones [-]."""
LEAST_WEIGHT = 1e-4
"""Normal parts that weigh less are left out."""
PLACE_SPREAD = 0.15
"""Deviation by which the place of a signature is spread [m]."""


def mixture_intervals(means: Floats, deviations: Floats, weights: Floats) -> tuple[Interval, ...]:
    """Return median and central interval of some mixtures of normal distributions.

    By Newton's method between the nearest values of a grid, halved where it would leave these.

    Parameters
    ----------
    means, deviations : ndarray, shape (n, n_mixtures)
        Of the parts; where these are many, near ones are joined.
    weights : ndarray, shape (n,)
        Of the parts, the same in every mixture; they sum to 1.

    Examples
    --------
    >>> (found,) = mixture_intervals(np.array([[1.0]]), np.array([[0.5]]), np.array([1.0]))
    >>> round(found.middle, 3), round(found.low, 3), round(found.high, 3)
    (1.0, 0.02, 1.98)
    """
    if len(means) > JOINED:
        means, deviations, weights = _joined(means, deviations, weights)
    else:
        weights = np.tile(weights[:, np.newaxis], means.shape[1])
    parts = weights.T[np.newaxis]
    wanted = np.array([0.5, 0.5 - 0.5 * COVERAGE, 0.5 + 0.5 * COVERAGE])[:, np.newaxis]
    ends = (means - REACH * deviations).min(axis=0), (means + REACH * deviations).max(axis=0)
    low, high, at = _brackets(means, deviations, parts, wanted=wanted, ends=ends)
    narrow = TOLERANCE * (ends[1] - ends[0])
    middles, sharp = means.T, 1.0 / deviations.T
    steep = np.sqrt(0.5 / np.pi) * sharp * parts[0]
    for _ in range(MOST_STEPS):
        z = at[:, :, np.newaxis] - middles
        z *= sharp
        over = (ndtr(z) * parts).sum(axis=2) - wanted
        z *= z
        z *= -0.5
        density = (np.exp(z, out=z) * steep).sum(axis=2)
        low, high = np.where(over < 0.0, at, low), np.where(over < 0.0, high, at)
        following = at - over / np.maximum(density, 1e-300)
        outside = (following < low) | (following > high)
        following = np.where(outside, 0.5 * (low + high), following)
        done = bool((np.abs(following - at) <= narrow).all())
        at = following
        if done:
            break
    return tuple(
        Interval(middle=float(middle), low=float(below), high=float(above))
        for middle, below, above in at.T
    )


def _joined(means: Floats, deviations: Floats, weights: Floats) -> tuple[Floats, Floats, Floats]:
    """Join the parts of each mixture that lie in one of `JOINED` equal intervals, by two moments.

    Returns
    -------
    means, deviations, weights : ndarray, shape (JOINED, n_mixtures)
        Without weight where an interval is empty.
    """
    count = means.shape[1]
    low, high = means.min(axis=0), means.max(axis=0)
    width = np.maximum(high - low, 1e-12) / JOINED
    place = np.minimum(((means - low) / width).astype(np.intp), JOINED - 1)
    cell = (place + JOINED * np.arange(count)).ravel()

    def summed(values: Floats) -> Floats:
        each = np.broadcast_to(values, means.shape).ravel()
        found = np.asarray(np.bincount(cell, each, JOINED * count), dtype=np.float64)
        return found.reshape(count, JOINED).T

    whole = summed(weights[:, np.newaxis])
    some = np.maximum(whole, 1e-300)
    middle = summed(weights[:, np.newaxis] * means) / some
    square = summed(weights[:, np.newaxis] * (deviations**2 + means**2)) / some
    empty = whole == 0.0
    variance = np.maximum(square - middle**2, deviations.min(axis=0) ** 2)
    middle = np.where(empty, low + 0.5 * width * JOINED, middle)
    return middle, np.sqrt(variance), whole


JOINED = 48
"""Parts of a mixture that quantiles are sought of, at most."""


def _brackets(
    means: Floats, deviations: Floats, parts: Floats, *, wanted: Floats, ends: tuple[Floats, Floats]
) -> tuple[Floats, Floats, Floats]:
    """Return between which values of a grid quantiles lie, and where a straight line puts them.

    Returns
    -------
    low, high, between : ndarray, shape (n_wanted, n_mixtures)
    """
    grid = ends[0] + SHARES * (ends[1] - ends[0])
    z = grid[:, :, np.newaxis] - means.T
    z /= deviations.T
    share = (ndtr(z, out=z) * parts).sum(axis=2)
    above = (share[np.newaxis, 1:-1] < wanted[:, np.newaxis]).sum(axis=1)
    each = np.arange(grid.shape[1])
    low, high = grid[above, each], grid[above + 1, each]
    first, last = share[above, each], share[above + 1, each]
    part = np.clip((wanted - first) / np.maximum(last - first, 1e-300), 0.0, 1.0)
    between: Floats = low + part * (high - low)
    return low, high, between


SHARES = np.linspace(0.0, 1.0, 17)[:, np.newaxis]
"""Of the way from the lowest to the highest value, between which quantiles are sought [-]."""
REACH = 8.0
"""Quantiles are sought within so many deviations of the outermost parts [-]."""
TOLERANCE = 1e-6
"""Of quantiles, as a share of where they are sought [-]."""
MOST_STEPS = 60


def _widened(interval: Interval, low: float, high: float, *, least: float = 0.0) -> Interval:
    middle = interval.middle
    return Interval(
        middle=middle,
        low=max(least, middle - low * (middle - interval.low)),
        high=middle + high * (interval.high - middle),
    )
