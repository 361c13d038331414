"""Emulator, samples, chain and profiles on movements that were made up."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm
from tests.unit.test_calibration_fit import PARAMETERS, TRUE, misfit, movement

from turnout.calibration.comparison import Comparison, Uncertainty
from turnout.calibration.covariance import Spread, spread_of
from turnout.calibration.emulator import emulate
from turnout.calibration.evaluate import CELL, Evaluator, Response, ThrowInputs
from turnout.calibration.fit import Fit, fit
from turnout.calibration.measured_movements import BIN, MeasuredMovement, Signal
from turnout.calibration.misfit import Misfit, framed, jacobian
from turnout.calibration.noise import Noise
from turnout.calibration.parameter import Parameter
from turnout.calibration.posterior import posterior_of, posterior_record
from turnout.calibration.predict import compared
from turnout.core.errors import SolverError
from turnout.panel.load import load_panel

NOISE = 2.0
LINEAR = tuple(
    Parameter(
        name=name, keys=(name,), start=400.0, lower=-5e3, upper=5e3, unit="N", transform="linear"
    )
    for name in ("level", "slope")
)


def shapes(time: np.ndarray) -> np.ndarray:
    """Give what each of the linear parameters multiplies, shape (n, 2)."""
    return np.column_stack([np.ones(time.size), time - 2.0])


class Linear(Evaluator):
    """Answers with a force that is linear in its two parameters."""

    def responses(self, throws: Sequence[ThrowInputs]) -> list[Response]:
        time = CELL * (np.arange(1500) + 0.5)
        return [
            Response(
                time=time,
                drive_force={
                    "1": shapes(time) @ [float(str(throw.overrides[p.name])) for p in LINEAR]
                },
                marker={"1": 0.0 * time},
                object_force=0.0 * time,
                onsets={"closing": 0.0},
            )
            for throw in throws
        ]


def linear_fit() -> tuple[Fit, np.ndarray, np.ndarray]:
    """Return a fit of the linear force, with mean and covariance of its posterior by hand."""
    rng = np.random.default_rng(5)
    time = BIN * (np.arange(150) + 0.5)
    values = shapes(time) @ [500.0, -120.0] + NOISE * rng.standard_normal(time.size)
    signal = Signal(channel="drive_force", drive="1", time=time, values=values)
    measured = MeasuredMovement(
        name="m", direction="closing", place="none", size=0.0, x=np.nan,
        signals=(signal,), length=2.9, clocked=True,
    )  # fmt: skip
    tiny = 1e-9
    exact = Uncertainty(
        clocked_onset=tiny, zero=tiny, gain=tiny, common_gain=0.0, cross_talk=0.0, scale=0.0
    )
    whole = Misfit(
        evaluator=Linear(load_panel("sb1")),
        parameters=LINEAR,
        base={item.name: item.start for item in LINEAR},
        movements=(measured,),
        comparison=Comparison(noise={("drive_force", "1"): Noise(white=NOISE)}, uncertainty=exact),
    )
    ((_, bins),) = compared(measured, whole.comparison.channels, whole.comparison.window)
    X, y = shapes(time[bins]), values[bins]
    covariance = NOISE**2 * np.linalg.inv(X.T @ X)
    start = {item.name: item.start for item in LINEAR}
    found = fit(whole, LINEAR, start, refined=False)
    # Noise and outliers are estimated by a fit; here both are known.
    kept = replace(found.misfit, comparison=whole.comparison)
    local = kept.local(found.values, list(start))
    frame = framed(local, kept)
    found = replace(
        found, misfit=kept, local=local, frame=frame,
        residuals=kept.residuals_of(local.simulated, frame),
        jacobian=jacobian(local, frame, list(start)),
    )  # fmt: skip
    return found, covariance @ (X.T @ y) / NOISE**2, covariance


@pytest.mark.usefixtures("short_chain")
def test_a_linear_model_has_the_posterior_of_the_normal_equations() -> None:
    found, mean, covariance = linear_fit()
    known = np.array([[3e-2, 1e-2], [1e-2, 2e-2]])
    scales = np.array([item.scale for item in LINEAR])
    plain = spread_of(found)
    for shared in (np.zeros((2, 2)), known):
        whole = replace(plain, common_covariance=shared / np.outer(scales, scales))
        drawn = posterior_of(found, whole, seed=2)
        size = np.sqrt(np.diag(covariance + shared))
        assert drawn.effective > 10_000
        # A mean of so many samples is off by a hundredth of a deviation, an end by three.
        assert np.abs((drawn.mean - mean) / size).max() < 0.05
        np.testing.assert_allclose(drawn.deviation, size, rtol=0.03)
        ends = mean[:, None] + np.outer(size, norm.ppf([0.025, 0.975]))
        assert np.abs((drawn.intervals - ends) / size[:, None]).max() < 0.1
        own = mean[:, None] + np.outer(np.sqrt(np.diag(covariance)), [-1.96, 1.96])
        np.testing.assert_allclose(drawn.profiles, own, rtol=1e-4)


@pytest.fixture
def short_chain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the chain, which checks the samples, too short to have mixed."""
    monkeypatch.setattr("turnout.calibration.posterior.CHAIN_STEPS", 50)


