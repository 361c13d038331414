"""Emulator, samples, chain and profiles on movements that were made up."""

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.test_calibration_fit import PARAMETERS, TRUE, misfit, movement

from turnout.calibration.comparison import Uncertainty
from turnout.calibration.covariance import Spread, spread_of
from turnout.calibration.emulator import emulate
from turnout.calibration.fit import Fit, fit
from turnout.calibration.posterior import posterior_of
from turnout.errors import SolverError


@pytest.fixture(scope="module")
def fitted() -> Fit:
    rng = np.random.default_rng(7)
    measured = [movement(f"m{n}", rng=rng, own=0.02 * rng.standard_normal()) for n in range(4)]
    whole = misfit(measured)
    # A posterior holds what the movements show, not what all of them could share.
    doubt = Uncertainty(common_gain=0.0, cross_talk=0.0)
    whole.comparison = replace(whole.comparison, uncertainty=doubt)
    return fit(whole, PARAMETERS, TRUE)


@pytest.fixture(scope="module")
def spread(fitted: Fit) -> Spread:
    return spread_of(fitted)


def test_the_emulator_meets_fresh_points_and_says_so(fitted: Fit, spread: Spread) -> None:
    emulator = emulate(fitted, spread, rng=np.random.default_rng(1))
    assert emulator.proved
    assert emulator.points == 1 + 2 * 6 + 20
    at_fit = float(emulator.cost(np.zeros((1, 2)))[0])
    assert at_fit == pytest.approx(fitted.cost, rel=1e-3)
    aside = fitted.values["k"] * 1.002
    whole = {**fitted.values, "k": aside}
    residuals = fitted.misfit.residuals_of(fitted.misfit.responses([whole])[0], fitted.frame)
    step = np.array([0.0, np.log(1.002)])
    standard = np.linalg.solve(emulator.root, step)[None, :]
    assert float(emulator.cost(standard)[0]) == pytest.approx(residuals @ residuals, rel=2e-3)


def test_a_posterior_that_is_normal_is_that_of_the_fit(fitted: Fit, spread: Spread) -> None:
    found = posterior_of(fitted, spread, seed=3)
    assert found.method == "importance sampling"
    assert found.effective > 5000
    np.testing.assert_allclose(found.deviation, spread.deviations, rtol=0.1)
    np.testing.assert_allclose(found.intervals[1], spread.intervals[1], rtol=1e-3)
    np.testing.assert_allclose(found.profiles[1], spread.intervals[1], rtol=1e-3)
    assert found.outside == 0.0
    if np.isfinite(found.apart):
        assert found.apart < 0.1


def test_the_same_seed_gives_the_same_posterior(fitted: Fit, spread: Spread) -> None:
    one, two = (posterior_of(fitted, spread, seed=4) for _ in range(2))
    np.testing.assert_array_equal(one.mean, two.mean)


def test_an_emulator_that_misses_is_refused(
    fitted: Fit, spread: Spread, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("turnout.calibration.emulator.LARGEST_ERROR", 1e-12)
    with pytest.raises(SolverError, match="differs from new throws"):
        posterior_of(fitted, spread)
