"""Each fault of a recorded throw is seen, named, and excludes it; sound throws pass."""

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr
from tests.unit.recorded import changed, clean, noisy, only, samples, typical

from turnout.measurement.quality.channel_faults import KINDS, line_amplitude, mostly_beyond
from turnout.measurement.quality.throw_faults import (
    Expected,
    ThrowQuality,
    judge_recording,
    open_level,
)


def judged(
    dataset: xr.Dataset, *, direction: str = "closing", load_cell: bool = True
) -> ThrowQuality:
    expected = Expected(
        direction=direction, load_cell=load_cell, rate=1000.0, profile=typical(direction)
    )
    return judge_recording(dataset, only(dataset), expected=expected)


def altered(
    channel: str, change: Callable[[np.ndarray], np.ndarray], *, seed: int = 21
) -> xr.Dataset:
    dataset = noisy(seed, 0.026)
    return changed(dataset, channel, change(samples(dataset, channel)))


def held(values: np.ndarray) -> np.ndarray:
    values[3500:3560] = values[3500]
    return values


def with_hole(values: np.ndarray) -> np.ndarray:
    values[3500:3560] = np.nan
    return values


def humming(values: np.ndarray) -> np.ndarray:
    return values + 90.0 * np.sin(2.0 * np.pi * 50.0 * np.arange(values.size) / 1000.0)


def railway_hum(values: np.ndarray) -> np.ndarray:
    return values + 90.0 * np.sin(2.0 * np.pi * 50.0 / 3.0 * np.arange(values.size) / 1000.0)


def ringing(values: np.ndarray) -> np.ndarray:
    """Ring as a load cell that is struck, at the frequency of railway supply; it dies away."""
    since = np.arange(values.size) / 1000.0 - 3.6
    wave = 900.0 * np.exp(-since / 0.2) * np.sin(2.0 * np.pi * 50.0 / 3.0 * since)
    return values + np.where(since > 0.0, wave, 0.0)


def spiked(values: np.ndarray, height: float = 9000.0) -> np.ndarray:
    """Put a tooth of one sample into the rest, one into the motion and one into the end."""
    values[[40, 3000, values.size - 40]] += height * np.array([1.0, -1.0, 1.0])
    return values


def drifting(values: np.ndarray) -> np.ndarray:
    return values + 180.0 * np.arange(values.size) / 1000.0


def swapped(name: str) -> xr.Dataset:
    dataset = noisy(22, 0.026)
    return dataset.assign({name: (dataset[name].dims, dataset[name].values[::-1])})


def at_rate(factor: float) -> xr.Dataset:
    """State samples at another rate than they were taken at, then read them as if at 1 kHz."""
    dataset = noisy(23, 0.026)
    time = dataset["time"].values
    return dataset.interp(
        time=time[time <= time[-1] * min(1.0, 1.0 / factor)] * factor
    ).assign_coords(time=time[time <= time[-1] * min(1.0, 1.0 / factor)])


@pytest.mark.parametrize(
    ("dataset", "kind", "channel"),
    [
        (lambda: altered("drive_force 2", lambda v: np.minimum(v, 4000.0)), "clipping", "force 2"),
        (lambda: altered("object_force", lambda v: np.minimum(v, 1500.0)), "clipping", "object"),
        (lambda: altered("drive_force 1", held), "drop-out", "drive_force 1"),
        (lambda: altered("drive_current 2", with_hole), "missing samples", "drive_current 2"),
        (lambda: altered("drive_force 2", lambda v: 0.0 * v), "dead channel", "drive_force 2"),
        (lambda: altered("drive_current 1", lambda v: 0.0 * v), "dead channel", "drive_current 1"),
        (lambda: swapped("drive_force"), "swapped channels", "drive_force 1 and 2"),
        (lambda: swapped("drive_current"), "swapped channels", "drive_current 1 and 2"),
        (lambda: altered("drive_force 1", lambda v: -v), "reversed polarity", "drive_force 1"),
        (lambda: altered("drive_current 2", lambda v: -v), "reversed polarity", "current 2"),
        (lambda: altered("object_force", lambda v: -v), "reversed polarity", "object_force"),
        (lambda: at_rate(2.0), "sampling rate", ""),
        (lambda: at_rate(0.8), "sampling rate", ""),
        (lambda: altered("object_force", railway_hum), "mains hum", "object_force"),
        (lambda: altered("drive_force 1", spiked), "spikes", "drive_force 1"),
        (lambda: altered("drive_current 1", lambda v: spiked(v, 8.0)), "spikes", "current 1"),
        (lambda: altered("drive_force 2", drifting), "drift", "drive_force 2"),
        (lambda: noisy(24, 0.026).sel(time=slice(2.2, None)), "truncated", ""),
        (lambda: noisy(24, 0.026).sel(time=slice(None, 4.5)), "truncated", ""),
    ],
)
def test_a_fault_is_seen_and_excludes(
    dataset: Callable[[], xr.Dataset], kind: str, channel: str
) -> None:
    verdict = judged(dataset())
    found = [fault for fault in verdict.faults if fault.kind == kind and channel in fault.channel]
    assert found, verdict
    assert not verdict.usable
    assert kind in KINDS
    assert any(kind in reason for reason in verdict.reasons)


def test_a_load_cell_that_rings_after_an_impact_does_not_hum() -> None:
    dataset = altered("object_force", ringing)
    assert not [fault for fault in judged(dataset).faults if fault.kind == "mains hum"]
    assert judged(dataset).usable


