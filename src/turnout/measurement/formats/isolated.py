"""Read recordings in a process of their own, with limits of memory and time.

The process is started at the first file and kept for the next ones, so that a campaign pays for
its start once. After a file on which it crashes, runs out of memory or is too slow it is ended.
"""

import atexit
import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from turnout.core.errors import FileError
from turnout.measurement.formats.extent import most_memory, most_seconds
from turnout.measurement.formats.reader_process import Answer, Request
from turnout.measurement.recording import RecordedChannel, Recording

# To load the packages of a reader: their own time, whatever the file [s].
LOADING_SECONDS = 120.0
SERVER = "turnout.measurement.formats.reader_process"


_CLASSES = {
    (kind.__module__, kind.__qualname__): kind
    for kind in (Answer, Recording, RecordedChannel, FileError, Exception)
}
_OF_NUMPY = ("_reconstruct", "ndarray", "dtype", "scalar", "_frombuffer")


class AnswerUnpickler(pickle.Unpickler):
    """An unpickler of recordings and errors: a reader that a file has taken over sends no code."""

    def find_class(self, module: str, name: str) -> Any:
        """Return what answers are made of; UnpicklingError for anything else."""
        if (module, name) in _CLASSES:
            return _CLASSES[module, name]
        if (module, name) == ("builtins", "getattr"):
            return _new_of
        if module.partition(".")[0] == "numpy" and name in _OF_NUMPY:
            return super().find_class(module, name)
        message = f"no answer holds {module}.{name}"
        raise pickle.UnpicklingError(message)


def _new_of(kind: type, name: str) -> Any:
    """Return the constructor of a class, with which errors are pickled."""
    if name != "__new__":
        message = f"no answer holds an attribute {name}"
        raise pickle.UnpicklingError(message)
    return kind.__new__


class RecordingReader:
    """A process that reads one file after another."""

    def __init__(self) -> None:
        # The process finds turnout wherever this one did, but nothing in the current folder.
        paths = os.pathsep.join(os.path.abspath(item) for item in sys.path if item)
        self.owner = os.getpid()
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-c", f"from {SERVER} import serve_reader; serve_reader()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": paths},
            # Ctrl-C is answered by the program that reads, which ends this process.
            start_new_session=True,
        )

    def ask(self, request: Request) -> tuple[Any, bool]:
        """Return the answer, None if the process ended, and True if time ran out."""
        assert self.process.stdin is not None
        with suppress(OSError):
            pickle.dump(request, self.process.stdin)
            self.process.stdin.flush()
        loaded, _ = self._answer(LOADING_SECONDS, bool)
        return self._answer(request.seconds, Answer) if loaded else (None, False)

    def _answer(self, seconds: float, kind: type) -> tuple[Any, bool]:
        """Wait for an answer of the process, which is killed when it takes too long.

        It is killed as well when it answers anything but that kind: a file has damaged it.
        """
        assert self.process.stdout is not None
        late = threading.Event()

        def end() -> None:
            late.set()
            self.process.kill()

        timer = threading.Timer(seconds, end)
        timer.daemon = True
        timer.start()
        try:
            answer = AnswerUnpickler(self.process.stdout).load()
        except EOFError:
            return None, late.is_set()
        except Exception:  # bytes that are no answer make it raise whatever they mean
            answer = None
        finally:
            timer.cancel()
        if not isinstance(answer, kind):
            self.process.kill()
            return None, late.is_set()
        return answer, late.is_set()

    def close(self) -> int:
        """End the process, whatever it does; return its exit code."""
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()
        if self.owner != os.getpid():
            self.process.returncode = 0
            return 0
        with suppress(subprocess.TimeoutExpired):
            return self.process.wait(timeout=0.5)
        self.process.kill()
        return self.process.wait()


_lock = threading.Lock()
_kept: list[RecordingReader] = []


def read_isolated(
    path: Path,
    *,
    reader: str,
    kind: str,
    package: str = "",
    throws: Sequence[str] = (),
    **options: object,
) -> list[Recording | FileError]:
    """Read a file by a reader in a process of its own.

    Parameters
    ----------
    path : Path
        File of a binary format; may be damaged or hostile.
    reader : str
        Module and function: "turnout.measurement.formats.hdf5:read_hdf5".
    kind : str
        What files of this kind are called.
    package : str
        What the reader loads, which does not count as time of the file.
    throws : sequence of str
        Which throws of several in one table; none for the one recording of a file.
    **options
        Arguments of the reader.

    Raises
    ------
    FileError
        When the reader refuses the file, crashes on it, or takes too much memory or time.
    """
    size = path.stat().st_size
    seconds = most_seconds(size)
    with _lock:
        process = _reader()
        reply: Any = None
        late, code = False, 0
        try:
            reply, late = process.ask(
                Request(
                    folder="" if path.is_absolute() else os.getcwd(),
                    path=path,
                    kind=kind,
                    reader=reader,
                    package=package,
                    throws=tuple(throws),
                    memory=most_memory(size),
                    seconds=seconds,
                    options=options,
                )
            )
        finally:
            if reply is None or reply.exhausted:
                _kept.clear()
                code = process.close()
    if late:
        message = f"{path}: takes longer than {seconds:.0f} s to read; save it in another format"
        raise FileError(message)
    if reply is None:
        raise FileError(_crash(path, kind, code))
    if isinstance(reply.found, FileError):
        raise reply.found
    found: list[Recording | FileError] = reply.found
    # That of a sheet names it as well.
    return [replace(r, source=str(path)) if isinstance(r, Recording) else r for r in found]


def _reader() -> RecordingReader:
    """Return the process that reads, of this program and alive."""
    if _kept and (_kept[0].owner != os.getpid() or _kept[0].process.poll() is not None):
        _kept.pop().close()
    if not _kept:
        _kept.append(RecordingReader())
    return _kept[0]


@atexit.register
def _end() -> None:
    while _kept:
        _kept.pop().close()


def _crash(path: Path, kind: str, code: int) -> str:
    # A signal: negative on Linux and macOS, a large status on Windows.
    if code < 0 or code > 255:
        return (
            f"{path}: the reader of {kind} files crashed on it (code {code}): the file is "
            "truncated or damaged; save it again"
        )
    return f"{path}: the reader of {kind} files cannot be used here (exit code {code})"
