"""Decorators of compiled kernels, and their cache in the user's cache folder.

A kernel is machine code for the kinds of arguments that it is called with. The cache holds this
code in one file for each kernel, kinds and processor, in a folder whose name has a digest of every
kernel source: a new source, a new folder. Only what is not found there is compiled, by Numba, which
is not imported before (`turnout.kernels.compiler`).
"""

import functools
import hashlib
import inspect
import os
import re
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

from turnout.core.cache_folder import safe_folder, user_cache_folder
from turnout.core.errors import TurnoutError
from turnout.core.files import write_atomic
from turnout.core.sources import KERNELS, digest_of_sources
from turnout.kernels.arguments import Kind, add_argument, describe
from turnout.kernels.machine_code import (
    SUFFIX,
    MachineCode,
    built_code,
    callable_code,
    machine_digest,
)

P = ParamSpec("P")
T = TypeVar("T")

CACHE_VARIABLE = "NUMBA_CACHE_DIR"
"""Environment variable with the folder of compiled kernels, for child processes and Numba."""


def kernel_cache_folder() -> Path:
    """Return the cache folder of the kernels compiled from the present sources."""
    return user_cache_folder() / f"kernels-{digest_of_sources(KERNELS)}"


def _choose_folder() -> None:
    """Choose a folder that no other user can write, since code from it is run.

    It bears the digest of the present sources wherever it is: a folder that the user chose may
    have served others before.
    """
    chosen, wanted = os.environ.pop(CACHE_VARIABLE, None), kernel_cache_folder()
    if chosen:  # by the user, or by the process that started this one
        place = Path(chosen).absolute()
        wanted = place if place.name == wanted.name else place / wanted.name
    folder = safe_folder(wanted)
    if folder is not None:
        os.environ[CACHE_VARIABLE] = str(folder)


_choose_folder()
_ROOT = Path(__file__).parents[1]
_lock = threading.RLock()


every_kernel = list["Kernel"]()
"""All kernels that this process has defined."""


class Kernel:
    """A function that is compiled when it is called, or comes compiled from the cache.

    Attributes
    ----------
    py_func : callable
        The plain function.
    loop, part : bool
        Whether it is compiled into what calls it; for a loop, arrays that are written overlap none.
    cache_hits : int
        How often machine code came from the cache in this process.
    ready : dict
        Machine code in this process, by the kinds of its arguments.
    """

    def __init__(self, function: Callable[..., Any], *, loop: bool, part: bool) -> None:
        functools.update_wrapper(self, function)
        self.py_func, self.loop, self.part = function, loop, part
        self.cache_hits = 0
        self._count = function.__code__.co_argcount
        self.ready: dict[tuple[Kind, ...], Callable[[list[Any]], Any]] = {}
        every_kernel.append(self)

    def __call__(self, *args: Any, **named: Any) -> Any:
        """Call the machine code for arguments of these kinds."""
        if named or len(args) != self._count:
            bound = inspect.signature(self.py_func).bind(*args, **named)
            bound.apply_defaults()
            args = bound.args
        words: list[Any] = []
        kinds: list[Kind] = []
        for value in args:
            add_argument(value, words, kinds)
        key = tuple(kinds)
        call = self.ready.get(key)
        if call is None:
            _make_ready([(self, key)])
            call = self.ready[key]
        return call(words)

    @property
    def _numba_type_(self) -> Any:
        """Numba's type of this kernel for kernels that call it."""
        import numba

        return numba.typeof(self.dispatcher)  # type: ignore[no-untyped-call]

    @functools.cached_property
    def dispatcher(self) -> Any:
        """The kernel as Numba has it."""
        from turnout.kernels.compiler import inner_dispatcher

        return inner_dispatcher(self.py_func, loop=self.loop, part=self.part)

    def is_kept(self) -> bool:
        """Return True if machine code of this kernel is in use, built ahead, or in the cache."""
        begin = f"{self.full_name}-"
        if self.ready or any(name.startswith(begin) for name in built_code().results):
            return True
        folder = os.environ.get(CACHE_VARIABLE)
        pattern = f"{begin}*-{machine_digest()}{SUFFIX}"
        return folder is not None and any(Path(folder).glob(pattern))

    @property
    def full_name(self) -> str:
        """Module and name, such as "turnout.solver.march.march"."""
        return re.sub(r"[^\w.]", "_", f"{self.py_func.__module__}.{self.py_func.__qualname__}")

    def identity(self, kinds: tuple[Kind, ...]) -> str | None:
        """Return a name of the machine code for arguments of some kinds that no other one has.

        None where there is none: of a kernel that is defined in no file, or depends on variables
        around it. One outside turnout is known by the content of its file as well, those inside by
        the folder of the cache.
        """
        code = self.py_func.__code__
        source = Path(code.co_filename)
        if code.co_freevars or not source.is_file():
            return None
        text = "\n".join([str(code.co_firstlineno), *map(describe, kinds)])
        found = hashlib.blake2b(text.encode(), digest_size=8)
        if not source.is_relative_to(_ROOT):
            found.update(source.read_bytes())
        return f"{self.full_name}-{found.hexdigest()}"

    def file_for(self, kinds: tuple[Kind, ...]) -> Path | None:
        """Return the file of the machine code for arguments of some kinds; None without one."""
        folder, identity = os.environ.get(CACHE_VARIABLE), self.identity(kinds)
        if folder is None or identity is None:
            return None
        return Path(folder) / f"{identity}-{machine_digest()}{SUFFIX}"

    def load(self, kinds: tuple[Kind, ...]) -> bool:
        """Load machine code that was built ahead, or lies in the cache; False if there is none."""
        identity, code = self.identity(kinds), built_code()
        if identity is None:
            return False
        if identity not in code.results:
            file = self.file_for(kinds)
            kept = None if file is None else MachineCode.from_file(file)
            if kept is None or identity not in kept.results:
                return False
            code = kept
            self.cache_hits += 1
        self.ready[kinds] = callable_code(code, identity, kinds)
        return True

    def take(self, code: MachineCode, entry: str, kinds: tuple[Kind, ...]) -> None:
        """Load and keep machine code that was just made for arguments of some kinds."""
        self.ready[kinds] = callable_code(code, entry, kinds)
        file = self.file_for(kinds)
        if file is not None:
            with suppress(OSError, TurnoutError):  # without a cache it is made again
                write_atomic(file, code.to_bytes(), durable=False)


