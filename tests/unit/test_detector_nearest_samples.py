"""What is sought between signatures: exact where everything is linear and normal."""

import numpy as np
import pytest
from tests.unit.detector_toy import toy_evidence

from turnout.detection.detector.nearest_samples import LEFT, Samples
from turnout.detection.detector.object_posterior import objects_near


def samples(change: np.ndarray, share: np.ndarray, throw: np.ndarray) -> Samples:
    return Samples(
        components=np.arange(len(change)),
        share=share,
        change=change - share @ change,
        left=throw - change,
    )


def test_samples_move_to_the_exact_conditional_mean() -> None:
    """Values linear in three directions of signatures, measured with noise of known variance."""
    rng = np.random.default_rng(1)
    directions = rng.standard_normal((3, 20))
    way, throw = rng.standard_normal(3), rng.standard_normal(20)
    places = 2.0 * rng.standard_normal((40, 3))
    share = rng.dirichlet(np.ones(40))
    change, values = places @ directions, (places @ way)[:, np.newaxis]
    found = samples(change, share, throw)
    moved, deviation = found.moved(values)
    mean = share @ change
    own = np.cov(change.T, aweights=share, bias=True)
    both = (share[:, np.newaxis] * (change - mean)).T @ values
    gain = np.linalg.solve(own + LEFT * np.eye(20), both)
    assert share @ moved == pytest.approx(share @ values + (throw - mean) @ gain, rel=1e-9)
    assert deviation == pytest.approx(np.sqrt(LEFT) * np.linalg.norm(gain, axis=0), rel=1e-9)
    spread = share @ (moved - share @ moved) ** 2 + deviation**2
    exact = share @ (values - share @ values) ** 2 - np.einsum("ij,ij->j", gain, both)
    assert spread == pytest.approx(exact, rel=1e-9)


def test_what_does_not_depend_on_signatures_stays() -> None:
    rng = np.random.default_rng(2)
    found = samples(rng.standard_normal((30, 5)), np.full(30, 1 / 30), rng.standard_normal(5))
    moved, deviation = found.moved(np.full((30, 1), 3.0))
    assert moved == pytest.approx(3.0)
    assert deviation == pytest.approx(0.0)


def test_each_signature_counts_once() -> None:
    view, evidence = toy_evidence()
    near = objects_near(view, evidence, 0)
    numbers = evidence.hypotheses.number[near.components]
    assert len(np.unique(numbers)) == len(numbers)
    assert near.share.sum() == pytest.approx(1.0)
    assert near.share @ near.change == pytest.approx(0.0, abs=1e-9)
    assert np.all(evidence.hypotheses.kind[near.components] < view.objects)
