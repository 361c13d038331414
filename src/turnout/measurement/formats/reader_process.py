"""The process in which recordings are read.

Readers of binary formats crash on damaged files, and small files can declare huge contents; here
that does no harm. A pickled request on stdin is answered twice: when the reader is loaded, and when
it has read the file or says why it could not.
"""

import os
import pickle
import signal
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from turnout.core.errors import FileError
from turnout.core.processes import limit_memory
from turnout.measurement.formats.channel_table import recordings_of
from turnout.measurement.recording import Recording


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """A file to be read.

    Attributes
    ----------
    folder : str
        From which `path` counts; empty for an absolute one.
    path : Path
        The file.
    kind : str
        What files of this kind are called.
    reader : str
        Module and function.
    package : str
        What the reader loads.
    throws : tuple of str
        Which throws of a table; none for the one recording of a file.
    memory, seconds : int, float
        Limits [byte], [s].
    options : mapping of str to object
        Arguments of the reader.
    """

    folder: str
    path: Path
    kind: str
    reader: str
    package: str
    throws: tuple[str, ...]
    memory: int
    seconds: float
    options: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Answer:
    """Recordings of a file or the errors of some, or the error of all.

    `exhausted` is True if the process is to be ended, as the file took all that it may take.
    """

    found: list[Recording | FileError] | FileError
    exhausted: bool = False


def read_requested(request: Request) -> Answer:
    """Read a file within a limit of memory."""
    path, kind = request.path, request.kind
    module, _, function = request.reader.partition(":")
    exhausted = False
    try:
        read = getattr(import_module(module), function)
    except (ImportError, AttributeError) as error:
        message = f"{path}: the reader of {kind} files cannot be loaded ({error}); "
        return Answer(FileError(message + "install turnout again"))
    limit_memory(request.memory)
    try:
        return Answer(recordings_of(read(path, **request.options), request.throws))
    except FileError as error:
        return Answer(error)
    except MemoryError:
        exhausted = True
        reason = f"takes more than {request.memory // 1_000_000} MB to read, too much for a file "
        reason += "of its size; export it again, in shorter recordings or uncompressed"
    except RecursionError:
        exhausted = True
        reason = "what it holds is nested too deeply; save it again"
    except Exception as error:  # a damaged file makes a reader raise whatever its parts raise
        said = " ".join(str(getattr(error, "message", "") or error).split())[:80]
        reason = f"is no {kind} file, or a damaged one ({said}); save it again"
    return Answer(FileError(f"{path}: {reason}"), exhausted)


def serve_reader() -> None:
    """Answer requests until there are no more; whatever a reader prints is not heard."""
    with os.fdopen(os.dup(1), "wb") as replies:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        while True:
            try:
                request: Request = pickle.load(sys.stdin.buffer)
            except EOFError:
                return
            if request.folder:
                os.chdir(request.folder)
            if request.package:
                import_module(request.package)
            pickle.dump(True, replies)
            replies.flush()
            # Should the program that asked be gone, nothing else would end a reader that hangs.
            if sys.platform != "win32":
                signal.alarm(int(request.seconds) + 5)
            pickle.dump(read_requested(request), replies)
            if sys.platform != "win32":
                signal.alarm(0)
            replies.flush()
