"""Further figures of a detector: rates, causes unknown to it, ice, soft objects, a year."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from os import getloadavg
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.detector_figures import (
    Judged,
    Uses,
    a90,
    changes_of,
    drawn_errors,
    false_alarm_limits,
    measured_by_switch,
    of_each_switch,
)
from benchmarks.studies.detector_unknown import left_out_scores, unknown_figures
from turnout.core.threads import one_blas_thread
from turnout.detection.detector.calibrating import AT_ONCE, Errors, alarms_of, learn_history
from turnout.detection.detector.detector import Detector
from turnout.detection.detector.judging import CYCLE, View, evidence_of, make_view
from turnout.detection.detector.knowledge import Knowledge
from turnout.detection.detector.recorded import Recorded
from turnout.detection.detector.switch_history import observe
from turnout.detection.detector.throw_layout import Layout
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.train_detector import knowledge_of_sets
from turnout.detection.detector.training_plan import HISTORY, OBJECT, SOUND
from turnout.detection.floor import TOUCH_FORCE

Floats = NDArray[np.float64]


def ratios_alone(knowledge: Knowledge, sound: ThrowSet, *, draws: int) -> Floats:
    """Return log likelihood ratios of sound throws, used several times, shape (draws, n) [-]."""
    errors, view = drawn_errors(knowledge, 21), make_view(knowledge)
    return np.array([alarms_of(view, measured_by_switch(sound, errors)) for _ in range(draws)])


def rates_alone(
    knowledge: Knowledge, sound: ThrowSet, ratios: Floats
) -> dict[str, dict[str, float]]:
    """Return false alarms of single sound throws at both thresholds, by `ratios_alone`."""
    calibrated = knowledge.calibration(part=CYCLE, history=0)
    assert calibrated is not None
    return {
        rate: false_alarm_limits(
            [ratios[:, sound.switch == own].ravel() > threshold for own in np.unique(sound.switch)],
            uses=len(ratios),
        )
        for rate, threshold in calibrated.thresholds.items()
    }


def rates_known(
    knowledge: Knowledge,
    ratios: Sequence[Mapping[str, list[float]]],
    *,
    history: int = 20,
    uses: Uses = Uses(),  # noqa: B008 - frozen
) -> dict[str, dict[str, dict[str, float]]]:
    """Return alarms after a history, of sound throws, dry chairs and re-adjusted drives.

    Parameters
    ----------
    knowledge : Knowledge
        With thresholds.
    ratios : sequence of dict
        Of each switch, from `judge_with_history`.
    history : int
        Throws known.
    uses : Uses
        How often each throw was used.
    """
    calibrated = knowledge.calibration(part=CYCLE, history=history)
    assert calibrated is not None
    return {
        rate: {
            name: false_alarm_limits(
                [np.array(item[name]) > threshold for item in ratios],
                uses=uses.sound if name == SOUND else uses.causes,
            )
            for name in ratios[0]
        }
        for rate, threshold in calibrated.thresholds.items()
    }


def known_place_a90(
    knowledge: Knowledge, sound: ThrowSet, objects: ThrowSet, *, rate: float = 1e-3, draws: int = 8
) -> dict[str, float]:
    """Return a90 of the same ratio for a known place [m], to show the cost of not knowing it.

    Object at that place against a sound switch, its threshold taken from the sound throws that are
    judged.
    """
    errors = drawn_errors(knowledge, 23)
    view, sound = make_view(knowledge), sound.of(slice(KNOWN_PLACE_SOUND))
    places = knowledge.setting.places
    of_sound, of_objects = [], []
    for number in range(draws):
        rows = sound.features + errors.of_switches(len(sound.level))
        of_sound.append(_place_ratios(view, rows + errors.of_throws(sound.rates)))
        if number < 2:
            rows = objects.features + errors.of_switches(len(objects.level))
            of_objects.append(_place_ratios(view, rows + errors.of_throws(objects.rates)))
    threshold = np.quantile(np.concatenate(of_sound, axis=1), 1.0 - rate, axis=1)
    near = np.abs(objects.x[:, np.newaxis] - np.array(list(places.values()))).argmin(axis=1)
    found = {}
    for number, name in enumerate(places):
        mine = near == number
        seen = np.concatenate([item[number, mine] > threshold[number] for item in of_objects])
        if seen.size:
            found[name] = a90(np.tile(objects.size[mine], len(of_objects)), seen)
    return found


KNOWN_PLACE_SOUND = 3000
"""Sound throws that the thresholds of known places are taken from."""


def _place_ratios(view: View, features: Floats) -> Floats:
    found = []
    for first in range(0, len(features), AT_ONCE):
        evidence = evidence_of(view, features[first : first + AT_ONCE])
        found.append(evidence.kind[: view.objects] - evidence.sound)
    return np.concatenate(found, axis=1)


def unknown_alone(
    knowledge: Knowledge, sets: Mapping[str, ThrowSet]
) -> dict[str, dict[str, float]]:
    """Return how well each cause differs from sound throws without a history when it is left out.

    An adjustment is part of the population then.
    """
    errors, view = drawn_errors(knowledge, 24), make_view(knowledge)
    calibrated = knowledge.calibration(part=CYCLE, history=0)
    assert calibrated is not None
    measured = {}
    for name, throws in sets.items():
        if name.startswith(HISTORY) or name == "adjustment":
            continue
        own = throws.of(throws.force > TOUCH_FORCE) if name == OBJECT else throws
        change = changes_of(own, sets[HISTORY], knowledge)
        measured[name] = measured_by_switch(own, errors), change
    return unknown_figures([left_out_scores(knowledge, view, calibrated, measured)])


@dataclass(frozen=True, slots=True, kw_only=True)
class Ramp:
    """When growing ice was touched, called, and reported by lock or sensors first [m].

    Attributes
    ----------
    place, touched, called, reported : float
        [m]; infinite where it never was.
    before, early : int
        Throws before the ice is touched, and alarms among them.
    """

    place: float
    touched: float
    called: float
    reported: float
    before: int
    early: int


def ice_ramps(knowledge: Knowledge, ice: ThrowSet, *, known: int = 20) -> list[Ramp]:
    """Judge each throw of growing ice, and learn those that are not called, five at a time."""
    errors = drawn_errors(knowledge, 25)
    population = make_view(knowledge)
    calibrated = knowledge.calibration(part=CYCLE, history=known)
    assert calibrated is not None
    threshold = calibrated.thresholds["0.001"]
    limits = np.array(knowledge.setting.limits)
    assumed, model = knowledge.errors(), knowledge.model
    found = []
    for switch in np.unique(ice.switch):
        own = ice.of(ice.switch == switch)
        fixed = errors.of_switches(1)
        features = own.features + fixed + errors.of_throws(own.rates)
        expected = learn_history(knowledge, features[:known], view=population)
        alarm = np.zeros(len(features), dtype=bool)
        touched = own.force > TOUCH_FORCE
        for first in range(known, len(features), 5):
            rows = np.arange(first, min(first + 5, len(features)))
            view = make_view(knowledge, known=expected)
            alarm[rows] = alarms_of(view, features[rows]) > threshold
            if (alarm & touched).any():
                break
            for row in rows[~alarm[rows]]:
                level = float(own.level[row])
                expected = observe(model, assumed, expected, features[row], level=level)
        before = int(np.count_nonzero(~touched[known:]))
        found.append(
            Ramp(
                place=float(own.x[-1]),
                touched=_first(own.size, touched),
                called=_first(own.size, alarm & touched),
                reported=_first(own.size, (own.gaps >= limits).any(axis=1)),
                before=before,
                early=int(np.count_nonzero(alarm & ~touched)),
            )
        )
    return found


def _first(size: Floats, which: NDArray[np.bool_]) -> float:
    return float(size[np.argmax(which)]) if which.any() else np.inf


def soft_shares(
    knowledge: Knowledge, soft: ThrowSet, kinds: Sequence[str], *, draws: int = 4
) -> dict[str, dict[str, float]]:
    """Return for each kind of object the share of touched ones that is called, and a90 by place."""
    errors = drawn_errors(knowledge, 26)
    view = make_view(knowledge)
    calibrated = knowledge.calibration(part=CYCLE, history=0)
    assert calibrated is not None
    each = int(soft.row.max() + 1) // len(kinds)
    names, places = zip(*knowledge.setting.places.items(), strict=True)
    found = {}
    for number, kind in enumerate(kinds):
        own = soft.of((soft.row // each == number) & (soft.force > 0.0))
        called = []
        for _ in range(draws):
            rows = own.features + errors.of_switches(len(own.level)) + errors.of_throws(own.rates)
            called.append(alarms_of(view, rows) > calibrated.thresholds["0.001"])
        found[kind] = {"touched": float(len(own.level)), "called": float(np.mean(called))}
        near = np.abs(own.x[:, np.newaxis] - np.array(places)).argmin(axis=1)
        for place in np.unique(near):
            mine = near == place
            seen = np.concatenate([item[mine] for item in called])
            found[kind][f"a90, {names[place]}"] = a90(np.tile(own.size[mine], draws), seen)
    return found


def year_rates(
    knowledge: Knowledge, year: ThrowSet, folder: Path, *, known: int = 20, again: int = 17
) -> list[dict[str, float]]:
    """Return false alarms in each month; at its end, throws called sound are learned."""
    population = make_view(knowledge)
    calibrated = knowledge.calibration(part=CYCLE, history=known)
    assert calibrated is not None
    threshold = calibrated.thresholds["0.001"]
    assumed, model = knowledge.errors(), knowledge.model

    def of_switch(number: int) -> dict[str, list[float]]:
        errors = drawn_errors(knowledge, 27, number)
        fixed = errors.of_switches(1)
        first = year.of(year.switch == -1 - number)
        expected = learn_history(
            knowledge, first.features + fixed + errors.of_throws(first.rates), view=population
        )
        found = {}
        for month in range(12):
            own = year.of(year.switch == 12 * number + month)
            view = make_view(knowledge, known=expected)
            uses = [own.features + fixed + errors.of_throws(own.rates) for _ in range(again)]
            ratios = [alarms_of(view, rows) for rows in uses]
            found[str(month)] = np.concatenate(ratios).tolist()
            for row, level, ratio in zip(uses[0], own.level, ratios[0], strict=True):
                if ratio <= threshold:
                    expected = observe(model, assumed, expected, row, level=float(level))
        return found

    switches = np.arange(-int(year.switch.min()))
    months = of_each_switch(switches, folder, of_switch)
    return [
        false_alarm_limits([np.array(item[str(month)]) > threshold for item in months])
        for month in range(12)
    ]


def price_of(
    knowledge: Knowledge,
    train: Mapping[str, ThrowSet],
    test: Mapping[str, ThrowSet],
    *,
    discrepancy: float,
) -> dict[str, dict[str, object]]:
    """Return losses and gains of a detector that assumes a larger discrepancy, without a history.

    a90 at every place [m] and false alarms of test throws whose discrepancy is the drawn one, and
    of such whose discrepancy is that large; of the detector as it is, and of one that assumes it.
    """
    drawn = knowledge.setting.allowances
    larger = replace(drawn, discrepancy=discrepancy)
    rows = {name: item for name, item in train.items() if not name.startswith(HISTORY)}
    setting = replace(knowledge.setting, allowances=larger)
    robust = knowledge_of_sets(rows, setting, draws=4, histories=())
    found: dict[str, dict[str, object]] = {}
    for name, judge in (("as drawn", knowledge), ("larger", robust)):
        calibrated = judge.calibration(part=CYCLE, history=0)
        assert calibrated is not None
        threshold, view = calibrated.thresholds["0.001"], make_view(judge)
        found[name] = {"threshold": threshold}
        for case, errors in (
            ("drawn", drawn_errors(knowledge, 28)),
            ("larger", drawn_errors(robust, 28)),
        ):
            found[name] |= _alarms_and_a90(view, test, errors, threshold, judge, case)
    return found


def _alarms_and_a90(
    view: View,
    test: Mapping[str, ThrowSet],
    errors: Errors,
    threshold: float,
    knowledge: Knowledge,
    case: str,
) -> dict[str, object]:
    objects, sound = test[OBJECT], test[HISTORY]
    called = alarms_of(view, measured_by_switch(objects, errors)) > threshold
    false = alarms_of(view, measured_by_switch(sound, errors)) > threshold
    places = knowledge.setting.places
    near = np.abs(objects.x[:, np.newaxis] - np.array(list(places.values()))).argmin(axis=1)
    return {
        f"a90, {case} discrepancy": {
            name: a90(objects.size[near == number], called[near == number])
            for number, name in enumerate(places)
        },
        f"false alarms, {case} discrepancy": false_alarm_limits(
            [false[sound.switch == own] for own in np.unique(sound.switch)]
        ),
    }


def missed_shares(judged: Judged) -> dict[str, dict[str, float]]:
    """Return shares of touched objects that the detector, lock and end-position sensors miss.

    Lock and sensors see an object by the true gap at the end: lock at the drives, TKK at sensors.
    """
    own = [i for i in judged.of(OBJECT) if judged.touched[i]]
    size = np.array([judged.size[i] for i in own])
    names = [gap.name for gap in judged.verdict[own[0]].gaps]
    limits = np.array([gap.limit for gap in judged.verdict[own[0]].gaps])
    above = np.array([judged.gaps[i] for i in own]) >= limits
    seen = {
        "detector": judged.alarms(np.array(own)),
        "lock": above[:, [name.startswith("drive ") for name in names]].any(axis=1),
        "sensors": above[:, [name.startswith("sensor ") for name in names]].any(axis=1),
    }
    found = {}
    for low, high in itertools.pairwise(SIZES):
        rows = (size >= low) & (size < high)
        if rows.any():
            found[f"{1e3 * low:g} to {1e3 * high:g} mm"] = {"objects": float(rows.sum())} | {
                name: 1.0 - float(item[rows].mean()) for name, item in seen.items()
            }
    return found


SIZES = (0.0, 5e-3, 10e-3, 15e-3, 31e-3)
"""Bounds of sizes that shares of missed objects are given for [m]."""


def scatters(knowledge: Knowledge, sound: ThrowSet, *, history: int = 20) -> dict[str, float]:
    """Return how much more switches vary from throw to throw than is assumed, by their throws [-].

    The factor on the variance that each learns from its first throws, which vary as is assumed.
    """
    population, first = make_view(knowledge), int(np.bincount(sound.switch).max())
    found = []
    for switch in np.unique(sound.switch):
        errors = drawn_errors(knowledge, 30, int(switch))
        own = sound.of((sound.switch == switch) & (sound.row % first < history))
        rows = own.features + errors.of_switches(1) + errors.of_throws(own.rates)
        found.append(learn_history(knowledge, rows, view=population).scatter)
    quantiles = {"median": 0.5, "95 %": 0.95, "largest": 1.0}
    return {name: float(np.quantile(found, share)) for name, share in quantiles.items()}


def verdict_times(
    knowledge: Knowledge, throws: ThrowSet, *, count: int = 200
) -> dict[str, dict[str, float]]:
    """Return processor time of a verdict on a single throw, by its features and recorded.

    Parameters
    ----------
    knowledge : Knowledge
        Judged with, without a history.
    throws : ThrowSet
        Whose first ones are judged.
    count : int
        How many of them.

    Returns
    -------
    dict of str to dict
        Of later throws the median and quantiles, the time of the first of a fresh detector, which
        prepares what all later ones need [s], and the load of the machine [-].
    """
    errors = drawn_errors(knowledge, 29)
    own = throws.of(slice(count))
    rows = own.features + errors.of_switches(len(own.level)) + errors.of_throws(own.rates)
    recordings = [recorded_like(row, knowledge.layout, errors.rng) for row in rows]
    return {
        "features": _times(Detector(knowledge).judge_features, list(rows)),
        "recorded at 1 kHz": _times(Detector(knowledge).predict, recordings),
    }


def _times(judge: Callable[[Any], object], throws: Sequence[Any]) -> dict[str, float]:
    """Return the processor time of judging single throws [s], and the load of the machine."""
    times = []
    with one_blas_thread():
        for throw in [throws[0], *throws]:
            start = process_time()
            judge(throw)
            times.append(process_time() - start)
    quantiles = {"10 %": 0.1, "median": 0.5, "90 %": 0.9}
    found = {name: float(np.quantile(times[1:], share)) for name, share in quantiles.items()}
    return found | {"first": times[0], "load": getloadavg()[0]}


def recorded_like(features: Floats, layout: Layout, rng: np.random.Generator) -> Recorded:
    """Return a recording at 1 kHz of forces with some features, onsets known to some milliseconds.

    Parameters
    ----------
    features : ndarray, shape (n_features,)
        [N]
    layout : Layout
        Of these.
    rng : Generator
        Of noise and onsets.
    """
    time = np.arange(0.0, layout.time.max() + 0.1, 1e-3)
    force = [
        np.interp(time, layout.time[layout.drive == row], features[layout.drive == row])
        for row in range(len(layout.drives))
    ]
    noise = RECORDED_NOISE * rng.standard_normal((len(force), time.size))
    onsets = {part.name: part.start + 3e-3 * rng.standard_normal() for part in layout.parts}
    return Recorded(
        name="", time=time, force=np.array(force) + noise, drives=layout.drives, onsets=onsets
    )


RECORDED_NOISE = 20.0
"""Standard deviation of a sample of such a recording [N]."""
