"""Pipes, sockets and devices named as a file: refused at once; reading one could wait for ever."""

import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from turnout.core.errors import FileError
from turnout.core.files import require_regular_file

SECONDS = 60.0


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


READERS: dict[str, str] = {
    "panel": "from turnout.panel.load import load_panel as read",
    "schedule": "from turnout.panel.markers import read_schedule_csv as read",
    "study": "from turnout.calibration.load_study import open_study as read",
    "calibration": "from turnout.calibration.result import load_calibration as read",
    "response": "from turnout.throw.store import open_response as read",
}


@pytest.mark.parametrize("reader", READERS)
def test_no_reader_waits_for_a_pipe(reader: str, pipe: Path) -> None:
    said = _output(f"{READERS[reader]}\nread(Path({str(pipe)!r}))")
    assert "is a pipe, not a file" in said


def test_matrices_from_a_pipe(pipe: Path) -> None:
    script = (
        "from turnout.panel.matrices import read_rail_matrices\n"
        f"print(read_rail_matrices(Path({str(pipe)!r}))[1])"
    )
    assert "is a pipe, not a file" in _output(script)


def _output(script: str) -> str:
    """Return what a script of its own process prints, both streams."""
    run = subprocess.run(
        [sys.executable, "-c", f"from pathlib import Path\n{script}"],
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=False,
    )
    return run.stdout + run.stderr
