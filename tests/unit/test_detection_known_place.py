"""The known-place bound on toys with closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm
from tests.unit.detection_throws import toy_throws

from turnout.detection.limit.bound import detection_index, predictive
from turnout.detection.limit.known_place import (
    Population,
    draw_sound,
    known_place_power,
    threshold_of,
)
from turnout.detection.limit.known_place_map import known_place_map, known_rows
from turnout.detection.limit.limit_map import limit_map
from turnout.detection.population import Local
from turnout.detection.reference import Conditions

RATE = 1e-3
CLOSING = 0.8
ROOT = np.array([[2.0, 0.0, 0.0], [1.0, 1.5, 0.0], [-0.5, 0.3, 1.0]])
WAY = np.array([1.0, -2.0, 0.5])


def one_level(covariance: np.ndarray, shift: np.ndarray | None = None) -> Population:
    size = len(covariance)
    return Population(
        level=np.array([0.3]), spread=0.03, mean=np.full((1, size), 7.0),
        covariances=[covariance], shifts=[np.zeros((size, 0)) if shift is None else shift],
    )  # fmt: skip


@pytest.mark.parametrize("size", [1.0, 2.0, 3.0])
def test_a_signature_that_is_known_gives_the_closed_form(size: float) -> None:
    covariance = ROOT @ ROOT.T
    drawn = draw_sound(one_level(covariance), np.full(2, 0.3), draws=20_000)
    same = np.tile(size * WAY, (2, 1, 1))
    found = known_place_power(
        drawn, same, same, false_alarm_rate=RATE, amplitude=0.0, objects=20_000
    )
    index = float(detection_index(size * WAY, covariance))
    expected = norm.cdf(index - norm.isf(RATE))
    # standard errors: draws at most 0.25 points; threshold 0.05 times the index (40 alarms)
    assert found.pod[0] == pytest.approx(expected, abs=0.008)
    assert found.threshold == pytest.approx(
        index * norm.isf(RATE) - 0.5 * index**2, abs=0.15 * index
    )
    low, high = found.alarm_rate
    assert low < RATE < high


def test_with_a_history_it_is_the_closed_form_of_what_remains() -> None:
    one = Local(
        level=0.3, mean=np.full(2, 7.0), sensitivity=np.array([[3.0], [1.0]]), slope=np.zeros(2),
        within=np.eye(2),
    )  # fmt: skip
    expected = predictive(
        [one], discrepancy=4.0 * np.eye(2), noise=0.25 * np.eye(2), fixed_share=0.5,
        level_deviation=0.03, history=20,
    )  # fmt: skip
    shift, covariance = expected.shifts[0], expected.covariances[0]
    unknown = predictive(
        [one], discrepancy=4.0 * np.eye(2), noise=0.25 * np.eye(2), fixed_share=0.5,
        level_deviation=0.03, history=0,
    ).covariances[0]  # fmt: skip
    np.testing.assert_allclose(shift @ shift.T + covariance, unknown, rtol=1e-9)
    drawn = draw_sound(one_level(covariance, shift), np.full(2, 0.3), draws=20_000)
    same = np.tile([6.0, 5.0], (2, 1, 1))
    found = known_place_power(
        drawn, same, same, false_alarm_rate=RATE, amplitude=0.0, objects=20_000
    )
    index = float(detection_index([6.0, 5.0], covariance))
    assert found.pod[0] == pytest.approx(norm.cdf(index - norm.isf(RATE)), abs=0.008)


def test_sizes_and_states_that_are_not_known_cost_detections() -> None:
    rng = np.random.default_rng(5)
    covariance = ROOT @ ROOT.T
    drawn = draw_sound(one_level(covariance), np.full(40, 0.3), draws=20_000)
    ways = WAY + 0.8 * rng.standard_normal((40, 3))
    sizes = np.array([1.0, 2.0, 4.0])
    hypothesis = sizes[:, None] * ways[:, None, :]
    found = known_place_power(drawn, hypothesis, hypothesis, false_alarm_rate=RATE, objects=20_000)
    index = detection_index(hypothesis, covariance)
    bound = norm.cdf(index - norm.isf(RATE)).mean(axis=0)
    assert np.all(found.pod < bound + 0.003)
    assert found.pod[1] < bound[1] - 0.01
    reported = known_place_power(
        drawn, hypothesis, hypothesis, false_alarm_rate=RATE, objects=20_000, held_out=False
    )
    assert np.all(reported.pod >= found.pod - 0.003)


def test_levels_of_several_centres_are_one_mixture() -> None:
    level = np.array([0.1, 0.2, 0.3])
    many = Population(
        level=level, spread=0.05, mean=np.array([[0.0], [0.0], [0.0]]),
        covariances=[np.eye(1)] * 3, shifts=[np.zeros((1, 0))] * 3,
    )  # fmt: skip
    drawn = draw_sound(many, np.array([0.1, 0.17, 0.28]), draws=20_000)
    same = np.full((3, 1, 1), 4.0)
    found = known_place_power(
        drawn, same, same, false_alarm_rate=RATE, amplitude=0.0, objects=20_000
    )
    assert found.pod[0] == pytest.approx(norm.cdf(4.0 - norm.isf(RATE)), abs=0.01)


def test_a_small_rate_needs_no_more_draws() -> None:
    normal = np.random.default_rng(2).standard_normal((2, 20_000))
    sound, likely = 4.0 * normal - 8.0 + 16.0 * np.array([[0.0], [1.0]])
    z = (threshold_of(sound, likely, rate=1e-5) + 8.0) / 4.0
    assert z == pytest.approx(norm.isf(1e-5), abs=0.02)


def test_the_map_lies_above_the_linear_bound_and_falls_with_a_history() -> None:
    throws = toy_throws(states=30)
    found = known_place_map(throws, Conditions(), closing=CLOSING, draws=2000)
    linear = limit_map(throws, Conditions(), closing=CLOSING)["a90"].sel(channel="both drives")
    assert np.all(found["known_a90_high"] >= linear - 1e-4)
    assert np.all(found["known_a90"] < linear + 1.5e-3)
    known = known_place_map(throws, Conditions(history=20), closing=CLOSING, draws=2000)
    assert np.all(known["known_a90"] < found["known_a90"])
    assert np.all(found["known_alarm_rate_low"] < 1e-3)
    assert np.all(found["known_alarm_rate_high"] > 1e-3)
    assert [row["place"] for row in known_rows(found)] == ["drive 1", "sleeper 1"]


def test_an_object_that_changes_nothing_is_not_seen() -> None:
    throws = replace(toy_throws(states=30), change=0.0 * toy_throws(states=30).change)
    found = known_place_map(throws, Conditions(), closing=CLOSING, draws=1000)
    assert np.isnan(found["known_a90"]).all()
