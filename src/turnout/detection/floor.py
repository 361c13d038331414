"""The touch floor: the size below which an object is not touched, so that nothing can see it."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

TOUCHING_SHARE = 0.9
"""Share of the states in which an object of the touch floor's size is touched [-]."""
TOUCH_FORCE = 5.0
"""Force on an object above which it counts as touched [N]."""


def touch_floor(gap: ArrayLike, *, share: float = TOUCHING_SHARE) -> Floats:
    """Return the size that touches in a share of the states at each place.

    An object touches where it is larger than the gap that a sound closing leaves.

    Parameters
    ----------
    gap : array_like, shape (n_states, n_places)
        After a sound closing [m]; NaN where a throw did not end.
    share : float
        Of the states [-].

    Returns
    -------
    ndarray, shape (n_places,)
        [m]; 0 where the closed rail leaves no gap.

    Examples
    --------
    >>> gaps = np.linspace(0.0, 0.010, 101)[:, np.newaxis]
    >>> touch_floor(gaps).round(6).tolist()
    [0.009]
    """
    return np.maximum(np.nanquantile(np.asarray(gap, dtype=np.float64), share, axis=0), 0.0)


def touched(force_peak: ArrayLike, *, least: float = TOUCH_FORCE) -> NDArray[np.bool_]:
    """Return which objects were touched at any time, by the largest force on them [N].

    Examples
    --------
    >>> touched([0.0, 4.9, 5.1, float("nan")]).tolist()
    [False, False, True, False]
    """
    return np.asarray(np.asarray(force_peak, dtype=np.float64) > least)