@pytest.mark.parametrize("direction", ["closing", "opening"])
@pytest.mark.parametrize("size", [0.0, 0.013, 0.031])
@pytest.mark.parametrize("seed", [31, 32])
def test_a_sound_throw_passes(direction: str, size: float, seed: int) -> None:
    verdict = judged(
        noisy(seed, size, direction), direction=direction, load_cell=direction == "closing"
    )
    assert verdict.usable, verdict.reasons


@pytest.mark.parametrize("currents", [True, False])
@pytest.mark.parametrize(("change", "kind"), [(spiked, "spikes"), (drifting, "drift")])
def test_spikes_and_drift_are_called_so(
    currents: bool, change: Callable[[np.ndarray], np.ndarray], kind: str
) -> None:
    """Neither hides where the throw begins and ends, so that nothing else is found."""
    dataset = altered("drive_force 2", change)
    dataset = dataset if currents else dataset.drop_vars("drive_current")
    verdict = judge_recording(
        dataset, only(dataset), expected=Expected(direction="closing", rate=1000.0)
    )
    assert {fault.kind for fault in verdict.faults} == {kind}, verdict


@pytest.mark.parametrize("direction", ["closing", "opening"])
def test_a_zero_offset_is_remarked(direction: str) -> None:
    usual = noisy(41, direction=direction)
    level = open_level(usual, only(usual), direction=direction)
    known = Expected(direction=direction, load_cell=False, open_level=level)
    for seed in (42, 43):
        sound = noisy(seed, direction=direction)
        assert not judge_recording(sound, only(sound), expected=known).faults
    sound["drive_force"][0] += 1500.0
    verdict = judge_recording(sound, only(sound), expected=known)
    assert verdict.usable
    (remark,) = verdict.remarks
    assert remark.startswith("zero offset of drive_force 1: ")
    sound["drive_current"][1] += 0.2
    assert any(
        "zero offset of drive_current 2" in r for r in judge_recording(sound, only(sound)).remarks
    )


def test_a_coarse_converter_is_remarked() -> None:
    dataset = altered("drive_force 2", lambda v: 2000.0 * np.round(v / 2000.0))
    remarks = judged(dataset).remarks
    assert "quantisation of drive_force 2: it has steps of 2 kN, at most 50 N expected" in remarks


def with_short_hole(values: np.ndarray) -> np.ndarray:
    values[3000:3004] = np.nan
    return values


@pytest.mark.parametrize(
    ("dataset", "words"),
    [
        (lambda: altered("drive_force 1", with_short_hole, seed=36), "bridged"),
        (lambda: noisy(37, 0.0), "dead channel of object_force"),
    ],
)
def test_what_costs_no_throw_is_remarked(dataset: Callable[[], xr.Dataset], words: str) -> None:
    verdict = judged(dataset())
    assert verdict.usable
    assert any(words in remark for remark in verdict.remarks)


@pytest.mark.parametrize(
    ("dataset", "direction", "reason"),
    [
        (lambda: noisy(34), "opening", "the sheet says opening, the rod forces closing"),
        (
            lambda: noisy(35).isel(time=slice(None, None, 2)),
            "closing",
            "sampling rate: 500 Hz stated, 1000 Hz in the rest",
        ),
        (
            lambda: altered("drive_force 1", lambda v: np.nan * v, seed=36),
            "closing",
            "dead channel of drive_force 1: it was not recorded",
        ),
    ],
)
def test_a_reason_is_in_plain_numbers(
    dataset: Callable[[], xr.Dataset], direction: str, reason: str
) -> None:
    reasons = judged(dataset(), direction=direction).reasons
    assert any(reason in item for item in reasons)
    assert len(reasons) == 1 or direction == "opening"


@pytest.mark.parametrize("dataset", [lambda: noisy(33, 0.013, friction=0.44), lambda: clean(0.031)])
def test_more_friction_and_samples_without_noise_are_no_fault(
    dataset: Callable[[], xr.Dataset],
) -> None:
    assert judged(dataset()).usable


def test_rods_of_different_sign_are_seen_without_a_sheet() -> None:
    dataset = altered("drive_force 1", lambda v: -v)
    (reason,) = judge_recording(dataset, only(dataset)).reasons
    assert reason == "reversed polarity of drive_force: rod forces of different sign in one throw"


def test_a_load_cell_that_was_not_mounted_is_not_looked_at() -> None:
    dataset = altered("object_force", with_hole)
    assert judged(dataset, load_cell=False).usable
    assert not judged(dataset).usable


@pytest.mark.parametrize("frequency", [50.0 / 3.0, 50.0, 60.0])
def test_a_line_is_measured_on_top_of_a_ramp(frequency: float) -> None:
    time = np.arange(3200) / 1000.0
    values = 35.0 * np.sin(2.0 * np.pi * frequency * time + 0.4) + 1500.0 * time**2
    assert line_amplitude(values, frequency=frequency, rate=1000.0) == pytest.approx(35.0, rel=0.02)


def test_a_wrong_unit_is_not_taken_for_spikes() -> None:
    """Noise of a force that reads a thousand times too much stands out everywhere."""
    rng = np.random.default_rng(3)
    values = 1e3 * (2000.0 + 5.0 * rng.standard_normal(4000))
    assert mostly_beyond(values, key="drive_force")
    assert not mostly_beyond(1e-3 * values, key="drive_force")
    few = 1e-3 * values
    few[::100] += 5e5
    assert not mostly_beyond(few, key="drive_force")