@pytest.fixture
def few_draws(monkeypatch: pytest.MonkeyPatch, short_chain: None) -> None:
    monkeypatch.setattr("turnout.calibration.posterior.SAMPLES", 1000)


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


def test_the_emulator_meets_fresh_points_and_says_so(fitted: Fit) -> None:
    emulator = emulate(fitted, rng=np.random.default_rng(1))
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
    assert found.deviation[1] == pytest.approx(spread.deviations[1], rel=0.1)
    np.testing.assert_allclose(found.intervals[1], spread.intervals[1], rtol=1e-3)
    # Friction scatters: both are Student's, of the scatter of four movements.
    np.testing.assert_allclose(found.intervals[0], spread.intervals[0], rtol=5e-3)
    assert found.away < 0.1
    np.testing.assert_allclose(found.profiles[1], spread.intervals[1], rtol=1e-3)
    assert found.outside == 0.0
    if np.isfinite(found.apart):
        assert found.apart < 0.1


@pytest.mark.usefixtures("few_draws")
def test_the_same_seed_gives_the_same_posterior(fitted: Fit, spread: Spread) -> None:
    one, two = (posterior_of(fitted, spread, seed=4) for _ in range(2))
    np.testing.assert_array_equal(one.mean, two.mean)


def test_an_emulator_that_misses_is_refused(
    fitted: Fit, spread: Spread, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("turnout.calibration.emulator.LARGEST_ERROR", 1e-12)
    with pytest.raises(SolverError, match="on new throws"):
        posterior_of(fitted, spread)


@pytest.mark.usefixtures("short_chain")
def test_errors_that_no_residual_shows_widen_both_alike(fitted: Fit) -> None:
    """Far wider ones than the movements leave: samples drawn that wide would hardly count."""
    doubt = Uncertainty(common_gain=0.1, cross_talk=0.0)
    comparison = replace(fitted.misfit.comparison, uncertainty=doubt)
    doubted = replace(fitted, misfit=replace(fitted.misfit, comparison=comparison))
    spread = spread_of(doubted)
    narrow = spread_of(fitted).deviations[1]
    assert spread.deviations[1] > 5.0 * narrow
    found = posterior_of(doubted, spread, seed=3)
    assert found.effective > 5000
    own, other = (float(np.diff(ends[1])[0]) for ends in (found.intervals, spread.intervals))
    assert own == pytest.approx(other, rel=0.05)
    assert found.away < 0.1


@pytest.mark.usefixtures("few_draws")
@pytest.mark.parametrize(
    ("limit", "value", "words"),
    [
        ("LEAST_EFFECTIVE", 1e9, ["effective samples", "--fix"]),
        ("AWAY", 0.0, ["standard deviations from the fit"]),
    ],
)
def test_too_few_effective_samples_and_a_mean_far_from_the_fit_are_said(
    fitted: Fit,
    spread: Spread,
    monkeypatch: pytest.MonkeyPatch,
    limit: str,
    value: float,
    words: list[str],
) -> None:
    """There are no intervals of too few samples, but a remedy."""
    monkeypatch.setattr(f"turnout.calibration.posterior.{limit}", value)
    monkeypatch.setattr("turnout.calibration.posterior.CHAIN_ROUNDS", 1)
    record, warnings = posterior_record(fitted, spread)
    assert (record == {}) == (limit == "LEAST_EFFECTIVE")
    assert record.get("away_from_fit", 1.0) > 0.0
    assert all(word in warnings[0] for word in words)
