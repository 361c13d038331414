"""Executors of a cluster: a Dask scheduler at an address, or jobs that Slurm starts.

The folder of a sweep must be seen under the same path by all workers, which write to it.
"""

import re
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from turnout.core.errors import FileError
from turnout.core.toml import read_toml

if TYPE_CHECKING:
    from dask_jobqueue.slurm import SLURMCluster

INSTALL = "install it with: pip install 'turnout[sweep]'"
ADDRESS = re.compile(r"(tcp|tls|ws|wss|ucx)://\S+:\d{1,5}")
# Seconds in which a scheduler must answer, and in which a first worker must be there.
ANSWER, WORKERS = 10.0, 600.0

PROFILE = {
    "queue": str,
    "account": str,
    "cores": int,
    "memory": str,
    "walltime": str,
    "interface": str,
    "jobs": int,
    "job_extra_directives": list,
    "job_script_prologue": list,
    "python": str,
    "local_directory": str,
    "log_directory": str,
}
"""Keys of a profile for Slurm; `cores`, `memory` and `jobs` are required."""
NEEDED = ("cores", "memory", "jobs")


@dataclass(frozen=True, slots=True)
class Cluster:
    """Workers elsewhere: their number, and the function that makes an executor of them."""

    workers: int
    pool: Callable[[], Executor]


@contextmanager
def scheduler_cluster(address: str) -> Iterator[Cluster]:
    """Use the workers of a Dask scheduler that runs already.

    Parameters
    ----------
    address : str
        Such as "tcp://127.0.0.1:8786".

    Raises
    ------
    FileError
        When Dask is not installed, it is no address, nothing answers there, or no worker comes.
    """
    client_type = _dask().Client
    if not ADDRESS.fullmatch(address):
        message = f"--scheduler {address}: is no address such as tcp://127.0.0.1:8786"
        raise FileError(message)
    try:
        client = client_type(address, timeout=ANSWER, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        message = f"--scheduler {address}: does not answer ({error}); start `dask scheduler` there"
        raise FileError(message) from None
    with client:
        yield _of_client(client)


@contextmanager
def slurm_cluster(profile: Path) -> Iterator[Cluster]:
    """Start jobs on Slurm with one worker a core, and end them afterwards.

    Parameters
    ----------
    profile : Path
        TOML with the keys of `PROFILE`.

    Raises
    ------
    FileError
        When the profile is wrong, dask-jobqueue is not installed, or no job starts.
    """
    settings = read_profile(profile)
    jobs = settings.pop("jobs")
    with make_slurm_cluster(settings) as cluster:
        cluster.scale(jobs=jobs)
        with _dask().Client(cluster, set_as_default=False) as client:
            yield _of_client(client, expected=jobs * settings["cores"])


def make_slurm_cluster(settings: dict[str, Any]) -> "SLURMCluster":
    """Return a cluster whose jobs are not started yet; one process a core."""
    try:
        from dask_jobqueue.slurm import SLURMCluster
    except ImportError:
        message = f"--slurm needs dask-jobqueue; {INSTALL}"
        raise FileError(message) from None
    return SLURMCluster(processes=settings["cores"], **settings)


def read_profile(path: Path) -> dict[str, Any]:
    """Read a profile for Slurm.

    Raises
    ------
    FileError
        With all that is wrong in it.
    """
    tree = read_toml(path).data
    problems = [f"{key}: unknown; there are {', '.join(PROFILE)}" for key in tree.keys() - PROFILE]
    problems += [f"{key}: is missing" for key in NEEDED if key not in tree]
    for key, kind in PROFILE.items():
        value = tree.get(key)
        if value is not None and (not isinstance(value, kind) or isinstance(value, bool)):
            problems.append(f"{key} = {value!r}: must be a {kind.__name__}")
        elif isinstance(value, int) and value < 1:
            problems.append(f"{key} = {value}: must be at least 1")
    if problems:
        raise FileError("\n  - ".join([f"{path}: a profile for Slurm", *sorted(problems)]))
    return dict(tree)


def _of_client(client: Any, *, expected: int = 1) -> Cluster:
    """Wait for a worker; return all that are there, or are expected."""
    try:
        client.wait_for_workers(1, timeout=WORKERS)
    except TimeoutError:
        message = f"no worker came within {WORKERS:g} s; check the queue, or start one"
        raise FileError(message) from None
    return Cluster(max(len(client.nthreads()), expected), lambda: client.get_executor(pure=False))


def _dask() -> Any:
    try:
        import dask.distributed
    except ImportError:
        message = f"a cluster needs dask[distributed]; {INSTALL}"
        raise FileError(message) from None
    return dask.distributed
