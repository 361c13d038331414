"""Keep NumPy from copying long rows into its buffer."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

ELEMENTS = 512
"""Size of the buffer: shorter than the rows where it helps, long enough to convert types."""


@contextmanager
def short_buffers() -> Iterator[None]:
    """Keep NumPy from copying rows into its buffers for a while.

    Where an operand is not in one piece, or is repeated along the rows, NumPy copies as many whole
    rows as fit its buffer of 8192 elements before it calculates with them, though no type has to be
    converted. Rows that do not fit are taken as they are, which takes a third of the time. What
    is calculated with is the same, and so are sums along an axis; a sum over all axes of an array
    that is not in one piece adds in another order.

    Examples
    --------
    >>> with short_buffers():
    ...     np.getbufsize()
    512
    >>> np.getbufsize()
    8192
    """
    with np.errstate():  # restores the size too
        np.setbufsize(ELEMENTS)
        yield
