"""Likelihood ratios on linear-Gaussian toys, where the exact answer is known."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from turnout.detection.likelihood import (
    AMPLITUDE,
    Signatures,
    log_density,
    log_sums,
    make_centre,
    weigh,
)

SIZE = 6


def toy(signatures: np.ndarray, covariance: np.ndarray) -> tuple[tuple, Signatures]:
    """One centre without gaps, each signature a kind of its own."""
    count = len(signatures)
    basis, mixing = np.linalg.qr(signatures.T)
    samples = Signatures(
        basis=basis,
        change=mixing.T,
        gap=np.zeros((count, 0)),
        level=np.zeros(count),
        kind=np.arange(count),
        size=np.full(count, 0.01),
        x=np.zeros(count),
    )
    centre = make_centre(
        mean=np.zeros(SIZE),
        covariance=covariance,
        log_weight=0.0,
        signatures=samples,
        distance=np.zeros(count),
    )
    return (centre,), samples


def drawn_covariance(rng: np.random.Generator) -> np.ndarray:
    root = rng.standard_normal((SIZE, SIZE)) + 2.0 * np.eye(SIZE)
    return root @ root.T


def test_the_ratio_is_that_of_normal_densities_with_an_uncertain_factor() -> None:
    """As far as noise goes, p_k / p_0 = N(y; s, C + alpha^2 s s^T) / N(y; 0, C), exactly."""
    rng = np.random.default_rng(1)
    covariance = drawn_covariance(rng)
    signatures = rng.standard_normal((2, SIZE))
    centres, samples = toy(signatures, covariance)
    y = 0.3 * np.linalg.cholesky(covariance) @ rng.standard_normal((SIZE, 4))
    found = weigh(y.T, centres, kind=samples.kind, kinds=2)
    sound = multivariate_normal(np.zeros(SIZE), covariance)
    for number, signature in enumerate(signatures):
        wide = covariance + AMPLITUDE**2 * np.outer(signature, signature)
        exact = multivariate_normal(signature, wide).logpdf(y.T) - sound.logpdf(y.T)
        left = (y.T - signature) @ np.linalg.inv(wide)
        within = np.einsum("ij,ij->i", left, y.T - signature) < SIZE + 3.0 * np.sqrt(2.0 * SIZE)
        assert within.all(), "these throws lie within the noise"
        ratio = found.kind[number] - found.sound
        np.testing.assert_allclose(ratio, exact, rtol=1e-9, atol=1e-9)


def test_a_known_signature_is_detected_as_often_as_the_best_test_detects_it() -> None:
    """POD = Phi(d - z) of Neyman and Pearson; the ratio orders throws as the best test does."""
    rng = np.random.default_rng(2)
    covariance = drawn_covariance(rng)
    signature = rng.standard_normal(SIZE)
    signature *= 3.0 / np.sqrt(signature @ np.linalg.solve(covariance, signature))
    centres, samples = toy(signature[np.newaxis], covariance)
    root = np.linalg.cholesky(covariance)
    throws, rate = 40_000, 0.01

    def ratios(y: np.ndarray) -> np.ndarray:
        found = weigh(y, centres, kind=samples.kind, kinds=1)
        return found.kind[0] - found.sound

    noise = rng.standard_normal((2, throws, SIZE)) @ root.T
    threshold = np.quantile(ratios(noise[0]), 1.0 - rate)
    detected = np.mean(ratios(noise[1] + signature) > threshold)
    # the factor of 1 +- 0.1 and the slower fall beyond the noise cost at most two points here
    assert norm.cdf(3.0 - norm.isf(rate)) - 0.02 < detected
    assert detected < norm.cdf(3.0 - norm.isf(rate)) + 0.015


def test_a_throw_that_fits_nothing_makes_differences_count_less() -> None:
    """Ten times as far out, the same improvement in the square is worth a tenth."""
    near = log_density(np.array([90.0, 100.0]), size=100)
    far = log_density(np.array([1414.0, 1424.0]), size=100)
    usual = 100.0 + 3.0 * np.sqrt(200.0)
    assert near[0] - near[1] == pytest.approx(5.0)
    assert far[0] - far[1] == pytest.approx(0.5 * usual * np.log(1424.0 / 1414.0))
    assert far[0] - far[1] < 0.102 * (near[0] - near[1])


def test_sums_of_groups_do_not_underflow() -> None:
    values = np.array([[-2000.0], [-2001.0], [-2500.0]])
    found = log_sums(values, np.array([0, 0, 1]), groups=3).ravel()
    np.testing.assert_allclose(found[0], -2000.0 + np.log1p(np.exp(-1.0)))
    assert found[1] == pytest.approx(-2500.0)
    assert found[2] == -np.inf
