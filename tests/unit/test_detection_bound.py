"""The bound on toys with closed forms, and detectors that may not exceed it."""

import numpy as np
import pytest
from scipy.stats import norm

from turnout.detection.features import (
    correlation,
    discrepancy_covariance,
    features_of,
    window_means,
)
from turnout.detection.limit.bound import (
    detection_index,
    excess_over_bound,
    predictive,
    probability_of_detection,
)
from turnout.detection.population import Local, independent, local_models
from turnout.detection.reference import Conditions

RATE = 1e-3
SIZES = (1.0, 2.0, 3.0, 4.5)


def toy(size: float) -> tuple[np.ndarray, np.ndarray]:
    """A signature that grows with the size, and the covariance of three features."""
    root = np.array([[2.0, 0.0, 0.0], [1.0, 1.5, 0.0], [-0.5, 0.3, 1.0]])
    return size * np.array([1.0, -2.0, 0.5]), root @ root.T


def matched_filter_detections(size: float, *, throws: int, factor: float = 1.0) -> int:
    """Count what the optimal test sees in drawn throws; a factor above 1 sees what is not there."""
    signature, covariance = toy(size)
    rng = np.random.default_rng(7)
    drawn = factor * signature + rng.multivariate_normal(np.zeros(3), covariance, throws)
    weights = np.linalg.solve(covariance, signature)
    threshold = norm.isf(RATE) * np.sqrt(signature @ weights)
    return int((drawn @ weights > threshold).sum())


@pytest.mark.parametrize("size", SIZES)
def test_toy_detections_are_the_closed_form_within_half_a_point(size: float) -> None:
    signature, covariance = toy(size)
    throws = 200_000  # standard error 0.11 points at most
    expected = probability_of_detection(
        detection_index(signature, covariance), false_alarm_rate=RATE
    )
    closed = norm.cdf(size * float(detection_index(toy(1.0)[0], covariance)) - norm.isf(RATE))
    assert float(expected) == pytest.approx(closed, abs=1e-12)
    assert matched_filter_detections(size, throws=throws) / throws == pytest.approx(
        float(expected), abs=0.005
    )


def test_a_detector_above_the_bound_is_found_out() -> None:
    signature, covariance = toy(1.0)
    bound = float(
        probability_of_detection(detection_index(signature, covariance), false_alarm_rate=RATE)
    )
    honest = matched_filter_detections(1.0, throws=20_000)
    cheating = matched_filter_detections(1.0, throws=20_000, factor=1.2)
    assert excess_over_bound(honest, 20_000, bound=bound) > 1e-3
    assert excess_over_bound(cheating, 20_000, bound=bound) < 1e-3


@pytest.mark.parametrize("history", [0, 20, 10**9])
def test_history_is_the_closed_form_of_a_repeated_measurement(history: int) -> None:
    """Without any it is the covariance of the population; after many what changes is left."""
    sensitivity, within = np.array([[3.0], [1.0]]), 3.25 * np.eye(2)
    one = Local(
        level=0.3, mean=np.zeros(2), sensitivity=sensitivity, slope=np.zeros(2), within=np.eye(2)
    )
    found = predictive(
        [one],
        discrepancy=4.0 * np.eye(2),
        noise=0.25 * np.eye(2),
        fixed_share=0.5,
        level_deviation=0.03,
        history=history,
    )
    between = sensitivity @ sensitivity.T + 2.0 * np.eye(2)
    # Woodbury's form of (between^-1 + history within^-1)^-1, which holds without history too
    left = between - history * between @ np.linalg.solve(history * between + within, between)
    np.testing.assert_allclose(found.covariances[0], left + within, rtol=1e-9, atol=1e-6)


def test_local_models_give_back_a_linear_population() -> None:
    rng = np.random.default_rng(3)
    count, level = 4000, rng.uniform(0.1, 0.5, 4000)
    switch = np.column_stack([rng.uniform(3e-3, 5e-3, count), np.zeros(count)])
    theta = (switch[:, 0] - switch[:, 0].mean()) / switch[:, 0].std()
    slope, way = np.array([100.0, -50.0, 0.0]), np.array([5.0, 0.0, 2.0])
    errors = rng.normal(size=(count, 3)) * [1.0, 2.0, 0.5]
    features = np.outer(level, slope) + np.outer(theta, way) + errors
    for model in local_models(features, switch=switch, level=level, centres=3):
        np.testing.assert_allclose(model.slope, slope, atol=8.0)
        product = model.sensitivity @ model.sensitivity.T
        np.testing.assert_allclose(product, np.outer(way, way), atol=1.0)
        np.testing.assert_allclose(model.within, np.diag([1.0, 4.0, 0.25]), atol=0.4)


def test_dependent_inputs_become_one() -> None:
    rng = np.random.default_rng(1)
    first = rng.normal(size=1000)
    assert (
        independent(np.column_stack([first, -first + 1e-3 * rng.normal(size=1000)])).shape[1] == 1
    )


def test_windows_are_short_where_the_switch_closes() -> None:
    time = np.arange(0.0, 8.504, 0.008)
    means = window_means(time, closing=4.4)
    np.testing.assert_allclose(means.sum(axis=1), 1.0)
    assert means.shape == (157, time.size)
    force = np.stack([np.ones(time.size), time])
    found = features_of(force, means)
    assert found.shape == (314,)
    np.testing.assert_allclose(found[:157], 1.0)
    assert np.all(np.diff(found[157:]) > 0)


@pytest.mark.parametrize("kernel", ["exponential", "matern 3/2"])
def test_discrepancy_covariance_is_that_of_drawn_discrepancies(kernel: str) -> None:
    time = np.arange(0.0, 1.6, 0.008)
    conditions = Conditions(kernel=kernel)
    means = window_means(time, closing=0.8)
    amplitude = np.array([3000.0, 6000.0])
    found = discrepancy_covariance(time, means, amplitude=amplitude, conditions=conditions)
    root = np.linalg.cholesky(correlation(time[:, None] - time, conditions) + 1e-9 * np.eye(200))
    drawn = np.random.default_rng(5).normal(size=(20_000, 2, 200)) @ root.T
    drawn *= 0.05 * amplitude[:, None]
    sample = np.cov(features_of(drawn, means).T)
    np.testing.assert_allclose(sample, found, atol=0.05 * found.max())
