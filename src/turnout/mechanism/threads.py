"""Keep the linear algebra of small matrices on one core."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from threadpoolctl import ThreadpoolController


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS and LAPACK to one thread for a while, whatever the environment says.

    Rails have some hundred coordinates: threads that wait for each other cost ten times what they
    gain, and a sweep fills the cores with scenarios instead.
    """
    with _controller().limit(limits=1, user_api="blas"):
        yield
