"""Recordings of the kinds that were once read with a wrong time: right, or refused with the reason.

Each is given by the channels that must come out, with their unit, rate, start, first and last
value, or by words of the message that must refuse it.
"""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from turnout.core.errors import FileError
from turnout.measurement.formats.file_format import read_recording

Row = tuple[str, float, float, float, float]
"""Unit, samples per second, start [s], first and last value."""
CASES: dict[str, dict[str, Row] | tuple[str, ...]] = {
    "sv_minus.csv": {"Kraft 1": ("kN", 100, 0, -0.61, 0.55)},
    "first_rows_dropped_minus.csv": {
        "Kraft 1": ("kN", 100, 0, -0.61, 0.6),
        "Kraft 2": ("kN", 100, 0, -2.81, 0.45),
    },
    "de_date.csv": {"Kraft 1": ("kN", 100, 0, -0.61, -0.12)},
    "index_first.csv": ("counts samples and is no time", "Sample rate: 1000 Hz"),
    "two_times_same_name.txt": {
        "Rod 1": ("kN", 100, 0, 0, 11),
        "Rod 2": ("kN", 25, 0, 0, -2),
    },
    "two.lvm": {"Rod 1": ("kN", 100, 0, -0.61, -0.12), "Clamp 1": ("A", 25, 0, 0.8, 1.0)},
    "timestamp_header.csv": {"Force 1": ("kN", 100, 0, -0.61, -0.12)},
    "text_column.csv": {"Rod 1": ("kN", 100, 0, -0.61, -0.12)},
    "toa5.dat": {"Rod1": ("kN", 100, 0, -0.61, -0.12)},
    "quoted_decimal_comma.csv": {"Kraft 1": ("kN", 100, 0, -0.61, -0.12)},
    "trailing_semicolon.csv": {"Rod 1": ("kN", 100, 0, -0.61, -0.12)},
    "de_rate_thousands.csv": {
        "Kraft 1": ("kN", 1000, 0, -0.61, 0.917),
        "Strom 1": ("A", 1000, 0, 6.3, 2.807),
    },
    "two_rates_row.csv": {
        "Force 1": ("kN", 1000, 0, -0.61, 2.499),
        "Temperature": ("°C", 25, 0, 11.2, 11.5),
    },
    "mains_frequency.csv": {"I1": ("A", 25, 0, 6.3, 2.677), "P1": ("W", 25, 0, 310, 513)},
    "torque_t.csv": {"I1": ("A", 25, 0, 6.3, 2.677), "T": ("", 25, 0, 1.5, 4.4)},
    "whole_seconds.csv": ("whole seconds", "state the sample rate"),
    "scpi_overload.csv": {"Clamp 1": ("A", 100, 0, np.nan, 2.677)},
    "pm_sample_index_rate.csv": ("2 throws in one table (column 'move_no')", "--throw 1"),
    "pm_throws_table.csv": ("3 throws in one table (column 'throw')", "--throw 417"),
    "hioki_block.csv": {
        "ACH1": ("A", 400, 0, 6.3, 2.807),
        "ACH2": ("V", 400, 0, -0.61, 0.917),
    },
}
BINARY: dict[str, dict[str, Row]] = {
    "starts_differ.tdms": {
        "Rod 1": ("kN", 100, 0, -0.61, 0.4),
        "Rod 2": ("kN", 100, 0.5, -0.61, 0.4),
    },
    "time_stamp.tdms": {"Rod 1": ("", 100, 0, -0.61, 0.4)},
    "invalid_bits.mf4": {"Rod 1": ("kN", 100, 0, -0.61, 0.4)},
    "scale_factor.h5": {"rod": ("kN", 100, 0, -0.61, 0.4)},
    "datenum.mat": {"rod": ("", 100, 0, -0.61, 0.4)},
    "simulink.mat": {"Rod 1": ("", 100, 0, -0.61, 0.4), "Rod 2": ("", 100, 0, 0.61, -0.4)},
    "index_unnamed.parquet": {"rod": ("kN", 100, 0, -0.61, 0.4)},
}


@pytest.fixture(scope="session")
def cases(pytestconfig: pytest.Config) -> Path:
    folder = pytestconfig.rootpath.parent / "shared/cases/import"
    if not folder.is_dir():
        pytest.skip("no collected recordings: ../shared/cases is not beside this checkout")
    return folder


@pytest.fixture(scope="session")
def binary(cases: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    for package in ("nptdms", "asammdf", "pyarrow"):
        pytest.importorskip(package, reason="the extras daq and parquet are not installed")
    folder = tmp_path_factory.mktemp("binary")
    script = cases / "make_binary_cases.py"
    subprocess.run([sys.executable, script, folder], check=True, capture_output=True)
    return folder


def check(path: Path, expected: dict[str, Row] | tuple[str, ...]) -> None:
    """Compare every channel of a file with what it must be, or the refusal with its words."""
    if isinstance(expected, tuple):
        with pytest.raises(FileError) as caught:
            read_recording(path)
        text = str(caught.value)
        assert len(text.splitlines()) == 1
        for word in (path.name, *expected):
            assert word in text
        return
    recording = read_recording(path)
    assert list(recording.channels) == list(expected), recording.problems
    for name, (unit, rate, start, first, last) in expected.items():
        channel = recording.channel(name)
        assert channel.unit == unit
        assert (channel.rate, channel.start) == pytest.approx((rate, start), rel=1e-6, abs=1e-9)
        ends = (channel.values[0], channel.values[-1])
        assert ends == pytest.approx((first, last), nan_ok=True)


@pytest.mark.parametrize("name", CASES)
def test_collected_text_files(cases: Path, name: str) -> None:
    check(cases / name, CASES[name])


@pytest.mark.parametrize("name", BINARY)
def test_collected_binary_files(binary: Path, name: str) -> None:
    check(binary / name, BINARY[name])


def test_every_collected_file_is_looked_at(cases: Path) -> None:
    left = {path.name for path in cases.iterdir()} - {"README.md", "make_binary_cases.py"}
    assert left == set(CASES)


def test_samples_marked_invalid_are_missing(binary: Path) -> None:
    values = read_recording(binary / "invalid_bits.mf4").channel("Rod 1").values
    assert np.flatnonzero(np.isnan(values)).tolist() == [5, 6]


def test_overloads_of_instruments_are_missing(cases: Path) -> None:
    recording = read_recording(cases / "scpi_overload.csv")
    values = recording.channel("Clamp 1").values
    assert np.flatnonzero(np.isnan(values)).tolist() == [0, 1, 2, 14, 20]
    assert recording.problems == ("channel 'Clamp 1': 5 samples are overload, taken as missing",)
