"""Calibration by known loads: a straight line with its uncertainty, and how straight it is."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class LoadCalibration:
    """A straight line through known loads: load = scale (raw - offset).

    Attributes
    ----------
    scale : float
        Load for each unit of raw.
    offset : float
        Raw at no load.
    scale_error, offset_error : float
        Standard errors; NaN with two points, which leave nothing over to judge by.
    nonlinearity : float
        Largest distance of a point from the line, over the range of the loads.
    count : int
        Number of points.
    """

    scale: float
    offset: float
    scale_error: float
    offset_error: float
    nonlinearity: float
    count: int


def fit_load_calibration(raw: Sequence[float], load: Sequence[float]) -> LoadCalibration:
    r"""Fit a straight line to known loads by least squares.

    .. math:: F = a + s\,r, \quad u(s)^2 = \frac{\sum e_i^2}{(n - 2) \sum (r_i - \bar r)^2}

    The error of the offset :math:`-a / s` follows from both by first-order propagation, centred
    where the two are not correlated.

    Parameters
    ----------
    raw : sequence of float, length n
        Readings of the sensor, n >= 2.
    load : sequence of float, length n
        Loads at these readings.

    Returns
    -------
    LoadCalibration
        In the units of the two.

    Raises
    ------
    ValueError
        When the points do not determine a line.

    Examples
    --------
    >>> line = fit_load_calibration([1.0, 3.0, 5.0], [0.0, 10.0, 20.0])
    >>> line.scale, line.offset, round(line.nonlinearity, 12)
    (5.0, 1.0, 0.0)
    """
    if len(raw) != len(load):
        message = f"{len(raw)} readings and {len(load)} loads; there must be as many"
        raise ValueError(message)
    if len(raw) < 2:
        message = "needs at least 2 points"
        raise ValueError(message)
    r, f = np.asarray(raw, dtype=float), np.asarray(load, dtype=float)
    spread = float(np.sum((r - r.mean()) ** 2))
    if np.ptp(r) == 0 or np.ptp(f) == 0:
        message = "all readings are the same" if np.ptp(r) == 0 else "all loads are the same"
        raise ValueError(message)
    scale = float(np.sum((r - r.mean()) * (f - f.mean()))) / spread
    if scale == 0:
        message = "the readings do not depend on the load"
        raise ValueError(message)
    offset = float(r.mean() - f.mean() / scale)
    residual = f - scale * (r - offset)
    free = len(r) - 2
    variance = float(np.sum(residual**2)) / free if free else np.nan
    scale_error = float(np.sqrt(variance / spread))
    # The mean load and the slope are not correlated; the offset is r_mean - f_mean / scale.
    lever = float(f.mean()) / scale
    offset_error = float(np.sqrt(variance / len(r) + (lever * scale_error) ** 2)) / abs(scale)
    return LoadCalibration(
        scale=scale,
        offset=offset,
        scale_error=scale_error,
        offset_error=offset_error,
        nonlinearity=float(np.max(np.abs(residual)) / np.ptp(f)),
        count=len(r),
    )
