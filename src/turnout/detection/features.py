"""Features of a detector: means of the drive forces over short windows, and their errors."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import block_diag

from turnout.detection.conditions import Conditions

Floats = NDArray[np.float64]

OPENING_WINDOW, CLOSING_WINDOW = 0.08, 0.04
"""Over which samples are averaged until the last closing begins, and from then on [s]."""


def window_means(time: ArrayLike, *, closing: float) -> Floats:
    """Return the matrix that averages samples over windows.

    Parameters
    ----------
    time : array_like, shape (n_times,)
        Of evenly spaced samples [s].
    closing : float
        When the last closing begins [s].

    Returns
    -------
    ndarray, shape (n_windows, n_times)
        Rows sum to 1; samples left over at either end of the two parts are not used.

    Examples
    --------
    >>> window_means(np.arange(0.0, 0.16, 0.02), closing=0.08).shape
    (3, 8)
    """
    instants = np.asarray(time, dtype=np.float64)
    step = float(instants[1] - instants[0])
    begin = int(np.searchsorted(instants, closing - 1e-9))
    rows = []
    for first, last, window in ((0, begin, OPENING_WINDOW), (begin, None, CLOSING_WINDOW)):
        samples = max(1, round(window / step))
        end = instants.size if last is None else last
        for start in range(first, end - samples + 1, samples):
            row = np.zeros(instants.size)
            row[start : start + samples] = 1.0 / samples
            rows.append(row)
    return np.array(rows)


def features_of(force: ArrayLike, means: Floats) -> Floats:
    """Return the features of throws.

    Parameters
    ----------
    force : array_like, shape (..., n_drives, n_times)
        [N]
    means : ndarray, shape (n_windows, n_times)
        From `window_means`.

    Returns
    -------
    ndarray, shape (..., n_drives * n_windows)
        Drive by drive [N].
    """
    averaged = np.asarray(force, dtype=np.float64) @ means.T
    return averaged.reshape(*averaged.shape[:-2], -1)


def correlation(lag: ArrayLike, conditions: Conditions) -> Floats:
    """Return the correlation of the discrepancy between instants some time apart [-].

    Examples
    --------
    >>> both = [Conditions(), Conditions(kernel="matern 3/2")]
    >>> [round(float(correlation(0.5, item)), 3) for item in both]
    [0.368, 0.368]
    """
    share = np.abs(np.asarray(lag, dtype=np.float64)) / conditions.correlation_time
    if conditions.kernel == "exponential":
        return np.asarray(np.exp(-share))
    share = MATERN_AT_1_E * share
    return np.asarray((1.0 + share) * np.exp(-share))


MATERN_AT_1_E = 2.1461932206205825
r"""Solution of :math:`(1 + u) e^{-u} = 1/e`: a Matern kernel falls to 1/e at this [-]."""


def discrepancy_covariance(
    time: ArrayLike, means: Floats, *, amplitude: ArrayLike, conditions: Conditions
) -> Floats:
    """Return the covariance of features that the discrepancy causes, of a switch and of a throw.

    The discrepancy is one Gaussian process over the whole record, opening and closing, independent
    between drives.

    Parameters
    ----------
    time : array_like, shape (n_times,)
        [s]
    means : ndarray, shape (n_windows, n_times)
        From `window_means`.
    amplitude : array_like, shape (n_drives,)
        [N]
    conditions : Conditions
        Size, kernel, time.

    Returns
    -------
    ndarray, shape (n_features, n_features)
        [N^2]
    """
    instants = np.asarray(time, dtype=np.float64)
    kernel = means @ correlation(instants[:, np.newaxis] - instants, conditions) @ means.T
    scale = (conditions.discrepancy * np.asarray(amplitude, dtype=np.float64)) ** 2
    return np.asarray(block_diag(*(item * kernel for item in scale)))


def noise_covariance(
    means: Floats, *, noise: ArrayLike, conditions: Conditions, sampled: float
) -> Floats:
    """Return the covariance of features that white noise causes.

    Parameters
    ----------
    means : ndarray, shape (n_windows, n_times)
        From `window_means`.
    noise : array_like, shape (n_signals,)
        Standard deviation of a sample of each signal [N], [A] or [W].
    conditions : Conditions
        Samples a second.
    sampled : float
        Samples a second of `means`; a faster recorder averages more samples in a window [Hz].
    """
    once = means @ means.T * (sampled / conditions.rate)
    return np.asarray(block_diag(*(item**2 * once for item in np.asarray(noise, dtype=float))))
