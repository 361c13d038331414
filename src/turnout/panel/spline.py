r"""Cubic splines through a few points.

The slopes :math:`s` at the knots follow from continuous curvature,

.. math:: h_i s_{i-1} + 2 (h_{i-1} + h_i) s_i + h_{i-1} s_{i+1}
          = 3 (h_i d_{i-1} + h_{i-1} d_i)

with the lengths :math:`h` and mean slopes :math:`d` of the intervals, and one condition at each
end. De Boor, A Practical Guide to Splines, 1978, chapter IV. It is written out here since a library
for it takes longer to load than many throws.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

ENDS = ("not-a-knot", "natural", "clamped")
"""Third derivative continuous at the next knot; no curvature; no slope."""


@dataclass(frozen=True, slots=True)
class Spline:
    """A cubic spline.

    Attributes
    ----------
    knots : ndarray, shape (n,)
        Rising.
    values, slopes : ndarray, shape (n, ...)
        At the knots.
    """

    knots: FloatArray
    values: FloatArray
    slopes: FloatArray

    def __call__(self, x: npt.ArrayLike) -> FloatArray:
        """Return the values at places, shape (..., ...); beyond the ends the last cubic goes on."""
        places = np.asarray(x, dtype=np.float64)
        last = self.knots.size - 2
        at = np.clip(np.searchsorted(self.knots, places, side="right") - 1, 0, last)
        length = self.knots[at + 1] - self.knots[at]
        share = (places - self.knots[at]) / length
        own = (..., *(np.newaxis,) * (self.values.ndim - 1))
        s, h = share[own], length[own]
        rest = 1.0 - s
        found: FloatArray = rest * rest * (1.0 + 2.0 * s) * self.values[at]
        found = found + s * s * (1.0 + 2.0 * rest) * self.values[at + 1]
        found = found + h * s * rest * (rest * self.slopes[at] - s * self.slopes[at + 1])
        return found


def cubic_spline(knots: Sequence[float], values: npt.ArrayLike, *, ends: tuple[str, str]) -> Spline:
    """Return the cubic spline through some points.

    Parameters
    ----------
    knots : sequence of float
        Rising, at least two; three for the end "not-a-knot".
    values : array_like, shape (n, ...)
        At the knots.
    ends : tuple of str
        What holds at the first and the last knot, of `ENDS`.

    Examples
    --------
    >>> cube = cubic_spline([0, 1, 2, 3], [0, 1, 8, 27], ends=("not-a-knot", "not-a-knot"))
    >>> float(cube(2.5))
    15.625
    """
    x, y = np.asarray(knots, dtype=np.float64), np.asarray(values, dtype=np.float64)
    n, length = x.size, np.diff(x)
    rise = np.diff(y, axis=0) / length.reshape(-1, *(1,) * (y.ndim - 1))
    if n == 3 and ends == ("not-a-knot", "not-a-knot"):  # which leaves one parabola
        bend = (rise[1] - rise[0]) / (length[0] + length[1])
        first = rise[0] - length[0] * bend
        slopes = np.stack((first, first + 2 * length[0] * bend, rise[1] + length[1] * bend))
        return Spline(x, y, slopes)
    matrix, right = np.zeros((n, n)), np.zeros_like(y)
    for i in range(1, n - 1):
        before, after = length[i - 1], length[i]
        matrix[i, i - 1 : i + 2] = after, 2.0 * (before + after), before
        right[i] = 3.0 * (after * rise[i - 1] + before * rise[i])
    for row, end in ((0, ends[0]), (n - 1, ends[1])):
        # seen from that end, so that both are written once
        order = slice(None) if row == 0 else slice(None, None, -1)
        matrix[row, order][: min(n, 3)], right[row] = _end(end, length[order], rise[order], n)
    solved = np.linalg.solve(matrix, right.reshape(n, -1))
    return Spline(x, y, np.asarray(solved, dtype=np.float64).reshape(y.shape))


def _end(end: str, length: FloatArray, rise: FloatArray, n: int) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients of the first three slopes, and the right side, of one end."""
    if end == "clamped":
        return np.array([1.0, 0.0, 0.0])[:n], np.zeros_like(rise[0])
    if end == "natural":
        return np.array([2.0, 1.0, 0.0])[:n], 3.0 * rise[0]
    one, two = length[0], length[1]
    both = one + two
    right = ((one + 2.0 * both) * two * rise[0] + one * one * rise[1]) / both
    return np.array([two, both, 0.0]), right
