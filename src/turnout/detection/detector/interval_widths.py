"""Widths of intervals and sets of places, from throws whose size, place and gaps are known."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr

from turnout.detection.detector.judging import View, evidence_of, ratios_of
from turnout.detection.detector.knowledge import Knowledge
from turnout.detection.detector.object_posterior import Interval, gaps_of, object_of
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.floor import touched

Floats = NDArray[np.float64]

AT_ONCE = 50
"""Throws judged together."""
Misses = list[list[float]]


@dataclass(slots=True)
class Missed:
    """By how many half-intervals throws with known sizes and gaps missed these.

    Attributes
    ----------
    size, x : list of (float, float)
        Of size and place of detected objects: log likelihood ratio of the alarm, and the miss [-].
    likelier : list of float
        How probable all places are that are likelier than the true one [-].
    sound, unnoticed, alarm : list of lists
        Of gaps, by throws without an object that is touched, with one that is not noticed, with
        an alarm; less than 0 where the truth lies below the median [-].
    open : list of (int, bool, float)
        Of gaps clearly above their limit: number of the gap, whether the throw is an alarm, and
        how far the limit lies above the median [-].
    """

    size: list[tuple[float, float]] = field(default_factory=list)
    x: list[tuple[float, float]] = field(default_factory=list)
    likelier: list[float] = field(default_factory=list)
    sound: Misses = field(default_factory=list)
    unnoticed: Misses = field(default_factory=list)
    alarm: Misses = field(default_factory=list)
    open: list[tuple[int, bool, float]] = field(default_factory=list)


def misses_of(
    knowledge: Knowledge, tried: Sequence[tuple[View, Floats, ThrowSet]], *, threshold: float
) -> Missed:
    """Return what throws with known sizes, places and gaps say of the intervals of these.

    Parameters
    ----------
    knowledge : Knowledge
        That did not see these throws.
    tried : sequence of (View, ndarray, ThrowSet)
        What they are judged with, measured features [N], and the throws.
    threshold : float
        From which on a throw is an alarm [-].
    """
    limits = np.array(knowledge.setting.limits)
    places = np.array(list(knowledge.setting.places.values()))
    found = Missed()
    for view, features, throws in tried:
        held = touched(throws.force)
        for first in range(0, len(features), AT_ONCE):
            evidence = evidence_of(view, features[first : first + AT_ONCE])
            ratio = ratios_of(view, evidence).alarm
            for number in range(len(ratio)):
                at = first + number
                said = gaps_of(view, evidence, number, limits=limits)
                gaps = [
                    signed_miss(g, float(t))
                    for g, t in zip(said.gaps, throws.gaps[at], strict=True)
                ]
                alarm = bool(ratio[number] > threshold)
                for row in np.flatnonzero(throws.gaps[at] >= limits + CLEARLY_OPEN):
                    gap = said.gaps[row]
                    reach = (limits[row] - gap.middle) / max(gap.high - gap.middle, 1e-9)
                    found.open.append((int(row), alarm, float(reach)))
                if not alarm:
                    (found.unnoticed if held[at] else found.sound).append(gaps)
                    continue
                found.alarm.append(gaps)
                if held[at]:
                    trapped = object_of(view, evidence, number)
                    alarm_ratio, true = float(ratio[number]), float(throws.x[at])
                    found.size.append((alarm_ratio, miss(trapped.size, float(throws.size[at]))))
                    found.x.append((alarm_ratio, miss(trapped.x, true)))
                    nearest = int(np.abs(places - true).argmin())
                    found.likelier.append(likelier(trapped.place, nearest))
    return found


def likelier(probability: Floats, true: int) -> float:
    """Return how probable all places are that are likelier than the true one.

    A set of the likeliest places whose probabilities reach a level holds the true place where this
    is below the level.

    Examples
    --------
    >>> likelier(np.array([0.5, 0.2, 0.3]), 1)
    0.8
    """
    return float(probability[probability > probability[true]].sum())


def level_of_places(likelier_than_true: Sequence[float], *, otherwise: float) -> float:
    r"""Return the level at which sets of places hold the true one with 90 %.

    The quantile of rank :math:`\lceil 0.9\,(n + 1) \rceil` of what is likelier than the true place:
    a further throw of the same kind lies below it with at least 90 % (split conformal prediction;
    Romano, Sesia and Candes, Classification with valid and adaptive coverage, 2020).

    Parameters
    ----------
    likelier_than_true : sequence of float
        Of throws with an alarm [-].
    otherwise : float
        Where these are too few.

    Examples
    --------
    >>> round(level_of_places(np.linspace(0.0, 0.99, 100), otherwise=0.9), 6)
    0.9
    """
    count = len(likelier_than_true)
    if count < LEAST_MISSES:
        return otherwise
    rank = int(np.ceil(IN_PLACES * (count + 1)))
    # a place as likely as the level says is to be in the set
    return min(1.0, float(np.nextafter(np.sort(likelier_than_true)[rank - 1], 2.0)))


IN_PLACES = 0.9
"""Share of sets of places that hold the true place [-]."""


def signed_miss(interval: Interval, truth: float) -> float:
    """Return `miss`, less than 0 where the truth lies below the middle.

    Examples
    --------
    >>> signed_miss(Interval(middle=1.0, low=0.5, high=3.0), 0.25)
    -1.5
    """
    return float(np.copysign(miss(interval, truth), truth - interval.middle))


def miss(interval: Interval, truth: float) -> float:
    """Return how far a truth lies from the middle, in half-intervals on its side; 1 is the edge.

    Examples
    --------
    >>> miss(Interval(middle=1.0, low=0.5, high=3.0), 2.0)
    0.5
    """
    edge = interval.high if truth > interval.middle else interval.low
    return abs(truth - interval.middle) / max(abs(edge - interval.middle), 1e-9)


CLEARLY_OPEN = 2e-3
"""Above its limit, from which on a gap must not be missed [m]."""
OPEN_CALLED, OPEN_CONFIDENCE = 0.97, 0.95
"""Share of these that are to be called, and the confidence of that [-]."""
LARGEST_REACH = 1.0


def reach_of_call(
    open_gaps: Sequence[tuple[int, bool, float]],
    *,
    factors: Sequence[float],
    object_factors: Sequence[float],
    otherwise: Sequence[float],
) -> tuple[float, ...]:
    """Return how far above its median a limit may lie for each gap to be called above it.

    So far that of gaps clearly above their limit 97 % are called, with a confidence of 95 %: the
    tolerance limit of Wilks (1941), the r-th smallest of n where at most r - 1 of n fall into 97 %
    with 95 %. Too few allow no such limit; then it is the largest, or that of `otherwise`. In upper
    half-intervals, of which one reaches to the upper end.

    Parameters
    ----------
    open_gaps : sequence of (int, bool, float)
        `Missed.open`.
    factors, object_factors : sequence of float
        By which the upper halves of the intervals of each gap are widened without and with an
        alarm [-].
    otherwise : sequence of float
        Of each gap, not gone below where there are too few.

    Examples
    --------
    >>> gaps = [(0, True, 0.01 * number) for number in range(100)]
    >>> given = {"factors": [1.0], "object_factors": [2.0], "otherwise": [0.0]}
    >>> reach_of_call(gaps, **given)
    (0.495,)
    """
    found = []
    for number, least in enumerate(otherwise):
        factor = {True: object_factors[number], False: factors[number]}
        own = np.sort([reach / factor[alarm] for at, alarm, reach in open_gaps if at == number])
        sure = bdtr(np.arange(own.size), own.size, OPEN_CALLED) >= OPEN_CONFIDENCE
        wanted = own[np.argmax(sure)] if sure.any() else max(own.max(initial=least), least)
        found.append(float(np.clip(wanted, 0.0, LARGEST_REACH)))
    return tuple(found)


def factor_of(*groups: Floats, otherwise: float) -> float:
    """Return by how much intervals must be widened to hold 95 %, never narrowed to below half.

    Parameters
    ----------
    *groups : ndarray
        Misses of kinds of throws, whatever their sign; each kind counts the same, those with too
        few do not.
    otherwise : float
        Where there are too few of every kind.
    """
    counted = [group for group in groups if len(group) >= LEAST_MISSES]
    if not counted:
        return otherwise
    misses = np.abs(np.concatenate(counted))
    weight = np.concatenate([np.full(len(group), 1.0 / len(group)) for group in counted])
    order = np.argsort(misses)
    share = np.cumsum(weight[order]) / len(counted)
    return max(0.5, float(np.interp(COVERED, share, misses[order])))


def sides_of(
    sound: Floats, unnoticed: Floats, *, otherwise: tuple[float, float]
) -> tuple[float, float]:
    r"""Return by how much the lower and the upper half must be widened to hold 95 % of both kinds.

    Where an object is not noticed the gap is wider than its median says, in a sound throw as often
    narrower. One factor for both halves, wide enough for objects, holds nearly every sound throw.
    With :math:`F_k` the distribution of signed misses of a kind, the factors :math:`a, b` solve

    .. math:: 0.95 \le F_k(b) - F_k(-a) \le 0.965 \quad \text{for both } k

    and are the shortest pair that does. If none does, that with the shares least apart is taken
    which holds 95 % of each.

    Parameters
    ----------
    sound, unnoticed : ndarray
        Signed misses of throws without an object and with one that raises no alarm [-]; a kind with
        too few does not count.
    otherwise : (float, float)
        Where there are too few of either kind.

    Examples
    --------
    >>> even = np.linspace(-1.0, 1.0, 2001)
    >>> low, high = sides_of(even, even + 0.5, otherwise=(1.0, 1.0))
    >>> round(low, 2), round(high, 2)  # 5 % of the first below, 5 % of the second above
    (0.9, 1.4)
    >>> round(sum(sides_of(even, even, otherwise=(9.0, 9.0))), 2)  # of 2 that hold them all
    1.9
    """
    kinds = [np.sort(kind) for kind in (sound, unnoticed) if len(kind) >= LEAST_MISSES]
    if not kinds:
        return otherwise
    tried = np.unique(np.concatenate([[0.0], *(-kind[kind < 0.0] for kind in kinds)]))
    tried = tried[np.linspace(0, tried.size - 1, min(tried.size, 500)).astype(np.intp)]
    pairs = []
    for low in tried:
        lost = [np.searchsorted(kind, -low) for kind in kinds]
        ranks = [
            int(np.ceil(COVERED * kind.size)) + int(below) - 1
            for kind, below in zip(kinds, lost, strict=True)
        ]
        if any(rank >= kind.size for rank, kind in zip(ranks, kinds, strict=True)):
            continue
        needed = [max(0.0, float(kind[rank])) for rank, kind in zip(ranks, kinds, strict=True)]
        high = max(needed)
        shares = [
            np.searchsorted(kind, high, side="right") - below
            for kind, below in zip(kinds, lost, strict=True)
        ]
        held = [share / kind.size for share, kind in zip(shares, kinds, strict=True)]
        pairs.append((max(held) - min(held), float(low) + high, float(low), high))
    alike = [pair for pair in pairs if pair[0] <= MOST_APART]
    _, _, low, high = min(alike, key=lambda pair: pair[1]) if alike else min(pairs)
    return low, high


COVERED, MOST_APART = 0.95, 0.015
"""Share that intervals are to hold, and by how much more of one kind than of the other [-]."""


def misses_in_doubt(found: Sequence[tuple[float, float]]) -> Floats:
    """Return the misses of that half of the detected objects which is nearest to the threshold.

    Held-back objects have any size, most of them far above what is just seen; an interval that is
    wide enough for them is too narrow for those in doubt.

    Parameters
    ----------
    found : sequence of (float, float)
        `Missed.size`.

    Examples
    --------
    >>> misses_in_doubt([(9.0, 0.2), (5.0, 1.5), (30.0, 0.1), (6.0, 0.7)]).tolist()
    [1.5, 0.7]
    """
    ordered = np.array([missed for _ratio, missed in sorted(found)])
    return ordered[: (len(ordered) + 1) // 2]


LEAST_MISSES = 40
