"""The program as a user starts it on a small sweep, to be ended in all ways."""

import subprocess
import time
from pathlib import Path

from tests.faults.terminal import started_in_terminal
from tests.unit.sweeps import batch_names

PATIENCE = 300.0


def started(study: Path, folder: Path, *options: str) -> subprocess.Popen[str]:
    """Start a sweep, in two processes unless another number is given."""
    chosen = options or ("--workers", "2")
    return started_in_terminal("sweep", "run", str(study), "-o", str(folder), *chosen)


def finished(study: Path, folder: Path, *options: str) -> str:
    """Run the program to its end; return what it said."""
    process = started(study, folder, *options)
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, err
    return out + err


def wait_for_batches(process: subprocess.Popen[str], folder: Path, count: int) -> None:
    due = time.monotonic() + PATIENCE
    while time.monotonic() < due and process.poll() is None:
        if len(batch_names(folder)) >= count:
            return
        time.sleep(0.02)


def workers_of(pid: int) -> list[int]:
    """Return the processes of a run that throw, by what the kernel knows of its children."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="utf-8").split()
    return [int(child) for child in children if _throws(int(child))]


def _throws(pid: int) -> bool:
    try:
        return b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False


def gone(pids: list[int], *, within: float = 20.0) -> bool:
    """Return whether processes end on their own."""
    due = time.monotonic() + within
    while time.monotonic() < due:
        if not any(_throws(pid) for pid in pids):
            return True
        time.sleep(0.05)
    return False
