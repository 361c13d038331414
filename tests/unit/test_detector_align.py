"""Onsets found again: the likelihood of early forces, movement by movement, is that of all."""

from itertools import product

import numpy as np
import pytest
from scipy.special import logsumexp
from tests.unit.detector_toy import toy_detector, toy_throw

from turnout.detection.density import log_density
from turnout.detection.detector.align_onsets import EARLY, REST_AFTER, Aligner, EarlyForces
from turnout.detection.detector.judging import View
from turnout.detection.detector.recorded import Recorded, features_of_recorded
from turnout.detection.detector.throw_layout import Layout


def directly(view: View, layout: Layout, throw: Recorded, onsets: dict[str, float]) -> float:
    """Return the likelihood of the early features by the covariance of all of them."""
    closing = layout.parts[-1]
    duration = closing.edges[-1] - REST_AFTER
    kept = np.flatnonzero(layout.time[view.features] - closing.start < EARLY * duration)
    features = features_of_recorded(throw, layout, onsets)[view.features[kept]]
    found = []
    for centre in view.centres:
        covariance = np.linalg.inv(centre.root.T @ centre.root)[np.ix_(kept, kept)]
        away = features - centre.mean[kept]
        square = np.array(away @ np.linalg.solve(covariance, away))
        scale = -0.5 * np.linalg.slogdet(covariance)[1]
        found.append(float(log_density(square, size=len(kept)) + scale))
    return float(logsumexp(found))


@pytest.mark.parametrize("part", ["cycle", "closing"])
def test_onsets_are_tried_at_the_likelihood_of_all_early_forces(part: str) -> None:
    detector = toy_detector()
    view, layout = detector.view(part), detector.knowledge.layout
    throw = toy_throw(level=0.27, seed=3, shift=0.006)
    shifts = {"opening": np.array([-0.02, 0.003]), "closing": np.array([-0.03, 0.0, 0.011, 0.04])}
    aligner = Aligner(view, layout)
    assert aligner.names(throw) == (["opening", "closing"] if part == "cycle" else ["closing"])
    tried = {name: throw.onsets[name] + shifts[name] for name in aligner.names(throw)}
    found = EarlyForces(aligner, throw, tried).scores()
    wanted = [
        directly(view, layout, throw, dict(zip(tried, at, strict=True)))
        for at in product(*tried.values())
    ]
    np.testing.assert_allclose(found.ravel(), wanted, rtol=1e-7)


def test_onsets_that_are_some_milliseconds_off_are_found_again() -> None:
    """The toy shows its onsets by little; so what is found lies between 0 and the true shift."""
    detector = toy_detector()
    aligner = Aligner(detector.view("cycle"), detector.knowledge.layout)
    for shift in (-0.03, 0.02):
        found = aligner.aligned(toy_throw(level=0.5, seed=5, shift=shift))[0]
        for name, at in (("opening", 0.2), ("closing", 4.4)):
            assert 0.6 < (found[name] - at) / shift < 1.2
