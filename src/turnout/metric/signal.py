"""Features of single channels."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import xarray as xr

Floats = NDArray[np.float64]

FILTER_WINDOW = 0.1


def filtered(channel: "xr.DataArray", *, window: float = FILTER_WINDOW) -> "xr.DataArray":
    """Return the centred moving average of a channel over time.

    Near the ends the average is over what there is. A window of 0.1 s is what the published
    measurements were filtered with.

    Parameters
    ----------
    channel : xarray.DataArray
        With the dimension "time", evenly sampled.
    window : float
        Width [s].

    Returns
    -------
    xarray.DataArray
        Of the same shape.

    Examples
    --------
    >>> import xarray as xr
    >>> ramp = xr.DataArray(np.arange(5.0), {"time": np.arange(5) * 0.05}, "time")
    >>> filtered(ramp).values
    array([0.5, 1. , 2. , 3. , 3.5])
    """
    axis = channel.get_axis_num("time")
    values = np.moveaxis(channel.values, axis, -1).astype(float)
    mean = filtered_values(values, time=channel["time"].values, window=window)
    return channel.copy(data=np.moveaxis(mean, -1, axis))


def filtered_values(values: Floats, *, time: Floats, window: float = FILTER_WINDOW) -> Floats:
    """Return what `filtered` does, for arrays.

    Parameters
    ----------
    values : ndarray, shape (..., n_times)
        Any channels.
    time : ndarray, shape (n_times,)
        Evenly spaced [s].
    window : float
        Width [s].

    Returns
    -------
    ndarray, shape (..., n_times)
    """
    if time.size < 2:
        return values.copy()
    step = (time[-1] - time[0]) / (time.size - 1)
    half = min(round(0.5 * window / step), time.size - 1)
    index = np.arange(time.size)
    total = np.cumsum(values, axis=-1)
    inside = time.size - half  # so many windows end before the channel does
    mean: Floats = np.repeat(total[..., -1:], time.size, axis=-1)
    mean[..., :inside] = total[..., half:]
    mean[..., half + 1 :] -= total[..., : inside - 1]
    mean /= np.minimum(index + half + 1, time.size) - np.maximum(index - half, 0)
    return mean


def first_time(flag: "xr.DataArray", *, after: float = -np.inf) -> "xr.DataArray":
    """Return when a logical channel is first true.

    Parameters
    ----------
    flag : xarray.DataArray of bool
        With the dimension "time".
    after : float
        Earlier instants do not count [s].

    Returns
    -------
    xarray.DataArray
        Without "time" [s]; NaN where the channel is never true.

    Examples
    --------
    >>> import xarray as xr
    >>> flag = xr.DataArray([False, True, True], {"time": [0.0, 0.5, 1.0]}, "time")
    >>> float(first_time(flag)), float(first_time(flag, after=0.7))
    (0.5, 1.0)
    """
    when = flag["time"].where(flag & (flag["time"] >= after))
    return when.min("time", skipna=True) if when.sizes["time"] else when.sum("time") * np.nan


def at_end(channel: "xr.DataArray") -> "xr.DataArray":
    """Return the last value of a channel."""
    return channel.isel(time=-1)
