"""The one decorator for compiled kernels, with its cache in the user's cache folder.

Numba notices a change of the file that holds a kernel, but not of the kernels it calls. The cache
folder's name therefore holds a digest of every kernel source: a new source, a new folder.
"""

import hashlib
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

_PACKAGES = ("law", "integrate", "machine/compute")


def user_cache_folder() -> Path:
    """Return the folder for turnout's caches, following the platform's custom.

    Returns
    -------
    pathlib.Path
        `$TURNOUT_CACHE_DIR` if set, else the platform's cache folder with `turnout` added.
    """
    if chosen := os.environ.get("TURNOUT_CACHE_DIR"):
        return Path(chosen)
    if sys.platform == "win32":
        root = Path(os.environ.get("LOCALAPPDATA", "~/AppData/Local"))
    elif sys.platform == "darwin":
        root = Path("~/Library/Caches")
    else:
        root = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache")
    return root.expanduser() / "turnout"


def kernel_cache_folder() -> Path:
    """Return the folder of compiled kernels that belongs to the present sources."""
    digest = hashlib.sha256()
    package_root = Path(__file__).parents[1]
    for package in _PACKAGES:
        for source in sorted((package_root / package).glob("*.py")):
            digest.update(source.name.encode())
            digest.update(source.read_bytes())
    return user_cache_folder() / f"kernels-{digest.hexdigest()[:16]}"


def _prepare_numba() -> Any:
    folder = kernel_cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        usable = os.access(folder, os.W_OK)
    except OSError:
        usable = False
    if not usable:
        folder = Path(tempfile.gettempdir()) / f"turnout-{os.getpid()}-{folder.name}"
    os.environ.setdefault("NUMBA_CACHE_DIR", str(folder))
    import numba

    setattr(numba.config, "CACHE_DIR", os.environ["NUMBA_CACHE_DIR"])  # noqa: B010
    return numba


_numba = _prepare_numba()
from turnout.law.no_overlap import WithoutOverlap  # noqa: E402, numba comes prepared


def compiled(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a kernel to machine code on its first call and keep it in the cache.

    The plain function stays reachable as `.py_func`. Kernels let other threads of Python run. They
    may not make arrays: nothing then needs to be counted when records of arrays are handed on.
    Sums keep the order in which they are written, and products are rounded before they are added,
    so that the same kernel gives the same bits however it came to be compiled.
    """
    return _compiled(function, memory=False)


def compiled_loop(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a short loop over arrays into each kernel that calls it.

    The arrays that it writes must not overlap with each other or with those that it reads: it is
    compiled without looking.
    """
    return _compiled(function, memory=False, loop=True)


def compiled_part(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a kernel into each kernel that calls it; for short ones that few call."""
    return _compiled(function, memory=False, part=True)


def compiled_with_memory(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a kernel that makes arrays of its own; for rare calls."""
    return _compiled(function, memory=True)


def _compiled(
    function: Callable[P, T], *, memory: bool, loop: bool = False, part: bool = False
) -> Callable[P, T]:
    options: dict[str, Any] = {"forceinline": True} if loop or part else {}
    if loop:
        options["pipeline_class"] = WithoutOverlap
    kernel: Callable[P, T] = _numba.njit(
        cache=True, error_model="numpy", nogil=True, _nrt=memory, **options
    )(function)
    return kernel
