"""Signals that tell motion: their rest, their mean over a while, and where they go."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

CLOSING, OPENING, UNKNOWN = "closing", "opening", "unknown"


def found_direction(forces: Floats, *, rate: float) -> str:
    """Return the direction of a throw from how its rod forces changed from rest to the end.

    Friction opposes the motion, so the sum of the forces ends further in the direction of the throw
    than it began; an offset does not matter.

    Parameters
    ----------
    forces : ndarray, shape (n_drives, n)
        Unfiltered rod forces, positive closing [N].
    rate : float
        Samples a second [1/s].

    Returns
    -------
    str
        "closing", "opening", or "unknown" where the change is less than the noise or 50 N.

    Examples
    --------
    >>> found_direction(np.array([[0.0] * 400 + [-900.0] * 400]), rate=1000.0)
    'opening'
    """
    change = float(np.sum(force_changes(forces, rate=rate)))
    if not abs(change) > 50.0:
        return UNKNOWN
    return CLOSING if change > 0 else OPENING


def force_changes(forces: Floats, *, rate: float) -> Floats:
    """Return how much each rod force differs between the end and the start of a throw [N].

    Parameters
    ----------
    forces : ndarray, shape (n_drives, n)
        Unfiltered [N].
    rate : float
        Samples a second [1/s].

    Returns
    -------
    ndarray, shape (n_drives,)
        Medians over the last 0.3 s less those over the first 0.3 s.

    Examples
    --------
    >>> force_changes(np.array([[1.0] * 300 + [3.0] * 300]), rate=1000.0)
    array([2.])
    """
    count = max(1, min(round(0.3 * rate), forces.shape[1] // 3))
    filled = np.array([without_holes(row) for row in forces])
    change = np.median(filled[:, -count:], axis=1) - np.median(filled[:, :count], axis=1)
    return np.asarray(change, dtype=np.float64)


def mean_over(values: Floats, *, width: int) -> Floats:
    """Return the centred mean over `width` samples, holes filled; the ends over what there is."""
    filled = without_holes(values)
    half = max(0, width // 2)
    total = np.concatenate(([0.0], np.cumsum(filled)))
    index = np.arange(filled.size)
    first, last = np.maximum(index - half, 0), np.minimum(index + half + 1, filled.size)
    return np.asarray((total[last] - total[first]) / (last - first))


def without_holes(values: Floats) -> Floats:
    """Return samples with a straight line across what is not finite; zeros where nothing is."""
    known = np.isfinite(values)
    if known.all():
        return values
    if not known.any():
        return np.zeros_like(values)
    index = np.arange(values.size)
    return np.asarray(np.interp(index, index[known], values[known]))
