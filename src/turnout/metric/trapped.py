"""Whether an object is still in the switch at the end: one rule for a throw and for thousands."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def is_trapped(contact: ArrayLike, taken: ArrayLike, left: ArrayLike) -> NDArray[np.bool_]:
    """Return which objects were touched and are still there at the end.

    Parameters
    ----------
    contact : array_like
        First contact of each object [s]; NaN for none.
    taken : array_like
        When it was taken out [s]; infinite where it was not by the end.
    left : array_like
        Size that is left of it at the end [m]; NaN where it remembers nothing, so all is left.

    Returns
    -------
    ndarray of bool
        False for what broke and left nothing, was taken out, or was never touched.

    Examples
    --------
    >>> never = float("inf")
    >>> is_trapped([7.1, 7.1, float("nan"), 7.1], [never, never, never, 9.0], [0.01, 0, 0.01, 0.01])
    array([ True, False, False, False])
    """
    first, end, size = (np.asarray(item, dtype=np.float64) for item in (contact, taken, left))
    gone = size <= 0.0  # not where it is NaN
    return np.asarray((first < end) & np.isinf(end) & ~gone)
