"""Places left out in turn: exact for a linear model, and a wrong place is seen."""

import numpy as np
import pytest

from turnout.calibration.validation.prediction_bands import (
    ThrowScatter,
    leave_out_places,
    variance_of,
)

PLACES = ["none", "none", "drive 1", "drive 1", "sleeper 7", "drive 2"]


def made() -> tuple[np.ndarray, np.ndarray]:
    """Return forces of two channels, and their slopes with three values."""
    rng = np.random.default_rng(5)
    slopes = rng.standard_normal((3, 2, len(PLACES), 40))
    measured = np.tensordot([1.0, -2.0, 0.5], slopes, axes=1)
    measured += 0.3 * rng.standard_normal(measured.shape)
    return measured, slopes


def left_out(
    measured: np.ndarray,
    forces: np.ndarray,
    slopes: np.ndarray,
    *,
    covariance: np.ndarray | None = None,
    own: np.ndarray | None = None,
    rest: np.ndarray | float = 0.3,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Leave out the places; of noises of 0.3, and with values as uncertain as they come."""
    shape = (0, *measured.shape) if own is None else (1, *own.shape)
    noises = np.broadcast_to(rest, len(measured)).astype(np.float64)
    scatter = ThrowScatter(
        own=np.zeros(shape) if own is None else own[None],
        sizes=np.ones(shape[0]),
        freedom=np.ones(shape[0]),
        rest=noises,
        decay=0.0 * noises,
    )
    known = np.eye(len(slopes)) if covariance is None else covariance
    return leave_out_places(
        measured, forces, slopes, places=PLACES, covariance=known, scatter=scatter
    )


def test_it_is_the_fit_to_the_other_places() -> None:
    measured, slopes = made()
    J = slopes.reshape(3, -1).T
    values = np.linalg.lstsq(J, measured.ravel(), rcond=None)[0]
    covariance = 0.09 * np.linalg.inv(J.T @ J)
    forces, variance, predicted = left_out(
        measured, np.tensordot(values, slopes, axes=1), slopes, covariance=covariance
    )
    assert predicted.all()
    for place in set(PLACES):
        inside = np.array([item == place for item in PLACES])
        rest = slopes[:, :, ~inside].reshape(3, -1).T
        others = np.linalg.lstsq(rest, measured[:, ~inside].ravel(), rcond=None)[0]
        expected = np.tensordot(others, slopes[:, :, inside], axes=1)
        np.testing.assert_allclose(forces[:, inside], expected, atol=1e-10)
        spread = variance_of(slopes[:, :, inside], 0.09 * np.linalg.inv(rest.T @ rest))
        np.testing.assert_allclose(variance[:, inside], spread, rtol=1e-8)


def test_values_that_are_off_are_off_by_as_much_in_each_prediction() -> None:
    """Values changed by hand were refused sooner than stated: their error was magnified."""
    measured, slopes = made()
    J = slopes.reshape(3, -1).T
    values = np.linalg.lstsq(J, measured.ravel(), rcond=None)[0]
    off = np.array([0.3, -0.2, 0.1])
    found, moved = (
        left_out(measured, np.tensordot(judged, slopes, axes=1), slopes)[0]
        for judged in (values, values + off)
    )
    change = np.tensordot(off, slopes, axes=1)
    np.testing.assert_allclose(moved, found + change, atol=1e-9)


def test_what_a_movement_has_of_its_own_is_no_reason_to_change_values() -> None:
    measured, slopes = made()
    rng = np.random.default_rng(6)
    own = 5.0 * rng.standard_normal(measured.shape)
    measured = measured + own * rng.standard_normal(len(PLACES))[:, None]
    weights = [
        np.linalg.inv(0.09 * np.eye(80) + np.outer(one, one))
        for one in (own[:, n].ravel() for n in range(len(PLACES)))
    ]
    J = [slopes[:, :, n].reshape(3, -1) for n in range(len(PLACES))]

    def values(numbers: list[int]) -> np.ndarray:
        H = sum((J[n] @ weights[n] @ J[n].T for n in numbers), np.zeros((3, 3)))
        g = sum((J[n] @ weights[n] @ measured[:, n].ravel() for n in numbers), np.zeros(3))
        return np.linalg.solve(H, g)

    every = list(range(len(PLACES)))
    forces = np.tensordot(values(every), slopes, axes=1)
    found = left_out(measured, forces, slopes, own=own)[0]
    for place in set(PLACES):
        inside = [n for n in every if PLACES[n] == place]
        others = values([n for n in every if n not in inside])
        expected = np.tensordot(others, slopes[:, :, inside], axes=1)
        np.testing.assert_allclose(found[:, inside], expected, atol=1e-9)


def test_a_value_that_one_place_alone_shows_keeps_that_place() -> None:
    measured, slopes = made()
    slopes[2, :, :5] = 0.0
    forces, _, predicted = left_out(measured, np.zeros_like(measured), slopes)
    assert predicted.tolist() == [True] * 5 + [False]
    np.testing.assert_array_equal(forces[:, 5], 0.0)


@pytest.mark.parametrize(("times", "enough"), [(10.0, True), (20.0, False)])
def test_a_place_that_knows_nearly_all_is_not_predicted_from_the_others(
    times: float, enough: bool
) -> None:
    """A slope t times as large at one of 6 movements leaves 5 / (t^2 + 5): 4.8 and 1.2 %."""
    slopes = np.ones((1, 1, len(PLACES), 40))
    slopes[:, :, 5] = times
    predicted = left_out(np.zeros((1, len(PLACES), 40)), np.zeros((1, len(PLACES), 40)), slopes)[2]
    assert predicted[5] == enough


def test_missing_bins_say_nothing() -> None:
    measured, slopes = made()
    measured[1, 2] = np.nan
    assert np.isfinite(left_out(measured, np.zeros_like(measured), slopes)[0]).all()


def test_channels_and_values_that_say_nothing_change_nothing() -> None:
    measured, slopes = made()
    forces = np.zeros_like(measured)
    plain, *_ = left_out(measured[:1], forces[:1], slopes[:, :1])
    rest = np.array([0.3, np.nan])  # a channel that was not fitted
    more = np.concatenate((slopes, 0.0 * slopes[:1]))  # a value on which nothing here depends
    found, _, predicted = left_out(measured, forces, more, rest=rest)
    assert predicted.all()
    np.testing.assert_allclose(found[0], plain[0], rtol=1e-12)
    assert not left_out(measured, forces, more[3:])[2].any()
