"""Products with triangular matrices, without most of their zeros."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
ROWS_AT_ONCE = 104
"""Rows of triangular matrices that are multiplied together."""


@dataclass(frozen=True, slots=True, eq=False)
class Whitening:
    """Lower triangular roots of several covariances, such as `Centre.root`.

    Attributes
    ----------
    rows : tuple of ndarray of float32, each of shape (k, n_rows, n_columns)
        Some rows of all roots, without the columns that are zero. Reading them takes most of the
        time of whitening one throw; in single precision that is half, and what is left of a throw
        changes by a few millionths of a deviation.
    """

    rows: tuple[Singles, ...]

    def of(self, off: Floats) -> tuple[Floats, Singles]:
        """Return what throws are off each mean, whitened, and that by the transposed roots again.

        Parameters
        ----------
        off : ndarray, shape (k, n, n_throws)
            What throws are off the means.

        Returns
        -------
        white : ndarray, shape (k, n, n_throws)
            [-]
        back : ndarray of float32, shape (k, n, n_throws)
            [1/N]
        """
        given = off.astype(np.float32)
        white, back = np.empty_like(given), np.zeros_like(given)
        for rows in self.rows:
            _, count, end = rows.shape
            own = white[:, end - count : end]
            np.matmul(rows, given[:, :end], out=own)
            # while these rows are near, so that they are read once
            back[:, :end] += rows.swapaxes(1, 2) @ own
        return white.astype(np.float64), back


def make_whitening(roots: Floats) -> Whitening:
    """Prepare to whiten by lower triangular roots, shape (k, n, n)."""
    size = roots.shape[1]
    ends = [*range(ROWS_AT_ONCE, size, ROWS_AT_ONCE), size]
    return Whitening(
        tuple(
            roots[:, first:end, :end].astype(np.float32, order="C")
            for first, end in zip([0, *ends[:-1]], ends, strict=True)
        )
    )
