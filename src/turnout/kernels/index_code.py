"""Indexing of arrays in kernels: from their front, without the checks that Numba adds.

Numba lets every index and both ends of every slice count from the end where they are negative, and
cuts slices to the size of what they are taken of. In kernels, whose indices come from lists of
places, these checks were a tenth of the time of a step. Here an index is taken as it is, but for a
constant such as ``array[-1]``; the end of a slice is still cut to the size, which is how Numba
takes ``array[first:]``. Negative indices that are computed would read out of bounds; kernels must
not use them.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from llvmlite import ir
from numba.cpython import slicing

_fix_index_of_numba: Any = slicing.fix_index


@contextmanager
def index_from_front() -> Iterator[None]:
    """Let Numba emit indexing without checks; other threads must not compile meanwhile."""
    checked = slicing.fix_index, slicing.fix_slice
    slicing.fix_index, slicing.fix_slice = _fix_index, _fix_slice
    try:
        yield
    finally:
        slicing.fix_index, slicing.fix_slice = checked


def _fix_index(builder: Any, index: Any, size: Any) -> Any:
    if isinstance(index, ir.Constant):
        return _fix_index_of_numba(builder, index, size)
    return index


def _fix_slice(builder: Any, bounds: Any, size: Any) -> None:
    stop = bounds.stop
    bounds.stop = builder.select(builder.icmp_signed("<", stop, size), stop, size)
