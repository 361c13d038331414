"""The process in which recordings are read, started with ``python -P -m`` and its own name.

Readers of binary formats crash on damaged files, and small files can declare huge contents; here
that does no harm. Each line on stdin is a request (JSON): reader, file, folder for the samples and
limits. Two lines answer it: one when the reader is loaded, one when it has read the file or says
why it could not.
"""

import json
import os
import signal
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from turnout.core.errors import FileError
from turnout.core.processes import limit_memory
from turnout.measurement.formats.channel_table import recordings_of
from turnout.measurement.recording import Recording

ARRAYS = "arrays.npz"
FAULT = "fault"
RECORDINGS = "recordings"
FIELDS = ("name", "unit", "rate", "start", "description")
"""Of a channel, beside its samples."""
EXHAUSTED = "exhausted"
"""True if the process is to be ended, as a file took all that it may take."""


def read_requested(request: dict[str, Any]) -> dict[str, Any]:
    """Read a file within a limit of memory; return a description of its channels, or the fault."""
    path, kind = Path(request["file"]), request["kind"]
    module, _, function = request["reader"].partition(":")
    try:
        read = getattr(import_module(module), function)
    except (ImportError, AttributeError) as error:
        message = f"{path}: the reader of {kind} files cannot be loaded ({error}); "
        return {FAULT: message + "install turnout again"}
    limit_memory(int(request["memory"]))
    try:
        found = recordings_of(read(path, **request["options"]), request["throws"])
        return {RECORDINGS: write_reply(found, Path(request["folder"]))}
    except FileError as error:
        return {FAULT: str(error)}
    except MemoryError:
        megabytes = int(request["memory"]) // 1_000_000
        message = f"{path}: takes more than {megabytes} MB to read, too much for a file of its size"
        message += "; export it again, in shorter recordings or uncompressed"
        return {FAULT: message, EXHAUSTED: True}
    except RecursionError:
        message = f"{path}: what it holds is nested too deeply; save it again"
        return {FAULT: message, EXHAUSTED: True}
    except Exception as error:  # a damaged file makes a reader raise whatever its parts raise
        reason = " ".join(str(getattr(error, "message", "") or error).split())[:80]
        message = f"{path}: is no {kind} file, or a damaged one ({reason}); save it again"
        return {FAULT: message}


def write_reply(found: list[Recording | FileError], folder: Path) -> list[dict[str, Any]]:
    """Leave the samples of recordings in a folder; return all else of each, or its fault."""
    replies: list[dict[str, Any]] = []
    arrays: dict[str, Any] = {}
    for recording in found:
        if isinstance(recording, FileError):
            replies.append({FAULT: str(recording)})
            continue
        channels = []
        for item in recording.channels.values():
            fields = {key: getattr(item, key) for key in FIELDS}
            channels.append({**fields, "values": f"{len(arrays)}"})
            arrays[f"{len(arrays)}"] = item.values
        whole = {key: getattr(recording, key) for key in ("start_time", "problems", "labels")}
        replies.append({**whole, "channels": channels})
    np.savez(folder / ARRAYS, **arrays)
    return replies


def serve_reader() -> None:
    """Answer requests until there are no more; whatever a reader prints is not heard."""
    with os.fdopen(os.dup(1), "w", encoding="utf-8") as replies:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        for line in sys.stdin:
            request = json.loads(line)
            for name in request["packages"]:
                import_module(name)
            replies.write("{}\n")
            replies.flush()
            # Should the program that asked be gone, nothing else would end a reader that hangs.
            if sys.platform != "win32":
                signal.alarm(int(request["seconds"]) + 5)
            reply = read_requested(request)
            if sys.platform != "win32":
                signal.alarm(0)
            replies.write(json.dumps(reply) + "\n")
            replies.flush()


if __name__ == "__main__":
    serve_reader()
