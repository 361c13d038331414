"""Factors and the inverse of a small matrix in a kernel, by LAPACK."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


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
