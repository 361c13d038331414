"""Functions of C and of LAPACK for kernels: memory, and the inverse of a small matrix."""

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


def factorise_in_place(matrix: Floats, pivots: Floats) -> int:
    """Factorise a matrix in place, its rows being columns (DGETRF); not zero if it is singular."""
    from scipy.linalg import lapack

    factors, found, info = lapack.dgetrf(matrix.T)
    matrix[:] = factors.T
    pivots.view(np.int32)[: found.size] = found
    return int(info)


def invert_factors(matrix: Floats, pivots: Floats) -> int:
    """Turn factors of `factorise_in_place` into the inverse (DGETRI); not zero if singular."""
    from scipy.linalg import lapack

    n = matrix.shape[0]
    inverse, info = lapack.dgetri(matrix.T, pivots.view(np.int32)[:n], n * 64)
    matrix[:] = inverse.T
    return int(info)
