"""Ctrl-C on a virtual campaign in two processes: one message, nothing lost, and it goes on."""

import os
import signal
import subprocess
import time
from pathlib import Path

from tests.faults.terminal import started_in_terminal

from turnout.study.virtual.series import STATE

PATIENCE = 300.0


def started(folder: Path) -> subprocess.Popen[str]:
    """Start a virtual campaign at two places."""
    options = "--panel sb2 --repeats 3 --size 13mm --format h5 --workers 2"
    places = ["--place", "sleeper 6", "--place", "sleeper 3"]
    return started_in_terminal(
        "campaign", "virtual", *options.split(), *places, "--out", str(folder)
    )


def kept(folder: Path) -> int:
    return len(list((folder / STATE).glob("*.npz")))


def test_what_was_thrown_is_kept_and_the_same_command_goes_on(tmp_path: Path) -> None:
    folder = tmp_path / "virtual"
    process, due = started(folder), time.monotonic() + PATIENCE
    while kept(folder) < 2 and process.poll() is None and time.monotonic() < due:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "run the same command to continue" in err
    assert "Traceback" not in err
    there = kept(folder)
    assert 2 <= there < 8
    assert not (folder / "runs.csv").exists()
    process = started(folder)
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, err
    assert "8 movements" in out
    assert (folder / "truth.nc").is_file()
