"""Thresholds of a detector: their confidence, and the throws behind them."""

from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np
import pytest
from tests.unit.detector_toy import toy_detector, toy_set, toy_setting, toy_training

from turnout.detection.alarm_threshold import confident_threshold, threshold_for
from turnout.detection.detector import calibrating, train_detector, training
from turnout.detection.detector.calibrating import known_and_later
from turnout.detection.detector.judging import SPEED, UNUSUAL
from turnout.detection.detector.knowledge import Knowledge, Setting
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.train_detector import folds_of, knowledge_of_sets
from turnout.detection.detector.training_sets import after_history


def test_thresholds_keep_their_rate_on_other_switches_although_few_raise_the_alarms() -> None:
    """One switch in 200 raises half of the alarms: the rate of a second draw is kept in 95 %."""

    def thrown(seed: int, switches: int) -> tuple[np.ndarray, np.ndarray]:
        rng = np.random.default_rng([seed, 3])
        shift = np.where(rng.random(switches) < 0.005, 6.0, 0.0)
        ratios = shift[:, np.newaxis] + rng.exponential(1.0, (switches, 20))
        return ratios.ravel(), np.repeat(np.arange(switches), 20)

    many, _ = thrown(99, 50_000)
    kept = {"estimate": 0, "confident": 0}
    for seed in range(20):
        ratios, switch = thrown(seed, 600)
        estimate = threshold_for(ratios, rate=2e-3)
        confident = confident_threshold(ratios, rate=2e-3, group=switch, seed=seed)
        assert confident >= estimate
        kept["estimate"] += bool((many > estimate).mean() <= 2e-3)
        kept["confident"] += bool((many > confident).mean() <= 2e-3)
    assert kept["estimate"] <= 17
    assert kept["confident"] >= 18


def test_every_switch_is_held_back_once_from_a_detector_that_did_not_learn_from_it() -> None:
    sets = {
        "sound": toy_set(640),
        "object": toy_set(500, kind="object"),
        "dry chairs": toy_set(60, kind="dry chairs"),
    }
    folds = folds_of(sets, toy_setting(), count=4)
    held = np.concatenate([fold.sound.row for fold in folds])
    assert sorted(held.tolist()) == list(range(640))
    objects = np.concatenate([fold.objects.partner for fold in folds])
    assert sorted(objects.tolist()) == np.flatnonzero(sets["object"].force > 0.0).tolist()
    for fold in folds:
        assert not set(fold.objects.partner) - set(fold.sound.row)
        assert fold.knowledge.causes == ("dry chairs", "force sensor", SPEED, UNUSUAL)
        # what a fold learned from objects and what it holds back make up all of them
        learned = np.count_nonzero(fold.knowledge.signatures.kind < len(fold.knowledge.places))
        assert learned + len(fold.objects.row) == len(objects)


def test_a_switch_with_a_history_is_learned_by_all_folds_but_that_which_judges_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    learned, known = list[set[int]](), toy_detector().knowledge

    def recorded(sets: Mapping[str, ThrowSet], setting: Setting) -> Knowledge:
        learned.append(set(sets["history"].switch.tolist()))
        return known

    monkeypatch.setattr(train_detector, "teach", recorded)
    sets = {
        "sound": toy_set(640),
        "object": toy_set(100, kind="object"),
        "history": toy_set(60, seed=9, sound_seed=9, repeats=6),
    }
    folds = folds_of(sets, toy_setting(), count=4)
    assert learned == [{n for n in range(10) if n % 4 != fold} for fold in range(4)]
    for number, fold in enumerate(folds):
        repeated = fold.sound.switch >= 640  # numbered after those of single throws
        assert set(fold.sound.switch[repeated] - 640) == {n for n in range(10) if n % 4 == number}
        assert set(fold.group[repeated]) == set(fold.sound.switch[repeated])


def test_throws_judged_after_a_history_are_not_always_the_last_ones() -> None:
    """The naming limit after 5 throws rested on 6 of 26: three from high friction made it 25."""
    throws, rng = toy_set(26, repeats=26), np.random.default_rng(3)
    known, later = known_and_later(throws, history=5, draw=0, rng=rng)
    assert (known.row.tolist(), later.row.tolist()) == ([0, 1, 2, 3, 4], [5, 6, 7, 8, 9, 10])
    seen = set(later.row.tolist())
    for draw in range(1, 8):
        known, later = known_and_later(throws, history=5, draw=draw, rng=rng)
        assert len(known.row) == 5
        assert not set(known.row) & set(later.row)
        seen |= set(later.row.tolist())
    assert len(seen) >= 20


def test_a_threshold_after_a_history_of_few_switches_is_not_below_that_of_many(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In a training of few throws, whose histories say too little of widths."""
    monkeypatch.setattr(training, "LEAST_SOUND", 60)
    monkeypatch.setattr(calibrating, "INTERVALS", 60)
    monkeypatch.setattr(calibrating, "INTERVAL_DRAWS", 1)
    monkeypatch.setattr(train_detector, "folds_of", partial(folds_of, count=2))
    history = {"seed": 9, "sound_seed": 9, "repeats": 7}
    sets = {
        "sound": toy_set(128),
        "object": toy_set(128, kind="object"),
        "dry chairs": toy_set(40, kind="dry chairs"),
        "history": toy_set(14, **history),
        after_history("object"): toy_set(14, kind="object", **history),
    }
    found = knowledge_of_sets(sets, toy_setting(), draws=1, history_draws=1, histories=(5,))
    calibrated = found.calibrated
    alone = {item.part: item for item in calibrated if not item.history}
    after = [item for item in calibrated if item.history]
    assert [item.part for item in after] == list(alone) == ["cycle", "closing"]
    for item in after:
        assert item.gap_factor == alone[item.part].gap_factor != ((1.0, 1.0),)
        for rate, threshold in item.thresholds.items():
            assert threshold >= alone[item.part].thresholds[rate]


@pytest.mark.long
def test_training_gives_the_thresholds_that_are_stored() -> None:
    stored = toy_detector().knowledge.calibrated
    for item, own in zip(toy_training().calibrated, stored, strict=True):
        numbers = {name: value for name, value in asdict(own).items() if name != "part"}
        assert item.part == own.part
        for name, wanted in numbers.items():
            assert _flat(asdict(item)[name]) == pytest.approx(_flat(wanted), rel=1e-6), name


def _flat(value: Any) -> list[float]:
    """Return the numbers of a mapping, of tuples or alone."""
    within = value.values() if isinstance(value, dict) else np.ravel(value)
    return [float(item) for item in within]
