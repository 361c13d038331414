"""Running time of a motor by its current above standstill, the one definition of a throw time.

Standstill is where the mean over 0.2 s is as near to zero as a clamp's zero ever is. Its median is
the zero, its scatter the noise. A motor runs where its current, counted from that zero in its own
direction, exceeds eight deviations of the noise and half of what it usually takes. Half of the
running current is also where a centred moving average meets the instant of switching.
"""

import numpy as np
from numpy.typing import NDArray

MAD_TO_SIGMA = 1.4826
r""":math:`1 / \Phi^{-1}(3/4)`: half of all normal numbers lie within 0.6745 deviations [-]."""


Floats = NDArray[np.float64]

LARGEST_ZERO = 0.1
"""A clamp's zero is never further off [A]."""
STANDSTILL = 0.2
"""Time over which standstill is recognised by its mean [s]."""
NOISE_REACH = 8.0
"""Standard deviations of the standstill current that are still standstill."""
RUNNING_SHARE, USUAL = 0.5, 0.25
"""A motor runs above this share of that quantile of the currents beyond the noise [-]."""
SHORTEST_PAUSE = 0.5
"""A current that stays below for less than this goes on, as when a load drives it back, unless it
brakes in between [s]."""


def running_level(current: Floats, *, rate: float) -> tuple[float, float, float]:
    """Return the current of standstill, and the level above it of a running motor.

    Parameters
    ----------
    current : ndarray, shape (n,)
        Without gaps [A].
    rate : float
        Samples a second [1/s].

    Returns
    -------
    zero, level, sign : float
        The motor runs where ``sign * (current - zero) > level`` [A]; infinite level where the
        current never leaves standstill. The sign is that of the running motor.

    Examples
    --------
    >>> current = np.repeat([0.01, 1.2, 0.01], [100, 300, 100])
    >>> zero, level, sign = running_level(current, rate=100.0)
    >>> round(zero, 3), round(level, 3), sign
    (0.01, 0.595, 1.0)
    """
    width = max(1, round(STANDSTILL * rate))
    count = current.size // width
    rest = np.empty(0)
    if count:
        windows = current[: count * width].reshape(count, width)
        rest = windows[np.abs(windows.mean(axis=1)) < LARGEST_ZERO].ravel()
    zero = float(np.median(rest)) if rest.size else 0.0
    noise = MAD_TO_SIGMA * float(np.median(np.abs(rest - zero))) if rest.size else 0.0
    least = max(NOISE_REACH * noise, LARGEST_ZERO)
    beyond = current[np.abs(current - zero) > least] - zero
    if not beyond.size:
        return zero, np.inf, 1.0
    usual = float(np.quantile(np.abs(beyond), USUAL))
    level = max(least, RUNNING_SHARE * usual)
    sign = 1.0 if np.median(beyond[np.abs(beyond) > level]) > 0.0 else -1.0
    return zero, level, sign


def running_time(time: Floats, current: Floats) -> tuple[float, float]:
    """Return the instants of switching a motor on and off, NaN if it did not run [s].

    Parameters
    ----------
    time : ndarray, shape (n,)
        Even [s].
    current : ndarray, shape (n,)
        Of one motor; best as recorded, since a moving average spreads the braking current [A].
        Samples that are NaN count as standstill.

    Examples
    --------
    >>> time = np.arange(0.0, 5.0, 0.01)
    >>> on, off = running_time(time, np.where((time > 0.995) & (time < 4.205), -1.2, 0.003))
    >>> round(on, 2), round(off, 2)
    (1.0, 4.2)
    """
    if time.size < 2:
        return np.nan, np.nan
    rate = (time.size - 1) / float(time[-1] - time[0])
    known = np.where(np.isfinite(current), current, 0.0)
    zero, level, sign = running_level(known, rate=rate)
    above = sign * (known - zero)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], above > level, [0]])))
    starts, ends = edges[::2], edges[1::2]
    if not starts.size:
        return np.nan, np.nan
    brakes = np.array([above[a:b].min() < -level for a, b in zip(ends, starts[1:], strict=False)])
    apart = np.flatnonzero((starts[1:] - ends[:-1] >= SHORTEST_PAUSE * rate) | brakes.astype(bool))
    starts = starts[np.concatenate([[0], apart + 1])]
    ends = ends[np.concatenate([apart, [ends.size - 1]])]
    longest = int(np.argmax(ends - starts))
    return float(time[starts[longest]]), float(time[ends[longest] - 1])
