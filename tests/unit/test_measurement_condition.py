"""Conditioning: no shift in time, edges and holes as stated, raw kept beside filtered."""

import numpy as np
import pytest

from turnout.core.channels import check_schema
from turnout.core.moving_average import moving_average, window_samples
from turnout.measurement.chain.apply import apply_chain, load_channel_map
from turnout.measurement.chain.condition import (
    condition,
    tare,
)
from turnout.measurement.recording import RecordedChannel, Recording

RATE = 1000.0
RNG = np.random.default_rng(7)


def test_a_tenth_of_a_second_is_101_samples() -> None:
    assert [window_samples(0.1, rate=rate) for rate in (1000.0, 2000.0, 100.0)] == [101, 201, 11]
    pulse = np.zeros(1001)
    pulse[500] = 101.0
    smooth = moving_average(pulse, rate=RATE)
    np.testing.assert_allclose(smooth[450:551], 1.0, rtol=1e-12)
    np.testing.assert_allclose(smooth[:450], 0.0, atol=1e-12)
    np.testing.assert_allclose(smooth[551:], 0.0, atol=1e-12)


def test_edges_are_over_what_there_is() -> None:
    values = RNG.normal(size=300)
    smooth = moving_average(values, rate=RATE)
    assert smooth[0] == pytest.approx(values[:51].mean())
    assert smooth[20] == pytest.approx(values[:71].mean())
    assert smooth[-1] == pytest.approx(values[-51:].mean())


def test_one_more_row_changes_no_bit_of_the_others() -> None:
    values = RNG.normal(size=(2, 500))
    alone = moving_average(values[:1], rate=RATE)
    np.testing.assert_array_equal(moving_average(values * [[1.0], [1e9]], rate=RATE)[:1], alone)


def test_rounding_in_the_rate_does_not_decide_the_window() -> None:
    """At 250 Hz half a window is 12.5 samples."""
    rates = 250.0 * (1.0 + 1e-14 * np.arange(-20, 21))
    assert {window_samples(0.1, rate=rate) for rate in rates} == {25}


def test_a_row_without_any_sample_stays_missing() -> None:
    values = np.vstack((np.full(300, np.nan), np.ones(300)))
    smooth = moving_average(values, rate=RATE)
    assert np.isnan(smooth[0]).all()
    assert np.all(smooth[1] == 1.0)


def test_holes_shorter_than_the_window_are_bridged() -> None:
    values = np.full(1000, 5.0)
    values[300:350] = np.nan
    values[600:800] = np.nan
    smooth = moving_average(values, rate=RATE)
    assert np.flatnonzero(np.isnan(smooth)).tolist() == list(range(650, 750))
    np.testing.assert_allclose(smooth[np.isfinite(smooth)], 5.0, rtol=1e-15)


def test_a_long_recording_keeps_its_digits() -> None:
    values = 1e7 + RNG.normal(size=1_000_000)
    smooth = moving_average(values, rate=RATE)
    assert smooth[-51] == pytest.approx(values[-101:].mean(), abs=1e-6)


def test_tare() -> None:
    time = np.arange(1000) / RATE
    pulse = np.where((time > 0.4) & (time < 0.6), 3.0, 0.0)
    np.testing.assert_allclose(tare(pulse + 7, rate=RATE, start=0.0, end=0.1), pulse, atol=1e-12)
    with pytest.raises(ValueError, match="no samples from 5 to 6 s"):
        tare(pulse, rate=RATE, start=5.0, end=6.0)


def test_raw_and_filtered_both_stay() -> None:
    values = RNG.normal(size=400)
    names = ("Rod 1", "Rod 2", "Clamp 1", "Clamp 2")
    units = ("mV/V", "mV/V", "V", "V")
    channels = {n: RecordedChannel(n, u, values, RATE) for n, u in zip(names, units, strict=True)}
    dataset = apply_chain(Recording(channels, "throw.csv"), load_channel_map("two-rods"))
    once = condition(dataset)
    check_schema(once)
    np.testing.assert_array_equal(once["drive_force_unfiltered"], dataset["drive_force"])
    np.testing.assert_allclose(
        once["drive_force"][1], moving_average(dataset["drive_force"].values[1], rate=RATE)
    )
    assert once.attrs["filter"] == "moving_average (window 0.1)"
    assert np.isnan(once["object_force"].values).all()
    other = condition(once, window=0.2)
    np.testing.assert_allclose(
        other["drive_current"],
        moving_average(dataset["drive_current"].values, rate=RATE, window=0.2),
    )
