r"""The margin of one method over others with an interval, by drawing test switches.

Throws of a switch are alike, so switches are drawn with replacement, for all methods the same ones
(Efron and Tibshirani 1993, chapter 8). In each draw every method gets the threshold that
1 in 1,000 of the sound throws drawn exceeds, and a90 at each place from a probit regression of its
calls on size,

.. math:: P(\text{called}) = \Phi(b_0 + b_1\,s), \qquad
    a_{90} = \frac{\Phi^{-1}(0.9) - b_0}{b_1}

by weighted maximum likelihood, a throw weighing as often as its switch was drawn.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtri

from turnout.open_benchmark.definition import EQUAL, HARD, MID_SPAN, SOUND
from turnout.open_benchmark.sides import Side

Floats = NDArray[np.float64]

DRAWS = 1000
WANTED = 0.9
STEPS, CLOSE = 60, 1e-6
"""Newton steps at most, and the change of a coefficient at the end [-]."""
RIDGE = 1e-4
"""Keeps slopes finite where calls and misses do not overlap; in squared standard sizes [-]."""
LEAST_HITS, FEWEST_SIZES = 5, 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Margin:
    """By how much smaller objects one method sees than another; positive where it is better.

    Attributes
    ----------
    own, other : float
        a90 of both, mean of sleepers 4 to 8 at equal false alarms [m]; infinite where some size is
        never seen in nine of ten throws.
    value, low, high : float
        Other less own, and its 95 % interval over drawn switches [m].
    ahead : float
        Share of the draws in which it is positive [-].
    """

    own: float
    other: float
    value: float
    low: float
    high: float
    ahead: float


def mid_span_draws(
    side: Side, scores: Mapping[str, Floats], *, draws: int = DRAWS, seed: int = 0
) -> dict[str, Floats]:
    """Return a90 of each method, of all switches first and then of draws of them.

    Parameters
    ----------
    side : Side
        Judged test throws.
    scores : mapping of str to ndarray, shape (n,)
        Of each method, higher where an object is likelier.
    draws : int
        Of switches.
    seed : int
        Of chance.

    Returns
    -------
    dict of str to ndarray, shape (1 + draws,)
        Mean of sleepers 4 to 8, stones and metal, at equal false alarms [m].
    """
    switches, own = np.unique(side.groups, return_inverse=True)
    chosen = np.random.default_rng(seed).integers(0, len(switches), (draws, len(switches)))
    times = np.array([np.bincount(row, minlength=len(switches)) for row in chosen])
    times = np.vstack([np.ones((1, len(switches))), times])
    sound = side.labels["role"] == SOUND
    hard = np.isin(side.labels["kind"], HARD)
    places = [name for name in MID_SPAN if np.any(hard & (side.labels["place"] == name))]
    found = {}
    for name, score in scores.items():
        level = equal_levels(score[sound], times[:, own[sound]])
        each = []
        for place in places:
            rows = hard & (side.labels["place"] == place)
            hit = score[rows] > level[:, np.newaxis]
            each.append(weighted_a90(side.labels["size"][rows], hit, times[:, own[rows]]))
        found[name] = np.mean(each, axis=0) if each else np.full(len(times), np.inf)
    return found


def equal_levels(score: Floats, weight: Floats) -> Floats:
    """Return the score that a share `EQUAL` of weighted throws exceeds, shape (n_draws,).

    Examples
    --------
    >>> equal_levels(np.arange(2000.0), np.ones((1, 2000))).tolist()
    [1997.0]
    """
    order = np.argsort(score)[::-1]
    above = np.cumsum(weight[:, order], axis=1)
    allowed = EQUAL * above[:, -1:]
    return np.asarray(score[order][np.argmax(above > allowed, axis=1)], dtype=np.float64)


def weighted_a90(size: Floats, hit: NDArray[np.bool_], weight: Floats) -> Floats:
    """Return the size that is seen in nine of ten throws, for many weightings at once.

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


LARGEST_STEP = 5.0
"""Of a coefficient, in one step [-]."""


def margin_over(own: Floats, others: Sequence[Floats]) -> Margin:
    """Return the margin over the best of some methods, which each draw chooses again.

    Parameters
    ----------
    own : ndarray, shape (1 + n_draws,)
        From `mid_span_draws`.
    others : sequence of ndarray
        Likewise.

    Examples
    --------
    >>> found = margin_over(np.array([10.0, 9.0, 11.0]), [np.array([12.0, 12.0, 10.5])])
    >>> found.value, found.ahead
    (2.0, 0.5)
    """
    best = np.min(others, axis=0)
    with np.errstate(invalid="ignore"):
        margin = best - own
    margin = np.where(np.isfinite(own), margin, np.where(np.isfinite(best), -np.inf, np.nan))
    drawn = margin[1:][~np.isnan(margin[1:])]
    if not drawn.size:
        drawn = np.array([np.nan])
    low, high = central_interval(drawn)
    return Margin(
        own=float(own[0]), other=float(best[0]), value=float(margin[0]),
        low=low, high=high,
        ahead=float(np.mean(drawn > 0.0)),
    )  # fmt: skip


def central_interval(drawn: Floats) -> tuple[float, float]:
    """Return the ends between which 95 % of draws lie, infinite ones included.

    Examples
    --------
    >>> central_interval(np.arange(100.0))
    (2.0, 97.0)
    """
    rising, tail = np.sort(drawn), int(0.025 * len(drawn))
    return float(rising[tail]), float(rising[-1 - tail])
