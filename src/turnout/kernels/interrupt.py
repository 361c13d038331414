"""Call kernels so that Ctrl-C can stop them.

Python handles Ctrl-C between two calls only, and one step of a hard contact problem may take
seconds. A kernel therefore polls a flag. Where Python's own handler of Ctrl-C is in place, one in
machine code replaces it while a kernel runs (`turnout.kernels.flag_setter`). Where the program
has a handler of its own, which runs in the main thread, a kernel runs in a worker thread meanwhile,
and the calling thread sets the flag. Where Ctrl-C does not reach the caller nothing is needed.
"""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from types import FrameType
from typing import ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]
P = ParamSpec("P")
T = TypeVar("T")

# On some platforms a wait without a timeout does not react to Ctrl-C [s].
POLL_INTERVAL = 0.1
# Elsewhere a handler serves one signal only and would have to put itself back.
HANDLERS_STAY = os.name == "posix"


@contextmanager
def one_thread() -> Iterator[Executor | None]:
    """Give an executor of one worker thread for kernels; None if they need none.

    Ctrl-C comes to the main thread alone, and to no process that ignores it, such as a worker of a
    sweep; Python's own handler is replaced while a kernel runs. One thread serves all runs:
    starting one takes a twentieth of a quick throw.
    """
    replaced = HANDLERS_STAY and _has_python_handler()
    if replaced or not _in_main_thread() or signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        yield None
        return
    yield _kept_thread()


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


def _has_python_handler() -> bool:
    return signal.getsignal(signal.SIGINT) is signal.default_int_handler


@cache
def _kept_thread() -> Executor:
    return ThreadPoolExecutor(1, thread_name_prefix="turnout")


if hasattr(os, "register_at_fork"):  # a forked process has none of the threads
    os.register_at_fork(after_in_child=_kept_thread.cache_clear)


def call_interruptible(
    thread: Executor | None, stop: Ints, kernel: Callable[P, T], *given: P.args, **named: P.kwargs
) -> T:
    """Call a kernel and return its result; on Ctrl-C set the flag that it polls.

    Parameters
    ----------
    thread : Executor or None
        From `one_thread`.
    stop : ndarray of int, shape (1,)
        The flag that the kernel polls. It stays set.
    kernel : callable
        It releases the global interpreter lock.
    *given, **named
        Its arguments.

    Examples
    --------
    >>> import numpy as np
    >>> with one_thread() as thread:
    ...     call_interruptible(thread, np.zeros(1, dtype=np.int64), max, 1, 2)
    2
    """
    if thread is None:
        if HANDLERS_STAY and _has_python_handler() and _in_main_thread():
            return _call_with_flag_setter(stop, kernel, *given, **named)
        return kernel(*given, **named)
    with _ctrl_c_sets(stop):
        future = thread.submit(kernel, *given, **named)
        while True:
            try:
                return future.result(timeout=POLL_INTERVAL)
            except TimeoutError:
                continue
            except KeyboardInterrupt:  # by a handler of others
                stop[0] = 1


def _call_with_flag_setter(
    stop: Ints, kernel: Callable[P, T], *given: P.args, **named: P.kwargs
) -> T:
    """Call a kernel in the present thread while a handler in machine code sets the flag on Ctrl-C.

    Python may raise what it noted of a Ctrl-C right after the handler is set: inside the `try`.
    """
    from turnout.kernels.flag_setter import flag_setter, present_handler, set_handler

    handler, flag_address = flag_setter()
    before = present_handler(signal.SIGINT)
    try:
        flag_address.value = stop.__array_interface__["data"][0]
        set_handler(signal.SIGINT, handler)
        return kernel(*given, **named)
    finally:
        set_handler(signal.SIGINT, before)


@contextmanager
def _ctrl_c_sets(stop: Ints) -> Iterator[None]:
    """Let Ctrl-C set a flag, unless the program handles it in its own way.

    An exception between two instructions of `concurrent.futures` could leave a lock locked, which
    the thread would wait for at its end.
    """
    before = signal.getsignal(signal.SIGINT)
    if before is not signal.default_int_handler:
        yield
        return

    def set_flag(_number: int, _frame: FrameType | None) -> None:
        stop[0] = 1

    signal.signal(signal.SIGINT, set_flag)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
