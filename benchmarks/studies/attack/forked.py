"""A call in a process of its own with limits, forked from one that has loaded all it needs."""

import os
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

POLL = 0.003


@dataclass(frozen=True, slots=True)
class Ended:
    """How a process ended.

    Attributes
    ----------
    code : int
        Exit code; negative: the signal that ended it.
    out, err : str
        What it said.
    seconds : float
        Processor time [s].
    memory : float
        Most that it held, of what it was forked with too [MB].
    late : bool
        Whether it was ended because its time was up.
    """

    code: int
    out: str
    err: str
    seconds: float
    memory: float
    late: bool


def forked(call: Callable[[], object], *, seconds: float = 0.0, memory: int = 0) -> int:
    """Start a call in a process and return its number.

    Parameters
    ----------
    call : callable
        Ends normally, or by `SystemExit` with an exit code.
    seconds : float
        Processor time after which the system ends it [s]; 0 for none.
    memory : int
        What it may have [bytes]; 0 for any.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    pid = os.fork()
    if pid == 0:
        _called(call, seconds, memory)
    return pid


def _called(call: Callable[[], object], seconds: float, memory: int) -> NoReturn:
    code = 0
    try:
        os.setsid()
        if memory:
            resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
        if seconds:
            resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 1))
        call()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:  # whatever it is, it must not go on as the process that forked
        traceback.print_exc()
        code = 1
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def run_limited(call: Callable[[], object], *, seconds: float, memory: int) -> Ended:
    """Run a call in a process to its end, or to its limits of time [s] and memory [bytes]."""
    with tempfile.TemporaryDirectory() as folder:
        out, err = Path(folder) / "out", Path(folder) / "err"

        def silent() -> None:
            for number, path in ((1, out), (2, err)):
                os.dup2(os.open(path, os.O_CREAT | os.O_WRONLY), number)
            call()

        pid = forked(silent, seconds=seconds, memory=memory)
        # A busy machine gives a process less than a whole processor.
        due, late = time.monotonic() + 4 * seconds, False
        while True:
            ended, status, used = os.wait4(pid, os.WNOHANG)
            if ended:
                break
            if time.monotonic() > due and not late:
                late = True
                os.kill(pid, signal.SIGKILL)
            time.sleep(POLL)
        code = os.waitstatus_to_exitcode(status)
        return Ended(
            code=code,
            out=_text(out),
            err=_text(err),
            seconds=used.ru_utime + used.ru_stime,
            memory=used.ru_maxrss / 1024,
            late=late or code == -signal.SIGXCPU,
        )


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""
