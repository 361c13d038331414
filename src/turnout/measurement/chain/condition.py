"""Condition sampled values: smooth without a time shift, resample, take off zero and drift.

Functions of values work along the last axis. NaN is a missing sample: averages and medians are
over what there is, so that a hole shorter than the window is bridged and a longer one stays.
"""

from collections.abc import Callable

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from turnout.core.channels import label
from turnout.core.moving_average import moving_average, window_samples
from turnout.measurement.campaign.motion_signals import bridge_gaps
from turnout.measurement.recording import RecordedChannel

ORDER = 4
FILTERED = ("drive_force", "drive_current", "drive_power", "object_force")
# Two times are the same when they differ by less than this part of a step.
SAME_STEP = 1e-3
# A channel map may ask for a higher rate than the recording has, up to so many times.
MOST_GROWTH_OF_RATE = 10

Values = NDArray[np.float64]


def median(values: Values, *, rate: float, window: float) -> Values:
    """Return the centred running median, which takes out single spikes; edges as the average's.

    Examples
    --------
    >>> median(np.array([1.0, 9.0, 1.0, 2.0]), rate=10.0, window=0.2)
    array([5. , 1. , 2. , 1.5])
    """
    width = window_samples(window, rate=rate)
    rows = values.reshape(-1, values.shape[-1])
    done = [
        pd.Series(row).rolling(width, center=True, min_periods=1).median().to_numpy()
        for row in rows
    ]
    return np.asarray(done, dtype=np.float64).reshape(values.shape)


def lowpass(values: Values, *, rate: float, cutoff: float, order: int = ORDER) -> Values:
    """Return values without frequencies above a cut-off: Butterworth, forwards and backwards.

    Twice through the filter, there is no time shift, and at the cut-off half the amplitude is left.
    At the ends the values are continued by their point reflection.

    Parameters
    ----------
    values : ndarray, shape (..., n)
        Samples; the filter runs over a straight line where one is missing, and leaves it missing.
    rate : float
        Samples a second [1/s].
    cutoff : float
        Frequency [Hz], below half the rate.
    order : int
        Of one pass.

    Raises
    ------
    ValueError
        When the cut-off is not between 0 and half the rate, or there are too few samples.

    Examples
    --------
    >>> time = np.arange(1000) / 1000
    >>> slow = np.sin(2 * np.pi * 2 * time)
    >>> hum = lowpass(slow + np.sin(2 * np.pi * 50 * time), rate=1000.0, cutoff=10.0) - slow
    >>> bool(np.abs(hum[100:-100]).max() < 0.02)
    True
    """
    if not 0 < cutoff < 0.5 * rate:
        message = f"a cut-off of {cutoff:g} Hz must be between 0 and half the rate of {rate:g} Hz"
        raise ValueError(message)
    sections = butter(order, cutoff, fs=rate, output="sos")
    least = 3 * (2 * len(sections) + 1) + 1
    if values.shape[-1] < least:
        message = f"{values.shape[-1]} samples are too few for this filter; it needs {least}"
        raise ValueError(message)
    bridged = bridge_gaps(values)
    smooth = np.asarray(sosfiltfilt(sections, bridged, axis=-1), dtype=np.float64)
    smooth[~np.isfinite(values)] = np.nan
    return smooth


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
    mean, _ = _rest(values, rate, start, end)
    return values - mean[..., None]


def remove_drift(
    values: Values, *, rate: float, before: tuple[float, float], after: tuple[float, float]
) -> Values:
    """Return values less the straight line through their means in two rests.

    Parameters
    ----------
    values : ndarray, shape (..., n)
        Samples along the last axis, in any unit.
    rate : float
        Samples a second [1/s].
    before, after : tuple of float
        Start and end of a rest before and one after [s]; the same load acts in both.

    Raises
    ------
    ValueError
        When there are no samples in a rest, or the two are the same.

    Examples
    --------
    >>> drifting = np.array([1.0, 2.0, 3.0, 9.0, 5.0, 6.0])
    >>> remove_drift(drifting, rate=10.0, before=(0.0, 0.1), after=(0.4, 0.5))
    array([0., 0., 0., 5., 0., 0.])
    """
    first, first_time = _rest(values, rate, *before)
    last, last_time = _rest(values, rate, *after)
    if last_time <= first_time:
        message = "the rest after must be later than the rest before"
        raise ValueError(message)
    time = np.arange(values.shape[-1]) / rate
    slope = (last - first) / (last_time - first_time)
    return values - (first[..., None] + slope[..., None] * (time - first_time))


def condition(
    dataset: xr.Dataset, *, smooth: Callable[..., Values] = moving_average, **options: float
) -> xr.Dataset:
    """Return a dataset with smoothed channels and the unfiltered ones beside them.

    Parameters
    ----------
    dataset : xarray.Dataset
        With forces and currents over an even ``time``.
    smooth : callable
        `moving_average`, `median` or `lowpass`.
    **options : float
        What it takes besides the rate: ``window`` [s] or ``cutoff`` [Hz].

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
        smoothed = np.moveaxis(smooth(values, rate=rate, **options), -1, axis)
        conditioned[kept] = raw.copy()
        conditioned[name] = raw.copy(data=smoothed)
    given = ", ".join(f"{name} {value:g}" for name, value in options.items())
    conditioned.attrs["filter"] = f"{smooth.__name__}{f' ({given})' if given else ''}"
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


def _rest(values: Values, rate: float, start: float, end: float) -> tuple[Values, float]:
    """Return the mean in a rest and the time of its middle."""
    count = values.shape[-1]
    first, last = max(round(start * rate), 0), min(round(end * rate) + 1, count)
    part = values[..., first:last]
    if first >= last or not np.isfinite(part).any(axis=-1).all():
        covered = f"from 0 to {(count - 1) / rate:g} s"
        message = f"there are no samples from {start:g} to {end:g} s; there are {covered}"
        raise ValueError(message)
    return np.asarray(np.nanmean(part, axis=-1)), 0.5 * (first + last - 1) / rate
