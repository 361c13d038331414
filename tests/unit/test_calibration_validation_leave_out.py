"""Places left out in turn: exact for a linear model, and a wrong place is seen."""

from typing import Any

import numpy as np

from turnout.calibration.validation.prediction_bands import LeftOut, leave_out_places

PLACES = ["none", "none", "drive 1", "drive 1", "sleeper 7", "drive 2"]


def made() -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]:
    rng = np.random.default_rng(5)
    slopes = {name: rng.standard_normal((2, len(PLACES), 40)) for name in ("mu", "k", "level")}
    stacked = np.stack(list(slopes.values()))
    measured = np.tensordot([1.0, -2.0, 0.5], stacked, axes=1)
    measured += 0.3 * rng.standard_normal(measured.shape)
    return measured, slopes, stacked


def left_out(
    measured: np.ndarray, forces: np.ndarray, slopes: dict[str, np.ndarray], **known: Any
) -> LeftOut:
    """Leave out the places; of noises of 0.3, and with values as uncertain as they come."""
    usual = {
        "variance": np.full(measured.shape, 0.09),
        "covariance": np.eye(len(slopes)),
        "places": PLACES,
    }
    return leave_out_places(measured, forces, slopes, **(usual | known))


def test_it_is_the_fit_to_the_other_places() -> None:
    measured, slopes, stacked = made()
    J = stacked.reshape(3, -1).T
    values = np.linalg.lstsq(J, measured.ravel(), rcond=None)[0]
    covariance = 0.09 * np.linalg.inv(J.T @ J)
    forces = np.tensordot(values, stacked, axes=1)
    found = left_out(measured, forces, slopes, covariance=covariance)
    assert found.predicted.all()
    for place in set(PLACES):
        inside = np.array([item == place for item in PLACES])
        rest = stacked[:, :, ~inside].reshape(3, -1).T
        others = np.linalg.lstsq(rest, measured[:, ~inside].ravel(), rcond=None)[0]
        expected = np.tensordot(others, stacked[:, :, inside], axes=1)
        np.testing.assert_allclose(found.forces[:, inside], expected, atol=1e-10)
        spread = 0.09 * np.linalg.inv(rest.T @ rest)
        variance = np.einsum(
            "icmt,ij,jcmt->cmt", stacked[:, :, inside], spread, stacked[:, :, inside]
        )
        np.testing.assert_allclose(found.variance[:, inside], variance, rtol=1e-8)


def test_values_that_are_off_are_off_by_as_much_in_each_prediction() -> None:
    """Values changed by hand were refused sooner than stated: their error was magnified."""
    measured, slopes, stacked = made()
    J = stacked.reshape(3, -1).T
    values = np.linalg.lstsq(J, measured.ravel(), rcond=None)[0]
    off = np.array([0.3, -0.2, 0.1])
    found, moved = (
        left_out(measured, np.tensordot(judged, stacked, axes=1), slopes)
        for judged in (values, values + off)
    )
    change = np.tensordot(off, stacked, axes=1)
    np.testing.assert_allclose(moved.forces, found.forces + change, atol=1e-9)


def test_what_a_movement_has_of_its_own_is_no_reason_to_change_values() -> None:
    measured, slopes, stacked = made()
    rng = np.random.default_rng(6)
    own = 5.0 * rng.standard_normal(measured.shape)
    measured = measured + own * rng.standard_normal(len(PLACES))[:, None]
    weights = [
        np.linalg.inv(0.09 * np.eye(80) + np.outer(one, one))
        for one in (own[:, n].ravel() for n in range(len(PLACES)))
    ]
    J = [stacked[:, :, n].reshape(3, -1) for n in range(len(PLACES))]

    def values(numbers: list[int]) -> np.ndarray:
        H = sum((J[n] @ weights[n] @ J[n].T for n in numbers), np.zeros((3, 3)))
        g = sum((J[n] @ weights[n] @ measured[:, n].ravel() for n in numbers), np.zeros(3))
        return np.linalg.solve(H, g)

    every = list(range(len(PLACES)))
    forces = np.tensordot(values(every), stacked, axes=1)
    found = left_out(measured, forces, slopes, alike=[own])
    for place in set(PLACES):
        inside = [n for n in every if PLACES[n] == place]
        others = values([n for n in every if n not in inside])
        expected = np.tensordot(others, stacked[:, :, inside], axes=1)
        np.testing.assert_allclose(found.forces[:, inside], expected, atol=1e-9)


def test_a_value_that_one_place_alone_shows_keeps_that_place() -> None:
    measured, slopes, _ = made()
    slopes["level"][:, :5] = 0.0
    found = left_out(measured, np.zeros_like(measured), slopes)
    assert found.predicted.tolist() == [True] * 5 + [False]
    np.testing.assert_array_equal(found.forces[:, 5], 0.0)


def test_missing_bins_say_nothing() -> None:
    measured, slopes, _ = made()
    measured[1, 2] = np.nan
    assert np.isfinite(left_out(measured, np.zeros_like(measured), slopes).forces).all()


def test_channels_and_values_that_say_nothing_change_nothing() -> None:
    measured, slopes, _ = made()
    forces, variance = np.zeros_like(measured), np.ones_like(measured)
    one = {key: item[:1] for key, item in slopes.items()}
    plain = left_out(measured[:1], forces[:1], one, variance=variance[:1])
    variance[1] = np.nan  # a channel that was not fitted
    slopes["clutch"] = np.zeros_like(measured)  # a value on which nothing here depends
    found = left_out(measured, forces, slopes, variance=variance)
    assert found.predicted.all()
    np.testing.assert_allclose(found.forces[0], plain.forces[0], rtol=1e-12)
    none = left_out(measured, forces, {"clutch": slopes["clutch"]}, variance=variance)
    assert not none.predicted.any()
