"""Markers taken from the folder, runs that repeat, and where the independent answers are."""

import multiprocessing
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

TESTS = Path(__file__).parent
REASONS = {"layers", "unit", "verification", "golden", "gallery", "faults", "browser"}

# The same examples in each run; no deadline, as a first call may compile a kernel.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")
# Figures are drawn, never shown.
os.environ.setdefault("MPLBACKEND", "Agg")
# Some hundred tests start the program; without what Python keeps of its sources each start and each
# process of a pool would compile them again.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
# Tests run in as many processes as there are cores: a second thread of linear algebra in each only
# waits, and takes the processors meanwhile. Set before NumPy is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# What a shell puts in the background is deaf to Ctrl-C, and so is what it starts in turn.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark each test with the folder it is in; a folder without a reason is refused."""
    for item in items:
        if not item.path.is_relative_to(TESTS):
            continue  # an example in a docstring of src
        folder = item.path.relative_to(TESTS).parts[0]
        if folder not in REASONS:
            message = f"{item.path}: tests live in one of tests/{{{','.join(sorted(REASONS))}}}"
            raise pytest.UsageError(message)
        item.add_marker(folder)
    if "PYTEST_XDIST_WORKER" in os.environ:
        from tests.distribution import ordered

        items[:] = ordered(items)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Share out whole files, long ones first."""
    if config.getoption("dist") != "loadfile":
        return None
    from tests.distribution import LongFirst

    return LongFirst(config, log)


def pytest_report_header() -> str:
    """Say why the first tests may take long, as nothing else is heard meanwhile."""
    from turnout.throw.compilation import cache_fault, must_compile

    if fault := cache_fault():
        return f"kernels: {fault}"
    if must_compile():
        return "kernels: the first test that simulates compiles them, silently, for 20 to 60 s"
    return "kernels: compiled before"


@pytest.fixture(scope="module", autouse=True)
def runs_of_one_file(request: pytest.FixtureRequest) -> Iterator[None]:
    """Drop what the functions of a file keep, such as whole histories, after its last test."""
    yield
    file = request.node.getparent(pytest.Module)
    for kept in vars(file.obj).values() if file is not None else ():
        if hasattr(kept, "cache_clear") and kept.__module__ == file.obj.__name__:
            kept.cache_clear()


@pytest.fixture(scope="session")
def worker_processes() -> None:
    """Skip where processes cannot share a lock, as they do through /dev/shm."""
    try:
        multiprocessing.get_context("spawn").Lock()
    except OSError as error:
        pytest.skip(f"no worker processes here: locks need a writable /dev/shm ({error})")


@pytest.fixture
def python_ctrl_c() -> Iterator[None]:
    """Let Ctrl-C raise KeyboardInterrupt; a cluster that ran before handles it in its own way."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session")
def reference_dir(pytestconfig: pytest.Config) -> Path:
    """Return the folder with answers of independent programs, kept beside the checkout."""
    folder = pytestconfig.rootpath.parent / "shared" / "reference"
    if not folder.is_dir():
        pytest.skip("no independent answers: ../shared/reference is not beside this checkout")
    return folder
