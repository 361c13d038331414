"""Fewer points of a curve that look the same."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def thinned(x: Floats, values: Floats, *, most: int) -> tuple[Floats, Floats]:
    """Return at most so many points of a curve that look the same.

    The curve is cut into parts of equal length, and of each the lowest, the highest and the first
    missing point stay, besides both ends of the curve: no peak gets lower, no tear is bridged.

    Parameters
    ----------
    x, values : ndarray, shape (n,)
        The curve; NaN in `values` where it is torn.
    most : int
        How many points may stay, at least 5.

    Returns
    -------
    (ndarray, ndarray), shape (m,)
        Points of the curve in their order.

    Examples
    --------
    >>> thinned(np.arange(7.0), np.array([0.0, 5.0, 1.0, 2.0, -3.0, 1.0, 1.0]), most=5)
    (array([0., 1., 4., 6.]), array([ 0.,  5., -3.,  1.]))
    """
    if values.size <= most:
        return x, values
    parts = max(1, (most - 2) // 3)
    size = -(-values.size // parts)
    padded = np.full(-(-values.size // size) * size, np.nan)
    padded[: values.size] = values
    rows = padded.reshape(-1, size)
    there = np.isfinite(rows)
    lowest = np.argmin(np.where(there, rows, np.inf), axis=1)
    highest = np.argmax(np.where(there, rows, -np.inf), axis=1)
    missing = np.where(there.all(axis=1), lowest, np.argmin(there, axis=1))
    begin = np.arange(rows.shape[0]) * size
    at = np.concatenate([begin + lowest, begin + highest, begin + missing, [0, values.size - 1]])
    kept = np.unique(np.minimum(at, values.size - 1))
    return x[kept], values[kept]
