"""Check of the file of a batch against the run of its sweep, made at each opening."""

import hashlib
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields, replace
from pathlib import Path

import h5py
import numpy as np
from h5py import h5a

from turnout.core.errors import FileError
from turnout.core.lru_cache import LRUCache
from turnout.study.sweep.batch import BATCH_NAME, DIGITS, ORIGIN, BatchOrigin, list_batches

STABLE_AGE = 2_000_000_000
"""A file that was changed within this time may change again with the same time stamp [ns]."""

Key = tuple[Path, int, int, int, int]

_origins = LRUCache[BatchOrigin](200_000)
"""Of files whose content was verified, by path, size, time stamps and inode."""


def content_fault(path: Path) -> str:
    """Return the fault that makes a batch differ from the digest in its name.

    Returns
    -------
    str
        Empty where nothing does.
    """
    match = BATCH_NAME.fullmatch(path.name)
    if match is None:
        return "has not the name of a batch"
    try:
        with path.open("rb", buffering=0) as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()[:DIGITS]
    except OSError as error:
        return f"cannot be read ({error.strerror or error})"
    return "" if digest == match[2] else "is damaged: its content is not that of its digest"


def _cache_key(path: Path) -> tuple[Key | None, bool]:
    """Return the cache key of a file, and True if it has been unchanged for long enough."""
    try:
        status = path.stat()
    except OSError:
        return None, False
    stamps = status.st_mtime_ns, status.st_ctime_ns
    return (path, status.st_size, *stamps, status.st_ino), time.time_ns() - max(stamps) > STABLE_AGE


def read_origin(file: "h5py.File") -> BatchOrigin | None:
    """Return the origin of an open batch, or None if it gives none."""
    if not h5a.exists(file.id, ORIGIN):
        return None
    value = np.empty((), dtype=object)
    h5a.open(file.id, ORIGIN).read(value)  # a fraction of what the layers above take
    text = value.item()
    parts = (text.decode() if isinstance(text, bytes) else str(text)).split()
    return BatchOrigin(*parts) if len(parts) == len(fields(BatchOrigin)) else None


def origin_fault(found: BatchOrigin | None, wanted: BatchOrigin) -> str:
    """Return the reason for rejecting a batch as not of this sweep; empty for its own."""
    if found is None:
        return "does not say which study it comes from"
    if found.study != wanted.study:
        return f"comes from another study ({found.study[:12]}, this one is {wanted.study[:12]})"
    if (found.version, found.code) != (wanted.version, wanted.code):
        return (
            f"was made with turnout {found.version} (sources {found.code}), this sweep with "
            f"{wanted.version} (sources {wanted.code})"
        )
    if found != wanted:
        return f"is batch {found.batch}, not {wanted.batch}"
    return ""


def expected_origin(path: Path, of_sweep: BatchOrigin) -> BatchOrigin:
    """Return the origin that a file of a sweep must have, by the number in its name."""
    return replace(of_sweep, batch=str(int(path.name.split("-")[0])))


@contextmanager
def open_verified(path: Path, of_sweep: BatchOrigin) -> Iterator["h5py.File"]:
    """Open the file of a batch after checking it, and close it in any case.

    All of a file is read to check it once in a process, and again when its time stamps, its size or
    its inode are others than before.

    Parameters
    ----------
    path : Path
        Of the batch.
    of_sweep : BatchOrigin
        Origin that the folder states; the number is taken from the name.

    Raises
    ------
    FileError
        When it is damaged or none of this sweep; it names the file and how to mend it.
    """
    key, settled = _cache_key(path)
    origin = _origins.get(key)
    fault = "" if origin is not None else content_fault(path)
    if not fault:
        try:
            file = h5py.File(path, "r")
        except OSError as error:
            fault = f"cannot be read ({error})"
    if fault:
        message = (
            f"{path}: {fault}; run `turnout sweep run STUDY -o {path.parents[1]}` again with the "
            "study of this sweep: it moves the file to the folder 'damaged' and throws these "
            "scenarios again, all other batches stay"
        )
        raise FileError(message)
    with file:
        if origin is None:
            origin = read_origin(file)
            if origin is not None and key is not None and settled:
                _origins.put(key, origin)
        fault = origin_fault(origin, expected_origin(path, of_sweep))
        if fault:
            message = (
                f"{path}: {fault}; move it out of the folder, then `turnout sweep run` with the "
                "study of this sweep throws what is missing"
            )
            raise FileError(message)
        yield file


def verified_batches(folder: Path, of_sweep: BatchOrigin) -> tuple[dict[int, Path], list[Path]]:
    """Return the batches of a sweep by their number, and files whose content is damaged.

    Parameters
    ----------
    folder : Path
        Of batches.
    of_sweep : BatchOrigin
        Origin that they must state; the number is taken from the name.

    Raises
    ------
    FileError
        When an intact one comes from another study, version or place in the study.
    """
    found: dict[int, Path] = {}
    damaged = []
    for number, path in list_batches(folder):
        if content_fault(path):
            damaged.append(path)
            continue
        with open_verified(path, of_sweep):
            found.setdefault(number, path)
    return found, damaged
