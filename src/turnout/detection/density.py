"""The density of a throw: normal near by, of longer tails far from all that is expected."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
USUAL = 3.0
"""Standard deviations of the squared distance within which a density is normal [-]."""
UNKNOWN_FROM = 2.0
"""Multiple of that distance from which on what is left is not taken for larger noise [-]."""
UNKNOWN_SHAPES = 60.0
r""":math:`\nu`, in how many ways an unknown deviation may differ: some two in a correlation time of
0.5 s, for two drives and 7 s of movement [-]."""


def log_density(square: Floats, *, size: int) -> Floats:
    """Return the logarithm of the density without its scale, by the squared distance.

    Parameters
    ----------
    square : ndarray
        :math:`Q` [-].
    size : int
        Of the throw, :math:`n`.

    Examples
    --------
    >>> log_density(np.array([8.0, 20.0]), size=8).tolist()
    [-4.0, -10.0]
    >>> round(float(log_density(np.array(20.0 * 2.0), size=8) + 10.0 * np.log(2.0)), 6)
    -10.0
    """
    given = np.asarray(square, dtype=np.float64)
    usual = size + USUAL * np.sqrt(2.0 * size)
    if not given.size or given.max() <= usual:
        return -0.5 * given
    farther = np.asarray(np.maximum(given, usual))
    farther /= usual
    np.log(farther, out=farther)
    found = np.asarray(np.minimum(farther, np.log(UNKNOWN_FROM)))
    found *= usual - min(UNKNOWN_SHAPES, usual)
    farther *= min(UNKNOWN_SHAPES, usual)
    found += farther
    found += np.minimum(given, usual)
    found *= -0.5
    return found
