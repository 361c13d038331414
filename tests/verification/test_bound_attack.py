"""Detectors that try to beat the bound, on linear-Gaussian switches where it is exact.

Each attacker sees the features of a throw and gives a score; its threshold is taken from sound
throws that it has not seen, at the rate of the bound. None may detect more than the bound says,
beyond what the drawn throws scatter (`excess_over_bound` below 0.001 would do so by chance in one
of a thousand tests). Attackers that cheat, by knowing what no detector can know, must be found out.
"""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import norm

from turnout.detection.limit.bound import (
    detection_index,
    excess_over_bound,
    probability_of_detection,
)

Floats = np.ndarray
Score = Callable[[Floats, Floats], Floats]

RATE, THROWS, SOUND = 1e-2, 20_000, 400_000
FEATURES = 12
RNG = np.random.default_rng(8)
_ROOT = RNG.normal(size=(FEATURES, FEATURES)) / 3.0 + np.eye(FEATURES)
COVARIANCE = _ROOT @ _ROOT.T
WAY = np.exp(-0.5 * ((np.arange(FEATURES) - 7.0) / 2.0) ** 2)
SIZES = np.array([1.0, 2.0, 3.0, 4.5])
INVERSE = np.linalg.inv(COVARIANCE)


def drawn(count: int, size: float, seed: int) -> tuple[Floats, Floats]:
    """Return throws with an object of a size, and what a cheat would use: the error itself."""
    error = np.random.default_rng([5, seed]).normal(size=(count, FEATURES)) @ _ROOT.T
    return error + size * WAY, error


def matched(throws: Floats, _: Floats) -> Floats:
    return throws @ INVERSE @ WAY


def unwhitened(throws: Floats, _: Floats) -> Floats:
    return throws @ WAY


def residual(throws: Floats, _: Floats) -> Floats:
    return np.einsum("ij,jk,ik->i", throws, INVERSE, throws)


def peak(throws: Floats, _: Floats) -> Floats:
    return throws.max(axis=1)


def averaged_ratio(throws: Floats, _: Floats) -> Floats:
    """The likelihood ratio of a detector that does not know the size."""
    along = throws @ INVERSE @ WAY
    power = float(WAY @ INVERSE @ WAY)
    return np.logaddexp.reduce([size * along - 0.5 * size**2 * power for size in SIZES], axis=0)


def learnt(throws: Floats, _: Floats) -> Floats:
    """Fisher's discriminant from 4,000 throws of each kind: a trained detector."""
    sound, _e = drawn(4000, 0.0, 91)
    seen = np.concatenate([drawn(1000, size, 92 + n)[0] for n, size in enumerate(SIZES)])
    spread = 0.5 * (np.cov(sound.T) + np.cov(seen.T))
    return throws @ np.linalg.solve(spread, seen.mean(axis=0) - sound.mean(axis=0))


def quieter(throws: Floats, error: Floats) -> Floats:
    """A cheat: its throws hold only nine tenths of the discrepancy that the bound assumes."""
    return matched(throws - 0.1 * error, error)


def looks_at_the_object(throws: Floats, error: Floats) -> Floats:
    """A cheat: a leak of a twentieth of what only the simulation knows, free of error."""
    return matched(throws, error) + matched(throws - error, error) * 0.25


def excess(score: Score, size: float) -> float:
    """Return how likely so many detections are where the bound holds."""
    threshold = float(np.quantile(score(*drawn(SOUND, 0.0, 1)), 1.0 - RATE))
    seen = int(np.count_nonzero(score(*drawn(THROWS, size, 2)) > threshold))
    # the threshold itself scatters: 4,000 alarms are drawn, so its rate by 1.6 %; allow three times
    index = detection_index(size * WAY, COVARIANCE)
    bound = float(probability_of_detection(index, false_alarm_rate=1.05 * RATE))
    return excess_over_bound(seen, THROWS, bound=bound)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("score", [matched, unwhitened, residual, peak, averaged_ratio, learnt])
def test_no_detector_lies_above_the_bound(score: Score, size: float) -> None:
    assert excess(score, size) > 1e-3


@pytest.mark.parametrize("score", [quieter, looks_at_the_object])
def test_a_detector_that_cheats_is_found_out(score: Score) -> None:
    assert min(excess(score, size) for size in SIZES) < 1e-3


def test_the_matched_filter_reaches_the_bound() -> None:
    """The bound is no empty promise: the best detector is on it within half a point."""
    threshold = norm.isf(RATE) * np.sqrt(WAY @ INVERSE @ WAY)
    for number, size in enumerate(SIZES):
        seen = np.mean(matched(*drawn(200_000, size, 20 + number)) > threshold)
        index = detection_index(size * WAY, COVARIANCE)
        assert seen == pytest.approx(
            float(probability_of_detection(index, false_alarm_rate=RATE)), abs=0.005
        )
