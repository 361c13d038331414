"""Features of single channels, and of the movements in them.

Filtered value, first and last times, value at the end; contact, build-up slope, peak and plateau of
the force of each channel in a movement.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from turnout.core.moving_average import WINDOW, moving_average

if TYPE_CHECKING:
    import xarray as xr


Floats = NDArray[np.float64]


def filtered(channel: "xr.DataArray", *, window: float = WINDOW) -> "xr.DataArray":
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
    time = channel["time"].values
    if time.size < 2:
        return channel.copy(data=channel.values.astype(float))
    rate = (time.size - 1) / (time[-1] - time[0])
    mean = moving_average(values, rate=rate, window=window)
    return channel.copy(data=np.moveaxis(mean, -1, axis))


def first_time(flag: "xr.DataArray", *, after: float = -np.inf) -> "xr.DataArray":
    """Return the time at which a logical channel is first true.

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


def final_value(channel: "xr.DataArray") -> "xr.DataArray":
    """Return the last value of a channel."""
    return channel.isel(time=-1)


# A force is taken to begin where it leaves this behind: above noise, below what matters [N].
CONTACT_FORCE = 100.0
# Part of the rise over which the slope is taken; the ends are rounded by filters and knees.
RISE = (0.2, 0.8)
PLATEAU = 0.3


def contact_time(
    object_force: "xr.DataArray", *, threshold: float = CONTACT_FORCE
) -> "xr.DataArray":
    """Return the time from which the force on the object exceeds a threshold for good.

    Parameters
    ----------
    object_force : xarray.DataArray, dims (..., time)
        Force on the object [N].
    threshold : float
        [N]

    Returns
    -------
    xarray.DataArray, dims (...)
        Where a straight line between samples crosses the threshold for the last time [s]; NaN
        where the force does not end above it, or begins there.

    Examples
    --------
    >>> import xarray as xr
    >>> force = xr.DataArray([0.0, 150.0, 50.0, 250.0, 900.0], {"time": np.arange(5.0)}, ("time",))
    >>> float(contact_time(force))
    2.25
    """
    ordered = object_force.transpose(..., "time")
    time = ordered["time"].values
    rows = ordered.values.reshape(-1, time.size)
    found = np.array([_last_crossing(row, time, threshold) for row in rows])
    return ordered.isel(time=0, drop=True).copy(data=found.reshape(ordered.shape[:-1]))


def _last_crossing(force: Floats, time: Floats, threshold: float) -> float:
    known = np.flatnonzero(np.isfinite(force))
    force, time = force[known], time[known]
    below = np.flatnonzero(force <= threshold)
    if not below.size or below[-1] + 1 >= force.size:
        return float("nan")
    pair = slice(below[-1], below[-1] + 2)
    return float(np.interp(threshold, force[pair], time[pair]))


def build_up_slope(force: "xr.DataArray", *, contact: float, end: float) -> float:
    """Return the slope with which a force builds up after contact.

    The straight line through the samples between 20 and 80 % of the rise from the contact to the
    first instant at the largest force (within 2 %).

    Parameters
    ----------
    force : xarray.DataArray, dims (time)
        [N]
    contact, end : float
        From when to when [s].

    Returns
    -------
    float
        [N/s]; NaN without a contact or with a rise below 100 N.

    Examples
    --------
    >>> import xarray as xr
    >>> time = np.linspace(0.0, 2.0, 201)
    >>> force = xr.DataArray(np.clip(1e3 * time, 0, 1e3), {"time": time}, ("time",))
    >>> round(build_up_slope(force, contact=0.0, end=2.0))
    1000
    """
    if not np.isfinite(contact):
        return float("nan")
    part = force.sel(time=slice(contact, end)).dropna("time")
    values, time = part.values, part["time"].values
    if values.size < 3:
        return float("nan")
    rise = values.max() - values[0]
    if rise < CONTACT_FORCE:
        return float("nan")
    share = (values - values[0]) / rise
    first_top = int(np.argmax(share >= 0.98))
    rising = share[: first_top + 1]
    inside = np.flatnonzero((rising >= RISE[0]) & (rising <= RISE[1]))
    if inside.size < 2:
        return float("nan")
    line = np.polyfit(time[inside] - time[inside[0]], values[inside], 1)
    return float(line[0])


def channel_features(
    channels: "xr.DataArray", *, contact: "xr.DataArray", end: float
) -> "xr.Dataset":
    """Return slope of the build-up, peak and plateau of each channel and movement.

    Parameters
    ----------
    channels : xarray.DataArray, dims (channel, movement, time)
        [N]
    contact : xarray.DataArray, dims (movement)
        When the object is first touched [s].
    end : float
        Of the movement; the plateau is the mean over the 0.3 s before, or before the last known
        sample of a movement that ends earlier [s].

    Returns
    -------
    xarray.Dataset, dims (channel, movement)
        `slope` [N/s], `peak` [N], `plateau` [N], and `contact` [s] (movement).

    Examples
    --------
    >>> import xarray as xr
    >>> time = np.linspace(0.0, 2.0, 201)
    >>> one = xr.DataArray(np.clip(1e3 * time, 0, 1e3)[None, None], {"time": time},
    ...                    ("channel", "movement", "time"))
    >>> found = channel_features(one, contact=xr.DataArray([0.0], dims="movement"), end=2.0)
    >>> round(float(found["peak"][0, 0])), round(float(found["plateau"][0, 0]))
    (1000, 1000)
    """
    import xarray as xr

    ordered = channels.transpose("channel", "movement", "time").sel(time=slice(None, end))
    slope = np.full(ordered.shape[:2], np.nan)
    for row, number in np.ndindex(*slope.shape):
        force = ordered.isel(channel=row, movement=number)
        slope[row, number] = build_up_slope(force, contact=float(contact[number]), end=end)
    dims = ("channel", "movement")
    last = ordered["time"].where(ordered.notnull().any("channel")).max("time")
    held = ordered.where(ordered["time"] >= last - PLATEAU)
    found = {
        "slope": (dims, slope, {"units": "N/s", "long_name": "slope of the build-up"}),
        "peak": ordered.max("time").assign_attrs(units="N", long_name="largest force"),
        "plateau": held.mean("time").assign_attrs(units="N", long_name="force at the end"),
        "contact": contact.assign_attrs(units="s", long_name="contact with the object"),
    }
    return xr.Dataset(found)
