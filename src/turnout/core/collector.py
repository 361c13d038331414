"""Python's collector of unused cycles, left out where little can be collected."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def without_collections() -> Iterator[None]:
    """Collect no cycles for a while, as one that loads libraries and is soon over.

    Loading makes some hundred thousand objects that stay, and each collection looks through all of
    them: a seventh of a short command. Most memory is freed without collections.

    Examples
    --------
    >>> with without_collections():
    ...     gc.isenabled()
    False
    >>> gc.isenabled()
    True
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
