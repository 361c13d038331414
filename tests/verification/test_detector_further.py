"""Figures of a detector that need no throws of a solver, on the toy."""

import numpy as np
import pytest
from benchmarks.studies.detector_further import recorded_like, scatters, verdict_times
from tests.unit.detector_toy import toy_detector, toy_set

from turnout.detection.detector.recorded import features_of_recorded


def test_switches_that_vary_as_is_assumed_show_it() -> None:
    sound = toy_set(60, seed=11, sound_seed=11, repeats=12)
    found = scatters(toy_detector().knowledge, sound, history=10)
    assert 1.0 <= found["median"] <= found["95 %"] <= found["largest"]
    assert found["95 %"] < 1.2


def test_a_recording_has_the_features_it_is_made_of() -> None:
    knowledge = toy_detector().knowledge
    features = knowledge.model.mean[5][: knowledge.layout.size]
    throw = recorded_like(features, knowledge.layout, np.random.default_rng(3))
    assert throw.time[1] - throw.time[0] == pytest.approx(1e-3)
    onsets = {part.name: part.start for part in knowledge.layout.parts}
    again = features_of_recorded(throw, knowledge.layout, onsets)
    inner = np.abs(np.diff(features, n=2, prepend=0.0, append=0.0)) < 50.0
    assert again[inner] == pytest.approx(features[inner], abs=30.0)


def test_times_are_given_by_features_and_recorded() -> None:
    found = verdict_times(toy_detector().knowledge, toy_set(5, kind="object"), count=5)
    assert set(found) == {"features", "recorded at 1 kHz"}
    for own in found.values():
        assert 0.0 < own["10 %"] <= own["median"] <= own["90 %"]
        assert own["first"] > 0.0
        assert own["load"] >= 0.0
