"""Memory that kernels take for themselves, and memory at an address."""

import ctypes

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def acquire_matrix(rows: int, columns: int) -> Floats:
    """Take memory for a matrix; a kernel gives it back by `release_matrix`."""
    return np.empty((rows, columns))


def release_matrix(matrix: Floats) -> None:
    """Give the memory of a matrix back."""


def vector_at(address: int, size: int) -> Floats:
    """Return the floats at an address in memory.

    Examples
    --------
    >>> values = np.arange(5.0)
    >>> vector_at(values.ctypes.data + 8, 3).tolist()
    [1.0, 2.0, 3.0]
    """
    return np.ctypeslib.as_array((ctypes.c_double * size).from_address(address))
