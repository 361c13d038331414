r"""Wider windows for currents and powers, so that the sound throws determine their covariance.

What is not explained by the force scatters little in a current or power, and the discrepancy that
fills the covariance of forces fills theirs only in part. Thrown as they are, 942 windows of force,
current and power of two drives ask for more sound throws than there are: the test that is best for
one half of 4,000 throws detects less in the other half than forces alone do, while the bound from
all of them claims 2 mm more than is there. Forces keep their windows. The others are averaged over
several of them, which loses little: a current follows the force, but for the inrush.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from turnout.detection.conditions import FORCE
from turnout.detection.signal_discrepancy import Signal

Floats = NDArray[np.float64]

BESIDE_FORCES, ALONE = 8, 2
"""Windows of a current or power that become one: where forces are judged too, and where not."""


def pooled_windows(signals: Sequence[Signal], means: Floats) -> Floats | None:
    """Return the matrix that pools windows of currents and powers, None for forces alone.

    Parameters
    ----------
    signals : sequence of Signal
        Whose windows are features, signal by signal.
    means : ndarray, shape (n_windows, n_times)
        From `window_means`.

    Returns
    -------
    ndarray, shape (n_features, n_signals * n_windows), or None
        Rows sum to 1. Windows of unlike length are not pooled, and what is left over at the end of
        each part is not used.

    Examples
    --------
    >>> signals = [Signal(quantity="force", drive="1"), Signal(quantity="current", drive="1")]
    >>> pooled_windows(signals, np.eye(16)).shape
    (18, 32)
    >>> pooled_windows(signals[:1], np.eye(16)) is None
    True
    """
    if all(item.quantity == FORCE for item in signals):
        return None
    several = any(item.quantity == FORCE for item in signals)
    lengths = np.count_nonzero(means, axis=1)
    ends = [0, *(np.flatnonzero(np.diff(lengths)) + 1), len(means)]
    pooled = _averages(ends, BESIDE_FORCES if several else ALONE)
    single = np.eye(len(means))
    return np.asarray(
        block_diag(*(single if item.quantity == FORCE else pooled for item in signals))
    )


def _averages(ends: Sequence[int], count: int) -> Floats:
    """Return the matrix that averages neighbouring windows between ends, at most `count` each."""
    rows = []
    for first, last in zip(ends, ends[1:], strict=False):
        own = min(count, last - first)
        for start in range(first, last - own + 1, own):
            row = np.zeros(ends[-1])
            row[start : start + own] = 1.0 / own
            rows.append(row)
    return np.array(rows)
