"""Import libraries without their parts that turnout never uses, for programs that end soon.

A program that imports turnout gets its libraries as they are; the commands `turnout simulate` and
`turnout sweep run` and workers are processes of their own.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any

UNUSED_OF_NUMPY = frozenset({"f2py", "ma", "polynomial", "testing"})
"""A parser of Fortran, masked arrays, old polynomials, helpers for tests: modules that NumPy loads
when they are named."""

THREADS = ("OPENBLAS_NUM_THREADS", "GOTO_NUM_THREADS", "OMP_NUM_THREADS")
"""Environment variables that OpenBLAS reads when it is loaded, the first one that is set."""

PLUGINS = "PYDANTIC_DISABLE_PLUGINS"
"""Environment variable that pydantic reads when it makes the first validator."""


def import_scipy() -> None:
    """Import SciPy without the NumPy modules that it loads by copying every listed name.

    Both lists are as before when it returns, and masked arrays are loaded when they are wanted.
    """
    if "scipy" in sys.modules:
        return
    np: Any = import_module("numpy")
    if "ma" not in vars(np):
        np.ma = _MaskedArrays("numpy.ma")
    names, listed = np.__all__, np.__dir__
    try:
        np.__all__ = [name for name in names if name not in UNUSED_OF_NUMPY]
        np.__dir__ = lambda: [name for name in listed() if name not in UNUSED_OF_NUMPY]
        import scipy.linalg
        import scipy.sparse  # noqa: F401 - loaded here, for all that import it later
    finally:
        np.__all__, np.__dir__ = names, listed


class _MaskedArrays(ModuleType):
    """Placeholder of `numpy.ma`, which `numpy.unique` loads only to test for a masked argument.

    No array is before that module is loaded. All else that is wanted of it loads it.
    """

    def __getattr__(self, name: str) -> Any:
        if name == "is_masked" and self.__name__ not in sys.modules:
            return lambda _: False
        return getattr(import_module(self.__name__), name)


@contextmanager
def without_blas_threads() -> Iterator[None]:
    """Let OpenBLAS start no threads when loaded, here or in processes started meanwhile.

    Rails are solved with one. Each copy of it, one in NumPy and one in SciPy, takes longer to start
    a thread for every core than it takes to be loaded. Users who want some set a variable.
    """
    if any(name in os.environ for name in THREADS):
        yield
        return
    os.environ[THREADS[0]] = "1"
    try:
        yield
    finally:
        # Another thread may have left first.
        os.environ.pop(THREADS[0], None)


@contextmanager
def without_plugins() -> Iterator[None]:
    """Keep pydantic from searching the metadata of every package for plugins meanwhile.

    Users who want theirs set the variable to the names of those that are left out, or to nothing.
    """
    if PLUGINS in os.environ:
        yield
        return
    os.environ[PLUGINS] = "__all__"
    try:
        yield
    finally:
        os.environ.pop(PLUGINS, None)


@contextmanager
def without_packages(*names: str) -> Iterator[None]:
    """Make imports of packages that are not loaded yet fail meanwhile.

    pandas imports pyarrow wherever it is installed, though only files of the format Parquet and
    columns of its own types need it; xarray imports pint to ask whether an array has units by it.
    """
    missing = [name for name in names if name not in sys.modules]
    sys.modules.update(dict.fromkeys(missing))  # type: ignore[arg-type]
    try:
        yield
    finally:
        for name in missing:
            sys.modules.pop(name, None)
