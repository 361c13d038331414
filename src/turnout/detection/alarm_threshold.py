r"""Thresholds of log likelihood ratios, beyond what the throws show by the tail of a distribution.

Excesses over a high quantile follow a generalised Pareto distribution, whatever the distribution is
(Pickands 1975):

.. math:: P(x > t) = p_u \left(1 + \xi\,\frac{t - u}{\sigma}\right)^{-1 / \xi}

with :math:`p_u` above :math:`u`. :math:`\sigma` and :math:`\xi` come from probability-weighted
moments (Hosking and Wallis 1987). Were the sound model exact, a likelihood ratio would exceed
:math:`e^t` with at most :math:`e^{-t}` (Markov), an exponential tail, :math:`\xi = 0`; a heavier
one shows that it is not, and a lighter one is not believed.

Alarms come in clusters: a switch that lies close to the threshold raises several. A threshold that
rests on a few switches is itself uncertain, so it is set to the upper limit of its own 95 %
confidence interval, over switches drawn with replacement (Field and Welsh 2007, cluster bootstrap,
J. R. Stat. Soc. B 69, 369), or over groups of switches that share their sections. The tail is
fitted to each draw again.
"""

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betaincinv

Floats = NDArray[np.float64]

SAFETY = {1e-3: 0.5, 1e-4: 0.1}
"""Thresholds are set for so much of each rate, beside their own uncertainty [-]. 30,000 throws of
other switches show a rate of 1/1,000 where at most 20 are alarms, which come in clusters, and one
of 1/10,000 where none is: a true rate of 1/100,000 leaves three times in four none."""
RATES = tuple(SAFETY)
"""Of false alarms a sound throw, that thresholds are given for."""
TAIL_SHARE = 0.01
"""Highest share of the ratios that the tail is fitted to [-]."""
LEAST_IN_TAIL = 10
"""Throws above a quantile that is taken as it is."""
HEAVIEST = 0.5
r"""Largest :math:`\xi` that is believed [-]."""


RESAMPLES, CONFIDENCE = 200, 0.95
"""Draws of groups, and the share of them in which a threshold keeps its rate [-]."""


def thresholds_of(
    ratios: Floats, *, group: NDArray[np.intp], usual: Mapping[str, float], least: float
) -> dict[str, float]:
    """Return from which log likelihood ratio on a throw is an alarm, for each of `RATES`.

    A threshold that too few throws reach is never below the usual one. That without a history rests
    on thousands of switches, those after one on some dozens; of n switches none may be of a kind
    that makes up 3 / n of all (rule of three), and one switch in 200 can raise most of the alarms.

    Parameters
    ----------
    ratios : ndarray, shape (n_throws,)
        Of sound throws that the detector did not learn from [-].
    group : ndarray of int, shape (n_throws,)
        Which group of alike switches each is of.
    usual : mapping of str to float
        What holds without a history; empty for that itself [-].
    least : float
        Below which no threshold lies [-].

    Examples
    --------
    >>> ratios = np.random.default_rng(0).exponential(size=40_000)
    >>> group = np.arange(40_000) // 500
    >>> usual = {"0.001": 20.0, "0.0001": 20.0}
    >>> found = thresholds_of(ratios, group=group, usual=usual, least=2.0)
    >>> found["0.001"] < 9.0, found["0.0001"]  # 0.4 of the throws lie above the latter
    (True, 20.0)
    """
    found = {}
    for rate, share in SAFETY.items():
        aim = share * rate
        own = confident_threshold(ratios, rate=aim, group=group)
        if aim * len(ratios) < LEAST_IN_TAIL:
            own = max(own, usual.get(f"{rate:g}", own))
        found[f"{rate:g}"] = max(least, own)
    return found


def confident_threshold(
    ratios: Floats, *, rate: float, group: NDArray[np.intp], seed: int = 0
) -> float:
    """Return what at most a share of sound throws exceeds, with a confidence of 95 %.

    Parameters
    ----------
    ratios : ndarray, shape (n,)
        Log likelihood ratios of sound throws.
    rate : float
        Share wanted [-].
    group : ndarray of int, shape (n,)
        Which switch each is of, or which group of switches that are alike.
    seed : int
        Of chance.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> ratios, group = rng.exponential(size=20000), np.arange(20000) // 20
    >>> estimate = threshold_for(ratios, rate=1e-3)
    >>> bool(estimate < confident_threshold(ratios, rate=1e-3, group=group) < estimate + 1.0)
    True
    """
    return _confident(partial(threshold_for, rate=rate), ratios, group, seed)


