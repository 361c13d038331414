"""A sweep ended at any moment, in any way, goes on with nothing lost, doubled or torn."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.faults.sweep_process import (
    finished,
    gone,
    started,
    wait_for_batches,
    workers_of,
)
from tests.unit.sweeps import batch_names, here, small_study, study_file

from turnout.core.files import make_durable
from turnout.core.progress import Progress
from turnout.study.sweep import run
from turnout.study.sweep.read import open_batches
from turnout.study.sweep.run import throw_study

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/task").exists(), reason="finds the processes of a run in /proc"
)
COUNT = 64


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sweep that nothing interrupted, made in one process."""
    folder = tmp_path_factory.mktemp("whole")
    throw_study(small_study(folder, count=COUNT), folder / "sweep", pool=here)
    return folder / "sweep"


def check_same(folder: Path, whole: Path) -> None:
    """Names of batches hold digests of their bytes; the datasets are compared as well."""
    assert batch_names(folder) == batch_names(whole)
    mine, theirs = open_batches(folder), open_batches(whole)
    assert mine["scenario"].values.tolist() == list(range(COUNT))
    xr.testing.assert_identical(mine.load(), theirs.load())
    assert not list((folder / "batches").glob(".*"))


def check_goes_on(folder: Path, whole: Path) -> None:
    """What was written is not thrown again."""
    study, written = small_study(folder, count=COUNT), len(batch_names(folder / "s"))
    assert throw_study(study, folder / "s", pool=here).thrown == COUNT - 8 * written
    check_same(folder / "s", whole)


def test_a_batch_is_on_the_disk_before_it_counts(
    worker_processes: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its worker goes on meanwhile; workers of another pool, maybe elsewhere, wait themselves."""
    waited: list[str] = []
    counted: set[tuple[int, int]] = set()

    def wait(paths: Iterable[Path]) -> None:
        paths = list(paths)
        make_durable(paths)
        waited.extend(path.name for path in paths)

    def report(state: Progress) -> None:
        counted.add((state.done, len(waited)))

    monkeypatch.setattr(run, "make_durable", wait)
    study = small_study(tmp_path, count=16)
    throw_study(study, tmp_path / "s", workers=1, report=report)
    assert counted == {(0, 0), (8, 1), (16, 2)}
    names = batch_names(tmp_path / "s")
    assert sorted(waited) == names
    throw_study(study, tmp_path / "other", pool=here)
    assert sorted(waited) == names
    # A run that was ended may have left a batch for which it had not waited yet.
    (tmp_path / "s" / "batches" / names[1]).unlink()
    waited.clear()
    throw_study(study, tmp_path / "s", pool=here)
    assert waited == names[:1]


def test_a_killed_worker_is_replaced_and_a_killed_run_leaves_none(
    worker_processes: None, whole: Path, tmp_path: Path
) -> None:
    study = study_file(tmp_path, count=COUNT)
    process = started(study, tmp_path / "s")
    wait_for_batches(process, tmp_path / "s", 1)
    os.kill(workers_of(process.pid)[0], signal.SIGKILL)
    wait_for_batches(process, tmp_path / "s", 3)
    # The other worker may make two batches before the new one has started.
    while len(workers := workers_of(process.pid)) < 2 and process.poll() is None:
        time.sleep(0.01)
    assert process.poll() is None
    process.kill()
    process.communicate()
    assert len(workers) == 2
    assert gone(workers)
    assert 3 <= len(batch_names(tmp_path / "s")) < len(batch_names(whole))
    check_goes_on(tmp_path, whole)


def test_ctrl_c_is_one_message_and_goes_on(
    worker_processes: None, whole: Path, tmp_path: Path
) -> None:
    study = study_file(tmp_path, count=COUNT)
    process = started(study, tmp_path / "s")
    wait_for_batches(process, tmp_path / "s", 1)
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "run the same command to continue" in err
    assert "Traceback" not in err
    check_goes_on(tmp_path, whole)


def test_a_full_disk_is_one_message_and_goes_on(whole: Path, tmp_path: Path) -> None:
    """A limit on the size of files stands in for a disk without space."""
    study = study_file(tmp_path, count=COUNT)
    words = (sys.executable, "-m", "turnout", "sweep", "run", study, "-o", tmp_path / "a b")
    path = os.pathsep.join(map(os.path.abspath, sys.path))
    run = subprocess.run(
        ["bash", "-c", 'ulimit -f 45; exec "$@" --workers 1', "bash", *map(str, words)],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
        check=False,
    )
    assert run.returncode == 2, run.stderr
    assert "no space left; free some" in run.stderr
    assert "Traceback" not in run.stderr
    assert batch_names(tmp_path / "a b") == []
    throw_study(small_study(tmp_path, count=COUNT), tmp_path / "a b", pool=here)
    check_same(tmp_path / "a b", whole)


@pytest.mark.long
def test_fifty_ends_at_random_instants(worker_processes: None, whole: Path, tmp_path: Path) -> None:
    """Half of them end the run, half a worker of it; each time from an early start."""
    rng = np.random.default_rng(50)
    study = study_file(tmp_path, count=COUNT)
    ends = 0
    while ends < 50:
        folder = tmp_path / f"s{ends}"
        for _ in range(5):
            process = started(study, folder)
            time.sleep(rng.uniform(0.3, 6.0))
            if process.poll() is None:
                workers = workers_of(process.pid)
                if rng.random() < 0.5 and workers:
                    with contextlib.suppress(ProcessLookupError):
                        os.kill(int(rng.choice(workers)), signal.SIGKILL)
                    time.sleep(rng.uniform(0.0, 1.0))
                process.kill()
                ends += 1
            process.communicate()
        finished(study, folder)
        check_same(folder, whole)
