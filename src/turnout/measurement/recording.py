"""What a data acquisition system recorded: evenly sampled channels, each with a rate of its own."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.errors import MeasurementError
from turnout.files.problems import choices, nearest

# A hole in a time column is filled with NaN as long as the channel grows by no more than this.
MOST_GROWTH = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Channel:
    """One evenly sampled channel as it was recorded.

    Attributes
    ----------
    name : str
        Name in the file.
    unit : str
        Unit as the file writes it; empty where it says nothing.
    values : ndarray of float64, shape (n,)
        Samples [unit]; NaN where one is missing.
    rate : float
        Samples a second [1/s].
    start : float
        Time of the first sample from the start of the recording [s].
    description : str
        What the file says about the channel.
    """

    name: str
    unit: str
    values: NDArray[np.float64]
    rate: float
    start: float = 0.0
    description: str = ""

    @property
    def time(self) -> NDArray[np.float64]:
        """Time of each sample from the start of the recording, shape (n,) [s].

        Examples
        --------
        >>> Channel("a", "V", np.zeros(3), rate=100.0, start=1.0).time
        array([1.  , 1.01, 1.02])
        """
        return self.start + np.arange(self.values.size) / self.rate

    @property
    def duration(self) -> float:
        """Number of samples over the rate [s]."""
        return self.values.size / self.rate


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """The content of one file of a data acquisition system.

    Attributes
    ----------
    channels : mapping of str to Channel
        By name, in the order of the file.
    source : str
        File that it was read from.
    start_time : str or None
        Date and time of the start in ISO 8601, where the file tells it.
    problems : tuple of str
        What could not be read or had to be mended, a sentence each.
    """

    channels: Mapping[str, Channel]
    source: str
    start_time: str | None = None
    problems: tuple[str, ...] = ()

    def channel(self, name: str) -> Channel:
        """Return a channel by its name.

        Raises
        ------
        MeasurementError
            When there is none; the text names the nearest and those there are.

        Examples
        --------
        >>> strain = Channel("rod 1", "mV/V", np.zeros(3), rate=1000.0)
        >>> Recording({"rod 1": strain}, "throw.csv").channel("rod 1").unit
        'mV/V'
        """
        if name not in self.channels:
            text = f"no channel '{name}'{nearest(name, self.channels)}; "
            raise MeasurementError(
                [text + f"there are {choices(self.channels)}"], source=self.source
            )
        return self.channels[name]


def even_channel(
    name: str,
    time: NDArray[np.float64],
    values: NDArray[np.float64],
    *,
    unit: str = "",
    description: str = "",
) -> tuple[Channel, str]:
    """Make a channel of samples with a time each.

    A time column may be rounded, up to half a step. Samples that are missing become NaN.

    Parameters
    ----------
    name : str
        Name of the channel.
    time : ndarray, shape (n,)
        Time of each sample, rising [s].
    values : ndarray, shape (n,)
        Samples.
    unit, description : str
        As in `Channel`.

    Returns
    -------
    channel : Channel
        Evenly sampled.
    problem : str
        What was mended; empty where nothing was.

    Raises
    ------
    ValueError
        When the times do not rise or are far from even; the text says where.

    Examples
    --------
    >>> time = np.array([0.0, 0.1, 0.2, 0.3, 0.5, 0.6])
    >>> channel, problem = even_channel("a", time, time)
    >>> channel.values, problem
    (array([0. , 0.1, 0.2, 0.3, nan, 0.5, 0.6]), '1 sample is missing at 0.4 s')
    """
    step, index, remark = _grid(time)
    start, count = float(time[0]), int(index[-1]) + 1
    if count == time.size:
        return Channel(name, unit, values, 1.0 / step, start, description), remark
    filled = np.full(count, np.nan)
    filled[index] = values
    lost = count - time.size
    first = start + step * (int(index[np.argmax(np.diff(index) > 1)]) + 1)
    what = "1 sample is missing" if lost == 1 else f"{lost} samples are missing, the first"
    channel = Channel(name, unit, filled, 1.0 / step, start, description)
    return channel, f"{what} at {first:.6g} s"


def _grid(time: NDArray[np.float64]) -> tuple[float, NDArray[np.int64], str]:
    """Return the step of a time column, the number of each sample on its grid, and a remark."""
    _check_rising(time)
    number = np.arange(time.size, dtype=np.int64)
    steps = np.diff(time)
    step = float((time[-1] - time[0]) / (time.size - 1))
    away = float(np.max(np.abs(time - time[0] - number * step))) / step
    # In all but the shortest channels a missing sample puts some time half a step off.
    if away <= 0.45:
        return step, number, ""
    if np.any(steps == 0) and away <= 2.0 * float(np.max(steps)) / step:
        return step, number, "time is rounded too coarsely to see whether samples are missing"
    typical = float(np.median(steps))
    regular = steps[np.abs(steps - typical) <= 0.5 * typical]
    step = float(np.mean(regular))
    if (time[-1] - time[0]) / step > MOST_GROWTH * time.size:
        at = int(np.argmax(steps))
        message = f"time is not even: it jumps from {time[at]:.6g} to {time[at + 1]:.6g} s"
        raise ValueError(message)
    # Rounded step by step, so that a small error of the step does not add up.
    counts = np.rint(steps / step).astype(np.int64)
    if np.any(counts < 1):
        at = int(np.argmin(counts))
        message = f"time is not even: {time[at]:.6g} and {time[at + 1]:.6g} s are less than a step"
        raise ValueError(message)
    index = np.concatenate((np.zeros(1, np.int64), np.cumsum(counts)))
    return float((time[-1] - time[0]) / index[-1]), index, ""


def _check_rising(time: NDArray[np.float64]) -> None:
    if time.size < 2:
        message = f"needs at least 2 samples to know the rate, has {time.size}"
        raise ValueError(message)
    finite = np.isfinite(time)
    if not finite.all():
        message = f"the time of sample {int(np.argmin(finite)) + 1} is no number"
        raise ValueError(message)
    steps = np.diff(time)
    if time[-1] <= time[0] or np.any(steps < 0):
        at = int(np.argmin(steps)) + 1
        message = f"time must rise; it goes from {time[at - 1]:.6g} to {time[at]:.6g} s"
        raise ValueError(message)
