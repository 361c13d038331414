"""What a recorder makes of a signal before it is kept: a mean over the time before each sample."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def trailing_mean(time: Floats, values: Floats, average: float) -> Floats:
    r"""Return a signal averaged over the time before each instant.

    .. math:: \bar F(t) = \frac1T \int_{t-T}^{t} F \, dt

    Before its first sample the signal is taken as constant.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Even [s].
    values : ndarray, shape (n,)
        Means over cells about these times.
    average : float
        `T` [s].

    Returns
    -------
    ndarray, shape (n,)

    Examples
    --------
    >>> time = np.arange(6) * 0.01
    >>> trailing_mean(time, 100.0 * time, 0.02).round(2)
    array([0.  , 0.25, 1.  , 2.  , 3.  , 4.  ])
    """
    cell = float(time[1] - time[0]) if time.size > 1 else 0.0
    if average <= 1e-6 or not cell:
        return np.asarray(values, dtype=np.float64)
    integral = np.concatenate(
        ([0.0], np.cumsum(0.5 * cell * (values[1:] + values[:-1]), dtype=np.float64))
    )
    before = np.minimum(time - average - time[0], 0.0) * values[0]
    past = np.interp(time - average, time, integral) + before
    return np.asarray((integral - past) / average)
