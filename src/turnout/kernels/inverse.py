"""The inverse of a small matrix in a kernel, by LAPACK, in memory that the kernel takes for it."""

import numpy as np
from numpy.typing import NDArray

from turnout.kernels.compiled import compiled
from turnout.kernels.memory import acquire_matrix, release_matrix

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


@compiled
def invert(matrix: Floats, inverse: Floats) -> None:
    """Write the inverse of a matrix to another one; NaN where there is none.

    Parameters
    ----------
    matrix : ndarray, shape (n, n)
        It is used up.
    inverse : ndarray, shape (n, n)
        Written.

    Examples
    --------
    >>> found = np.zeros((2, 2))
    >>> invert(np.array([[2.0, 1.0], [0.0, 4.0]]), found)
    >>> found.tolist()
    [[0.5, -0.125], [0.0, 0.25]]
    >>> invert(np.zeros((2, 2)), found)
    >>> found.tolist()
    [[nan, nan], [nan, nan]]
    """
    n, exists = matrix.shape[0], True
    for i in range(n):  # LAPACK has columns where NumPy has rows
        for j in range(n):
            inverse[j, i] = matrix[i, j]
            exists = exists and np.isfinite(matrix[i, j])
    if exists and n > 0:
        pivots = acquire_matrix(1, n)
        exists = (
            factorise_in_place(inverse, pivots[0]) == 0 and invert_factors(inverse, pivots[0]) == 0
        )
        release_matrix(pivots)
    for i in range(n):
        for j in range(n):
            matrix[j, i] = inverse[i, j]
    for i in range(n):
        for j in range(n):
            inverse[i, j] = matrix[i, j] if exists else np.nan
