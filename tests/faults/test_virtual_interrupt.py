"""Ctrl-C on a virtual campaign in two processes: one message, nothing lost, and it goes on."""

import os
import signal
import time
from pathlib import Path

from tests.faults.terminal import run_here, started_in_terminal

from turnout.study.virtual.series import STATE
from turnout.throw.store import open_response

PATIENCE = 300.0


def words(folder: Path, *, workers: int) -> list[str]:
    """Return the command that makes a virtual campaign at two places."""
    options = f"--panel sb2 --repeats 3 --size 13mm --format h5 --workers {workers}"
    places = ["--place", "sleeper 6", "--place", "sleeper 3"]
    return ["campaign", "virtual", *options.split(), *places, "--out", str(folder)]


def kept(folder: Path) -> int:
    return len(list((folder / STATE).glob("*.npz")))


def test_what_was_thrown_is_kept_and_the_same_command_goes_on(tmp_path: Path) -> None:
    folder = tmp_path / "virtual"
    process = started_in_terminal(*words(folder, workers=2))
    due = time.monotonic() + PATIENCE
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
    code, err = run_here(*words(folder, workers=1), folder=tmp_path)
    assert code == 0, err
    assert open_response(folder / "truth.nc").sizes["movement"] == 8
