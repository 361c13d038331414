"""Kernels that can be stopped while they work.

Python hears Ctrl-C between two calls only, and one step of a hard contact problem may take seconds.
A kernel therefore works in a thread of its own, and looks now and then at a flag that this thread
sets.
"""

from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]
P = ParamSpec("P")
T = TypeVar("T")

# A wait without an end would be deaf on some platforms [s].
POLL_INTERVAL = 0.1


def one_thread() -> Executor:
    """Return the thread that kernels work in; to be closed after use."""
    return ThreadPoolExecutor(1, thread_name_prefix="turnout")


def call_interruptible(
    thread: Executor, stop: Ints, kernel: Callable[P, T], *given: P.args, **named: P.kwargs
) -> T:
    """Call a kernel; on Ctrl-C set the flag, and return what the kernel then returns.

    Parameters
    ----------
    thread : Executor
        From `one_thread`.
    stop : ndarray of int, shape (1,)
        The flag that the kernel looks at. It stays set.
    kernel : callable
        Lets other threads run.
    *given, **named
        Its arguments.

    Examples
    --------
    >>> import numpy as np
    >>> with one_thread() as thread:
    ...     call_interruptible(thread, np.zeros(1, dtype=np.int64), max, 1, 2)
    2
    """
    future = thread.submit(kernel, *given, **named)
    while True:
        try:
            return future.result(timeout=POLL_INTERVAL)
        except TimeoutError:
            continue
        except KeyboardInterrupt:
            stop[0] = 1
