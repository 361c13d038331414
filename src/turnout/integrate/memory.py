"""Memory of histories that nobody looks at any more, which serves the next run.

Memory that is fresh from the operating system is filled with zeros when it is first touched, which
took a tenth of the time of a run in waveform mode.
"""

import weakref
from collections import deque

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MOST_KEPT = 16 * 2**20
"""Pieces of more numbers than this go back to the operating system; two pieces are kept at most."""

_spare: deque[Floats] = deque(maxlen=2)


def borrowed(count: int) -> Floats:
    """Return room for so many numbers or a few more; what they are means nothing.

    It comes back by itself once the last array that shares it is gone.

    Examples
    --------
    >>> first = borrowed(1000)
    >>> address = first.ctypes.data
    >>> part = first[10:20]
    >>> del first
    >>> borrowed(1000).ctypes.data == address  # a part of it is in use
    False
    >>> del part
    >>> borrowed(900).ctypes.data == address
    True
    """
    memory = _fitting(count)
    if memory is None:
        memory = np.empty(count)
    found = np.frombuffer(memory.data, dtype=np.float64)
    if memory.size <= MOST_KEPT:
        weakref.finalize(found, _spare.append, memory).atexit = False
    return found


def release() -> None:
    """Give spare memory back to the operating system."""
    _spare.clear()


def _fitting(count: int) -> Floats | None:
    """Take a spare piece of memory that is large enough and not twice as large."""
    for _ in range(len(_spare)):
        try:
            memory = _spare.pop()  # the last one may still be in the processor's caches
        except IndexError:  # another thread was quicker
            return None
        if count <= memory.size <= 2 * count:
            return memory
        _spare.appendleft(memory)
    return None
