"""The program as a user starts it in a terminal, to be ended in all ways."""

import os
import signal
import subprocess
import sys


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
