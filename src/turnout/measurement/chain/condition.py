"""Condition sampled values: average without a time shift, resample, take off the zero.

NaN is a missing sample: averages are over what there is, so that a hole shorter than the window is
bridged and a longer one stays.
"""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.channels import label
from turnout.core.moving_average import moving_average
from turnout.measurement.recording import RecordedChannel

FILTERED = ("drive_force", "drive_current", "drive_power", "object_force")
# Two times are the same when they differ by less than this part of a step.
SAME_STEP = 1e-3
# A channel map may ask for a higher rate than the recording has, up to so many times.
MOST_GROWTH_OF_RATE = 10

Values = NDArray[np.float64]


def tare(values: Values, *, rate: float, start: float, end: float) -> Values:
    """Return values less their mean in a rest from `start` to `end` [s].

    Raises
    ------
    ValueError
        When there are no samples in the rest.

    Examples
    --------
    >>> tare(np.array([1.0, 1.0, 5.0]), rate=10.0, start=0.0, end=0.1)
    array([0., 0., 4.])
    """
    count = values.shape[-1]
    first, last = max(round(start * rate), 0), min(round(end * rate) + 1, count)
    part = values[..., first:last]
    if first >= last or not np.isfinite(part).any(axis=-1).all():
        covered = f"from 0 to {(count - 1) / rate:g} s"
        message = f"there are no samples from {start:g} to {end:g} s; there are {covered}"
        raise ValueError(message)
    return np.asarray(values - np.nanmean(part, axis=-1, keepdims=True))


def condition(dataset: xr.Dataset, *, window: float = 0.1) -> xr.Dataset:
    """Return a dataset with averaged channels and the unfiltered ones beside them.

    Parameters
    ----------
    dataset : xarray.Dataset
        With forces and currents over an even ``time``.
    window : float
        Of the centred moving average [s].

    Returns
    -------
    xarray.Dataset
        ``drive_force_unfiltered`` and so on hold what was measured; smoothing a second time starts
        from them. ``attrs["filter"]`` says what was done.

    Examples
    --------
    >>> values = xr.DataArray(np.arange(5.0), {"time": np.arange(5) / 10}, "time")
    >>> smoothed = condition(xr.Dataset({"object_force": values}), window=0.2)
    >>> smoothed["object_force"].values, smoothed["object_force_unfiltered"].values[0]
    (array([0.5, 1. , 2. , 3. , 3.5]), np.float64(0.0))
    """
    time = dataset["time"].values
    rate = float((time.size - 1) / (time[-1] - time[0]))
    conditioned = dataset.copy()
    for name in FILTERED:
        if name not in dataset:
            continue
        kept = f"{name}_unfiltered"
        raw = dataset[kept] if kept in dataset else dataset[name]
        axis = raw.get_axis_num("time")
        values = np.moveaxis(raw.values, axis, -1)
        smoothed = np.moveaxis(moving_average(values, rate=rate, window=window), -1, axis)
        conditioned[kept] = raw.copy()
        conditioned[name] = raw.copy(data=smoothed)
    conditioned.attrs["filter"] = f"moving_average (window {window:g})"
    return label(conditioned)


def common_time(channels: list[RecordedChannel], *, rate: float | None = None) -> Values:
    """Return the even times that all channels cover, at the highest rate unless one is given [s].

    Raises
    ------
    ValueError
        When they have no time in common.

    Examples
    --------
    >>> a = RecordedChannel("a", "V", np.zeros(5), rate=10.0)
    >>> b = RecordedChannel("b", "V", np.zeros(2), rate=5.0, start=0.1)
    >>> common_time([a, b])
    array([0.1, 0.2, 0.3])
    """
    rate = rate or max(channel.rate for channel in channels)
    start = max(channel.start for channel in channels)
    end = min(channel.start + (channel.values.size - 1) / channel.rate for channel in channels)
    count = int(np.floor((end - start) * rate + 1e-6)) + 1
    most = MOST_GROWTH_OF_RATE * max(channel.values.size for channel in channels) + 1_000_000
    if count > most:
        message = f"at {rate:g} Hz they would have {count} samples, at most {most}; lower the rate"
        raise ValueError(message)
    if count < 2:
        message = f"the columns have no time in common (from {start:g} to {end:g} s)"
        raise ValueError(message)
    return start + np.arange(count) / rate


def resample(channel: RecordedChannel, values: Values, *, time: Values) -> Values:
    """Return values of a channel at other even times; at its own they are untouched.

    Between samples they are interpolated linearly; where the channel is faster, each is first
    averaged over one of the longer steps.

    Parameters
    ----------
    channel : RecordedChannel
        Whose times the values have.
    values : ndarray, shape (n,)
        Samples of the channel, in any unit; NaN for holes.
    time : ndarray, shape (m,)
        Even times within those of the channel [s].

    Examples
    --------
    >>> slow = RecordedChannel("a", "V", np.array([0.0, 1.0, 4.0]), rate=10.0)
    >>> resample(slow, slow.values, time=np.array([0.0, 0.05, 0.1]))
    array([0. , 0.5, 1. ])
    """
    step = time[1] - time[0]
    first = (time[0] - channel.start) * channel.rate
    same_rate = abs(step * channel.rate - 1.0) * time.size < SAME_STEP
    if same_rate and abs(first - round(first)) < SAME_STEP:
        return values[round(first) : round(first) + time.size]
    if step * channel.rate > 1.5:
        values = moving_average(values, rate=channel.rate, window=step)
    return np.interp(time, channel.time, values)
