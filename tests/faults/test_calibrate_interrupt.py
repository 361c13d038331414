"""Calibrations ended by Ctrl-C or killed: one message, nothing lost, no process left behind."""

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.faults.sweep_process import gone, workers_of
from tests.faults.terminal import started_in_terminal
from tests.verification.outsider import CASES, Case, Habits, Truth, write_campaign

from turnout.calibration.result import Calibration, load_calibration

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/task").exists(), reason="finds the processes of a run in /proc"
)
PATIENCE = 300.0
FILE = "calibration.toml"
# Two parameters are enough to be interrupted at.
FIXED = ("drive.1.saturation_force", "drive.2.stiffness", "drive.2.saturation_force")


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two movements, as a folder of recordings."""
    folder = tmp_path_factory.mktemp("interrupted") / "campaign"
    folder.mkdir()
    cases = (Case(), CASES[2])
    truth = Truth(stiffness=(640e3, 810e3), level=(6e3, 6e3))
    return write_campaign(folder, truth, cases=cases, habits=Habits(rate=200.0, noise=10.0))


@pytest.fixture(scope="module")
def whole(campaign: Path, worker_processes: None) -> Calibration:
    """The calibration that nothing interrupted."""
    folder = Path(shutil.copytree(campaign, campaign.parent / "whole"))
    finished(folder)
    return load_calibration(folder / FILE)


def started(folder: Path, *, workers: int = 2) -> subprocess.Popen[str]:
    """Start a calibration in a terminal."""
    options = ["--panel", "sb1", "-o", str(folder / FILE), "--workers", str(workers)]
    options += [word for key in FIXED for word in ("--fix", key)]
    return started_in_terminal("calibrate", str(folder), *options)


def finished(folder: Path) -> str:
    process = started(folder, workers=1)
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, err
    return out


def throws(folder: Path) -> int:
    """Count whole throws; what a kill tore has a name that begins with a dot."""
    return len(list((folder / ".turnout" / "throws").glob("[!.]*.npz")))


def wait_for(done: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    due = time.monotonic() + PATIENCE
    while not done() and process.poll() is None and time.monotonic() < due:
        time.sleep(0.02)


def check_goes_on(folder: Path, kept: int, whole: Calibration) -> None:
    """The same command throws what is missing alone, and comes to the same end."""
    assert not (folder / FILE).exists()
    finished(folder)
    found = load_calibration(folder / FILE)
    assert found.values == whole.values
    made = sum(stage.evaluations for stage in found.stages)
    assert made <= sum(stage.evaluations for stage in whole.stages) - kept


def test_ctrl_c_is_one_message_and_goes_on(
    campaign: Path, whole: Calibration, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(campaign, tmp_path / "campaign"))
    process = started(folder)
    wait_for(lambda: throws(folder) >= 6, process)
    workers = workers_of(process.pid)
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "the throws are kept, the same command goes on" in err
    assert "Traceback" not in err
    assert gone(workers)
    check_goes_on(folder, throws(folder), whole)


def test_a_killed_calibration_leaves_no_process_and_goes_on(
    campaign: Path, whole: Calibration, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(campaign, tmp_path / "campaign"))
    process = started(folder)
    wait_for(lambda: throws(folder) >= 15, process)
    workers = workers_of(process.pid)
    assert workers
    process.kill()
    process.communicate()
    assert gone(workers)
    check_goes_on(folder, throws(folder), whole)
