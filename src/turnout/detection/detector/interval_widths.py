"""Widths of intervals and sets of places, from throws whose size, place and gaps are known."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from turnout.detection.alarm_threshold import confident_quantile
from turnout.detection.detector.judging import View, evidence_of, ratios_of
from turnout.detection.detector.knowledge import Knowledge, Setting
from turnout.detection.detector.nearest_samples import Samples
from turnout.detection.detector.object_posterior import (
    Interval,
    gaps_of,
    object_of,
    objects_near,
)
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.floor import touched
from turnout.detection.likelihood import Evidence

Floats = NDArray[np.float64]

AT_ONCE = 50
"""Throws judged together."""
Misses = list[Floats]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tried:
    """Throws that widths of intervals are taken from.

    Attributes
    ----------
    features : ndarray, shape (n_throws, n_features)
        Measured [N].
    throws : ThrowSet
        What is true of them.
    gaps : ndarray, shape (n_draws, n_throws, n_gaps)
        Their end gaps, several times with other errors [m]. Where an interval is as narrow as these
        errors, one draw of them would decide which share it holds.
    """

    features: Floats
    throws: ThrowSet
    gaps: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThrowAnswer:
    """Answer to a throw, with its misses of the truth in half-intervals.

    Attributes
    ----------
    gaps : ndarray, shape (n_draws, n_gaps)
        Of gaps; less than 0 where the truth lies below the median [-].
    open : list of (int, float)
        Gaps clearly above their limit, once for each draw in which they are, and how far the limit
        lies above the median, in upper half-intervals [-].
    size, x, likelier : float
        Of size and place of an object, and how probable all places are that are likelier than the
        true one; 0 where none is touched or no alarm is raised [-].
    """

    gaps: Floats
    open: list[tuple[int, float]]
    size: float = 0.0
    x: float = 0.0
    likelier: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThrowAnswers:
    """Answers to a throw with and without an alarm.

    Attributes
    ----------
    ratio : float
        Log likelihood ratio of an object against everything else [-].
    touched : bool
        True where an object is touched.
    switch : int
        Number of the switch.
    quiet, alarm : ThrowAnswer
        Without and with an alarm; the latter None of a throw that cannot be one.
    """

    ratio: float
    touched: bool
    switch: int
    quiet: ThrowAnswer
    alarm: ThrowAnswer | None


@dataclass(frozen=True, slots=True)
class OpenGap:
    """A gap clearly above its limit.

    Attributes
    ----------
    gap, switch : int
        Numbers.
    alarm : bool
        Whether the throw is an alarm.
    reach : float
        How far the limit lies above the median, in upper half-intervals [-].
    """

    gap: int
    switch: int
    alarm: bool
    reach: float


@dataclass(slots=True, eq=False)
class Missed:
    """By how many half-intervals throws with known sizes and gaps missed these.

    Attributes
    ----------
    size, x : list of (float, float)
        Of size and place of detected objects: log likelihood ratio of the alarm, and the miss [-].
    likelier : list of float
        How probable all places are that are likelier than the true one [-].
    sound, unnoticed, alarm : list of ndarray, shape (n_draws, n_gaps)
        Of gaps, by throws without an object that is touched, with one that is not noticed, with
        an alarm; less than 0 where the truth lies below the median [-].
    open : list of OpenGap
        Gaps clearly above their limit.
    """

    size: list[tuple[float, float]] = field(default_factory=list)
    x: list[tuple[float, float]] = field(default_factory=list)
    likelier: list[float] = field(default_factory=list)
    sound: Misses = field(default_factory=list)
    unnoticed: Misses = field(default_factory=list)
    alarm: Misses = field(default_factory=list)
    open: list[OpenGap] = field(default_factory=list)


def answers_of(
    knowledge: Knowledge, view: View, tried: Sequence[Tried], *, least: float
) -> list[ThrowAnswers]:
    """Answer throws with known sizes, places and gaps.

    Parameters
    ----------
    knowledge : Knowledge
        That did not see these throws.
    view : View
        What they are judged with.
    tried : sequence of Tried
        The throws.
    least : float
        Log likelihood ratio up to which a throw is no alarm, whatever the threshold [-].
    """
    found = []
    for item in tried:
        held = touched(item.throws.force)
        for first in range(0, len(item.features), AT_ONCE):
            evidence = evidence_of(view, item.features[first : first + AT_ONCE])
            for number, ratio in enumerate(ratios_of(view, evidence).alarm.tolist()):
                at = first + number
                near = objects_near(view, evidence, number) if ratio > least else None
                given = knowledge.setting, view, evidence, number, item, at
                answers = ThrowAnswers(
                    ratio=ratio,
                    touched=bool(held[at]),
                    switch=int(item.throws.switch[at]),
                    quiet=_answer(*given),
                    alarm=None if near is None else _answer(*given, near=near, held=held[at]),
                )
                found.append(answers)
    return found


def _answer(
    setting: Setting,
    view: View,
    evidence: Evidence,
    number: int,
    item: Tried,
    at: int,
    *,
    near: Samples | None = None,
    held: bool = False,
) -> ThrowAnswer:
    """Answer one of some throws; `held` in full, as to an object that is touched."""
    limits, true_gaps = np.array(setting.limits), item.gaps[:, at]
    said = gaps_of(view, evidence, number, limits=limits, near=near)
    gaps = signed_misses(said.gaps, true_gaps)
    far = []
    for gap in np.nonzero(true_gaps >= limits + CLEARLY_OPEN)[1].tolist():
        own = said.gaps[gap]
        far.append((gap, float((limits[gap] - own.middle) / max(own.high - own.middle, 1e-9))))
    if near is None or not held:
        return ThrowAnswer(gaps=gaps, open=far)
    trapped = object_of(view, evidence, number, near=near)
    x, places = float(item.throws.x[at]), np.array(list(setting.places.values()))
    return ThrowAnswer(
        gaps=gaps,
        open=far,
        size=miss(trapped.size, float(item.throws.size[at])),
        x=miss(trapped.x, x),
        likelier=likelier(trapped.place, int(np.abs(places - x).argmin())),
    )


def missed_of(answers: Iterable[ThrowAnswers], *, threshold: float) -> Missed:
    """Return the misses of answers to throws, of which those above a threshold [-] are alarms."""
    found = Missed()
    for item in answers:
        alarm = item.alarm if item.ratio > threshold else None
        answer = alarm or item.quiet
        for gap, reach in answer.open:
            found.open.append(OpenGap(gap, item.switch, alarm is not None, reach))
        if alarm is None:
            (found.unnoticed if item.touched else found.sound).append(answer.gaps)
            continue
        found.alarm.append(answer.gaps)
        if item.touched:
            found.size.append((item.ratio, answer.size))
            found.x.append((item.ratio, answer.x))
            found.likelier.append(answer.likelier)
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


def signed_misses(intervals: Sequence[Interval], truths: Floats) -> Floats:
    """Return `miss` of each interval, less than 0 where the truth lies below the middle.

    Parameters
    ----------
    intervals : sequence of Interval
        n of them.
    truths : ndarray, shape (n_draws, n)
        Of each.

    Returns
    -------
    ndarray, shape (n_draws, n)

    Examples
    --------
    >>> interval = Interval(middle=1.0, low=0.5, high=3.0)
    >>> signed_misses([interval], np.array([[0.25], [2.0]])).tolist()
    [[-1.5], [0.5]]
    """
    low, middle, high = np.array([[item.low, item.middle, item.high] for item in intervals]).T
    half = np.where(truths > middle, high - middle, middle - low)
    return np.asarray((truths - middle) / np.maximum(half, 1e-9))


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
OPEN_CALLED = 0.97
"""Share of these that are to be called [-]."""
LARGEST_REACH = 1.0


def reach_of_call(
    open_gaps: Sequence[OpenGap],
    *,
    factors: Sequence[float],
    object_factors: Sequence[float],
    otherwise: Sequence[float],
) -> tuple[float, ...]:
    """Return how far above its median a limit may lie for each gap to be called above it.

    So far that of gaps clearly above their limit 97 % are called, with a confidence of 95 % over
    switches drawn with replacement: uses of one throw, and throws of one switch, are alike. Of
    gaps of fewer than `LEAST_OPEN` switches all are called, or as far as that of `otherwise`. In
    upper half-intervals, of which one reaches to the upper end.

    Parameters
    ----------
    open_gaps : sequence of OpenGap
        `Missed.open`.
    factors, object_factors : sequence of float
        By which the upper halves of the intervals of each gap are widened without and with an
        alarm [-].
    otherwise : sequence of float
        Of each gap, not gone below where there are too few.

    Examples
    --------
    >>> gaps = [OpenGap(0, number, True, 0.01 * number) for number in range(100)]
    >>> given = {"factors": [1.0], "object_factors": [2.0], "otherwise": [0.0]}
    >>> (reach,) = reach_of_call(gaps, **given)
    >>> 0.485 < reach <= 0.495
    True
    """
    found = []
    for number, least in enumerate(otherwise):
        factor = {True: object_factors[number], False: factors[number]}
        some = [item for item in open_gaps if item.gap == number]
        own = np.array([item.reach / factor[item.alarm] for item in some])
        switch = np.array([item.switch for item in some], dtype=np.intp)
        if len(np.unique(switch)) < LEAST_OPEN:
            wanted = max(float(own.max(initial=least)), least)
        else:
            wanted = confident_quantile(own, share=OPEN_CALLED, group=switch)
        found.append(float(np.clip(wanted, 0.0, LARGEST_REACH)))
    return tuple(found)


LEAST_OPEN = 20
"""Switches with gaps clearly above their limit that a share of these is taken from."""


def factor_of(*groups: Floats, otherwise: float) -> float:
    """Return by how much intervals must be widened to hold 95 %, never narrowed to below half.

    Parameters
    ----------
    *groups : ndarray, shape (n_throws, ...)
        Misses of kinds of throws, whatever their sign; each kind counts the same, those of too
        few throws do not.
    otherwise : float
        Where there are too few of every kind.
    """
    counted = [group for group in groups if len(group) >= LEAST_MISSES]
    if not counted:
        return otherwise
    misses = np.abs(np.concatenate([group.ravel() for group in counted]))
    weight = np.concatenate([np.full(group.size, 1.0 / group.size) for group in counted])
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
    sound, unnoticed : ndarray, shape (n_throws, ...)
        Signed misses of throws without an object and with one that raises no alarm [-]; a kind of
        too few throws does not count.
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
    kinds = [np.sort(kind, axis=None) for kind in (sound, unnoticed) if len(kind) >= LEAST_MISSES]
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


def factor_of_objects(found: Sequence[tuple[float, float]], *, otherwise: float) -> float:
    """Return by how much intervals of detected objects must be widened to hold 95 %.

    Of all of them, and of those in doubt.

    Parameters
    ----------
    found : sequence of (float, float)
        `Missed.size`.
    otherwise : float
        Where there are too few.
    """
    every = np.array([missed for _ratio, missed in found])
    groups = every, misses_in_doubt(found)
    return max(factor_of(group, otherwise=otherwise) for group in groups)


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
