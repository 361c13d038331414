"""History on toys: conditioning agrees with closed forms, and a ramp is not learned away."""

import numpy as np
import pytest

from turnout.detection.detector.sound_model import SPACING_SHARE, SoundModel, fit_sound_model
from turnout.detection.detector.switch_history import (
    ThrowErrors,
    before_history,
    observe,
    observe_all,
    predict,
)


def toy_model(*, spread: float = 0.0, size: int = 2, gaps: int = 1) -> SoundModel:
    """Features, a gap, and one mode of the switch that moves the first feature by `spread`."""
    values = size + gaps
    switch = np.zeros((3, values, 1))
    switch[:, 0, 0] = spread
    return SoundModel(
        level=np.array([0.1, 0.2, 0.3]), weight=np.full(3, 1.0 / 3.0), mean=np.zeros((3, values)),
        slope=np.zeros((3, values)), switch=switch, within=np.zeros((3, values, values)),
        shift=np.zeros((3, size, size)),
    )  # fmt: skip


def errors_of(*, fixed: float, changing: float, size: int = 2) -> ThrowErrors:
    unit = np.eye(size)
    return ThrowErrors(fixed=fixed**2 * unit, changing=changing**2 * unit, timing=0.0, gap=0.1)


@pytest.mark.parametrize("count", [1, 5, 20])
def test_variance_after_throws_is_that_of_a_normal_mean(count: int) -> None:
    """Prior variance a, n observations of variance b: 1 / (1/a + n/b), and b of the next throw."""
    model, errors = toy_model(spread=3.0), errors_of(fixed=2.0, changing=1.5)
    known = before_history(model, errors)
    for _ in range(count):
        known = observe(model, errors, known, np.array([1.0, -1.0]), level=0.2, drift=0.0)
    mean, covariance = predict(model, errors, known, 1)
    for feature, prior in ((0, 3.0**2 + 2.0**2), (1, 2.0**2)):
        left = 1.0 / (1.0 / prior + count / 1.5**2)
        assert covariance[feature, feature] == pytest.approx(left + 1.5**2, rel=1e-9)
        sign = 1.0 if feature == 0 else -1.0
        assert mean[feature] == pytest.approx(sign * (1.0 - left / prior), rel=1e-9)
    assert covariance[2, 2] == pytest.approx(0.01)
    assert known.throws == count


def test_what_is_learned_at_one_level_holds_at_others() -> None:
    model, errors = toy_model(spread=3.0), errors_of(fixed=0.1, changing=0.1)
    known = observe(model, errors, before_history(model, errors), np.array([2.0, 0.0]), level=0.12)
    mean, _ = predict(model, errors, known, 2)
    assert mean[0] == pytest.approx(2.0, abs=0.01)


def test_a_ramp_is_not_learned_away() -> None:
    """After 20 steady throws a ramp of half a deviation a throw stands out more and more."""
    model, errors = toy_model(spread=3.0), errors_of(fixed=0.5, changing=1.0)
    known = before_history(model, errors)
    for _ in range(20):
        known = observe(model, errors, known, np.zeros(2), level=0.2)
    off = []
    for number in range(1, 21):
        y = np.array([0.5 * number, 0.0])
        mean, covariance = predict(model, errors, known, 1)
        off.append((y[0] - mean[0]) / np.sqrt(covariance[0, 0]))
        known = observe(model, errors, known, y, level=0.2)
    assert off[9] > 3.0
    assert np.all(np.diff(off) > 0.0)


def test_sound_model_finds_a_linear_population() -> None:
    """y = 5 l + l u + e: mean, slope, what a switch does, and what changes from throw to throw."""
    rng = np.random.default_rng(3)
    count = 4000
    level, u = rng.uniform(0.1, 0.5, count), rng.uniform(-1.0, 1.0, (count, 1))
    noise = 0.05 * rng.standard_normal((count, 2))
    values = np.column_stack([5.0 * level + level * u[:, 0], np.zeros(count)]) + noise
    found, residual = fit_sound_model(
        values,
        level=level,
        inputs=u,
        rates=np.ones((count, 1)),
        part=np.zeros(1, dtype=np.intp),
        scale=np.ones(2),
        centres=5,
    )
    np.testing.assert_allclose(found.mean[:, 0], 5.0 * found.level, atol=0.02)
    np.testing.assert_allclose(found.slope[1:-1, 0], 5.0, atol=0.3)
    variance = np.einsum("kr,kr->k", found.switch[:, 0], found.switch[:, 0])
    np.testing.assert_allclose(np.sqrt(variance), found.level / np.sqrt(3.0), atol=0.01)
    np.testing.assert_allclose(found.within[:, 0, 0], 0.05**2, rtol=0.2)
    assert np.std(residual - noise) < 0.005
    assert found.gaps == 1
    assert SPACING_SHARE * found.spacing == pytest.approx(0.06, abs=0.005)


@pytest.mark.parametrize(
    ("drawn", "low", "high"), [(0.5, 1.0, 1.0), (1.0, 1.0, 1.1), (4.0, 3.6, 4.4)]
)
def test_throws_tell_how_much_a_switch_scatters(drawn: float, low: float, high: float) -> None:
    """Throws with so many times the assumed variance; less than assumed is never believed."""
    size, rng = 60, np.random.default_rng(8)
    model, errors = toy_model(size=size, gaps=0), errors_of(fixed=1.0, changing=1.0, size=size)
    own = rng.standard_normal(size)
    features = own + np.sqrt(drawn) * rng.standard_normal((20, size))
    known = observe_all(
        model, errors, before_history(model, errors), features, levels=np.full(20, 0.2)
    )
    assert low <= known.scatter <= high
    _, covariance = predict(model, errors, known, 1)
    assert np.diag(covariance) == pytest.approx(known.scatter * (1.0 + 1.0 / 20.0), rel=0.06)


def test_a_switch_that_scatters_is_learned_as_if_that_had_been_assumed() -> None:
    size, rng = 60, np.random.default_rng(9)
    model, errors = toy_model(size=size, gaps=0), errors_of(fixed=1.0, changing=1.0, size=size)
    features, levels = 2.0 * rng.standard_normal((20, size)), np.full(20, 0.2)
    found = observe_all(model, errors, before_history(model, errors), features, levels=levels)
    assumed = errors.scattered(found.scatter)
    known = before_history(model, assumed)
    for row in features:
        known = observe(model, assumed, known, row, level=0.2)
    np.testing.assert_allclose(found.mean, known.mean, atol=0.05)
    np.testing.assert_allclose(np.diag(found.covariance), np.diag(known.covariance), rtol=0.1)
