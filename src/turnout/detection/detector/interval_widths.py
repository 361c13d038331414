"""Widths of intervals and sets of places, from throws whose size, place and gaps are known."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

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
        an alarm [-].
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
                gaps = [miss(g, float(t)) for g, t in zip(said.gaps, throws.gaps[at], strict=True)]
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
OPEN_CALLED = 0.98
"""Share of these that are to be called [-]."""
LARGEST_REACH = 1.0


def reach_of_call(
    open_gaps: Sequence[tuple[int, bool, float]],
    *,
    factors: Sequence[float],
    object_factors: Sequence[float],
    otherwise: float,
) -> float:
    """Return how far above its median a limit may lie for a gap to be called above it.

    So far that of gaps clearly above their limit 98 % are called; in half-intervals, of which one
    reaches to the upper end.

    Parameters
    ----------
    open_gaps : sequence of (int, bool, float)
        `Missed.open`.
    factors, object_factors : sequence of float
        By which the intervals of each gap are widened without and with an alarm [-].
    otherwise : float
        Where there are too few.

    Examples
    --------
    >>> gaps = [(0, True, 0.01 * number) for number in range(100)]
    >>> round(reach_of_call(gaps, factors=[1.0], object_factors=[2.0], otherwise=0.0), 3)
    0.485
    """
    if len(open_gaps) < LEAST_MISSES:
        return otherwise
    widened = [
        reach / (object_factors if alarm else factors)[number] for number, alarm, reach in open_gaps
    ]
    return float(np.clip(np.quantile(widened, OPEN_CALLED), 0.0, LARGEST_REACH))


def factor_of(*groups: Floats, otherwise: float) -> float:
    """Return by how much intervals must be widened to hold 95 %, never narrowed to below half.

    Parameters
    ----------
    *groups : ndarray
        Misses of kinds of throws; each kind counts the same, those with too few do not.
    otherwise : float
        Where there are too few of every kind.
    """
    counted = [group for group in groups if len(group) >= LEAST_MISSES]
    if not counted:
        return otherwise
    misses = np.concatenate(counted)
    weight = np.concatenate([np.full(len(group), 1.0 / len(group)) for group in counted])
    order = np.argsort(misses)
    share = np.cumsum(weight[order]) / len(counted)
    return max(0.5, float(np.interp(0.95, share, misses[order])))


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
