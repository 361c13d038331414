"""Saturation of a force that grows with the object: a drive slips."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

# A rod force saturates where it grew by the first share of its largest value over a series of
# objects, and by less than the second from the second largest object to the largest [-].
GROWN, LEVEL = 0.2, 0.02


def saturates(series: Sequence[tuple[float, NDArray[np.float64]]]) -> bool:
    """Return True if a rod force that grew with the object is the same for the two largest.

    Parameters
    ----------
    series : sequence of (float, ndarray of shape (n_drives,))
        Size of each object [m], in any order, and the force of each rod [N].

    Examples
    --------
    >>> force = [(0.005, 1e3), (0.013, 4e3), (0.016, 4.02e3)]
    >>> saturates([(size, np.array([value, 500.0])) for size, value in force])
    True
    """
    if len(series) < 3:
        return False
    rows = np.abs(np.stack([force for _, force in sorted(series, key=lambda item: item[0])]))
    grown = rows[-2] - rows[0] > GROWN * rows[-1]
    return bool((grown & (rows[-1] - rows[-2] < LEVEL * rows[-1])).any())
