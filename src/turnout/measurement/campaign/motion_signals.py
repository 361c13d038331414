"""Signals that show motion: their rest, their mean over a while, and their direction."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

# At either end of a recording, where a drift shows [s].
END = 0.5
CLOSING, OPENING, UNKNOWN = "closing", "opening", "unknown"


def found_direction(forces: Floats, *, rate: float) -> str:
    """Return the direction of a throw from the changes of its rod forces from rest to the end.

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
    """Return the difference of each rod force between the end and the start of a throw [N].

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
    filled = bridge_gaps(forces)
    change = np.median(filled[:, -count:], axis=1) - np.median(filled[:, :count], axis=1)
    return np.asarray(change, dtype=np.float64)


def bridge_gaps(values: Floats) -> Floats:
    """Return samples with a straight line across values that are not finite; zeros if none is.

    Parameters
    ----------
    values : ndarray, shape (..., n)
        Rows of samples.
    """
    known = np.isfinite(values)
    if known.all():
        return values
    if values.ndim > 1:
        return np.array([bridge_gaps(row) for row in values])
    if not known.any():
        return np.zeros_like(values)
    index = np.arange(values.size)
    return np.asarray(np.interp(index, index[known], values[known]))


def true_runs(flags: Flags) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the first sample of each run of true flags, and one past its last.

    Parameters
    ----------
    flags : ndarray of bool, shape (n,)

    Examples
    --------
    >>> true_runs(np.array([True, True, False, True]))
    (array([0, 3]), array([2, 4]))
    """
    steps = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False]))))
    return steps[::2], steps[1::2]


def longest_true_run(flags: Flags) -> int:
    """Return the length of the longest run of true flags.

    Examples
    --------
    >>> longest_true_run(np.array([True, True, False, True]))
    2
    """
    starts, stops = true_runs(flags)
    return int((stops - starts).max(initial=0))


def spikes(values: Floats, *, rate: float, least: float) -> Flags:
    """Flag the samples that stand alone: a spike of one or two samples that is gone again at once.

    Motion and impacts last longer than 4 ms; below 500 samples a second a sample may hold a whole
    inrush, and no sample is called a spike.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Samples without holes.
    rate : float
        Samples a second [1/s].
    least : float
        Height above the samples around, from which on one is a spike [unit of the values].

    Returns
    -------
    ndarray of bool, shape (n,)

    Examples
    --------
    >>> spikes(np.r_[np.zeros(5), 9.0, np.ones(5)], rate=1000.0, least=5.0).nonzero()[0]
    array([5])
    """
    none = np.zeros(values.size, dtype=bool)
    if rate < 500.0 or values.size < 5 or not np.any(np.abs(np.diff(values)) > least):
        return none
    return np.asarray(np.abs(values - _median_of_five(values)) > least)


def without_spikes(values: Floats, *, rate: float, least: float) -> Floats:
    """Return samples with the median of five in place of each spike."""
    filled = bridge_gaps(values)
    found = spikes(filled, rate=rate, least=least)
    return np.where(found, _median_of_five(filled), values) if found.any() else values


def exchanged_pairs(rows: Floats) -> Iterator[tuple[int, int, Floats]]:
    """Yield the places of each two rows, and all rows with these two exchanged.

    Examples
    --------
    >>> [pair[2].tolist() for pair in exchanged_pairs(np.array([[1.0], [2.0]]))]
    [[[2.0], [1.0]]]
    """
    for first, second in combinations(range(len(rows)), 2):
        order = np.arange(len(rows))
        order[[first, second]] = second, first
        yield first, second, rows[order]


def drift(values: Floats, *, rate: float) -> float:
    """Return the slope that a channel has at rest at both ends, or zero without one.

    Parameters
    ----------
    values : ndarray, shape (n,)
        A throw with its rest on either side, or a whole recording.
    rate : float
        Samples a second [1/s].

    Returns
    -------
    float
        The lesser of both slopes, where they agree and stand out of the noise [unit/s].

    Examples
    --------
    >>> time = np.arange(5000) / 1000.0
    >>> throw = 900.0 * np.clip(time - 1.5, 0.0, 2.0)
    >>> round(drift(throw + 80.0 * time, rate=1000.0)), drift(throw, rate=1000.0)
    (80, 0.0)
    """
    count = round(END * rate)
    if count < 10 or values.size < 4 * count:
        return 0.0
    filled, time = bridge_gaps(values), np.arange(count) / rate
    slopes = []
    for part in (filled[:count], filled[-count:]):
        slope, level = np.polyfit(time, part, 1)
        noise = float(np.std(part - level - slope * time))
        if abs(slope) <= 6.0 * noise * np.sqrt(12.0 / count) / END:
            return 0.0
        slopes.append(float(slope))
    least, most = sorted(slopes, key=abs)
    return least if least * most > 0.0 and least / most > 0.5 else 0.0


def _median_of_five(values: Floats) -> Floats:
    return np.asarray(median_filter(values, 5, mode="nearest"))