Wanted = tuple[Kernel, tuple[Kind, ...]]


def prepare_kernels(*calls: tuple[Callable[..., Any], Sequence[Any]]) -> None:
    """Load kernels for calls with these arguments, and compile those that are not in the cache.

    What several of these call is optimised once.
    """
    wanted = list[Wanted]()
    for kernel, args in calls:
        kinds: list[Kind] = []
        for value in args:
            add_argument(value, [], kinds)
        wanted.append((cast("Kernel", kernel), tuple(kinds)))
    _make_ready(wanted)


def _make_ready(wanted: Sequence[Wanted]) -> None:
    with _lock:
        missing = [(kernel, kinds) for kernel, kinds in wanted if kinds not in kernel.ready]
        missing = [(kernel, kinds) for kernel, kinds in missing if not kernel.load(kinds)]
        if missing:
            from turnout.kernels.compiler import compiled_together

            names = [
                kernel.identity(kinds) or f"{kernel.full_name}-{os.urandom(16).hex()}"
                for kernel, kinds in missing
            ]
            parts = [(kernel.dispatcher, kinds) for kernel, kinds in missing]
            code = compiled_together(parts, names)
            for (kernel, kinds), name in zip(missing, names, strict=True):
                kernel.take(code, name, kinds)


def compiled(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a kernel to machine code on its first call and keep it in the cache.

    The plain function stays reachable as `.py_func`. Kernels let other threads of Python run. They
    may not allocate arrays, so that passing records of arrays needs no reference counting.
    Sums keep the order in which they are written, and products are rounded before they are added,
    so that the same kernel gives the same bits however it came to be compiled.
    """
    return _compiled(function)


def compiled_loop(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a short loop over arrays into each kernel that calls it.

    The arrays that it writes must not overlap each other or those that it reads, which is not
    checked.
    """
    return _compiled(function, loop=True)


def compiled_part(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a kernel inline into each kernel that calls it; for short ones with few callers."""
    return _compiled(function, part=True)


def _compiled(
    function: Callable[P, T], *, loop: bool = False, part: bool = False
) -> Callable[P, T]:
    kernel: Any = Kernel(function, loop=loop, part=part)
    found: Callable[P, T] = kernel
    return found
