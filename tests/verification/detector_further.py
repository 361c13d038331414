"""Further figures of a detector: rates, causes unknown to it, ice, soft objects, a year."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time

import numpy as np
from numpy.typing import NDArray
from tests.verification.detector_figures import (
    a90,
    drawn_errors,
    false_alarm_limits,
    measured_by_switch,
    of_each_switch,
)

from turnout.core.threads import one_blas_thread
from turnout.detection.detector.calibrating import AT_ONCE, alarms_of, learn_history
from turnout.detection.detector.detector import Detector
from turnout.detection.detector.judging import CYCLE, View, evidence_of, make_view
from turnout.detection.detector.knowledge import Knowledge
from turnout.detection.detector.switch_history import observe
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.train_detector import knowledge_of_sets
from turnout.detection.detector.training_plan import HISTORY, OBJECT, SOUND
from turnout.open_benchmark.metrics import auroc

Floats = NDArray[np.float64]


def rates_alone(
    knowledge: Knowledge, sound: ThrowSet, *, draws: int = 7
) -> dict[str, dict[str, float]]:
    """Return false alarms of single sound throws, each used several times, at both thresholds."""
    errors = drawn_errors(knowledge, 21)
    view = make_view(knowledge)
    found = [alarms_of(view, measured_by_switch(sound, errors))[0] for _ in range(draws)]
    ratios = np.array(found)
    calibrated = knowledge.calibration(part=CYCLE, history=0)
    assert calibrated is not None
    return {
        rate: false_alarm_limits(
            [ratios[:, sound.switch == own].ravel() > threshold for own in np.unique(sound.switch)]
        )
        for rate, threshold in calibrated.thresholds.items()
    }


def rates_known(
    knowledge: Knowledge, ratios: Sequence[Mapping[str, list[float]]], *, history: int = 20
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
    """
    calibrated = knowledge.calibration(part=CYCLE, history=history)
    assert calibrated is not None
    return {
        rate: {
            name: false_alarm_limits([np.array(item[name]) > threshold for item in ratios])
            for name in ratios[0]
        }
        for rate, threshold in calibrated.thresholds.items()
    }


