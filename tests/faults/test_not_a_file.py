"""Pipes, sockets and devices named as a file: refused at once; reading one could wait for ever."""

import os
import re
import socket
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
from tests.faults.terminal import no_longer_than

from turnout.calibration.load_study import open_study
from turnout.calibration.result import load_calibration
from turnout.core.errors import FileError, TurnoutError
from turnout.core.files import require_regular_file
from turnout.panel.load import load_panel
from turnout.panel.markers import read_schedule_csv
from turnout.panel.matrices import read_rail_matrices
from turnout.throw.store import open_response


@pytest.fixture
def pipe(tmp_path: Path) -> Path:
    if not hasattr(os, "mkfifo"):
        pytest.skip("this system has no named pipes")
    path = tmp_path / "pipe.toml"
    os.mkfifo(path)
    return path


def test_pipe_socket_and_device_are_named(pipe: Path, tmp_path: Path) -> None:
    with pytest.raises(FileError, match=re.escape(f"{pipe}: is a pipe, not a file")):
        require_regular_file(pipe)
    (tmp_path / "link.toml").symlink_to(pipe)
    with pytest.raises(FileError, match="is a pipe"):
        require_regular_file(tmp_path / "link.toml")
    with pytest.raises(FileError, match="is a device"):
        require_regular_file("/dev/zero")
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "socket"))
        with pytest.raises(FileError, match="is a socket"):
            require_regular_file(tmp_path / "socket")


def test_missing_and_impossible_paths_are_named(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no such file"):
        require_regular_file(tmp_path / "missing")
    with pytest.raises(FileError, match="cannot be read"):
        require_regular_file("a\0b")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    with pytest.raises(FileError, match="cannot be read"):
        require_regular_file(tmp_path / "loop")


READERS: Mapping[str, Callable[[Path], object]] = {
    "panel": load_panel,
    "schedule": read_schedule_csv,
    "study": open_study,
    "calibration": load_calibration,
    "response": open_response,
}


@pytest.mark.parametrize("reader", READERS)
def test_no_reader_waits_for_a_pipe(reader: str, pipe: Path) -> None:
    with no_longer_than(60.0), pytest.raises(TurnoutError, match="is a pipe, not a file"):
        READERS[reader](pipe)


def test_matrices_from_a_pipe(pipe: Path) -> None:
    with no_longer_than(60.0):
        assert "is a pipe, not a file" in str(read_rail_matrices(pipe)[1])
