"""Measures of how far two sets of movements are apart, by hand."""

import numpy as np
import pytest
import xarray as xr

from turnout.metric.agreement import (
    band_coverage,
    channel_scale,
    nrmse,
    repeat_groups,
    repeat_spread,
    rms_difference,
)
from turnout.metric.channel_features import build_up_slope, channel_features, contact_time

DIMS = ("channel", "movement", "time")


def channels(values: object) -> xr.DataArray:
    array = np.array(values, dtype=float)
    time = {"time": 0.02 * np.arange(array.shape[2])}
    return xr.DataArray(array, time, DIMS)


def test_errors_count_where_there_is_a_measurement() -> None:
    measured = channels([[[0.0, 2.0, np.nan], [np.nan] * 3], [[10.0, -20.0, 0.0], [1.0] * 3]])
    predicted = channels([[[3.0, 6.0, 99.0], [1.0] * 3], [[10.0, -20.0, 0.0], [3.0] * 3]])
    rms = rms_difference(measured, predicted)
    assert rms.values[0, 0] == pytest.approx(np.sqrt(12.5))
    assert np.isnan(rms.values[0, 1])
    assert channel_scale(measured).values.tolist() == [2.0, 20.0]
    assert nrmse(measured, predicted).values[1].tolist() == [0.0, 0.1]


def test_only_what_the_sheet_calls_equal_is_a_repeat() -> None:
    sheet = xr.Dataset(
        coords={
            "direction": ("movement", ["closing", "opening", "closing", "closing", "closing"]),
            "size": ("movement", [0.0, 0.0, 0.0, 0.013, 0.013]),
            "place": ("movement", ["none", "none", "none", "sleeper 6", "sleeper 7"]),
        }
    )
    assert repeat_groups(sheet) == [[0, 2]]


def test_the_spread_of_repeats_is_that_of_one_throw() -> None:
    rng = np.random.default_rng(4)
    values = 5.0 * rng.standard_normal((1, 60, 400)) + 100.0 * np.sin(np.arange(400))
    groups = [[3 * n, 3 * n + 1, 3 * n + 2] for n in range(20)]
    assert float(repeat_spread(channels(values), groups)[0]) == pytest.approx(5.0, rel=0.02)
    assert np.isnan(float(repeat_spread(channels(values), [])[0]))


def test_a_band_covers_what_lies_in_it() -> None:
    measured = channels([[[0.0, 1.0, 2.0, np.nan]], [[np.nan] * 4]])
    cover = band_coverage(measured, measured * 0 - 0.5, measured * 0 + 1.5)
    assert cover.values[0, 0] == pytest.approx(2 / 3)
    assert np.isnan(cover.values[1, 0])


def ramp(start: float, slope: float, top: float) -> xr.DataArray:
    time = 0.02 * np.arange(200)
    return xr.DataArray(np.clip(slope * (time - start), 0.0, top), {"time": time}, ("time",))


def test_contact_lies_between_samples_and_a_bounce_is_no_contact() -> None:
    force = ramp(1.0, 20e3, 5e3)
    # 100 N of a ramp of 20 kN/s are 5 ms.
    assert float(contact_time(force)) == pytest.approx(1.005, abs=1e-9)
    bounced = force.copy(data=np.where((force["time"] > 0.5) & (force["time"] < 0.6), 300.0, force))
    assert float(contact_time(bounced)) == pytest.approx(1.005, abs=1e-9)
    assert np.isnan(float(contact_time(0.0 * force)))
    assert np.isnan(float(contact_time(0.0 * force + 500.0)))


def test_a_build_up_has_the_slope_of_its_ramp() -> None:
    force = ramp(1.0, 22e3, 6e3) + 1000.0
    assert build_up_slope(force, contact=1.0, end=3.9) == pytest.approx(22e3, rel=1e-6)
    assert np.isnan(build_up_slope(force, contact=2.0, end=3.9))
    assert np.isnan(build_up_slope(force, contact=float("nan"), end=3.9))


def test_features_are_of_each_channel_and_movement() -> None:
    forces = xr.concat([ramp(1.0, 22e3, 6e3), ramp(2.0, 5e3, 1e3)], "movement")
    found = channel_features(
        forces.expand_dims("channel"), contact=xr.DataArray([1.0, 2.0], dims="movement"), end=3.9
    )
    assert found["slope"].values[0] == pytest.approx([22e3, 5e3], rel=1e-6)
    assert found["peak"].values[0].tolist() == [6e3, 1e3]
    assert found["plateau"].values[0] == pytest.approx([6e3, 1e3])
