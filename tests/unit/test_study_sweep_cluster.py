"""The same sweep by Dask: workers write their batches, only counts travel."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import pytest
from tests.unit.sweeps import batch_names, here, small_study

from turnout.core.errors import FileError
from turnout.core.progress import Progress
from turnout.study.study import Study
from turnout.study.sweep.cluster import (
    make_slurm_cluster,
    read_profile,
    scheduler_cluster,
)
from turnout.study.sweep.run import throw_study

distributed = pytest.importorskip("distributed", reason="pip install 'turnout[sweep]'")

PROFILE = """
queue = "short"
account = "track"
cores = 4
memory = "8 GB"
walltime = "01:00:00"
jobs = 3
job_script_prologue = ["module load python"]
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    return small_study(tmp_path_factory.mktemp("study"))


@pytest.fixture(scope="module")
def expected(study: Study, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp("here") / "sweep"
    throw_study(study, folder, pool=here)
    return batch_names(folder)


def test_a_local_cluster_comes_to_the_same_bits(
    study: Study, expected: list[str], tmp_path: Path
) -> None:
    """In threads of this process, so that what a worker runs is seen by the tests."""
    with (
        distributed.LocalCluster(
            host="127.0.0.1",
            n_workers=2,
            threads_per_worker=1,
            processes=False,
            protocol="tcp://",
            dashboard_address=":0",
        ) as cluster,
        scheduler_cluster(cluster.scheduler_address) as mine,
    ):
        assert mine.workers == 2
        throw_study(study, tmp_path / "s", workers=mine.workers, pool=mine.pool)
    assert batch_names(tmp_path / "s") == expected


@pytest.fixture
def cluster_processes(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A scheduler and two workers as processes of their own, over loopback TCP."""
    path = os.pathsep.join(map(os.path.abspath, sys.path))
    start = partial(
        subprocess.Popen,
        env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        cwd=tmp_path,
    )
    file = tmp_path / "scheduler.json"
    scheduler = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1"]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--nthreads", "1"]
    at = ["--scheduler-file", str(file)]
    processes = []
    with ExitStack() as stack:
        for command in (
            [*scheduler, "--port", "0", "--no-dashboard", *at],
            *([[*worker, "--no-nanny", "--no-dashboard", "--host", "127.0.0.1", *at]] * 2),
        ):
            process = start(command)
            processes.append(process)
            stack.callback(process.wait)
            stack.callback(process.terminate)
        due = time.monotonic() + 60
        while not file.exists() and time.monotonic() < due:
            time.sleep(0.05)
        yield json.loads(file.read_text())["address"], processes[1:]


def test_a_worker_that_is_killed_costs_at_most_its_batch(
    study: Study,
    expected: list[str],
    cluster_processes: tuple[str, list[subprocess.Popen[bytes]]],
    tmp_path: Path,
) -> None:
    address, workers = cluster_processes
    with distributed.Client(address) as client:
        client.wait_for_workers(2, timeout=60)

    def kill_one_at_the_first_batch(state: Progress) -> None:
        if state.done > 0:
            workers[0].kill()

    with scheduler_cluster(address) as mine:
        assert mine.workers == 2
        done = throw_study(
            study,
            tmp_path / "s",
            workers=mine.workers,
            pool=mine.pool,
            report=kill_one_at_the_first_batch,
        )
    assert workers[0].wait(10.0) != 0
    assert batch_names(tmp_path / "s") == expected
    numbers = [batch.number for batch in done.batches]
    assert sorted(numbers) == list(range(len(expected)))  # none came back twice


@pytest.mark.parametrize("address", ["nonsense", "127.0.0.1:8786", "tcp://host", "tcp://:x"])
def test_what_is_no_address_is_reported_at_once(address: str) -> None:
    with (
        pytest.raises(FileError, match="is no address such as tcp://"),
        scheduler_cluster(address),
    ):
        pass


def test_no_one_at_the_address_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("turnout.study.sweep.cluster.ANSWER", 0.5)
    with (
        pytest.raises(FileError, match=r"--scheduler tcp://127\.0\.0\.1:9: does not answer"),
        scheduler_cluster("tcp://127.0.0.1:9"),
    ):
        pass


def test_a_profile_becomes_jobs_of_slurm(tmp_path: Path) -> None:
    jobqueue = pytest.importorskip("dask_jobqueue", reason="pip install 'turnout[sweep]'")
    path = tmp_path / "cluster.toml"
    path.write_text(PROFILE)
    settings = read_profile(path)
    assert settings.pop("jobs") == 3
    with make_slurm_cluster(settings | {"interface": "lo"}) as cluster:
        assert isinstance(cluster, jobqueue.SLURMCluster)
        script = cluster.job_script()
    for words in ("-p short", "-A track", "-t 01:00:00", "module load python", "--nworkers 4"):
        assert words in script
    assert "--nthreads 1" in script


def test_everything_wrong_in_a_profile_is_reported_at_once(tmp_path: Path) -> None:
    path = tmp_path / "cluster.toml"
    path.write_text('cores = "four"\nmemory = "8 GB"\nqueu = "short"\njobs = 0\n')
    with pytest.raises(FileError) as caught:
        read_profile(path)
    for words in ("cores = 'four': must be a int", "queu: unknown", "jobs = 0: must be at least 1"):
        assert words in str(caught.value)
