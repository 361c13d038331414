"""Readers of other people in a process of their own, so that their crashes stay there.

A reader module is started as ``python -m MODULE FILE FOLDER`` and leaves two files in the folder:
numbers, and a header that says what they are. Dewesoft's closed library crashes on a truncated
file, and the reader of MDF files prints tracebacks about damaged ones.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from turnout.errors import FileError
from turnout.measurement.assemble import Column, assemble, tidy_unit
from turnout.measurement.handover import ARRAYS, FAULT, HEADER
from turnout.measurement.recording import Recording

# Longer than any file takes, shorter than for ever [s].
PATIENCE = 600.0


def read_isolated(path: Path, *, module: str, kind: str) -> Recording:
    """Read a file by a reader module in a process of its own.

    Parameters
    ----------
    path : Path
        The file.
    module : str
        Full name of the reader module.
    kind : str
        What files of this kind are called.

    Raises
    ------
    FileError
        When the reader refuses the file or crashes on it, or no channel is left.
    """
    with tempfile.TemporaryDirectory() as folder:
        run = _run(path, module, folder)
        header_file = Path(folder) / HEADER
        if run.returncode != 0 or not header_file.exists():
            raise FileError(_crash(path, kind, run.returncode, run.stderr))
        header: dict[str, Any] = json.loads(header_file.read_text(encoding="utf-8"))
        if FAULT in header:
            reason = " ".join(str(header[FAULT]).split())[:80]
            message = f"{path}: is no {kind} file, or a damaged one ({reason}); save it again"
            raise FileError(message)
        with np.load(Path(folder) / ARRAYS) as arrays:
            columns = _columns(header["channels"], arrays)
    return assemble(
        columns,
        source=str(path),
        start_time=header["start_time"],
        problems=header["problems"],
    )


def _columns(channels: list[dict[str, Any]], arrays: Any) -> list[Column]:
    times = {name: arrays[name] for name in {item["time"] for item in channels} if name}
    return [
        Column(
            item["name"],
            arrays[item["values"]],
            tidy_unit(item["unit"]),
            item["description"],
            time=times.get(item["time"]),
            rate=item["rate"],
            start=item["start"],
        )
        for item in channels
    ]


def _run(path: Path, module: str, folder: str) -> "subprocess.CompletedProcess[str]":
    # The process finds turnout wherever this one did.
    paths = os.pathsep.join(os.path.abspath(item) for item in sys.path)
    try:
        return subprocess.run(
            [sys.executable, "-m", module, str(path.resolve()), folder],
            capture_output=True,
            text=True,
            check=False,
            timeout=PATIENCE,
            env={**os.environ, "PYTHONPATH": paths},
        )
    except subprocess.TimeoutExpired:
        message = f"{path}: its reader did not come to an end; save it in another format"
        raise FileError(message) from None


def _crash(path: Path, kind: str, code: int, said: str) -> str:
    # A signal: negative on Linux and macOS, a large status on Windows.
    if code < 0 or code > 255:
        return (
            f"{path}: the reader of {kind} files crashed on it (code {code}): the file is "
            "truncated or damaged; save it again"
        )
    last = said.strip().splitlines()[-1] if said.strip() else f"code {code}"
    return f"{path}: the reader of {kind} files cannot be used here ({last})"
