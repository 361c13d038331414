"""Recordings of many loggers and programs: the right samples at the right times, or the reason."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from tests.unit.recording_files import FILES, Write
from tests.unit.recording_kinds import COUNT, CURRENT, FORCE, REMARKS, TEXTS, Read

from turnout.core.errors import FileError
from turnout.measurement.formats.file_format import read_recording

SAMPLES = {"Force": FORCE, "Current": CURRENT, "1": FORCE, "2": CURRENT, "column 3": CURRENT}


def check(path: Path, expected: Read | tuple[str, ...]) -> None:
    """Compare rates, starts and samples with what was written, or the message with its words."""
    if isinstance(expected, tuple):
        with pytest.raises(FileError) as caught:
            read_recording(path)
        text = str(caught.value)
        assert len(text.splitlines()) == 1
        assert len(text) < 1000
        for word in (path.name, *expected):
            assert word in text
        return
    recording = read_recording(path)
    assert list(recording.channels) == list(expected), recording.problems
    for name, (rate, start) in expected.items():
        channel = recording.channel(name)
        assert channel.rate == pytest.approx(rate, rel=1e-6)
        assert channel.start == pytest.approx(start, abs=1e-6)
        samples = SAMPLES.get(re.split(r"[./]", name)[-1])
        if samples is None:
            assert channel.values.size == COUNT
        else:
            there = np.isfinite(channel.values)
            if np.flatnonzero(~there).tolist() == [0, 1]:  # before the samples
                samples = np.concatenate((np.full(2, np.nan), samples[: COUNT - 2]))
            held = samples[: channel.values.size][there]
            np.testing.assert_allclose(channel.values[there], held, rtol=1e-6)
            assert np.count_nonzero(~there) in (0, 1, 2, 6)
            assert channel.values.size in (COUNT, COUNT // 5)


@pytest.mark.parametrize(
    ("text", "expected"),
    [pytest.param(text, expected, id=name) for name, text, expected in TEXTS],
)
def test_texts(tmp_path: Path, text: str, expected: Read | tuple[str, ...]) -> None:
    path = tmp_path / ("throw.lvm" if text.startswith("LabVIEW") else "throw.csv")
    path.write_text(text, encoding="utf-8")
    check(path, expected)


@pytest.mark.parametrize(
    ("suffix", "write", "expected"),
    [pytest.param(*row, id=name) for name, *row in FILES],
)
def test_files(tmp_path: Path, suffix: str, write: Write, expected: Read | tuple[str, ...]) -> None:
    path = tmp_path / f"throw{suffix}"
    write(path)
    check(path, expected)


@pytest.mark.parametrize(
    ("text", "remarks"),
    [pytest.param(text, remarks, id=name) for name, text, remarks in REMARKS],
)
def test_remarks(tmp_path: Path, text: str, remarks: tuple[str, ...]) -> None:
    path = tmp_path / "throw.csv"
    path.write_text(text, encoding="utf-8")
    assert read_recording(path).problems == remarks


@pytest.mark.parametrize(
    ("others", "remark"),
    [
        (["2", "3"], "all have three digits behind ',', which is taken for the decimal mark"),
        (["2.5", "3.25"], "',' is taken to part thousands ('7,000')"),
    ],
)
def test_a_remark_on_commas_in_texts(tmp_path: Path, others: list[str], remark: str) -> None:
    path = tmp_path / "throw.json"
    path.write_text(json.dumps({"fs": 25, "I": ["7,000", "6,250"], "U": others}), encoding="utf-8")
    assert read_recording(path).problems == (f"check the values: {remark}",)
