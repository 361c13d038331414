"""Kernels as plain intermediate code, by parts of Numba that are not public.

Numba optimises each kernel with all that it calls and makes machine code of it, and does the same
again for whatever calls that kernel. Only the few kernels that Python calls need this, and they get
it by `turnout.kernels.compiler`. Here is all that turnout changes in Numba and that Numba does not
promise to keep; for a version that nobody has tried, kernels are compiled without it.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numba
from llvmlite import ir

KNOWN = ("0.61", "0.64", "0.65", "0.68")
"""Minor versions of Numba that this has been tried with."""


def is_known() -> bool:
    """Return whether the Numba at hand is of a known version."""
    return ".".join(numba.__version__.split(".")[:2]) in KNOWN


def options(loop: bool) -> dict[str, Any]:
    """Return options of a kernel."""
    return {"pipeline_class": _loop_compiler()} if loop else {}


def _loop_compiler() -> Any:
    """Return a compiler that sets the flag `noalias`: no array that is written overlaps another.

    Without it a vectorised loop over several arrays begins with overlap checks, which short loops
    do not repay.
    """
    from numba.core.compiler import Compiler

    class LoopCompiler(Compiler):
        def define_pipelines(self) -> Any:
            self.state.flags.noalias = True
            return super().define_pipelines()  # type: ignore[no-untyped-call]

    return LoopCompiler


@contextmanager
def made() -> Iterator[None]:
    """Let Numba make plain code only, and index from the front; no other thread compiles then."""
    from numba.core.codegen import JITCodeLibrary
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.cpu import CPUContext
    from numba.cpython import slicing

    def finish(library: Any) -> None:
        library._finalize_dynamic_globals()
        library._finalized = True

    def no_address(library: Any, _name: str) -> int:
        library._ensure_finalized()
        return 0

    changes: list[tuple[Any, str, Callable[..., Any]]] = [
        (JITCodeLibrary, "_optimize_final_module", lambda _library: None),
        (JITCodeLibrary, "_finalize_final_module", finish),
        (JITCodeLibrary, "get_pointer_to_function", no_address),
        # A mark in place of a function: any one that was not there before.
        (CPUContext, "get_executable", lambda *_: [].append),
        (slicing, "fix_index", _fix_index),
        (slicing, "fix_slice", _fix_slice),
    ]
    with global_compiler_lock:
        before = [(place, name, getattr(place, name)) for place, name, _ in changes]
        global _fix_index_of_numba
        _fix_index_of_numba = slicing.fix_index
        try:
            for place, name, change in changes:
                setattr(place, name, change)
            yield
        finally:
            for place, name, own in before:
                setattr(place, name, own)


_fix_index_of_numba: Any = None


def _fix_index(builder: Any, index: Any, size: Any) -> Any:
    """Take an index as it is, but for a constant such as ``array[-1]``."""
    if isinstance(index, ir.Constant):
        return _fix_index_of_numba(builder, index, size)
    return index


def _fix_slice(builder: Any, bounds: Any, size: Any) -> None:
    """Cut only the end of a slice to the size, which is how Numba takes ``array[first:]``."""
    stop = bounds.stop
    bounds.stop = builder.select(builder.icmp_signed("<", stop, size), stop, size)
