r"""Figures of merit of verdicts, each by its definition.

False alarms are counted by switch, whose throws are alike: the interval comes from drawing switches
with replacement, and is never narrower than that of independent throws (Clopper and Pearson).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtri
from scipy.stats import rankdata

from turnout.core.errors import StudyError
from turnout.detection.alarm_threshold import share_interval
from turnout.detection.pod.estimate import estimate_pod
from turnout.detection.pod.pod_result import PodModel
from turnout.detection.pod.pod_table import TestThrows

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

RESAMPLES = 1000
BINS = 10
"""Of the calibration error."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rate:
    """A share with its 95 % interval.

    Attributes
    ----------
    value, low, high : float
        [-]
    hits, count, switches : int
        What it rests on.
    """

    value: float
    low: float
    high: float
    hits: int
    count: int
    switches: int


def clustered_rate(hits: Bools, groups: NDArray[np.intp], *, seed: int = 0) -> Rate:
    """Return a share with an interval that allows for throws of a switch being alike.

    Parameters
    ----------
    hits : ndarray of bool, shape (n,)
        What is counted.
    groups : ndarray of int, shape (n,)
        Switch of each.
    seed : int
        Of chance.

    Examples
    --------
    >>> none = clustered_rate(np.zeros(300, dtype=bool), np.arange(300))
    >>> round(none.high, 4)  # 1 - 0.025 ** (1 / 300)
    0.0122
    """
    count, total = len(hits), int(np.sum(hits))
    if not count:
        return Rate(value=np.nan, low=np.nan, high=np.nan, hits=0, count=0, switches=0)
    _, own = np.unique(groups, return_inverse=True)
    each = np.bincount(own).astype(float)
    hit = np.bincount(own, weights=np.asarray(hits, dtype=float))
    drawn = np.random.default_rng(seed).integers(0, len(each), (RESAMPLES, len(each)))
    shares = hit[drawn].sum(axis=1) / each[drawn].sum(axis=1)
    low, high = np.quantile(shares, [0.025, 0.975])
    exact_low, exact_high = share_interval(total, count)
    return Rate(
        value=total / count,
        low=min(float(low), float(exact_low)), high=max(float(high), float(exact_high)),
        hits=total, count=count, switches=len(each),
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Detectable:
    """Size that is seen in nine of ten throws.

    Attributes
    ----------
    a90, a90_95 : float
        Size and its upper 95 % limit [m]; infinite where no size is seen so often.
    throws, hits : int
        What it rests on.
    """

    a90: float
    a90_95: float
    throws: int
    hits: int


def detectable(
    size: Floats, hit: Bools, groups: NDArray[np.intp], *, grouped: bool = True
) -> Detectable:
    """Return a90 and a90/95 of throws with objects, by `turnout.detection.pod.estimate`.

    Parameters
    ----------
    size : ndarray, shape (n,)
        Of the objects [m].
    hit : ndarray of bool, shape (n,)
        Whether each was called.
    groups : ndarray of int, shape (n,)
        Switch of each.
    grouped : bool
        Whether switches differ; without, which is quicker, the limit is too low.
    """
    count, hits = len(size), int(np.sum(hit))
    own = {"throws": count, "hits": hits}
    if hits < LEAST_HITS:
        return Detectable(a90=np.inf, a90_95=np.inf, **own)
    if hits == count:
        return Detectable(a90=float(size.min()), a90_95=float(size.min()), **own)
    throws = TestThrows(
        size=size, response=None, hit=hit, switch=tuple(map(str, groups)),
        simulated=np.ones(count, dtype=bool), source="benchmark",
    )  # fmt: skip
    try:
        pod = estimate_pod(throws, PodModel(drawn=0, size_scale="linear", grouped=grouped))
    except StudyError:
        # nothing between the largest miss and the smallest hit, or no growth with size
        grows = size[hit].min() > size[~hit].max()
        value = float(size[~hit].max()) if grows else np.inf
        return Detectable(a90=value, a90_95=value, **own)

    def known(value: float) -> float:
        return float(value) if np.isfinite(value) else np.inf

    return Detectable(a90=known(pod.a90), a90_95=known(pod.a90_95), **own)


LEAST_HITS = 5


def auroc(positive: Floats, negative: Floats) -> float:
    """Return the probability that a positive scores higher than a negative, ties as one half.

    Examples
    --------
    >>> auroc(np.array([1.0, 3.0]), np.array([0.0, 2.0]))
    0.75
    """
    if not positive.size or not negative.size:
        return float("nan")
    ranks = rankdata(np.concatenate([positive, negative]))
    count = len(positive)
    above = ranks[:count].sum() - count * (count + 1) / 2.0
    return float(above / (count * len(negative)))


def macro_f1(true: Sequence[str], said: Sequence[str], names: Sequence[str]) -> float:
    """Return the mean of the F1 scores of some classes.

    Examples
    --------
    >>> round(macro_f1(["a", "a", "b"], ["a", "b", "b"], ["a", "b"]), 4)  # 2/3 each
    0.6667
    """
    given, called = np.array(true), np.array(said)
    scores = []
    for name in names:
        both = np.count_nonzero((given == name) & (called == name))
        whole = np.count_nonzero(given == name) + np.count_nonzero(called == name)
        if whole:
            scores.append(2.0 * both / whole)
    return float(np.mean(scores)) if scores else float("nan")


def calibration_error(probability: Floats, true: Bools) -> float:
    """Return the mean distance between probability and share, over ten bins by their counts.

    Examples
    --------
    >>> says = np.full(10, 0.8)
    >>> round(calibration_error(says, np.arange(10) < 6), 6)
    0.2
    """
    if not probability.size:
        return float("nan")
    bins = np.minimum((BINS * probability).astype(int), BINS - 1)
    found = 0.0
    for number in np.unique(bins):
        own = bins == number
        found += own.mean() * abs(probability[own].mean() - true[own].mean())
    return float(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class Accuracy:
    """Errors of a value and the coverage of its interval.

    Attributes
    ----------
    median, ninety : float
        Quantiles of the absolute error [m].
    coverage : float
        Share of the intervals that hold the true value [-].
    count : int
        Values.
    """

    median: float
    ninety: float
    coverage: float
    count: int


def accuracy(said: Floats, true: Floats) -> Accuracy:
    """Return the errors of the values that are not NaN.

    Parameters
    ----------
    said : ndarray, shape (n, 3)
        Value and ends of its interval.
    true : ndarray, shape (n,)

    Examples
    --------
    >>> accuracy(np.array([[1.0, 0.0, 2.0], [5.0, 4.0, 6.0]]), np.array([1.5, 8.0])).coverage
    0.5
    """
    known = np.isfinite(said[:, 0]) & np.isfinite(true)
    if not known.any():
        return Accuracy(median=np.nan, ninety=np.nan, coverage=np.nan, count=0)
    error = np.abs(said[known, 0] - true[known])
    holds = (said[known, 1] <= true[known]) & (true[known] <= said[known, 2])
    return Accuracy(
        median=float(np.median(error)), ninety=float(np.quantile(error, 0.9)),
        coverage=float(holds.mean()), count=int(known.sum()),
    )  # fmt: skip


def roc_curve(sound: Floats, objects: Floats) -> tuple[Floats, Floats]:
    """Return shares of false alarms and of detections at every threshold, from the highest on."""
    thresholds = np.unique(np.concatenate([sound, objects]))[::-1]
    false = 1.0 - np.searchsorted(np.sort(sound), thresholds) / len(sound)
    seen = 1.0 - np.searchsorted(np.sort(objects), thresholds) / len(objects)
    return false, seen


WANTED = 0.9
STEPS, CLOSE = 60, 1e-6
"""Newton steps at most, and the change of a coefficient at the end [-]."""
RIDGE = 1e-4
"""Keeps slopes finite where calls and misses do not overlap; in squared standard sizes [-]."""
FEWEST_SIZES = 3
LARGEST_STEP = 5.0
"""Of a coefficient, in one step [-]."""


def weighted_a90(size: Floats, hit: NDArray[np.bool_], weight: Floats) -> Floats:
    r"""Return the size that is seen in nine of ten throws, for many weightings at once.

    By weighted maximum likelihood from a probit regression of calls on size,

    .. math:: P(\text{called}) = \Phi(b_0 + b_1\,s), \qquad
        a_{90} = \frac{\Phi^{-1}(0.9) - b_0}{b_1}

    Parameters
    ----------
    size : ndarray, shape (n,)
        [m]
    hit : ndarray of bool, shape (n_draws, n)
        Whether each was called.
    weight : ndarray, shape (n_draws, n)
        How often each counts.

    Returns
    -------
    ndarray, shape (n_draws,)
        Infinite with fewer than five hits, or where detection does not grow with size [m].
    """
    if len(np.unique(size)) < FEWEST_SIZES:
        return np.full(len(hit), np.inf)
    x = (size - size.mean()) / size.std()
    sign = np.where(hit, 1.0, -1.0)
    beta = np.zeros((len(hit), 2))
    for _ in range(STEPS):
        z = sign * (beta[:, :1] + beta[:, 1:] * x)
        ratio = np.exp(-0.5 * z**2 - log_ndtr(z)) / np.sqrt(2.0 * np.pi)
        pull = weight * sign * ratio
        curve = weight * ratio * (z + ratio)
        gradient = np.stack([pull.sum(1), pull @ x - RIDGE * beta[:, 1]], axis=1)
        cross = curve @ x
        a, d = curve.sum(1) + RIDGE**2, curve @ x**2 + RIDGE
        determinant = a * d - cross**2
        step = np.stack([
            d * gradient[:, 0] - cross * gradient[:, 1], a * gradient[:, 1] - cross * gradient[:, 0]
        ], axis=1) / determinant[:, np.newaxis]  # fmt: skip
        beta += np.clip(step, -LARGEST_STEP, LARGEST_STEP)
        if np.abs(step).max() < CLOSE:
            break
    rises = (beta[:, 1] > 0.0) & ((weight * hit).sum(axis=1) >= LEAST_HITS)
    slope = np.where(rises, beta[:, 1], 1.0)
    at = size.mean() + size.std() * (ndtri(WANTED) - beta[:, 0]) / slope
    smallest = float(size.min())
    return np.asarray(np.where(rises, np.maximum(at, smallest), np.inf))
