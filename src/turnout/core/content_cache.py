"""Cache slow results by the content of all inputs that they were computed from.

A key is a digest of the input values and of the computing sources, so that a stale result is never
found and nothing is computed twice. Arrays are cached in memory and as files in the user's cache
folder; a file that cannot be read or written costs time, never a result.
"""

import hashlib
import logging
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from turnout.core.cache_folder import (
    remove_outdated,
    safe_folder,
    user_cache_folder,
    why_private,
)
from turnout.core.errors import FileError
from turnout.core.files import write_atomic
from turnout.core.lru_cache import LRUCache
from turnout.core.sources import RAILS, digest_of_sources
from turnout.core.stored_arrays import DamagedError, arrays_from_bytes, arrays_to_bytes

Arrays = dict[str, NDArray[np.float64]]

counts: Counter[str] = Counter()
"""Events since the start: "section computed", "superelement from memory", "damaged" ..."""

MOST_FILES = 300
"""Files in the cache folder; beyond, the older half is removed."""
_memory = LRUCache[Arrays](32)
_reported: set[str] = set()
_log = logging.getLogger("turnout")


def cached_arrays(
    kind: str, parts: Sequence[object], compute: Callable[[], Arrays], *, on_disk: bool = True
) -> Arrays:
    """Return arrays from memory or a file; compute and cache them if they are in neither.

    Parameters
    ----------
    kind : str
        Word for the arrays; part of the key and of the names in `counts`.
    parts : sequence of object
        All inputs that they depend on: arrays, numbers, texts, tuples of these.
    compute : callable
        Returns the arrays, by name.
    on_disk : bool
        Whether they are stored as a file too if they are computed; not worth it for computations of
        milliseconds.

    Returns
    -------
    dict of str to ndarray
        Shared by all callers and therefore read-only.

    Examples
    --------
    >>> made = cached_arrays("example", [1.0], lambda: {"double": np.array([2.0])})
    >>> again = cached_arrays("example", [1.0], lambda: {"double": np.array([9.0])})
    >>> float(again["double"][0])
    2.0
    """
    key = f"{kind}-{digest(parts)}"
    found = _memory.get(key)
    if found is not None:
        counts[f"{kind} from memory"] += 1
        return found
    found = _read(key)
    if found is not None:
        counts[f"{kind} from file"] += 1
    else:
        found = compute()
        counts[f"{kind} computed"] += 1
        if on_disk:
            _write(key, found)
    for array in found.values():
        array.flags.writeable = False
    return _memory.put(key, found)


def clear_content_cache() -> None:
    """Clear the cache in memory; files stay."""
    _memory.clear()


def digest(parts: Iterable[object]) -> str:
    """Hash values by their content: arrays by dtype, shape and bytes, all else by its text.

    Examples
    --------
    >>> digest([np.array([1.0, 2.0]), "a"]) == digest([np.array([1.0, 2.0]), "a"])
    True
    >>> digest([np.array([1.0, 2.0])]) == digest([np.array([[1.0, 2.0]])])
    False
    """
    found = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            found.update(f"array {part.dtype.str} {part.shape} ".encode())
            found.update(np.ascontiguousarray(part).tobytes())
        else:
            found.update(f"{type(part).__name__} {part!r} ".encode())
    return found.hexdigest()[:32]


def cache_folder() -> Path | None:
    """Return the folder of cached arrays of the present sources, or None if none is possible."""
    wanted = user_cache_folder() / f"models-{digest_of_sources(RAILS)}"
    new = not wanted.exists()
    folder = safe_folder(wanted)
    if new and folder is not None:
        remove_outdated(folder)
    return folder


def _read(key: str) -> Arrays | None:
    folder = cache_folder()
    if folder is None:
        return None
    path = folder / f"{key}.npz"
    try:
        return arrays_from_bytes(path.read_bytes(), key)
    except FileNotFoundError:
        return None
    except (OSError, DamagedError) as error:
        counts["damaged"] += 1
        _report_once("damaged", f"{path}: cannot be used ({error}); it is computed again")
        return None


def _write(key: str, arrays: Arrays) -> None:
    folder = cache_folder()
    try:
        if folder is None:
            raise FileError(why_private())
        write_atomic(folder / f"{key}.npz", arrays_to_bytes(arrays, key))
        _prune(folder)
    except (OSError, FileError) as error:
        counts["unwritable"] += 1
        _report_once("unwritable", f"{error}; each run reduces rails again (TURNOUT_CACHE_DIR)")


def _prune(folder: Path) -> None:
    """Remove the older half of too many files."""
    files = list(folder.glob("*.npz"))
    if len(files) <= MOST_FILES:
        return
    with suppress(OSError):
        files.sort(key=lambda path: path.stat().st_mtime)
        for path in files[: len(files) // 2]:
            path.unlink(missing_ok=True)


def _report_once(what: str, text: str) -> None:
    """Log a problem with the cache once per process."""
    if what not in _reported:
        _reported.add(what)
        _log.warning("cache: %s", text)
