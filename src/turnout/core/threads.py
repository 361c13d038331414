"""Keep the linear algebra of small matrices on one core."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from threadpoolctl import ThreadpoolController


class _Limit(threading.local):
    """Whether this thread is within a limit."""

    holds = False


_limit = _Limit()


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS and LAPACK to one thread for a while, whatever the environment says.

    Rails have some hundred coordinates: threads that wait for each other cost ten times what they
    gain, and a sweep fills the cores with scenarios instead. Within another limit nothing is asked
    of the libraries, which takes them a hundredth of a quick throw.
    """
    if _limit.holds:
        yield
        return
    with _controller().limit(limits=1, user_api="blas"):
        _limit.holds = True
        try:
            yield
        finally:
            _limit.holds = False
