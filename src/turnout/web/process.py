"""A worker process that can be killed in any state.

A thread cannot: a power of large numbers, a crashing reader or an endless search blocks it and the
interpreter. A process has a memory limit too. It leads its own process group, so readers that it
starts end with it and Ctrl-C on the terminal does not reach it.
"""

import ctypes
import logging
import os
import queue
import re
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

from turnout.core.errors import TurnoutError
from turnout.core.processes import FreshProcesses, limit_memory
from turnout.web.question import (
    MEMORY_LIMIT,
    Question,
    Reply,
    Superseded,
    Task,
    UnknownMarkError,
)

Answering = Callable[[Task, Question], Reply]
Prepare = Callable[[], Answering]

# Caches grow with use: a process is replaced when it has grown by this factor since its first
# replies and holds more than this [bytes].
FIRST_ANSWERS, GROWTH, MEMORY_AT_REST = 20, 1.3, 800_000_000
_READY = b"ready"
# Begins a message that says how much is done; replies begin with a brace.
_PROGRESS = b"%"
_log = logging.getLogger("turnout")
# Directories before the last part of an absolute path, of Linux, macOS or Windows.
_FOLDERS = re.compile(r"(?<![\w.~/\\])(?:[A-Za-z]:)?(?:[/\\][^\s/\\'\"<>|:;,()\[\]]+)*[/\\](?=\w)")
_SIGNAL_OF_PARENTS_DEATH = 1


class EndedError(Exception):
    """The process ended before it answered."""


