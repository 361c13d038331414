"""Products with triangular matrices, without most of their zeros."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
ROWS_AT_ONCE = 104
"""Rows of a triangular matrix that are multiplied together."""


def whitened(root: Floats, off: Floats) -> Floats:
    """Return the product of a lower triangular matrix and columns, without most of its zeros.

    Parameters
    ----------
    root : ndarray, shape (n, n)
        Such as `Centre.root`. Of one throw, reading it takes most of the time.
    off : ndarray, shape (n, n_throws)
        What throws are off a mean.
    """
    found = np.empty((len(root), off.shape[1]))
    for first in range(0, len(root), ROWS_AT_ONCE):
        end = first + ROWS_AT_ONCE
        np.matmul(root[first:end, :end], off[:end], out=found[first:end])
    return found


def unwhitened(root: Floats, white: Floats) -> Floats:
    """Return the product of the transpose of such a matrix and columns, shape (n, n_throws)."""
    found = np.zeros((len(root), white.shape[1]))
    for first in range(0, len(root), ROWS_AT_ONCE):
        end = first + ROWS_AT_ONCE
        found[:end] += root[first:end, :end].T @ white[first:end]
    return found