def known_place_a90(
    knowledge: Knowledge, sound: ThrowSet, objects: ThrowSet, *, rate: float = 1e-3, draws: int = 8
) -> dict[str, float]:
    """Return a90 of the same ratio where the place is known [m]: what not knowing it costs.

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


def unknown_auroc(
    knowledge: Knowledge, sets: Mapping[str, ThrowSet], *, draws: int = 2
) -> dict[str, float]:
    """Return for each cause how well its throws differ from sound ones when it is left out.

    Area under the curve of what the best of the remaining hypotheses leaves.
    """
    errors = drawn_errors(knowledge, 24)
    view = make_view(knowledge)
    found = {}
    for name in (*(item for item in knowledge.causes if item in sets), OBJECT):
        left_out = np.arange(view.objects) if name == OBJECT else np.array([view.kinds.index(name)])
        squares = {}
        for kind in (SOUND, name):
            item = sets[kind].of(slice(600))
            parts = []
            for _ in range(draws):
                rows = item.features + errors.of_switches(len(item.level))
                rows = rows + errors.of_throws(item.rates)
                parts.append(_left_by_others(view, rows, left_out))
            squares[kind] = np.concatenate(parts)
        found[name] = auroc(squares[name], squares[SOUND])
    return found


def _left_by_others(view: View, features: Floats, left_out: NDArray[np.intp]) -> Floats:
    found = []
    for first in range(0, len(features), AT_ONCE):
        evidence = evidence_of(view, features[first : first + AT_ONCE])
        kept = ~np.isin(evidence.hypotheses.kind, left_out)
        found.append(np.minimum(evidence.own.min(axis=0), evidence.square[kept].min(axis=0)))
    return np.concatenate(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ramp:
    """When growing ice was found [m], and what lock and sensors reported first [m]."""

    place: float
    called: float
    reported: float


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
        called = np.inf
        for first in range(known, len(features), 5):
            rows = features[first : first + 5]
            alarms = alarms_of(make_view(knowledge, known=expected), rows)[0] > threshold
            if alarms.any():
                called = float(own.size[first + int(np.argmax(alarms))])
                break
            for row, level in zip(rows, own.level[first : first + 5], strict=True):
                expected = observe(model, assumed, expected, row, level=float(level))
        above = (own.gaps >= limits).any(axis=1)
        reported = float(own.size[np.argmax(above)]) if above.any() else np.inf
        found.append(Ramp(place=float(own.x[-1]), called=called, reported=reported))
    return found


def soft_shares(
    knowledge: Knowledge, soft: ThrowSet, kinds: Sequence[str], *, draws: int = 4
) -> dict[str, dict[str, float]]:
    """Return for each kind of object the share that is called, of those that are touched."""
    errors = drawn_errors(knowledge, 26)
    view = make_view(knowledge)
    calibrated = knowledge.calibration(part=CYCLE, history=0)
    assert calibrated is not None
    each = int(soft.row.max() + 1) // len(kinds)
    found = {}
    for number, kind in enumerate(kinds):
        own = soft.of((soft.row // each == number) & (soft.force > 0.0))
        called = []
        for _ in range(draws):
            rows = own.features + errors.of_switches(len(own.level)) + errors.of_throws(own.rates)
            called.append(alarms_of(view, rows)[0] > calibrated.thresholds["0.001"])
        found[kind] = {
            "touched": float(len(own.level)),
            "called": float(np.mean(called)),
            "a90": a90(np.tile(own.size, draws), np.concatenate(called)),
        }
    return found


def year_rates(
    knowledge: Knowledge, year: ThrowSet, folder: Path, *, known: int = 20, again: int = 17
) -> list[dict[str, float]]:
    """Return false alarms in each month; every month ends with learning what was called sound."""
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
            ratios = [alarms_of(view, rows)[0] for rows in uses]
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
) -> dict[str, dict[str, float]]:
    """Return a90 without a history of detectors that assume the drawn discrepancy, and more [m].

    Both learn and take thresholds in the same way; test throws differ by the drawn discrepancy.
    """
    drawn = knowledge.setting.allowances
    found = {}
    for share in (drawn.discrepancy, discrepancy):
        setting = replace(knowledge.setting, allowances=replace(drawn, discrepancy=share))
        other = knowledge_of_sets(
            {name: item for name, item in train.items() if not name.startswith(HISTORY)},
            setting,
            draws=4,
        )
        errors = drawn_errors(knowledge, 28)
        view, objects = make_view(other), test[OBJECT]
        calibrated = other.calibration(part=CYCLE, history=0)
        assert calibrated is not None
        rows = objects.features + errors.of_switches(len(objects.level))
        seen = alarms_of(view, rows + errors.of_throws(objects.rates))[0]
        called = seen > calibrated.thresholds["0.001"]
        places = knowledge.setting.places
        near = np.abs(objects.x[:, np.newaxis] - np.array(list(places.values()))).argmin(axis=1)
        found[f"{share:g}"] = {
            name: a90(objects.size[near == number], called[near == number])
            for number, name in enumerate(places)
        }
    return found


def verdict_times(knowledge: Knowledge, objects: ThrowSet, *, count: int = 200) -> dict[str, float]:
    """Return processor time of a verdict on a single throw [s]."""
    errors = drawn_errors(knowledge, 29)
    own = objects.of(slice(count))
    rows = own.features + errors.of_switches(len(own.level)) + errors.of_throws(own.rates)
    detector = Detector(knowledge)
    detector.judge_features(rows[0])
    times = []
    with one_blas_thread():
        for row in rows:
            start = process_time()
            detector.judge_features(row)
            times.append(process_time() - start)
    return {"median": float(np.median(times)), "90 %": float(np.quantile(times, 0.9))}
