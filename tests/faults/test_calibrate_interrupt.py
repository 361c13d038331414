"""Calibrations ended by Ctrl-C or killed: one message, nothing lost, no process left behind."""

import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest
from tests.faults.sweep_process import gone, workers_of
from tests.faults.terminal import run_here, started_in_terminal
from tests.verification.outsider import CASES, Case, Habits, Truth, write_campaign

from turnout.calibration.result import Calibration, load_calibration

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/task").exists(), reason="finds the processes of a run in /proc"
)
PATIENCE = 300.0
FILE = "calibration.toml"
# Two parameters are enough to be interrupted at.
FIXED = ("drive.1.saturation_force", "drive.2.stiffness", "drive.2.saturation_force")


def campaign(folder: Path) -> Path:
    """Two movements, as a folder of recordings."""
    folder.mkdir()
    cases = (Case(), CASES[2])
    truth = Truth(stiffness=(640e3, 810e3), level=(6e3, 6e3))
    return write_campaign(folder, truth, cases=cases, habits=Habits(rate=200.0, noise=10.0))


def words(folder: Path, *, workers: int) -> list[str]:
    options = ["--panel", "sb1", "-o", str(folder / FILE), "--workers", str(workers)]
    return ["calibrate", str(folder), *options, *(w for key in FIXED for w in ("--fix", key))]


def finished(folder: Path) -> Calibration:
    """Return the calibration that the command comes to where nothing interrupts it."""
    code, err = run_here(*words(folder, workers=1), folder=folder)
    assert code == 0, err
    return load_calibration(folder / FILE)


def throws(folder: Path) -> int:
    """Count whole throws; what a kill tore has a name that begins with a dot."""
    return len(list((folder / ".turnout" / "throws").glob("[!.]*.npz")))


def started(folder: Path, *, until: int) -> subprocess.Popen[str]:
    """Start a calibration in a terminal, and wait until so many throws are kept."""
    process = started_in_terminal(*words(folder, workers=2))
    due = time.monotonic() + PATIENCE
    while throws(folder) < until and process.poll() is None and time.monotonic() < due:
        time.sleep(0.02)
    return process


def test_ctrl_c_is_one_message_a_kill_leaves_no_process_and_both_go_on(
    worker_processes: None, tmp_path: Path
) -> None:
    """The same command throws what is missing alone, and comes to the same end."""
    folder = campaign(tmp_path / "campaign")
    whole = finished(Path(shutil.copytree(folder, tmp_path / "whole")))
    process = started(folder, until=6)
    workers = workers_of(process.pid)
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "run the same command to continue" in err
    assert "Traceback" not in err
    assert gone(workers)
    assert not (folder / FILE).exists()
    process = started(folder, until=throws(folder) + 6)
    workers = workers_of(process.pid)
    assert workers
    process.kill()
    process.communicate()
    assert gone(workers)
    assert not (folder / FILE).exists()
    kept, found = throws(folder), finished(folder)
    assert found.values == whole.values
    made = sum(stage.evaluations for stage in found.stages)
    assert made <= sum(stage.evaluations for stage in whole.stages) - kept
