"""What the best explanation leaves of a throw, on linear-Gaussian toys with an exact answer."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from turnout.detection.detector.knowledge import RESIDUAL_LEVELS, Calibrated
from turnout.detection.detector.throw_verdict import share_worse
from turnout.detection.detector.unexplained import (
    EXCESS,
    Variation,
    irregularities,
    least_squares,
)
from turnout.detection.likelihood import (
    Hypotheses,
    Signatures,
    make_centre,
    make_hypotheses,
    weigh,
)

SIZE = 30


def toy(within: np.ndarray, noise: np.ndarray) -> tuple[Hypotheses, Signatures]:
    """One centre, and two signatures along the first two features."""
    signatures = Signatures(
        basis=np.eye(SIZE)[:, :2], change=30.0 * np.eye(2), gap=np.zeros((2, 0)),
        level=np.zeros(2), kind=np.arange(2), size=np.full(2, 0.01), x=np.zeros(2),
    )  # fmt: skip
    centre = make_centre(
        mean=np.zeros(SIZE), covariance=within + noise, log_weight=0.0, signatures=signatures
    )
    return make_hypotheses((centre,), signatures, distance=np.zeros((1, 2)), kinds=2), signatures


def covariances(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Variation in four directions, and noise."""
    ways = np.random.default_rng(seed).standard_normal((SIZE, 4))
    ways[:2] = 0.0
    return ways @ ways.T, np.diag(np.linspace(0.5, 2.0, SIZE))


def test_irregularity_orders_throws_as_the_exact_likelihood_ratio_does() -> None:
    """log N(y; 0, C + a W) / N(y; 0, C) = (z' M z - log det(I + a L)) / 2."""
    within, noise = covariances(1)
    whole = within + noise
    hypotheses, signatures = toy(within, noise)
    y = np.random.default_rng(2).multivariate_normal(np.zeros(SIZE), whole, size=4000)
    found = irregularities(
        weigh(y, hypotheses), Variation(within[np.newaxis]), signatures, kept=np.zeros(2, bool)
    )
    assert found.mean() == pytest.approx(0.0, abs=0.05)
    assert found.std() == pytest.approx(1.0, abs=0.05)
    zero = np.zeros(SIZE)
    exact = multivariate_normal(zero, whole + EXCESS * within).logpdf(y)
    exact -= multivariate_normal(zero, whole).logpdf(y)
    slope, offset = np.polyfit(found, exact, 1)
    # the roots that throws are whitened by are of single precision
    np.testing.assert_allclose(exact, slope * found + offset, atol=1e-5)
    assert slope > 0.0


def test_what_varies_more_is_irregular_before_it_is_large() -> None:
    within, noise = covariances(3)
    hypotheses, signatures = toy(within, noise)
    rng = np.random.default_rng(4)
    usual = rng.multivariate_normal(np.zeros(SIZE), within + noise, size=2000)
    rough = rng.multivariate_normal(np.zeros(SIZE), 3.0 * within + noise, size=2000)
    variation = Variation(within[np.newaxis])
    seen = []
    for values in (
        [least_squares(weigh(y, hypotheses)) for y in (usual, rough)],
        [irregularities(weigh(y, hypotheses), variation, signatures) for y in (usual, rough)],
    ):
        seen.append(np.mean(values[1] > np.quantile(values[0], 0.99)))
    assert seen[1] > seen[0] + 0.15


def test_what_a_known_cause_explains_is_not_left_unless_the_cause_is_left_out() -> None:
    within, noise = covariances(5)
    hypotheses, signatures = toy(within, noise)
    evidence = weigh(30.0 * np.eye(SIZE)[:1], hypotheses)
    assert least_squares(evidence)[0] < 1.0
    left_out = np.array([False, True])
    assert least_squares(evidence, kept=left_out)[0] > 100.0


def test_of_two_tests_one_fails_as_seldom_as_wanted() -> None:
    """At a fifth of the level and at four fifths: 0.2 p + 0.8 p - 0.16 p^2 of independent ones."""
    levels = np.array(RESIDUAL_LEVELS)
    calibrated = Calibrated(
        part="cycle", history=0, thresholds={}, throws=1, switches=1,
        residual=tuple(100.0 * levels), irregularity=tuple(levels),
    )  # fmt: skip
    found = share_worse(
        np.array([50.0, 99.0, 50.0]), np.array([0.5, 0.5, 0.999]), calibrated=calibrated
    )
    np.testing.assert_allclose(found, [0.625, 0.05, 0.00125], rtol=1e-9)
    even = np.random.default_rng(7).random((2, 200_000))
    shares = share_worse(100.0 * even[0], even[1], calibrated=calibrated)
    assert np.mean(shares < 0.01) == pytest.approx(0.01 - 0.16 * 0.01**2, abs=7e-4)
