"""Thresholds and widths of intervals from throws that a detector was not trained on.

Each throw is used several times, with its own discrepancy, noise and timing. Rates below what the
throws support come from an exponential fitted to the highest hundredth.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

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
    fitted = start + float(excess.mean()) * np.log(TAIL_SHARE / rate) if excess.size else start
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
    sizes, gaps, object_gaps = _misses(knowledge, tried)
    return Calibrated(
        part=part,
        history=history,
        thresholds={
            f"{rate:g}": max(LEAST_THRESHOLD, threshold_for(ratios, rate=SAFETY * rate))
            for rate in RATES
        },
        throws=len(ratios),
        switches=switches,
        residual=tuple(np.quantile(left, RESIDUAL_LEVELS).tolist()),
        size_factor=_factor(sizes, otherwise=otherwise.size_factor if otherwise else 1.0),
        gap_factor=_factor(gaps, otherwise=otherwise.gap_factor if otherwise else 1.0),
        object_gap_factor=_factor(
            object_gaps, otherwise=otherwise.object_gap_factor if otherwise else 1.0
        ),
    )


def _misses(
    knowledge: Knowledge, tried: Sequence[tuple[View, Floats, ThrowSet]]
) -> tuple[list[float], list[float], list[float]]:
    """Return by how many half-intervals sizes, gaps, and gaps with a clear object were missed."""
    limits = np.array(knowledge.setting.limits)
    sizes: list[float] = []
    gaps: tuple[list[float], list[float]] = ([], [])
    for view, features, throws in tried:
        for first in range(0, len(features), AT_ONCE):
            rows = slice(first, first + AT_ONCE)
            evidence = evidence_of(view, features[rows])
            seen = ratios_of(view, evidence).alarm > CLEARLY
            for number in range(len(features[rows])):
                found = posterior_of(view, evidence, number, limits=limits)
                at = first + number
                gaps[int(seen[number])].extend(
                    miss(item, float(truth))
                    for item, truth in zip(found.gaps, throws.gaps[at], strict=True)
                )
                if throws.size[at] > 0.0 and seen[number]:
                    sizes.append(miss(found.size, float(throws.size[at])))
    return sizes, *gaps


CLEARLY = 5.0
"""Log likelihood ratio from which on the size of an object means something [-]."""


def miss(interval: Interval, truth: float) -> float:
    """Return how far a truth lies from the middle, in half-intervals on its side; 1 is the edge.

    Examples
    --------
    >>> miss(Interval(middle=1.0, low=0.5, high=3.0), 2.0)
    0.5
    """
    edge = interval.high if truth > interval.middle else interval.low
    return abs(truth - interval.middle) / max(abs(edge - interval.middle), 1e-9)


def _factor(misses: Sequence[float], *, otherwise: float) -> float:
    """Return by how much intervals must be widened to hold 95 %, never narrowed to below half."""
    if len(misses) < LEAST_MISSES:
        return otherwise
    return max(0.5, float(np.quantile(misses, 0.95)))


LEAST_MISSES = 40


def with_calibration(knowledge: Knowledge, *calibrated: Calibrated | None) -> Knowledge:
    """Return a detector with thresholds."""
    return replace(knowledge, calibrated=tuple(item for item in calibrated if item is not None))
