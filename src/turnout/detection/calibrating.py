"""Thresholds and widths of intervals from throws that a detector was not trained on.

Each throw is used several times, with its own discrepancy, noise and timing. Rates below what the
throws support come from an exponential fitted to the highest hundredth.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from turnout.detection.floor import touched
from turnout.detection.judging import (
    CAUSE_WEIGHT,
    CYCLE,
    View,
    best_square,
    evidence_of,
    level_of,
    make_view,
    ratios_of,
)
from turnout.detection.knowledge import RESIDUAL_LEVELS, Calibrated, Knowledge
from turnout.detection.object_posterior import Interval, posterior_of
from turnout.detection.switch_history import Expectation, ThrowErrors, before_history, observe
from turnout.detection.throw_set import ThrowSet

Floats = NDArray[np.float64]

RATES = (1e-3, 1e-4)
"""Of false alarms a sound throw, that thresholds are given for."""
SAFETY = 0.5
"""Thresholds are set for so much of the stated rate, for what is not foreseen [-]."""
TAIL_SHARE = 0.01
"""Highest share of the ratios that the exponential is fitted to [-]."""
LEAST_IN_TAIL = 10
"""Throws above a quantile that is taken as it is."""
AT_ONCE = 50
"""Throws judged together."""
LEAST_THRESHOLD = 1.0 - float(np.log(CAUSE_WEIGHT))
"""A cause that explains a throw nearly as well as an object does keeps it below this [-]."""
INTERVALS = 400
"""Throws that widths of intervals are taken from."""

Report = Callable[[int, int], None]


class Errors:
    """Draws what measured throws differ by from simulated ones.

    Parameters
    ----------
    errors : ThrowErrors
        Covariances.
    part : ndarray of int, shape (n_features,)
        Movement of each feature.
    rng : Generator
        Of chance.
    """

    def __init__(
        self, errors: ThrowErrors, *, part: NDArray[np.intp], rng: np.random.Generator
    ) -> None:
        size = len(errors.fixed)
        tiny = 1e-9 * np.trace(errors.changing) / size * np.eye(size)
        self._fixed = np.linalg.cholesky(errors.fixed + tiny)
        self._changing = np.linalg.cholesky(errors.changing + tiny)
        self._timing, self._part, self._rng = errors.timing, part, rng

    def of_switches(self, count: int) -> Floats:
        """Return what stays the same for each of some switches, shape (count, n_features) [N]."""
        return np.asarray(self._rng.standard_normal((count, len(self._fixed))) @ self._fixed.T)

    def of_throws(self, rates: Floats) -> Floats:
        """Return what each of some throws adds, by their rates, shape (count, n_features) [N]."""
        found = self._rng.standard_normal(rates.shape) @ self._changing.T
        shifts = self._timing * self._rng.standard_normal((len(rates), int(self._part.max()) + 1))
        return np.asarray(found + shifts[:, self._part] * rates)


def measured(throws: ThrowSet, errors: Errors) -> Floats:
    """Return features of throws as if each were measured at another switch [N]."""
    return throws.features + errors.of_switches(len(throws.level)) + errors.of_throws(throws.rates)


def alarms_of(view: View, features: Floats) -> tuple[Floats, Floats]:
    """Return log likelihood ratios of throws, and what the best hypothesis leaves of each."""
    alarm, left = [], []
    for first in range(0, len(features), AT_ONCE):
        evidence = evidence_of(view, features[first : first + AT_ONCE])
        alarm.append(ratios_of(view, evidence).alarm)
        left.append(best_square(evidence))
    return np.concatenate(alarm), np.concatenate(left)


def threshold_for(ratios: Floats, *, rate: float) -> float:
    """Return what a share of sound throws exceeds.

    The quantile itself where enough throws lie above it, and never less than what an exponential
    fitted to the highest hundredth gives.

    Parameters
    ----------
    ratios : ndarray, shape (n,)
        Log likelihood ratios of sound throws.
    rate : float
        Share wanted [-].

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> round(float(threshold_for(rng.exponential(size=20000), rate=1e-4)))
    9
    """
    start = float(np.quantile(ratios, 1.0 - TAIL_SHARE))
    excess = ratios[ratios > start] - start
    tail = float(excess.mean()) if excess.size else 0.0
    fitted = start + tail * float(np.log(TAIL_SHARE / rate))
    if rate * len(ratios) < LEAST_IN_TAIL:
        return fitted
    return max(fitted, float(np.quantile(ratios, 1.0 - rate)))


def learn_history(
    knowledge: Knowledge, features: Floats, *, errors: ThrowErrors | None = None
) -> Expectation:
    """Return what sound throws of one switch say of it.

    Parameters
    ----------
    knowledge : Knowledge
        Trained.
    features : ndarray, shape (n_throws, n_features)
        In the order of time [N].
    errors : ThrowErrors, optional
        Assumed; default those of the knowledge.
    """
    model, assumed = knowledge.model, errors or knowledge.errors()
    levels = throw_levels(make_view(knowledge, errors=assumed), features, levels=model.level)
    known = before_history(model, assumed)
    for row, level in zip(features, levels, strict=True):
        known = observe(model, assumed, known, row, level=float(level))
    return known


def throw_levels(view: View, features: Floats, *, levels: Floats) -> Floats:
    """Return the friction level of each throw [-]."""
    return level_of(view, evidence_of(view, features), levels=levels)


def calibrate_alone(
    knowledge: Knowledge,
    sound: ThrowSet,
    objects: ThrowSet,
    *,
    part: str = CYCLE,
    draws: int = 12,
    seed: int = 0,
) -> Calibrated:
    """Return what holds without a history, from single throws of many switches.

    Parameters
    ----------
    knowledge : Knowledge
        That did not see these throws.
    sound, objects : ThrowSet
        Held back.
    part : str
        What is recorded.
    draws : int
        Uses of each sound throw.
    seed : int
        Of chance.
    """
    errors = _errors(knowledge, seed)
    view = make_view(knowledge, part=part)
    found = [alarms_of(view, measured(sound, errors)) for _ in range(draws)]
    ratios = np.concatenate([item[0] for item in found])
    seen = objects.of(np.argsort(errors.of_switches(len(objects.level))[:, 0])[:INTERVALS])
    return _calibrated(
        knowledge,
        part=part,
        history=0,
        ratios=ratios,
        left=np.concatenate([item[1] for item in found]),
        switches=len(sound.level),
        tried=[
            (view, measured(sound.of(slice(INTERVALS)), errors), sound.of(slice(INTERVALS))),
            (view, measured(seen, errors), seen),
        ],  # fmt: skip
    )


def _errors(knowledge: Knowledge, seed: int) -> Errors:
    rng = np.random.default_rng([seed, 11])
    return Errors(knowledge.errors(), part=knowledge.layout.part, rng=rng)


def calibrate_history(
    knowledge: Knowledge,
    throws: ThrowSet,
    *,
    history: int,
    part: str = CYCLE,
    objects: ThrowSet | None = None,
    otherwise: Calibrated | None = None,
    draws: int = 4,
    again: int = 6,
    seed: int = 0,
    report: Report | None = None,
) -> Calibrated | None:
    """Return what holds after a history, from repeated throws of some switches.

    Parameters
    ----------
    knowledge : Knowledge
        That did not see these throws.
    throws : ThrowSet
        Repeated throws; those after the history are judged.
    history : int
        Throws that are known of each switch.
    part : str
        What is recorded.
    objects : ThrowSet, optional
        The same throws with objects, for the widths of intervals.
    otherwise : Calibrated, optional
        Whose widths are taken where these throws say too little.
    draws : int
        Histories of each switch.
    again : int
        Uses of each throw after a history.
    seed : int
        Of chance.
    report : callable, optional
        Called with how many histories are done, and of how many.

    Returns
    -------
    Calibrated or None
        None where no switch has more throws than the history.
    """
    errors = _errors(knowledge, seed + 1)
    numbers = np.unique(throws.switch)
    ratios, left, tried = [], [], []
    for done, (switch, _) in enumerate((s, d) for s in numbers for d in range(draws)):
        own = throws.of(throws.switch == switch)
        if len(own.level) <= history:
            continue
        fixed = errors.of_switches(1)
        known = own.of(slice(history))
        expected = learn_history(knowledge, known.features + fixed + errors.of_throws(known.rates))
        view = make_view(knowledge, part=part, known=expected)
        rest = own.of(slice(history, None))
        for _ in range(again):
            features = rest.features + fixed + errors.of_throws(rest.rates)
            alarm, square = alarms_of(view, features)
            ratios.append(alarm)
            left.append(square)
        if done % draws == 0:
            tried.append((view, features, rest))
            if objects is not None:
                with_object = objects.of((objects.switch == switch) & (objects.force > 0.0))
                moved = fixed + errors.of_throws(with_object.rates)
                tried.append((view, with_object.features + moved, with_object))
        if report is not None:
            report(done + 1, len(numbers) * draws)
    if not ratios:
        return None
    return _calibrated(
        knowledge,
        part=part,
        history=history,
        ratios=np.concatenate(ratios),
        left=np.concatenate(left),
        switches=len(numbers),
        tried=tried,
        otherwise=otherwise,
    )


def _calibrated(
    knowledge: Knowledge,
    *,
    part: str,
    history: int,
    ratios: Floats,
    left: Floats,
    switches: int,
    tried: Sequence[tuple[View, Floats, ThrowSet]],
    otherwise: Calibrated | None = None,
) -> Calibrated:
    thresholds = {
        f"{rate:g}": max(LEAST_THRESHOLD, threshold_for(ratios, rate=SAFETY * rate))
        for rate in RATES
    }
    found = _misses(knowledge, tried, threshold=thresholds[f"{RATES[0]:g}"])
    usual = otherwise or Calibrated(
        part=part, history=0, thresholds={}, throws=0, switches=0, residual=()
    )
    count = len(knowledge.setting.gaps)

    def factors(groups: Sequence[Misses], given: tuple[float, ...]) -> tuple[float, ...]:
        columns = [np.array(group).reshape(-1, count).T for group in groups]
        each = zip(*columns, np.broadcast_to(given, count).tolist(), strict=True)
        return tuple(_factor(*own, otherwise=one) for *own, one in each)

    return Calibrated(
        part=part,
        history=history,
        thresholds=thresholds,
        throws=len(ratios),
        switches=switches,
        residual=tuple(np.quantile(left, RESIDUAL_LEVELS).tolist()),
        size_factor=_factor(np.array(found.size), otherwise=usual.size_factor),
        gap_factor=factors([found.sound, found.unnoticed], usual.gap_factor),
        object_gap_factor=factors([found.alarm], usual.object_gap_factor),
        place_level=level_of_places(found.likelier, otherwise=usual.place_level),
    )


Misses = list[list[float]]


@dataclass(slots=True)
class _Found:
    """By how many half-intervals sizes and gaps were missed, and what is likelier than the place.

    Gaps by throws without an object that is touched, with one that is not noticed, with an alarm.
    """

    size: list[float] = field(default_factory=list)
    likelier: list[float] = field(default_factory=list)
    sound: Misses = field(default_factory=list)
    unnoticed: Misses = field(default_factory=list)
    alarm: Misses = field(default_factory=list)


def _misses(
    knowledge: Knowledge, tried: Sequence[tuple[View, Floats, ThrowSet]], *, threshold: float
) -> _Found:
    """Return what throws with known sizes, places and gaps say of the intervals of these."""
    limits = np.array(knowledge.setting.limits)
    places = np.array(list(knowledge.setting.places.values()))
    found = _Found()
    for view, features, throws in tried:
        held = touched(throws.force)
        for first in range(0, len(features), AT_ONCE):
            evidence = evidence_of(view, features[first : first + AT_ONCE])
            ratio = ratios_of(view, evidence).alarm
            for number in range(len(ratio)):
                at = first + number
                said = posterior_of(view, evidence, number, limits=limits)
                gaps = [miss(g, float(t)) for g, t in zip(said.gaps, throws.gaps[at], strict=True)]
                if ratio[number] <= threshold:
                    (found.unnoticed if held[at] else found.sound).append(gaps)
                    continue
                found.alarm.append(gaps)
                if held[at]:
                    found.size.append(miss(said.size, float(throws.size[at])))
                    nearest = int(np.abs(places - throws.x[at]).argmin())
                    found.likelier.append(likelier(said.place, nearest))
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


def _factor(*groups: Floats, otherwise: float) -> float:
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


LEAST_MISSES = 40


def with_calibration(knowledge: Knowledge, *calibrated: Calibrated | None) -> Knowledge:
    """Return a detector with thresholds."""
    return replace(knowledge, calibrated=tuple(item for item in calibrated if item is not None))
