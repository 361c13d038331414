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


def sums_of_groups(
    values: Floats, starts: NDArray[np.intp], *, temper: float
) -> tuple[Floats, Floats]:
    """Return the logarithm of the sum of the exponentials of each of some groups, two ways.

    Parameters
    ----------
    values : ndarray, shape (n, m)
        Logarithms; those of a group follow each other.
    starts : ndarray of int, shape (k,)
        Where groups begin.
    temper : float
        By which logarithms are divided in the second way [-].

    Returns
    -------
    whole, tempered : ndarray, shape (k, m)

    Examples
    --------
    >>> logs, starts = np.log([[1.0], [4.0], [9.0]]), np.array([0, 2])
    >>> [np.exp(item[:, 0]).round(6).tolist() for item in sums_of_groups(logs, starts, temper=2.0)]
    [[5.0, 9.0], [3.0, 3.0]]
    """
    highest = values.max(axis=0)
    whole, tempered = np.empty((2, len(starts), values.shape[1]))
    for group, rows in enumerate(np.split(values, starts[1:])):
        scaled = np.maximum(rows - highest, LEAST)
        scaled /= temper
        np.exp(scaled, out=scaled)
        scaled.sum(axis=0, out=tempered[group])
        np.power(scaled, temper, out=scaled)  # faster than another exponential
        scaled.sum(axis=0, out=whole[group])
    return highest + np.log(whole), highest / temper + np.log(tempered)


LEAST = -600.0
"""Logarithms of densities are held at so much below the highest, above the smallest numbers."""
