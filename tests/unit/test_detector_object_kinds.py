"""Of which kind an object is: odds by kind, and what is said where kinds look alike."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from tests.unit.detector_toy import toy_detector, toy_set, toy_setting

from turnout.detection.detector.detector import Detector
from turnout.detection.detector.judging import evidence_of
from turnout.detection.detector.object_kinds import kinds_in_words
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.training import competes, teach

BREAKS = 7.2
"""When a stone of these throws breaks [s]."""


def of_stone(held: ThrowSet, sound: ThrowSet) -> ThrowSet:
    """Return throws whose object leaves nothing from some instant on."""
    after = toy_setting().layout.time > BREAKS
    features = np.where(after, sound.of(held.partner).features, held.features)
    return replace(held, features=features)


@cache
def detector() -> Detector:
    """Return a detector that learned stones, and ice that is as hard as steel."""
    sound, held = toy_set(600), toy_set(500, kind="object")
    sets = {
        "sound": sound,
        "object": held,
        "object-stone": of_stone(held, sound).of(slice(200)),
        "object-ice": held.of(slice(200)),
    }
    taught = teach(sets, toy_setting())
    return Detector(replace(taught, calibrated=toy_detector().knowledge.calibrated))


def test_kinds_that_differ_are_named_and_those_that_do_not_are_not() -> None:
    sound, held = (toy_set(60, sound_seed=3, seed=3, kind=kind) for kind in ("sound", "object"))
    large = (held.size > 14e-3) & (held.x > 1.0) & (held.x < 6.0)
    hard, stone = held.of(large), of_stone(held, sound).of(large)
    assert len(hard.level) >= 5
    view = detector().view()
    assert view.object_kinds is not None
    for throws, words in ((stone, "stone"), (hard, "not identifiable (rigid or ice)")):
        evidence = evidence_of(view, throws.features)
        odds = [view.object_kinds.odds_of(evidence, i) for i in range(len(throws.level))]
        assert np.mean([kinds_in_words(item) == words for item in odds]) >= 0.8
        assert all(next(iter(item.values())) == 1.0 for item in odds)
    said = [detector().judge_features(row) for row in hard.features]
    assert all(item.alarm for item in said)
    assert ", kind not identifiable (rigid or ice)," in said[0].lines()[0]


def test_kinds_change_no_verdict_but_the_kind_and_stay_in_the_file(tmp_path: Path) -> None:
    with_kinds = detector()
    without = Detector(replace(with_kinds.knowledge, object_kinds=None))
    features = toy_set(40, sound_seed=3, seed=3, kind="object").features
    path = tmp_path / "kinds.detector"
    with_kinds.save(path)
    again = Detector.load(path)
    for row in features[::8]:
        one, other = with_kinds.judge_features(row), without.judge_features(row)
        assert replace(one, kinds={}) == other
        assert bool(one.kinds) == one.alarm
        kept = again.judge_features(row).kinds
        assert set(kept) == set(one.kinds)
        assert all(abs(kept[name] - one.kinds[name]) < 0.02 for name in kept)


def test_a_weak_supply_competes_where_a_second_drive_or_a_current_tells_it_apart() -> None:
    setting = toy_setting()
    alone = replace(setting, layout=replace(setting.layout, drives=("1",)))
    assert competes("supply", setting)
    assert not competes("supply", alone)
    assert competes("supply", replace(alone, quantity="current"))
    assert competes("in-drive", alone)