def confident_quantile(
    values: Floats, *, share: float, group: NDArray[np.intp], seed: int = 0
) -> float:
    """Return what at least a share of some values does not exceed, with a confidence of 95 %.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Of throws.
    share : float
        Wanted [-].
    group : ndarray of int, shape (n,)
        Which switch each is of.
    seed : int
        Of chance.

    Examples
    --------
    >>> values, group = np.linspace(0.0, 1.0, 1000), np.arange(1000) // 5
    >>> bool(0.9 < confident_quantile(values, share=0.9, group=group) < 0.96)
    True
    """
    return _confident(partial(np.quantile, q=share), values, group, seed)


def _confident(
    found_in: Callable[[Floats], float], values: Floats, group: NDArray[np.intp], seed: int
) -> float:
    """Return the upper limit of what is found in values, over groups drawn with replacement."""
    rng = np.random.default_rng([seed, 13])
    numbers, own = np.unique(group, return_inverse=True)
    usual, found = float(found_in(values)), []
    for _ in range(RESAMPLES):
        often = np.bincount(rng.integers(0, numbers.size, numbers.size), minlength=numbers.size)
        found.append(float(found_in(np.repeat(values, often[own]))))
    return max(usual, float(np.quantile(found, CONFIDENCE)))


def threshold_for(ratios: Floats, *, rate: float) -> float:
    """Return what a share of sound throws exceeds.

    The quantile itself where enough throws lie above it, and never less than the fitted tail.

    Parameters
    ----------
    ratios : ndarray, shape (n,)
        Log likelihood ratios of sound throws.
    rate : float
        Share wanted [-].

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> round(threshold_for(rng.exponential(size=20000), rate=1e-4))
    10
    """
    start = float(np.quantile(ratios, 1.0 - TAIL_SHARE))
    shape, scale = pareto_tail(ratios[ratios > start] - start)
    fitted = start + scale * growth(TAIL_SHARE / rate, shape)
    if rate * len(ratios) < LEAST_IN_TAIL:
        return fitted
    return max(fitted, float(np.quantile(ratios, 1.0 - rate)))


def pareto_tail(excess: Floats) -> tuple[float, float]:
    r"""Return :math:`\xi` [-] and :math:`\sigma` of excesses over a threshold.

    Parameters
    ----------
    excess : ndarray, shape (n,)
        Positive; without any the scale is 0.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> shape, scale = pareto_tail(3.0 * (rng.random(200_000) ** -0.25 - 1.0) / 0.25)
    >>> round(shape, 2), round(scale, 1)
    (0.25, 3.0)
    """
    if not excess.size:
        return 0.0, 0.0
    ordered = np.sort(excess)
    mean = float(ordered.mean())
    above = 1.0 - (np.arange(1, ordered.size + 1) - 0.35) / ordered.size
    weighted = float((above * ordered).mean())
    # of an exponential the weighted moment is a quarter of the mean
    shape = 2.0 - mean / (mean - 2.0 * weighted) if mean > 2.0 * weighted else 0.0
    if not shape > 0.0:
        return 0.0, mean
    shape = min(shape, HEAVIEST)
    return shape, mean * (1.0 - shape)


def growth(times: float, shape: float) -> float:
    """Return by how many scales a threshold rises to be exceeded so many times less often [-].

    Examples
    --------
    >>> round(growth(100.0, 0.0), 3), round(growth(100.0, 0.5), 3)
    (4.605, 18.0)
    """
    if shape < SMALL:
        return float(np.log(times))
    return float((times**shape - 1.0) / shape)


SMALL = 1e-6
r""":math:`\xi` below which the tail counts as exponential [-]."""


def share_interval(hits: ArrayLike, count: int, *, tail: float = 0.025) -> tuple[Floats, Floats]:
    """Return the interval of a share of independent throws (Clopper and Pearson 1934).

    Parameters
    ----------
    hits : array_like of int, shape (...)
        How many of the throws count.
    count : int
        Throws, at least one.
    tail : float
        Probability that the share lies beyond either end, at most [-].

    Returns
    -------
    tuple of ndarray, shape (...)
        Lower and upper end [-].

    Examples
    --------
    >>> low, high = share_interval([0, 300], 300)
    >>> low.round(4).tolist(), high.round(4).tolist()  # 0.025 ** (1 / 300)
    ([0.0, 0.9878], [0.0122, 1.0])
    """
    called = np.asarray(hits, dtype=np.float64)
    low = betaincinv(np.maximum(called, 1.0), count - called + 1.0, tail)
    high = betaincinv(called + 1.0, np.maximum(count - called, 1.0), 1.0 - tail)
    return np.where(called > 0, low, 0.0), np.where(called < count, high, 1.0)
