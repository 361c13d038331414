"""Thresholds and widths of intervals from throws that a detector was not trained on.

Each throw is used several times, with its own discrepancy, noise and timing.
"""

import itertools
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from turnout.core.progress import Pace
from turnout.core.workers import Workers
from turnout.detection.alarm_threshold import RATES, thresholds_of
from turnout.detection.detector.interval_widths import (
    AT_ONCE,
    Misses,
    ThrowAnswers,
    Tried,
    answers_of,
    factor_of,
    factor_of_objects,
    level_of_places,
    missed_of,
    reach_of_call,
    sides_of,
)
from turnout.detection.detector.judging import (
    CAUSE_WEIGHT,
    CYCLE,
    SPEED,
    View,
    evidence_of,
    level_of,
    make_view,
    ratios_of,
    support_of,
    unexplained,
)
from turnout.detection.detector.knowledge import RESIDUAL_LEVELS, Calibrated, Knowledge
from turnout.detection.detector.switch_history import (
    Expectation,
    ThrowErrors,
    before_history,
    observe_all,
)
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.likelihood import Evidence
from turnout.study.defects import DEFECTS

Floats = NDArray[np.float64]
Judged = tuple[Floats, Floats, Floats, Floats]
"""Alarm, causes, square and irregularity of sound throws."""

LEAST_THRESHOLD = 1.0 - float(np.log(CAUSE_WEIGHT))
"""A cause that explains a throw nearly as well as an object does keeps it below this [-]."""
INTERVALS, INTERVAL_DRAWS = 800, 2
"""Throws of a kind that widths of intervals are taken from, and how often each is used."""
GAP_DRAWS = 8
"""End gaps of each of these, which differ from the simulated ones."""
CAUSE_RATE = 1e-2
"""Share of sound throws in which each other cause has more support than it is named from [-]."""
LEAST_CAUSE = float(np.log(20.0))
"""Support below which no other cause is named [-]."""
LEAST_SPEED = float(np.log(1e6))
"""The same for another speed, since an onset found some 10 ms off looks like a little of it [-]."""


def _least_support(cause: str) -> float:
    """Return the support below which a cause is not named [-]."""
    if cause == SPEED:
        return LEAST_SPEED
    own = DEFECTS[cause].least_support if cause in DEFECTS else None
    return LEAST_CAUSE if own is None else own


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
        self._timing, self._gap, self._part, self.rng = errors.timing, errors.gap, part, rng

    def of_switches(self, count: int) -> Floats:
        """Return what stays the same for each of some switches, shape (count, n_features) [N]."""
        return np.asarray(self.rng.standard_normal((count, len(self._fixed))) @ self._fixed.T)

    def of_throws(self, rates: Floats) -> Floats:
        """Return what each of some throws adds, by their rates, shape (count, n_features) [N]."""
        found = self.rng.standard_normal(rates.shape) @ self._changing.T
        shifts = self._timing * self.rng.standard_normal((len(rates), int(self._part.max()) + 1))
        return np.asarray(found + shifts[:, self._part] * rates)

    def true_gaps(self, throws: ThrowSet, count: int) -> Floats:
        """Return end gaps off the simulated ones as is assumed, shape (count, n, n_gaps) [m]."""
        return throws.gaps + self._gap * self.rng.standard_normal((count, *throws.gaps.shape))

    def tried(self, features: Floats, throws: ThrowSet) -> Tried:
        """Return throws with drawn errors that widths of intervals are taken from."""
        return Tried(features=features, throws=throws, gaps=self.true_gaps(throws, GAP_DRAWS))


def measured(throws: ThrowSet, errors: Errors) -> Floats:
    """Return features of throws as if each were measured at another switch [N]."""
    return throws.features + errors.of_switches(len(throws.level)) + errors.of_throws(throws.rates)


def alarms_of(view: View, features: Floats) -> Floats:
    """Return log likelihood ratios of an object against everything else, shape (n_throws,) [-]."""
    return np.concatenate([ratios_of(view, some).alarm for some in _weighed(view, features)])


def _weighed(view: View, features: Floats) -> Iterator[Evidence]:
    """Yield what throws say of all hypotheses, some throws at a time."""
    for first in range(0, len(features), AT_ONCE):
        yield evidence_of(view, features[first : first + AT_ONCE])


