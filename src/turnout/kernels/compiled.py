"""Decorators of compiled kernels, and their cache in the user's cache folder.

Numba notices a change of the file that holds a kernel, but not of the kernels it calls. The cache
folder's name therefore holds a digest of every kernel source: a new source, a new folder.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from turnout.core.cache_folder import safe_folder, user_cache_folder
from turnout.core.sources import KERNELS, digest_of_sources

P = ParamSpec("P")
T = TypeVar("T")

CACHE_VARIABLE = "NUMBA_CACHE_DIR"


def kernel_cache_folder() -> Path:
    """Return the cache folder of the kernels compiled from the present sources."""
    return user_cache_folder() / f"kernels-{digest_of_sources(KERNELS)}"


def _prepare_numba() -> Any:
    """Import Numba with a cache folder that no other user can write, since it unpickles kernels."""
    chosen = os.environ.pop(CACHE_VARIABLE, None)
    folder = safe_folder(Path(chosen).absolute() if chosen else kernel_cache_folder())
    if folder is not None:
        os.environ[CACHE_VARIABLE] = str(folder)
    import numba

    setattr(numba.config, "CACHE_DIR", str(folder or ""))  # noqa: B010
    return numba


_numba = _prepare_numba()
from numba.core.compiler import CompilerBase, DefaultPassBuilder  # noqa: E402, after its folder


class WithoutOverlap(CompilerBase):
    """Compile with the flag `noalias`: no array that is written overlaps another.

    Without it a vectorised loop over several arrays begins with overlap checks, which short loops
    do not repay.
    """

    def define_pipelines(self) -> list[object]:
        """Return the pipeline of Numba with the flag set."""
        self.state.flags.noalias = True
        pipeline: object = DefaultPassBuilder.define_nopython_pipeline(self.state)  # type: ignore[no-untyped-call]
        return [pipeline]


def compiled(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a kernel to machine code on its first call and keep it in the cache.

    The plain function stays reachable as `.py_func`. Kernels let other threads of Python run. They
    may not allocate arrays, so that passing records of arrays needs no reference counting.
    Sums keep the order in which they are written, and products are rounded before they are added,
    so that the same kernel gives the same bits however it came to be compiled.
    """
    return _compiled(function, memory=False)


def compiled_loop(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a short loop over arrays into each kernel that calls it.

    The arrays that it writes must not overlap each other or those that it reads, which is not
    checked.
    """
    return _compiled(function, memory=False, loop=True)


def compiled_part(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a kernel inline into each kernel that calls it; for short ones with few callers."""
    return _compiled(function, memory=False, part=True)


def compiled_with_memory(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a kernel that may allocate arrays; for rare calls."""
    return _compiled(function, memory=True)


def _compiled(
    function: Callable[P, T], *, memory: bool, loop: bool = False, part: bool = False
) -> Callable[P, T]:
    options: dict[str, Any] = {"no_cfunc_wrapper": True}  # no kernel is passed to another one
    if loop or part:
        options["forceinline"] = True
    if loop:
        options["pipeline_class"] = WithoutOverlap
    kernel: Callable[P, T] = _numba.njit(
        cache=CACHE_VARIABLE in os.environ, error_model="numpy", nogil=True, _nrt=memory, **options
    )(function)
    return kernel
