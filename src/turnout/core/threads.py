"""Limit the linear algebra of small matrices to one thread."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import cache

from threadpoolctl import ThreadpoolController


class _Limit(threading.local):
    """State of the present thread: inside `one_blas_thread` or not."""

    holds = False


_limit = _Limit()


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()


def _has_one() -> bool:
    """Return True if BLAS already has one thread, as in a worker of a sweep."""
    libraries = _controller().lib_controllers
    return all(one.num_threads == 1 for one in libraries if one.user_api == "blas")


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS and LAPACK to one thread for a while, whatever the environment says.

    Rails have some hundred coordinates: threads that wait for each other cost ten times what they
    gain, and a sweep uses the cores for scenarios instead. A nested limit does not call the
    libraries again, which would cost a hundredth of a quick throw.
    """
    if _limit.holds:
        yield
        return
    with nullcontext() if _has_one() else _controller().limit(limits=1, user_api="blas"):
        _limit.holds = True
        try:
            yield
        finally:
            _limit.holds = False
