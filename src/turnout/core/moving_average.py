"""Moving average of measurements and features, as `turnout.metric.force_features` makes it too."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

WINDOW = 0.1
"""Width that the published measurements were filtered with [s]."""


def whole_count(samples: float) -> int:
    """Return the nearest whole number of samples; rounding in a rate decides no tie.

    Examples
    --------
    >>> whole_count(2.5 * (1 + 1e-12)), whole_count(3.5 * (1 - 1e-12))
    (2, 4)
    """
    return round(round(samples, 6))


def window_samples(window: float, *, rate: float) -> int:
    """Return the odd number of samples of a centred window.

    Parameters
    ----------
    window : float
        Width [s].
    rate : float
        Samples a second [1/s].

    Examples
    --------
    >>> window_samples(0.1, rate=1000.0), window_samples(0.1, rate=250.0 * (1 + 1e-12))
    (101, 25)
    """
    return 2 * whole_count(0.5 * window * rate) + 1


def moving_average(values: Floats, *, rate: float, window: float = WINDOW) -> Floats:
    """Return the centred moving average, which does not shift in time.

    Within half a window of an end the average is over the samples there are, so it is not centred
    there. Each row is averaged about its own mean: sums over a long recording keep their digits,
    and one more row changes no bit of the others.

    Parameters
    ----------
    values : ndarray, shape (..., n)
        Samples; NaN is a missing one, over which the average is of the others.
    rate : float
        Samples a second [1/s].
    window : float
        Width [s]; 0.1 s at 1 kHz are 101 samples.

    Returns
    -------
    ndarray, shape (..., n)
        NaN where a window has no sample at all.

    Examples
    --------
    >>> moving_average(np.array([0.0, 3.0, 0.0, 0.0, np.nan]), rate=10.0, window=0.2)
    array([1.5, 1. , 1. , 0. , 0. ])
    """
    count = values.shape[-1]
    if count == 0:
        return values.astype(np.float64)
    half = min(window_samples(window, rate=rate) // 2, count - 1)
    known = np.isfinite(values)
    level = row_levels(values)[..., np.newaxis]
    if known.all():
        index = np.arange(count)
        number = np.minimum(index + half + 1, count) - np.maximum(index - half, 0)
        mean: Floats = _window_sums(values - level, half) / number
        mean += level
        return mean
    total = _window_sums(np.where(known, np.where(known, values, 0.0) - level, 0.0), half)
    number = _window_sums(known.astype(np.float64), half)
    mean = np.divide(total, number, out=np.full_like(total, np.nan), where=number > 0)
    return np.asarray(mean + level, dtype=np.float64)


def row_levels(values: Floats) -> Floats:
    """Return the mean of the samples of each row, shape (...); 0 for a row without samples."""
    with np.errstate(invalid="ignore"):
        mean: Floats = values.mean(axis=-1)
    if not np.isfinite(mean).all():
        known = np.isfinite(values)
        mean = np.where(known, values, 0.0).sum(axis=-1) / np.maximum(known.sum(axis=-1), 1)
    return mean


def _window_sums(values: Floats, half: int) -> Floats:
    """Return the sums over `half` samples on both sides and the one between, shape (..., n)."""
    total = np.cumsum(values, axis=-1)
    inside = values.shape[-1] - half  # windows that end within the samples
    found = np.empty_like(total)
    found[..., :inside] = total[..., half:]
    found[..., inside:] = total[..., -1:]
    found[..., half + 1 :] -= total[..., : inside - 1]
    return found
