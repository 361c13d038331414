"""Small files that ask for much: read or refused within 1 GB and 10 s, with one message."""

import resource
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from benchmarks.studies.attack.recordings import OWN_LIMIT, judged, sound_files
from tests.faults.hostile_recordings import HOSTILE

from turnout.core.errors import FileError
from turnout.measurement.formats import file_format
from turnout.measurement.formats.file_format import read_recording

LONG = (
    *("filled float32", "filled int8", "filled, called netCDF", "filled beyond any memory"),
    *("compressed by lzf", "columns of one name", "parquet in columns", "mdf", "tdms"),
    *("7.3 in parts", "7.3 beyond any memory", "7.3 circle", "7.3 large chunk"),
    *("7.3 cell of itself", "5 compressed in parts", "5 many variables", "5 fewer cells"),
    *("5 objects", "5 larger than it is"),
)
"""Rows whose way of asking for much another row has, in another type, number or format."""

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/clear_refs").exists(), reason="counts the memory of processes in /proc"
)


@pytest.fixture(scope="module", autouse=True)
def own_limit() -> Iterator[None]:
    """Only keeps a program that fails these tests from taking the machine's memory."""
    before = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (OWN_LIMIT, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_DATA, before)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.long) if name in LONG else name for name in HOSTILE],
)
def test_a_hostile_recording_takes_little(tmp_path: Path, name: str) -> None:
    """Time is that of the processors, as a machine may be busy otherwise."""
    suffix, write = HOSTILE[name]
    path = tmp_path / f"throw{suffix}"
    write(path)
    found = judged(path, name)
    assert found["outcome"] != "fault", found["text"]


def test_sound_recordings_are_read_as_these_are(tmp_path: Path) -> None:
    """Refusing all would pass every test above."""
    pytest.importorskip("asammdf", reason="the extra daq is not installed")
    pytest.importorskip("pyarrow", reason="the extra parquet is not installed")
    for kind, path in sound_files(tmp_path).items():
        assert read_recording(path).channels, kind
        assert judged(path, kind)["outcome"] == "answered"


def test_a_reader_that_cannot_be_loaded_is_not_a_damaged_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.h5"
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(600))
    moved = tuple(replace(item, reader="nowhere:read") for item in file_format.FORMATS)
    monkeypatch.setattr(file_format, "FORMATS", moved)
    with pytest.raises(FileError, match="cannot be loaded .*install turnout again"):
        read_recording(path)
