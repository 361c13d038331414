"""Throws are found in recordings, to the millisecond where currents do, with direction."""

import numpy as np
import pytest
import xarray as xr
from tests.unit.recorded import changed, clean, noisy, only, samples

from turnout.measurement.campaign.find_throws import Detection, find_throws
from turnout.measurement.campaign.motion_signals import (
    UNKNOWN,
    bridge_gaps,
    force_changes,
    found_direction,
)
from turnout.measurement.quality.throw_faults import judge_recording

ONSET = 2.0


@pytest.mark.parametrize("direction", ["closing", "opening"])
@pytest.mark.parametrize("size", [0.0, 0.013, 0.031])
def test_onset_and_direction_are_found(direction: str, size: float) -> None:
    throw = only(noisy(1, size, direction))
    assert abs(throw.onset - ONSET) < 0.005
    assert throw.direction == direction
    assert throw.source == "current"
    assert not throw.cut_start
    assert not throw.cut_end


def test_the_end_is_that_of_the_slower_drive() -> None:
    throw = only(noisy(2))
    assert throw.duration == pytest.approx(3.4, abs=0.02)
    assert throw.drive_ends == pytest.approx((ONSET + 3.2, ONSET + 3.4), abs=0.02)


@pytest.mark.parametrize("rate", [25.0, 100.0])
@pytest.mark.parametrize("quantity", ["drive_current", "drive_power"])
def test_a_record_that_begins_with_the_inrush_is_whole(quantity: str, rate: float) -> None:
    """As the contactor triggers it: no rest before, one after the motor is switched off."""
    time = np.arange(0.0, 6.0, 1.0 / rate)
    run = np.where(time < 5.0, 2.3 + 4.0 * np.exp(-time / 0.08), 0.0)
    factor = 150.0 if quantity == "drive_power" else 1.0
    dataset = xr.Dataset(
        {quantity: (("drive", "time"), [factor * run])}, {"time": time, "drive": ["1"]}
    )
    throw = only(dataset)
    assert (throw.source, throw.triggered, throw.cut_start) == (quantity[6:], True, False)
    assert (throw.onset, throw.end) == pytest.approx((0.0, 5.0), abs=1.01 / rate)
    verdict = judge_recording(dataset, throw)
    assert verdict.usable, verdict
    assert [text.split(":")[0] for text in verdict.remarks] == ["triggered"]
    # From its middle on the same record has lost its beginning.
    assert only(dataset.sel(time=slice(1.0, None))).cut_start


def test_a_slipping_drive_runs_until_it_is_switched_off() -> None:
    throw = only(noisy(3, 0.031))
    assert throw.drive_ends[1] == pytest.approx(ONSET + 8.0, abs=0.02)


@pytest.mark.parametrize("direction", ["closing", "opening"])
@pytest.mark.parametrize("friction", [0.25, 0.4])
@pytest.mark.parametrize("seed", range(5))
def test_rod_forces_alone_tell_the_onset_less_sharply(
    direction: str, seed: int, friction: float
) -> None:
    throw = only(noisy(seed, 0.013, direction, friction).drop_vars("drive_current"))
    assert throw.source == "force"
    assert abs(throw.onset - ONSET) < 0.010
    assert throw.direction == direction
    assert np.isnan(throw.drive_ends).all()


def test_a_reversed_clamp_tells_the_onset_too() -> None:
    dataset = noisy(4)
    for drive in ("1", "2"):
        channel = f"drive_current {drive}"
        dataset = changed(dataset, channel, -samples(dataset, channel))
    assert abs(only(dataset).onset - ONSET) < 0.005


def test_several_throws_of_one_recording_are_cut_apart() -> None:
    opening, closing = noisy(5, direction="opening"), noisy(6, direction="closing")
    later = closing.assign_coords(time=closing["time"] + 12.0)
    both = xr.concat([opening, later], "time")
    throws = find_throws(both)
    assert [throw.direction for throw in throws] == ["opening", "closing"]
    assert [throw.onset for throw in throws] == pytest.approx([2.0, 14.0], abs=0.005)
    assert throws[0].stop <= throws[1].first


def test_nothing_moves_in_noise() -> None:
    rest = noisy(7).isel(time=slice(0, 1900))
    assert find_throws(rest) == ()
    assert find_throws(rest.drop_vars("drive_current")) == ()


def test_what_is_kept_before_and_after_is_chosen() -> None:
    (throw,) = find_throws(noisy(8), detection=Detection(before=0.5, after=0.25))
    time = noisy(8)["time"].values
    assert time[throw.first] == pytest.approx(ONSET - 0.5, abs=0.02)
    assert time[throw.stop] == pytest.approx(throw.end + 0.25, abs=0.02)


def test_cut_recordings_say_so() -> None:
    whole = noisy(9)
    assert only(whole.sel(time=slice(2.5, None))).cut_start
    assert only(whole.sel(time=slice(None, 4.0))).cut_end


def test_an_offset_does_not_turn_the_direction() -> None:
    forces = clean(0.0, "opening")["drive_force"].values
    assert found_direction(forces[:, :8000] + 9000.0, rate=1000.0) == "opening"
    assert found_direction(np.zeros((2, 3000)), rate=1000.0) == UNKNOWN


def test_a_hole_is_bridged_by_a_straight_line() -> None:
    np.testing.assert_array_equal(
        bridge_gaps(np.array([0.0, np.nan, 2.0])), np.array([0.0, 1.0, 2.0])
    )
    np.testing.assert_array_equal(bridge_gaps(np.full(2, np.nan)), np.zeros(2))


def test_changes_are_those_of_each_drive() -> None:
    forces = np.repeat([[1.0, 4.0], [5.0, 2.0]], 400, axis=1)
    np.testing.assert_array_equal(force_changes(forces, rate=1000.0), [3.0, -3.0])
