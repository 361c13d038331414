"""Likelihood ratios on linear-Gaussian toys, where the exact answer is known."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from turnout.detection.density import log_density
from turnout.detection.likelihood import (
    AMPLITUDE,
    REACH,
    Hypotheses,
    Signatures,
    make_centre,
    make_hypotheses,
    weigh,
)
from turnout.detection.triangular import make_whitening

SIZE = 6


SINGLE = 1e-6
"""Products with signatures are of single precision, 6e-8."""


def toy(signatures: np.ndarray, covariance: np.ndarray) -> Hypotheses:
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
    )
    return make_hypotheses((centre,), samples, distance=np.zeros((1, count)), kinds=count)


def drawn_covariance(rng: np.random.Generator) -> np.ndarray:
    root = rng.standard_normal((SIZE, SIZE)) + 2.0 * np.eye(SIZE)
    return root @ root.T


def test_the_ratio_is_that_of_normal_densities_with_an_uncertain_factor() -> None:
    """As far as noise goes, p_k / p_0 = N(y; s, C + alpha^2 s s^T) / N(y; 0, C), exactly."""
    rng = np.random.default_rng(1)
    covariance = drawn_covariance(rng)
    signatures = rng.standard_normal((2, SIZE))
    hypotheses = toy(signatures, covariance)
    y = 0.3 * np.linalg.cholesky(covariance) @ rng.standard_normal((SIZE, 4))
    found = weigh(y.T, hypotheses)
    sound = multivariate_normal(np.zeros(SIZE), covariance)
    for number, signature in enumerate(signatures):
        wide = covariance + AMPLITUDE**2 * np.outer(signature, signature)
        exact = multivariate_normal(signature, wide).logpdf(y.T) - sound.logpdf(y.T)
        left = (y.T - signature) @ np.linalg.inv(wide)
        within = np.einsum("ij,ij->i", left, y.T - signature) < SIZE + 3.0 * np.sqrt(2.0 * SIZE)
        assert within.all(), "these throws lie within the noise"
        ratio = found.kind[number] - found.sound
        np.testing.assert_allclose(ratio, exact, rtol=SINGLE, atol=SINGLE)


def test_a_known_signature_is_detected_as_often_as_the_best_test_detects_it() -> None:
    """POD = Phi(d - z) of Neyman and Pearson; the ratio orders throws as the best test does."""
    rng = np.random.default_rng(2)
    covariance = drawn_covariance(rng)
    signature = rng.standard_normal(SIZE)
    signature *= 3.0 / np.sqrt(signature @ np.linalg.solve(covariance, signature))
    hypotheses = toy(signature[np.newaxis], covariance)
    root = np.linalg.cholesky(covariance)
    throws, rate = 40_000, 0.01

    def ratios(y: np.ndarray) -> np.ndarray:
        found = weigh(y, hypotheses)
        return found.kind[0] - found.sound

    noise = rng.standard_normal((2, throws, SIZE)) @ root.T
    threshold = np.quantile(ratios(noise[0]), 1.0 - rate)
    detected = np.mean(ratios(noise[1] + signature) > threshold)
    # the factor of 1 +- 0.1 and the slower fall beyond the noise cost at most two points here
    assert norm.cdf(3.0 - norm.isf(rate)) - 0.02 < detected
    assert detected < norm.cdf(3.0 - norm.isf(rate)) + 0.015


def test_a_throw_that_fits_nothing_makes_differences_count_less() -> None:
    """Twice as far out, the same improvement in the square is worth half; then that of 60 ways."""
    near = log_density(np.array([90.0, 100.0]), size=100)
    far = log_density(np.array([274.0, 284.0]), size=100)
    beyond = log_density(np.array([1414.0, 1424.0]), size=100)
    usual = 100.0 + 3.0 * np.sqrt(200.0)
    assert near[0] - near[1] == pytest.approx(5.0)
    assert far[0] - far[1] == pytest.approx(0.5 * usual * np.log(284.0 / 274.0))
    assert far[0] - far[1] < 0.52 * (near[0] - near[1])
    assert beyond[0] - beyond[1] == pytest.approx(0.5 * 60.0 * np.log(1424.0 / 1414.0))
    at_edge = log_density(2.0 * usual * np.array([1.0 - 1e-9, 1.0 + 1e-9]), size=100)
    assert at_edge[0] == pytest.approx(at_edge[1], abs=1e-5)


def test_a_share_of_what_nothing_explains_speaks_little_for_a_signature() -> None:
    """A signature explains a twentieth of a large deviation, or all of a small one."""
    size = 300
    ways = np.eye(size)
    samples = Signatures(
        basis=ways[:, :1], change=np.array([[10.0]]), gap=np.zeros((1, 0)), level=np.zeros(1),
        kind=np.zeros(1, dtype=np.intp), size=np.full(1, 0.01), x=np.zeros(1),
    )  # fmt: skip
    centre = make_centre(
        mean=np.zeros(size), covariance=np.eye(size), log_weight=0.0, signatures=samples
    )
    hypotheses = make_hypotheses((centre,), samples, distance=np.zeros((1, 1)), kinds=1)
    noise = np.random.default_rng(5).standard_normal(size)
    for far, least, most in ((0.0, 30.0, 60.0), (43.0, 0.5, 3.0)):
        found = weigh((noise + 10.0 * ways[0] + far * ways[1])[np.newaxis], hypotheses)
        assert least < found.kind[0, 0] - found.sound[0] < most


def test_kinds_are_sums_over_signatures_near_each_centre() -> None:
    """Three centres and eleven signatures in any order, against the sum of their densities."""
    rng = np.random.default_rng(3)
    count, kinds = 11, 4
    signatures = rng.standard_normal((count, SIZE))
    level, kind = rng.uniform(-1.2, 3.3, count), rng.integers(0, kinds - 1, count)
    basis, mixing = np.linalg.qr(signatures.T)
    nothing = np.zeros(count)
    samples = Signatures(
        basis=basis, change=mixing.T, gap=np.zeros((count, 0)), level=level, kind=kind,
        size=nothing, x=nothing,
    )  # fmt: skip
    means = rng.standard_normal((3, SIZE))
    covariances = [drawn_covariance(rng) + 9.0 * np.eye(SIZE) for _ in range(3)]  # within the noise
    weights = np.array([0.5, 0.3, 0.2])
    centres = tuple(
        make_centre(
            mean=means[at], covariance=covariances[at], log_weight=np.log(weights[at]),
            signatures=samples,
        )
        for at in range(3)
    )  # fmt: skip
    distance = level - np.arange(3.0)[:, np.newaxis]
    y = means.mean(axis=0) + 0.5 * rng.standard_normal((5, SIZE))
    near = np.maximum(1.0 - np.abs(distance) / REACH, 0.0)
    exact = np.zeros((kinds, 5))
    for at, number in zip(*np.nonzero(near), strict=True):
        signature = signatures[number]
        wide = covariances[at] + AMPLITUDE**2 * np.outer(signature, signature)
        density = multivariate_normal(means[at] + signature, wide).pdf(y)
        share = near[at, number] / near[at, kind == kind[number]].sum()
        exact[kind[number]] += weights[at] * share * density
    constant = (2.0 * np.pi) ** (0.5 * SIZE)
    for given in (samples, samples.by_level()):
        order = distance if given is samples else np.sort(level) - np.arange(3.0)[:, np.newaxis]
        found = weigh(y, make_hypotheses(centres, given, distance=order, kinds=kinds))
        np.testing.assert_allclose(np.exp(found.kind), exact * constant, rtol=SINGLE)
        one = found.of_throw(3)
        np.testing.assert_array_equal(one.kind[:, 0], found.kind[:, 3])
        assert len(one.component) == np.count_nonzero(near)
    assert (found.kind[-1] == -np.inf).all(), "no signature is of the last kind"


def test_sums_of_kinds_do_not_underflow() -> None:
    """A throw so far out that every density is 0 in double precision has finite logarithms."""
    hypotheses = toy(np.eye(SIZE)[:2], 1e-6 * np.eye(SIZE))
    found = weigh(np.full((1, SIZE), 50.0), hypotheses)
    assert np.isfinite(found.kind).all()
    assert np.exp(found.component.max()) < 1.0
    np.testing.assert_allclose(found.kind[:, 0], found.component[:, 0])


def test_triangular_roots_are_multiplied_in_blocks() -> None:
    rng = np.random.default_rng(8)
    roots, off = np.tril(rng.standard_normal((2, 203, 203))), rng.standard_normal((2, 203, 3))
    whitening = make_whitening(roots)
    white, back = whitening.of(off)
    scale = np.abs(roots @ off).max()
    assert white == pytest.approx(roots @ off, abs=SINGLE * scale)
    scale = np.abs(roots.swapaxes(1, 2) @ white).max()
    assert back == pytest.approx(roots.swapaxes(1, 2) @ white, abs=SINGLE * scale)
