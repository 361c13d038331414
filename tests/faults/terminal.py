"""The program as a user starts it in a terminal, to be ended in all ways, or in this process."""

import contextlib
import io
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import patch

from turnout.cli.main import main


def started_in_terminal(*arguments: str) -> subprocess.Popen[str]:
    """Start the program in a group of its own, as a terminal does."""
    path = os.pathsep.join(map(os.path.abspath, sys.path))
    return subprocess.Popen(
        [sys.executable, "-m", "turnout", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # A shell in the background has Ctrl-C ignored, and its children inherit that.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        env={**os.environ, "PYTHONPATH": path},
    )


@contextlib.contextmanager
def no_longer_than(seconds: float) -> Iterator[None]:
    """Raise TimeoutError in what waits for ever, such as for the other end of a pipe."""

    def end(*_: object) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def run_shell(*arguments: str, folder: Path) -> tuple[int, str]:
    """Run the program in a folder by a process of its own; return code and stderr."""
    path = os.pathsep.join(map(os.path.abspath, filter(None, sys.path)))
    done = subprocess.run(
        [sys.executable, "-P", "-m", "turnout", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": path},
    )
    return done.returncode, done.stderr


def run_code(code: str) -> str:
    """Run code by a process of its own; return what it prints."""
    path = os.pathsep.join(map(os.path.abspath, filter(None, sys.path)))
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": path},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def run_here(*arguments: str, folder: Path) -> tuple[int, str]:
    """Run the program in a folder by this process, which has all loaded; return code and stderr."""
    before, said = Path.cwd(), io.StringIO()
    os.chdir(folder)
    try:
        with (
            patch.object(sys, "argv", ["turnout", *arguments]),
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(said),
        ):
            main()
    except SystemExit as end:
        return int(end.code or 0), said.getvalue()
    finally:
        os.chdir(before)
    return 0, said.getvalue()