class Process:
    """A process that handles one task at a time, seen from the server.

    `start` and `ask` block, so call them in threads; `kill` is safe anywhere.

    Parameters
    ----------
    prepare : callable
        Called in the process, returns its task handler; pickled.
    folder : str
        For temporary files of the process.
    memory : int
        Limit of a reply above the memory of the idle process [bytes].
    """

    def __init__(self, prepare: Prepare, folder: str, memory: int = MEMORY_LIMIT) -> None:
        context = FreshProcesses()
        self._ours, self._theirs = context.Pipe()
        arguments = (self._theirs, folder, memory)
        self._prepare = prepare
        self._process = context.Process(target=_compute, args=arguments, daemon=True)
        self._sending = threading.Lock()
        self._started = self._killed = self._gone = False
        self._number = 0
        self.share = 0.0
        """Done of the present task, as far as it says."""

    @property
    def pid(self) -> int | None:
        """Return its number in the system; None before it is started."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """True if it accepts tasks."""
        return self._started and not self._killed and self._process.is_alive()

    def start(self) -> None:
        """Start it and wait until it is ready.

        Raises
        ------
        EndedError
            When it ends before it is ready.
        """
        self._process.start()
        self._theirs.close()
        self._started = True
        if self._killed:
            self.kill()
        try:
            self._ours.send(self._prepare)
            ready = self._ours.recv_bytes()
        except (EOFError, OSError):
            raise EndedError(self._ended()) from None
        if ready != _READY:
            self._ended()
            raise EndedError(ready.decode())

    def ask(self, task: Task) -> Reply:
        """Return its reply.

        Raises
        ------
        EndedError
            When it ends first, of itself or through `kill`.
        """
        self._number += 1
        self.share = 0.0
        try:
            with self._sending:
                self._ours.send((self._number, task))
            while (message := self._ours.recv_bytes()).startswith(_PROGRESS):
                self.share = float(message[1:])
            return Reply.unpacked(message)
        except (EOFError, OSError):
            raise EndedError(self._ended()) from None

    def overtake(self, number: int) -> None:
        """Signal that a newer request supersedes its task of this number."""
        with suppress(OSError), self._sending:
            self._ours.send((number, None))

    @property
    def number(self) -> int:
        """Return the number of the latest task."""
        return self._number

    def kill(self) -> None:
        """End it at once, with all that it has started."""
        self._killed = True
        pid = self._process.pid
        if pid is None or self._gone:
            return
        with suppress(OSError):
            if hasattr(os, "killpg"):
                # Before it leads a group of its own there is none of its number.
                os.killpg(pid, signal.SIGKILL)
        with suppress(OSError, ValueError):
            self._process.kill()

    def _ended(self) -> str:
        """Wait for its end and return the reason."""
        if not self._killed:
            self._process.join(timeout=1)
        self.kill()
        self._process.join()
        self._gone = True
        self._ours.close()
        code = self._process.exitcode or 0
        return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def _compute(connection: Connection, folder: str, memory: int) -> None:
    """Handle tasks until the server is gone; runs in the process."""
    _set_apart()
    # The server removes this folder when it ends.
    tempfile.tempdir = os.environ["TMPDIR"] = folder
    try:
        prepare: Prepare = connection.recv()
    except (EOFError, OSError):
        return
    try:
        answering = prepare()
    except Exception as error:
        _log.exception("the studio's process cannot be prepared")
        connection.send_bytes(f"{type(error).__name__}: {error}".encode())
        return
    limit_memory(memory)
    connection.send_bytes(_READY)
    tasks: queue.SimpleQueue[tuple[Task, Question]] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(connection, tasks), daemon=True).start()
    memory_use = _MemoryUse()
    while True:
        reply = _answered(answering, *tasks.get())
        if memory_use.has_grown():
            reply = replace(reply, exhausted=True)
        with suppress(OSError):  # the server is gone; the listening thread ends this process
            connection.send_bytes(reply.packed())


class _MemoryUse:
    """Growth of the memory of this process since its first replies."""

    def __init__(self) -> None:
        self._answers, self._most = 0, float("inf")

    def has_grown(self) -> bool:
        """Return, after a reply, True if the process should be replaced."""
        if sys.platform != "linux":
            return False
        self._answers += 1
        if self._answers < FIRST_ANSWERS:
            return False
        used = _pages()[1] * _page_size()
        if self._answers == FIRST_ANSWERS:
            self._most = max(MEMORY_AT_REST, GROWTH * used)
        return used > self._most


def _pages() -> list[int]:
    """Return the pages of memory that this process has, and those of them that it fills."""
    return [int(word) for word in Path("/proc/self/statm").read_text(encoding="ascii").split()[:2]]


def _page_size() -> int:
    return os.sysconf("SC_PAGE_SIZE")


def _listen(connection: Connection, tasks: "queue.SimpleQueue[tuple[Task, Question]]") -> None:
    present, question = 0, Question()
    while True:
        try:
            number, task = connection.recv()
        except (EOFError, OSError):
            os._exit(0)
        if task is not None:
            present, question = number, Question(send=partial(_send_share, connection))
            tasks.put((task, question))
        elif number == present:
            question.overtaken.set()


def _send_share(connection: Connection, share: float) -> None:
    with suppress(OSError):
        connection.send_bytes(_PROGRESS + f"{share:.4f}".encode())


def _answered(answering: Answering, task: Task, question: Question) -> Reply:
    question.began = time.monotonic()
    try:
        return answering(task, question)
    except Superseded:
        return Reply(superseded=True)
    except UnknownMarkError as error:
        return Reply(Reply.refused(str(error)).content, status=422, needs=error.mark)
    except TurnoutError as error:
        return Reply.refused(without_folders(str(error)))
    except MemoryError:
        return Reply.refused(MEMORY_MESSAGE, exhausted=True)
    except RecursionError:
        return Reply.refused("this is nested too deeply; use fewer levels")
    except Exception as error:
        _log.exception("the studio failed")
        # Its text may name files of this machine.
        text = f"the studio failed ({type(error).__name__}); see its terminal for details"
        return Reply.refused(text, status=500)


MEMORY_MESSAGE = (
    f"this needs more than {MEMORY_LIMIT / 1e9:g} GB of memory, so it was stopped; "
    "send less: a smaller panel, a shorter schedule or a shorter recording"
)


def without_folders(text: str) -> str:
    """Return a message with file names only, without the folders of this machine.

    Examples
    --------
    >>> without_folders("/home/anna/switch.toml: 750 kN/m is no length, see '/etc/x/y'")
    "switch.toml: 750 kN/m is no length, see 'y'"
    """
    return _FOLDERS.sub("", text)


def _set_apart() -> None:
    """Lead a group of processes, and end when the server does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "setsid"):
        os.setsid()
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_SIGNAL_OF_PARENTS_DEATH, signal.SIGKILL)
