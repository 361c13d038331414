r"""Trends over the verdicts of many throws of one switch, and causes that stay.

A weak cause, such as two dry chairs, shows in no single throw. It stays, so its evidence adds up
(Page 1954):

.. math:: S_n = \max(0,\ S_{n-1} + \log\Lambda_n)

:math:`\Lambda_n` is the likelihood ratio of the cause against a sound switch in throw n. Of
independent throws of a sound switch that the model describes exactly, :math:`S` exceeds :math:`h`
no sooner than after :math:`e^h` throws in the mean (Lorden 1971).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

Floats = NDArray[np.float64]

STAYS = float(np.log(1e4))
""":math:`h` from which on a cause is said to stay [-]."""
LEAST_THROWS = 5
"""Throws that a trend needs."""
PER = 100.0
"""Throws that a slope is given for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trend:
    """A straight line through what was found in each throw.

    Attributes
    ----------
    first, last : float
        Its ends, in the unit of the values.
    slope, low, high : float
        Change in 100 throws with its 95 % interval.
    """

    first: float
    last: float
    slope: float
    low: float
    high: float

    @property
    def clear(self) -> bool:
        """True if the interval of the slope leaves out 0."""
        return self.low > 0.0 or self.high < 0.0


def trend_of(values: ArrayLike) -> Trend | None:
    """Return the trend over throws in the order of time; None of fewer than five.

    Parameters
    ----------
    values : array_like, shape (n,)
        NaN where a throw was not judged.

    Examples
    --------
    >>> found = trend_of([0.20, 0.21, 0.22, 0.23, 0.24, 0.25])
    >>> round(found.slope, 9), found.clear
    (1.0, True)
    """
    given = np.asarray(values, dtype=np.float64)
    at = np.flatnonzero(np.isfinite(given))
    if at.size < LEAST_THROWS:
        return None
    x = at - at.mean()
    slope = float(x @ given[at] / (x @ x))
    middle = float(given[at].mean())
    residual = given[at] - middle - slope * x
    error = float(np.sqrt(residual @ residual / (at.size - 2) / (x @ x)))
    reach = float(stdtrit(at.size - 2, 0.975)) * error
    return Trend(
        first=middle + slope * float(x[0]),
        last=middle + slope * float(x[-1]),
        slope=PER * slope,
        low=PER * (slope - reach),
        high=PER * (slope + reach),
    )


def cumulated(log_odds: ArrayLike) -> Floats:
    """Return :math:`S` after each throw, shape (n,) [-].

    Parameters
    ----------
    log_odds : array_like, shape (n,)
        Logarithms of the likelihood ratio of a cause in each throw; NaN counts as 0.

    Examples
    --------
    >>> cumulated([-2.0, 1.0, 1.5, -4.0, 3.0]).tolist()
    [0.0, 1.0, 2.5, 0.0, 3.0]
    """
    found, total = [], 0.0
    for value in np.nan_to_num(np.asarray(log_odds, dtype=np.float64)):
        total = max(0.0, total + float(value))
        found.append(total)
    return np.array(found)


def staying_causes(verdicts: Sequence[Mapping[str, Any]]) -> dict[str, tuple[int, float]]:
    """Return causes other than an object whose evidence adds up, the surest first.

    Parameters
    ----------
    verdicts : sequence of mapping
        Fields of `Verdict`, in the order of time.

    Returns
    -------
    dict
        For each cause the throw from which on it stays, counted from 0, and the last :math:`S`.
    """
    names = dict.fromkeys(name for item in verdicts for name in item["odds"] if name != "object")
    found = {}
    for name in names:
        odds = np.array([item["odds"].get(name, np.nan) for item in verdicts], dtype=np.float64)
        total = cumulated(np.log(np.maximum(odds, LEAST_ODDS)))
        if total.size and total[-1] > STAYS:
            since = np.flatnonzero(total == 0.0)
            found[name] = (int(since[-1]) + 1 if since.size else 0, float(total[-1]))
    return dict(sorted(found.items(), key=lambda item: -item[1][1]))


LEAST_ODDS = 1e-300
