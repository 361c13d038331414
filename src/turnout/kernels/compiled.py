"""Decorators of compiled kernels, and their cache in the user's cache folder.

Numba notices a change of the file that holds a kernel, but not of the kernels it calls. The cache
folder's name therefore holds a digest of every kernel source: a new source, a new folder.

Numba optimises each kernel with all that it calls and makes machine code of it, and does the same
again for whatever calls that kernel. Only the few kernels that Python calls need this. A kernel
that another one calls is therefore compiled to plain intermediate code, which is optimised once,
within the kernel that Python calls: this halves the time of a first start and changes no bit.
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
from llvmlite.binding import parse_bitcode  # noqa: E402, after its folder
from numba.core import types  # noqa: E402
from numba.core.caching import CompileResultCacheImpl, FunctionCache  # noqa: E402
from numba.core.codegen import JITCodeLibrary  # noqa: E402
from numba.core.compiler import (  # noqa: E402
    CR_FIELDS,
    CompilerBase,
    CompileResult,
    DefaultPassBuilder,
)
from numba.core.registry import CPUDispatcher  # noqa: E402
from numba.core.runtime.nrt import rtsys  # noqa: E402


class _PlainCode(JITCodeLibrary):
    """Code of a kernel that only other kernels call: neither optimised nor made machine code."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()  # type: ignore[no-untyped-call]
        self._finalized = True


class _Whole(CompilerBase):
    """Compile a kernel that Python calls, as Numba does."""

    def define_pipelines(self) -> list[object]:
        """Return the pipeline of Numba."""
        pipeline: object = DefaultPassBuilder.define_nopython_pipeline(self.state)  # type: ignore[no-untyped-call]
        return [pipeline]


class _WithoutOverlap(_Whole):
    """Compile with the flag `noalias`: no array that is written overlaps another.

    Without it a vectorised loop over several arrays begins with overlap checks, which short loops
    do not repay.
    """

    def define_pipelines(self) -> list[object]:
        """Return the pipeline of Numba with the flag set."""
        self.state.flags.noalias = True
        return super().define_pipelines()


class _Inner(_Whole):
    """Compile a kernel that only other kernels call."""

    def define_pipelines(self) -> list[object]:
        """Return the pipeline of Numba, which then ends with plain code."""
        state = self.state
        state.flags.no_cpython_wrapper = True
        state.flags.no_compile = True
        codegen = state.targetctx.codegen()
        state.library = _PlainCode(codegen, state.func_id.func_qualname)  # type: ignore[no-untyped-call]
        return super().define_pipelines()


class _InnerLoop(_Inner, _WithoutOverlap):
    """The same of arrays that do not overlap."""


class _PlainCodeFiles(CompileResultCacheImpl):
    """Plain code of a kernel in the cache, in files beside those of what Python calls."""

    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        """Return the beginning of the names of its files."""
        return f"inner.{super().get_filename_base(fullname, abiflags)}"  # type: ignore[no-untyped-call]

    def reduce(self, cres: Any) -> Any:
        """Return what is stored of compiled code."""
        cres.fndesc.typemap = cres.fndesc.calltypes = None  # of the compiler, and large
        code = cres.library._final_module.as_bitcode()
        return cres.library.name, code, cres.fndesc, cres.signature, cres.reload_init

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Return compiled code from what was stored."""
        name, code, fndesc, signature, reload_init = payload
        library = _PlainCode(target_context.codegen(), name)  # type: ignore[no-untyped-call]
        library._final_module = parse_bitcode(code)
        library._finalize_final_module()
        known = {"fndesc": fndesc, "signature": signature, "reload_init": reload_init}
        blank: dict[str, Any] = dict.fromkeys(CR_FIELDS)
        known |= {"library": library, "target_context": target_context}
        return CompileResult(**blank | known | {"lifted": (), "entry_point": library})


class _PlainCodeCache(FunctionCache):
    """Cache of kernels that only other kernels call."""

    _impl_class = _PlainCodeFiles


class _InnerKernel(CPUDispatcher):
    """What other kernels call; its code has no address of its own."""

    def enable_caching(self) -> None:
        """Keep the plain code: another kernel that Python calls may need it later."""
        self._cache = _PlainCodeCache(self.py_func)  # type: ignore[no-untyped-call]

    def add_overload(self, cres: Any) -> None:
        """Register compiled code under a mark in place of an address."""
        found = cres._replace(entry_point=object())
        mark, code = found.entry_point, found.library
        self.targetctx.insert_user_function(mark, found.fndesc, [code])  # type: ignore[no-untyped-call]
        self.overloads[tuple(found.signature.args)] = found


class _KernelCache(FunctionCache):
    """Cache of kernels that Python calls."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load machine code without all that Numba knows of types, which only compiling asks for.

        Filling its registries takes longer than all else that happens here.
        """
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]


class _Kernel(CPUDispatcher):
    """What Python calls; in another kernel its name stands for its inner kernel.

    Cache and inner kernel are made at their first use: most kernels have none, where the few that
    Python calls are at hand.
    """

    loop, kept = False, False
    _inner: Any = None

    @property
    def _numba_type_(self) -> types.Dispatcher:
        if self._inner is None:
            compiler = _InnerLoop if self.loop else _Inner
            options = dict(self.targetoptions)
            inner = _InnerKernel(self.py_func, targetoptions=options, pipeline_class=compiler)
            if self.kept:
                inner.enable_caching()
            self._inner = inner
        return types.Dispatcher(self._inner)

    def enable_caching(self) -> None:
        """Keep the machine code."""
        self._cache = _KernelCache(self.py_func)  # type: ignore[no-untyped-call]

    def compile(self, sig: Any) -> Any:
        """Compile or load the kernel for the types of its arguments."""
        if self.kept and not isinstance(self._cache, _KernelCache):
            self.enable_caching()
        return super().compile(sig)


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
    options: dict[str, Any] = {
        "nopython": True,
        "error_model": "numpy",
        "nogil": True,
        "_nrt": memory,
        "no_cfunc_wrapper": True,  # no kernel is passed to another one
    }
    if loop or part:
        options["forceinline"] = True
    compiler = _WithoutOverlap if loop else _Whole
    kernel: Any = _Kernel(function, targetoptions=options, pipeline_class=compiler)
    kernel.loop, kernel.kept = loop, CACHE_VARIABLE in os.environ
    found: Callable[P, T] = kernel
    return found