def _said_of_sound(view: View, features: Floats) -> Judged:
    """Return alarm, causes, square and irregularity of sound throws.

    The first is the log likelihood ratio of an object against everything else, shape (n_throws,),
    the second the support of every other cause, shape (n_throws, n_causes).
    """
    found = []
    for evidence in _weighed(view, features):
        ratios, left = ratios_of(view, evidence), unexplained(view, evidence)
        found.append((ratios.alarm, support_of(view, ratios, left[1]).T, *left))
    alarm, cause, square, irregularity = (np.concatenate(item) for item in zip(*found, strict=True))
    return alarm, cause, square, irregularity


def learn_history(
    knowledge: Knowledge,
    features: Floats,
    *,
    errors: ThrowErrors | None = None,
    view: View | None = None,
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
    view : View, optional
        Of the population, that friction levels are taken with; made where it is not given.
    """
    model, assumed = knowledge.model, errors or knowledge.errors()
    population = view or make_view(knowledge, errors=assumed)
    levels = throw_levels(population, features, levels=model.level)
    return observe_all(model, assumed, before_history(model, assumed), features, levels=levels)


def throw_levels(view: View, features: Floats, *, levels: Floats) -> Floats:
    """Return the friction level of each throw [-]."""
    return level_of(view, evidence_of(view, features), levels=levels)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fold:
    """A detector, and the throws that it did not learn from.

    Attributes
    ----------
    knowledge : Knowledge
        Without thresholds.
    sound, objects : ThrowSet
        Held back.
    group : ndarray of int, shape (n_sound,)
        Of the switch of each sound throw: switches of a group share their sections.
    """

    knowledge: Knowledge
    sound: ThrowSet
    objects: ThrowSet
    group: NDArray[np.intp]


def calibrate_alone(
    folds: Sequence[Fold],
    *,
    part: str = CYCLE,
    draws: int = 16,
    seed: int = 0,
    workers: Workers | None = None,
    pace: Pace | None = None,
) -> Calibrated:
    """Return what holds without a history, from single throws of many switches.

    The detectors of all folds share the thresholds (cross-fitting), so that every switch counts:
    few of them raise most of the false alarms, and a single fold knows too few of these.

    Parameters
    ----------
    folds : sequence of Fold
        Each switch is held back in one of them.
    part : str
        What is recorded.
    draws : int
        Uses of each sound throw.
    seed : int
        Of chance.
    workers : Workers, optional
        Processes, which take a fold each.
    pace : Pace, optional
        Counts the folds.
    """
    share, pace = INTERVALS // len(folds), pace or Pace()
    pace.begin(kind := thresholds_after(0, part), len(folds))
    jobs = [
        partial(_judge_alone, fold, part=part, draws=draws, share=share, seed=seed + FOLD_SEED * n)
        for n, fold in enumerate(folds)
    ]
    made = dict[int, _Judging]()
    for number, (judging, cost) in (workers or Workers(0)).run(jobs):
        made[number] = judging
        pace.count(kind, cost=cost)
    switches = sum(len(np.unique(fold.sound.switch)) for fold in folds)
    usual = Calibrated(part=part, history=0, thresholds={}, throws=0, switches=switches)
    return _calibrated(folds[0].knowledge, usual, [made[number] for number in range(len(folds))])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Judging:
    """Judgements of throws that a detector did not learn from.

    Attributes
    ----------
    sound : Judged
        Of sound throws.
    group : ndarray of int, shape (n_sound,)
        Of their switches.
    answers : list of ThrowAnswers
        Of some, and of throws with objects.
    """

    sound: Judged
    group: NDArray[np.intp]
    answers: list[ThrowAnswers]


def _judge_alone(
    fold: Fold, *, part: str, draws: int, share: int, seed: int
) -> tuple[_Judging, float]:
    """Judge the sound throws of a fold; return the time of that too [s]."""
    errors, tried, began = _errors(fold.knowledge, seed), list[Tried](), time.perf_counter()
    view = make_view(fold.knowledge, part=part)
    sound = [_said_of_sound(view, measured(fold.sound, errors)) for _ in range(draws)]
    for _ in range(INTERVAL_DRAWS):
        for throws in (fold.sound, fold.objects):
            some = throws.of(errors.rng.permutation(len(throws.level))[:share])
            tried.append(errors.tried(measured(some, errors), some))
    judging = _Judging(
        sound=_joined(sound),
        group=np.tile(fold.group, draws),
        answers=answers_of(fold.knowledge, view, tried, least=LEAST_THRESHOLD),
    )
    return judging, time.perf_counter() - began


def _joined(judged: Iterable[Judged]) -> Judged:
    alarm, causes, square, irregularity = map(np.concatenate, zip(*judged, strict=True))
    return alarm, causes, square, irregularity


FOLD_SEED = 1000


def _errors(knowledge: Knowledge, seed: int) -> Errors:
    rng = np.random.default_rng([seed, 11])
    return Errors(knowledge.errors(), part=knowledge.layout.part, rng=rng)


def thresholds_after(history: int, part: str = CYCLE) -> str:
    """Return the name of thresholds in reports of progress."""
    return f"thresholds after {history} throws" if history else f"thresholds of the {part}"


def calibrate_history(
    folds: Sequence[Fold],
    throws: ThrowSet,
    *,
    history: int,
    alone: Mapping[str, Calibrated],
    objects: ThrowSet | None = None,
    draws: int = 4,
    again: int = 24,
    seed: int = 0,
    workers: Workers | None = None,
    pace: Pace | None = None,
) -> list[Calibrated]:
    """Return what holds after a history, from repeated throws of some switches.

    Parameters
    ----------
    folds : sequence of Fold
        Whose detectors take turns, switch by switch.
    throws : ThrowSet
        Repeated throws of switches that none of them learned from.
    history : int
        Throws that are known of each switch.
    alone : mapping of str to Calibrated
        What holds without a history for each part that is recorded: where these throws say too
        little of widths, that is taken.
    objects : ThrowSet, optional
        The same throws with objects, for the widths of intervals.
    draws : int
        Histories of each switch.
    again : int
        Uses of each throw after a history.
    seed : int
        Of chance.
    workers : Workers, optional
        Processes, which take a fold each.
    pace : Pace, optional
        Counts the histories.

    Returns
    -------
    list of Calibrated
        For each part; none where no switch has more throws than the history.
    """
    numbers, pace, workers = np.unique(throws.switch), pace or Pace(), workers or Workers(0)
    pace.begin(kind := thresholds_after(history), len(numbers) * draws)
    jobs, turns = list[partial[tuple[dict[tuple[int, int], _ByPart], float]]](), list[int]()
    for turn, fold in enumerate(folds):
        own = throws.of(throws.switch % len(folds) == turn)
        errors = _errors(fold.knowledge, seed + 1 + FOLD_SEED * turn)
        counts = {"history": history, "draws": draws, "again": again}
        jobs.append(partial(_judge_histories, fold, own, objects, errors, tuple(alone), **counts))
        turns.append(len(np.unique(own.switch)) * draws)
    made = dict[tuple[int, int], _ByPart]()
    for turn, (found, cost) in workers.run(jobs):
        made |= found
        pace.count(kind, turns[turn], cost=cost)
    return [
        _calibrated(
            folds[0].knowledge,
            replace(other, history=history, switches=len(numbers)),
            [made[number][part] for number in sorted(made)],
        )
        for part, other in alone.items()
        if made
    ]


_ByPart = dict[str, _Judging]
"""Judgements of a switch after a history, by the part that is recorded."""


def _judge_histories(
    fold: Fold,
    throws: ThrowSet,
    objects: ThrowSet | None,
    drawn: Errors,
    parts: Sequence[str],
    *,
    history: int,
    draws: int,
    again: int,
) -> tuple[dict[tuple[int, int], _ByPart], float]:
    """Judge switches after histories, by switch and draw; return the time of that too [s]."""
    knowledge, began = fold.knowledge, time.perf_counter()
    found = dict[tuple[int, int], _ByPart]()
    population = make_view(knowledge)
    for switch, draw in itertools.product(np.unique(throws.switch).tolist(), range(draws)):
        own = throws.of(throws.switch == switch)
        if len(own.level) <= history:
            continue
        known, later = known_and_later(own, history=history, draw=draw, rng=drawn.rng)
        fixed = drawn.of_switches(1)
        learned = known.features + fixed + drawn.of_throws(known.rates)
        expected = learn_history(knowledge, learned, view=population)
        features = [later.features + fixed + drawn.of_throws(later.rates) for _ in range(again)]
        # the same for every part, so that none depends on which parts there are
        held = [drawn.tried(rows, later) for rows in features[:INTERVAL_DRAWS]]
        held += _with_objects(objects, switch, fixed, drawn)
        group, judged = np.tile(later.switch, again), _ByPart()
        for part in parts:
            view = make_view(knowledge, part=part, known=expected)
            judged[part] = _Judging(
                sound=_said_of_sound(view, np.concatenate(features)),
                group=group,
                answers=answers_of(knowledge, view, held, least=LEAST_THRESHOLD),
            )
        found[switch, draw] = judged
    return found, time.perf_counter() - began


def _with_objects(
    objects: ThrowSet | None, switch: int, fixed: Floats, errors: Errors
) -> list[Tried]:
    """Return throws of a switch with objects and drawn errors."""
    if objects is None:
        return []
    held = objects.of((objects.switch == switch) & (objects.force > 0.0))
    return [
        errors.tried(held.features + fixed + errors.of_throws(held.rates), held)
        for _ in range(INTERVAL_DRAWS)
    ]


def known_and_later(
    throws: ThrowSet, *, history: int, draw: int, rng: np.random.Generator
) -> tuple[ThrowSet, ThrowSet]:
    """Return the throws of a switch that are known, and those that are judged.

    At first its first throws, then some drawn from all of them, so that every throw is judged: a
    quantile of the same few throws would rest on two or three from high friction.
    """
    if draw:
        throws = throws.of(rng.permutation(len(throws.level)))
    return throws.of(slice(history)), throws.of(slice(history, history + MOST_LATER))


MOST_LATER = 6
"""Throws judged after a history."""


def _calibrated(
    knowledge: Knowledge, usual: Calibrated, judgings: Sequence[_Judging]
) -> Calibrated:
    """Return thresholds and widths; those of `usual` where the throws say too little.

    Upper limits count groups of switches: those that share their sections are alike.
    """
    ratios, causes, left, irregular = _joined(own.sound for own in judgings)
    group = np.concatenate([own.group for own in judgings])
    thresholds = thresholds_of(ratios, group=group, usual=usual.thresholds, least=LEAST_THRESHOLD)
    answers = itertools.chain.from_iterable(own.answers for own in judgings)
    found = missed_of(answers, threshold=thresholds[f"{RATES[0]:g}"])
    count = len(knowledge.setting.gaps)

    def each_gap(group: Misses) -> Floats:
        """Return misses of each gap, shape (n_gaps, n_throws, n_draws)."""
        return np.moveaxis(np.array(group).reshape(-1, GAP_DRAWS, count), -1, 0)

    gap_factor = tuple(
        sides_of(sound, unnoticed, otherwise=(float(low), float(high)))
        for sound, unnoticed, (low, high) in zip(
            each_gap(found.sound),
            each_gap(found.unnoticed),
            np.broadcast_to(usual.gap_factor, (count, 2)),
            strict=True,
        )
    )
    given = np.broadcast_to(usual.object_gap_factor, count).tolist()
    object_gap_factor = tuple(
        factor_of(own, otherwise=one) for own, one in zip(each_gap(found.alarm), given, strict=True)
    )
    least_support = [_least_support(name) for name in knowledge.causes]
    # a cause without a signature has no support at all
    rare = np.quantile(np.maximum(causes, least_support), 1.0 - CAUSE_RATE, axis=0)
    return replace(
        usual,
        thresholds=thresholds,
        throws=len(ratios),
        groups=len(np.unique(group)),
        residual=tuple(np.quantile(left, RESIDUAL_LEVELS).tolist()),
        irregularity=tuple(np.quantile(irregular, RESIDUAL_LEVELS).tolist()),
        cause_thresholds={
            name: float(value) for name, value in zip(knowledge.causes, rare, strict=True)
        },
        size_factor=factor_of_objects(found.size, otherwise=usual.size_factor),
        x_factor=factor_of_objects(found.x, otherwise=usual.x_factor),
        gap_factor=gap_factor,
        object_gap_factor=object_gap_factor,
        gap_reach=reach_of_call(
            found.open,
            factors=[high for _low, high in gap_factor],
            object_factors=object_gap_factor,
            otherwise=np.broadcast_to(usual.gap_reach, count).tolist(),
        ),
        place_level=level_of_places(found.likelier, otherwise=usual.place_level),
    )


def with_calibration(knowledge: Knowledge, calibrated: Sequence[Calibrated]) -> Knowledge:
    """Return a detector with thresholds."""
    return replace(knowledge, calibrated=tuple(calibrated))
