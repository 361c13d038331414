"""Recordings at any sampling rate, and the recorder's response in fits and validations alike."""

import json
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from tests.unit.test_calibration_fit import TRUE, movement, response

from turnout.calibration.comparison import predicted
from turnout.calibration.evaluate import CELL
from turnout.calibration.measured_movements import BIN, _Bins, _recorder
from turnout.calibration.validation.validate import SharedBins
from turnout.core.toml import parse_toml
from turnout.measurement.chain.apply import apply_chain, parse_channel_map
from turnout.measurement.chain.recorder import LowPass, Recorder
from turnout.measurement.recording import RecordedChannel, Recording


def slow(time: np.ndarray) -> np.ndarray:
    return np.sin(2.0 * time)


@pytest.mark.parametrize("rate", [1000.0, 1024.0, 100.0, 75.0, 60.0, 50.0, 33.0, 20.0])
def test_bins_are_those_of_20_ms_at_any_rate(rate: float) -> None:
    time = (np.arange(round(4.0 * rate)) - round(rate)) / rate
    bins = _Bins.of(time)
    np.testing.assert_allclose(np.diff(bins.centres), BIN, rtol=2e-3)
    means = bins.means(slow(time))
    # Lines between samples T apart are off by F'' T^2 / 8 at most.
    np.testing.assert_allclose(means, slow(bins.centres), atol=1e-4 + 0.5 / rate**2)


def test_a_bin_with_a_sample_missing_is_missing() -> None:
    time = np.arange(0.0, 3.0, 1.0 / 75.0)
    values = slow(time)
    values[60] = np.nan  # at 0.8 s
    bins = _Bins.of(time)
    means = bins.means(values)
    lost = bins.centres[np.isnan(means)]
    assert 0 < lost.size <= 4
    np.testing.assert_allclose(lost, 0.8, atol=0.04)


def test_forces_that_are_sampled_more_slowly_than_currents_say_so() -> None:
    columns = {
        "Rod 1": RecordedChannel("Rod 1", "N", np.zeros(80), rate=20.0),
        "Clamp 1": RecordedChannel("Clamp 1", "A", np.zeros(4000), rate=1000.0),
    }
    text = (
        '[drive_force.1]\ncolumn = "Rod 1"\nkind = "scaled"\n'
        '[drive_current.1]\ncolumn = "Clamp 1"\nkind = "scaled"\n'
    )
    channel_map = parse_channel_map(parse_toml(text, source="map"))
    made = apply_chain(Recording(columns, "made up"), channel_map)
    assert json.loads(made.attrs["force_rates"]) == {"drive_force.1": 20.0}
    alike = {"Rod 1": replace(columns["Clamp 1"], name="Rod 1", unit="N")}
    same = apply_chain(Recording({**columns, **alike}, "made up"), channel_map)
    assert "force_rates" not in same.attrs


def row(rate: float, **attributes: object) -> xr.Dataset:
    time = np.arange(round(4.0 * rate)) / rate
    return xr.Dataset(coords={"time": time, "movement": "m"}, attrs=attributes)


def test_each_channel_has_the_rate_of_its_own_column() -> None:
    """A load cell of 10 samples a second must not smear the rods beside it."""
    assert _recorder(row(20.0), "drive_force.1") == Recorder(rate=20.0)
    assert _recorder(row(75.0), "drive_force.1") == Recorder(rate=75.0)
    assert _recorder(row(1000.0), "drive_force.1") == Recorder()
    stated = row(1000.0, recorded_rate=25.0)
    assert _recorder(stated, "drive_force.1") == Recorder(rate=25.0)
    mixed = row(1000.0, force_rates='{"m": {"object_force": 10.0}}')
    assert _recorder(mixed, "object_force") == Recorder(rate=10.0)
    assert _recorder(mixed, "drive_force.1") == Recorder()


@pytest.mark.parametrize("late", [0.0, 1e-3, 2e-3])
def test_bins_that_end_within_cells_of_a_response_are_not_smoothed(late: float) -> None:
    """Steps from cell to cell of 4 ms smoothed by up to what samples 5 ms apart do."""
    item = movement("m", rng=np.random.default_rng(0))
    made = response(TRUE)
    parabola = 0.5 * made.time**2 + CELL**2 / 24.0
    bins = np.arange(60, 160)
    (signal,) = item.signals
    seen = predicted(replace(made, drive_force={"1": parabola}), item, signal, bins, shift=late)
    began = signal.time[bins] - late + made.onsets["closing"]
    np.testing.assert_allclose(seen - 0.5 * began**2, BIN**2 / 24.0, rtol=1e-6)


def test_a_validation_has_the_recorder_that_a_fit_has() -> None:
    recorder = Recorder(low_pass=LowPass(corner=1.5), average=0.1)
    bare = movement("m", rng=np.random.default_rng(0))
    item = replace(bare, signals=(replace(bare.signals[0], recorder=recorder),))
    made = response(TRUE)
    grid = SharedBins.of([item])
    seen = grid.predicted([item], [made], shifts=np.zeros(1))[0, 0]
    (signal,) = item.signals
    np.testing.assert_allclose(seen, predicted(made, item, signal, grid.bins))
    kept = {name: recorder.applied(made.time, row) for name, row in made.drive_force.items()}
    (plain,) = bare.signals
    expected = predicted(replace(made, drive_force=kept), bare, plain, grid.bins)
    np.testing.assert_allclose(seen, expected)
    assert np.abs(seen - predicted(made, bare, plain, grid.bins)).max() > 100.0
