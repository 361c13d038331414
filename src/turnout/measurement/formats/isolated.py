"""Read recordings in a process of their own, with limits of memory and time.

The process is started at the first file and kept for the next ones, so that a campaign pays for
its start once. After a file on which it crashes, runs out of memory or is too slow it is ended.
"""

import atexit
import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from turnout.core.errors import FileError
from turnout.measurement.formats.extent import most_memory, most_seconds
from turnout.measurement.formats.reader_process import ARRAYS, EXHAUSTED, FAULT, RECORDINGS
from turnout.measurement.recording import RecordedChannel, Recording

# To load the packages of a reader: their own time, whatever the file [s].
LOADING_SECONDS = 120.0


class RecordingReader:
    """A process that reads one file after another."""

    def __init__(self) -> None:
        # The process finds turnout wherever this one did, but nothing in the current folder.
        paths = os.pathsep.join(os.path.abspath(item) for item in sys.path if item)
        self.owner = os.getpid()
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", "turnout.measurement.formats.reader_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            encoding="utf-8",
            env={**os.environ, "PYTHONPATH": paths},
            # Ctrl-C is answered by the program that reads, which ends this process.
            start_new_session=True,
        )

    def ask(self, request: dict[str, Any]) -> tuple[dict[str, Any], bool]:
        """Return the answer, empty if the process ended, and True if time ran out."""
        assert self.process.stdin is not None
        with suppress(OSError):
            self.process.stdin.write(json.dumps(request) + "\n")
            self.process.stdin.flush()
        loaded, _ = self._line(LOADING_SECONDS)
        if not loaded:
            return {}, False
        line, late = self._line(float(request["seconds"]))
        found: dict[str, Any] = json.loads(line) if line.endswith("\n") else {}
        return found, late

    def _line(self, seconds: float) -> tuple[str, bool]:
        """Wait for a line of the process, which is killed when it takes too long."""
        assert self.process.stdout is not None
        late = threading.Event()

        def end() -> None:
            late.set()
            self.process.kill()

        timer = threading.Timer(seconds, end)
        timer.daemon = True
        timer.start()
        try:
            return self.process.stdout.readline(), late.is_set()
        finally:
            timer.cancel()

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
    packages: Sequence[str] = (),
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
    packages : sequence of str
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
    with _lock, tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        seconds = most_seconds(size)
        request = {
            "file": str(path.absolute()),
            "kind": kind,
            "reader": reader,
            "packages": packages,
            "throws": throws,
            "folder": folder,
            "memory": most_memory(size),
            "seconds": seconds,
            "options": options,
        }
        process = _reader()
        reply: dict[str, Any] = {}
        late, code = False, 0
        try:
            reply, late = process.ask(request)
        finally:
            if not reply or EXHAUSTED in reply:
                _kept.clear()
                code = process.close()
        if late:
            message = (
                f"{path}: takes longer than {seconds:.0f} s to read; save it in another format"
            )
            raise FileError(message)
        if not reply:
            raise FileError(_crash(path, kind, code))
        if FAULT in reply:
            raise _fault(path, reply)
        return _recordings(path, reply[RECORDINGS], Path(folder))


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


def _fault(path: Path, reply: dict[str, Any]) -> FileError:
    return FileError(str(reply[FAULT]).replace(str(path.absolute()), str(path)))


def _recordings(
    path: Path, replies: list[dict[str, Any]], folder: Path
) -> list[Recording | FileError]:
    found: list[Recording | FileError] = []
    with np.load(folder / ARRAYS, allow_pickle=False) as arrays:
        for reply in replies:
            if FAULT in reply:
                found.append(_fault(path, reply))
                continue
            channels = {
                item["name"]: RecordedChannel(**{**item, "values": arrays[item["values"]]})
                for item in reply["channels"]
            }
            whole = {key: reply[key] for key in ("start_time", "labels")}
            problems = tuple(reply["problems"])
            found.append(Recording(channels, str(path), problems=problems, **whole))
    return found


def _crash(path: Path, kind: str, code: int) -> str:
    # A signal: negative on Linux and macOS, a large status on Windows.
    if code < 0 or code > 255:
        return (
            f"{path}: the reader of {kind} files crashed on it (code {code}): the file is "
            "truncated or damaged; save it again"
        )
    return f"{path}: the reader of {kind} files cannot be used here (exit code {code})"
