"""A recording: evenly sampled channels, each with its own rate, and an overview of them."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import MeasurementError
from turnout.core.problems import choices, nearest

# A hole in a time column is filled with NaN as long as the channel grows by no more than this.
MOST_GROWTH = 3.0
# Share of times that repeat, as some recorders write a row twice; more tell no rate.
MOST_REPEATED = 0.01
# Fewer steps than these may look like those of rounded times by chance.
_SHORT = 20


@dataclass(frozen=True, slots=True, eq=False)
class RecordedChannel:
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
        Description of the channel in the file.
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
        >>> RecordedChannel("a", "V", np.zeros(3), rate=100.0, start=1.0).time
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
    channels : mapping of str to RecordedChannel
        By name, in the order of the file.
    source : str
        File that it was read from.
    start_time : str or None
        Date and time of the start in ISO 8601, where the file states it.
    problems : tuple of str
        Parts that could not be read or had to be mended, a sentence each.
    labels : mapping of str to str
        Cells that are the same in all rows of a table, by column; `throw` is which of several.
    """

    channels: Mapping[str, RecordedChannel]
    source: str
    start_time: str | None = None
    problems: tuple[str, ...] = ()
    labels: Mapping[str, str] = field(default_factory=dict)

    def channel(self, name: str) -> RecordedChannel:
        """Return a channel by its name.

        Raises
        ------
        MeasurementError
            When there is none; the text names the nearest and those there are.

        Examples
        --------
        >>> strain = RecordedChannel("rod 1", "mV/V", np.zeros(3), rate=1000.0)
        >>> Recording({"rod 1": strain}, "throw.csv").channel("rod 1").unit
        'mV/V'
        """
        if name not in self.channels:
            text = f"no channel '{name}'{nearest(name, self.channels)}; "
            raise MeasurementError(
                [text + f"there are {choices(self.channels)}"], source=self.source
            )
        return self.channels[name]


@dataclass(frozen=True, slots=True, eq=False)
class TimeGrid:
    """Places of the samples of a time column on an even grid.

    Attributes
    ----------
    start, step : float
        First time and distance of two [s].
    index : ndarray of int, shape (n,)
        Place of each sample on the grid; not consecutive where samples are missing.
    remark : str
        Fault that the column hides; empty for none.
    """

    start: float
    step: float
    index: NDArray[np.int64]
    remark: str = ""


def time_grid(time: NDArray[np.float64]) -> TimeGrid:
    """Find the even grid of a time column, which may be rounded by up to half a step.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Time of each sample, rising [s].

    Raises
    ------
    ValueError
        When the times do not rise or are far from even; the text says where.

    Examples
    --------
    >>> time_grid(np.array([0.0, 0.1, 0.2, 0.3, 0.5, 0.6])).index
    array([0, 1, 2, 3, 5, 6])
    """
    _check_rising(time)
    start = float(time[0])
    number = np.arange(time.size, dtype=np.int64)
    steps = np.diff(time)
    step = float((time[-1] - start) / (time.size - 1))
    away = float(np.max(np.abs(time - start - number * step))) / step
    # In all but the shortest channels a missing sample puts some time half a step off.
    counts, remark = _counts(time, steps, near=away <= 0.45)
    if away <= 0.45 and counts is None:
        time, late = _without_jump(time, steps)
        step = float((time[-1] - start) / (time.size - 1))
        return TimeGrid(start, _whole_step(time, step), number, remark or late)
    repeated = int(np.count_nonzero(steps == 0))
    if repeated and away <= 2.0:
        remark = f"{repeated} of its times repeat; whether samples are missing there is not known"
        return TimeGrid(start, step, number, remark)
    if counts is None:
        typical = _typical(steps)
        regular = steps[np.abs(steps - typical) <= 0.5 * typical]
        step = float(np.mean(regular)) if regular.size else 0.0
        few = 2 * int(np.count_nonzero(steps < 1.5 * step)) <= steps.size
        # Rounded step by step, so that a small error of the step does not add up.
        counts = np.zeros(0) if step <= 0 or few else np.rint(steps / step)
        if counts.size and np.all(counts == 1):
            time, remark = _without_jump(time, steps)
    if not counts.size or counts.sum() > MOST_GROWTH * time.size:
        raise _jumps(time, int(np.argmax(steps)))
    if np.any(counts < 1):
        at = int(np.argmin(counts))
        message = f"time is not even: two samples at {time[at]:.6g} s are less than a step apart"
        raise ValueError(message)
    index = np.concatenate((np.zeros(1, np.int64), np.cumsum(counts).astype(np.int64)))
    step = float((time[-1] - start) / index[-1])
    off = np.abs(time - start - index * step)
    if off.max() > step:
        at = int(np.argmax(off))
        first, last = ((time[b] - time[a]) / (b - a) for a, b in ((0, at), (at, time.size - 1)))
        message = (
            f"time is not even: its step is {first:.6g} s up to {time[at]:.6g} s and {last:.6g} s "
            "behind it; save each part in a file of its own"
        )
        raise ValueError(message)
    return TimeGrid(start, step, index, remark)


def _counts(
    time: NDArray[np.float64], steps: NDArray[np.float64], *, near: bool
) -> tuple[NDArray[np.float64] | None, str]:
    """Return the whole numbers of steps between times of which samples are missing, and a remark.

    None if the steps are alike, no multiples of the least, or those of rounded times, which are
    near even ones.

    Raises
    ------
    ValueError
        When a sample may be missing, or the times be rounded.
    """
    least, typical = float(steps.min()), _typical(steps)
    few = least < 0.75 * typical and np.mean(np.abs(steps / typical - 1.0) < 0.1) >= 0.9
    if least <= 0.0 or few:  # of short steps
        return None, ""
    short = steps.size < _SHORT
    for part in (1, 2, 3) if short else (1,):
        ratio = part * steps / float(np.mean(steps[steps < 1.4 * least]))
        counts = np.rint(ratio)
        if np.max(np.abs(ratio - counts)) <= 0.1:
            break
    else:
        return None, ""
    holes = int(np.count_nonzero(counts > part))
    if not holes or counts.sum() > MOST_GROWTH * part * time.size:
        return None, ""
    digit, mean = _last_digit(time), float(np.mean(steps))
    # The first and the last time of a short channel are rounded, too.
    reach = digit / steps.size
    tried = np.linspace(mean - reach, mean + reach, 41) if steps.size < 50 else [mean]
    rounded = near and min(_spread(time, one) for one in tried) <= 1.001 * digit
    if not rounded and part == 1 and 2 * holes < steps.size:
        return counts, ""
    # Rounding repeats its pattern.
    if rounded and (part > 1 or holes > 2):
        unclear = f"check the time: taken as rounded to {digit:g} s; else samples are missing"
        return None, unclear if short else ""
    if not near and np.count_nonzero(np.diff(counts)) == 1:  # another rate from there on
        return None, ""
    at = int(np.argmax(ratio))
    message = (
        f"time is not even: it jumps from {time[at]:.6g} to {time[at + 1]:.6g} s, where samples "
        "may be missing or times are rounded; export times with more digits"
    )
    raise ValueError(message)


def _jumps(time: NDArray[np.float64], at: int) -> ValueError:
    message = (
        f"time is not even: it jumps from {time[at]:.6g} to {time[at + 1]:.6g} s; save each part "
        "in a file of its own, or export it at an even rate"
    )
    return ValueError(message)


def _without_jump(
    time: NDArray[np.float64], steps: NDArray[np.float64]
) -> tuple[NDArray[np.float64], str]:
    """Put a last time that alone is off into step; return the times and a remark.

    Raises
    ------
    ValueError
        When few longer or shorter steps are among equal ones, after which all times are off.
    """
    typical = _typical(steps)
    jumps = np.abs(steps - typical) > 0.2 * typical
    equal = np.mean(np.abs(steps - typical) <= 1e-3 * typical) >= 0.9
    if not equal or abs(float(np.sum(steps[jumps] - typical))) <= 0.2 * typical:
        return time, ""
    at = int(np.argmax(jumps))
    if at < steps.size - 1:
        raise _jumps(time, at)
    even = np.append(time[:-1], time[-2] + typical)
    return even, f"check the time: its last, {time[-1]:.6g} s, is taken as {even[-1]:.6g} s"


def _last_digit(time: NDArray[np.float64]) -> float:
    """Return the unit of the last decimal digit of times [s]; 0 where they are not rounded."""
    digits = (10.0**-place for place in range(10))
    return next((q for q in digits if np.allclose(time / q, np.rint(time / q), 0, 1e-4)), 0.0)


def _spread(time: NDArray[np.float64], step: float) -> float:
    """Return by how much times differ from even ones [s]; at most a digit if they are rounded."""
    return float(np.ptp(time - np.arange(time.size) * step))


def _whole_step(time: NDArray[np.float64], step: float) -> float:
    """Return the step [s] of a whole rate if uneven times may be its, rounded; else the step."""
    whole = 1.0 / max(round(1.0 / step), 1)
    if _spread(time, step) < 1e-6 * step or _spread(time, whole) > 1.001 * _last_digit(time):
        return step
    return whole


def _typical(steps: NDArray[np.float64]) -> float:
    """Return the median; of two in the middle the lower."""
    return float(np.sort(steps)[(steps.size - 1) // 2])


def on_grid(grid: TimeGrid, channel: RecordedChannel) -> tuple[RecordedChannel, str]:
    """Make samples at the times of a column an even channel; those that are missing become NaN.

    Parameters
    ----------
    grid : TimeGrid
        Of the time column.
    channel : RecordedChannel
        As many samples as the time column has; its rate and start are not used.

    Returns
    -------
    channel : RecordedChannel
        Evenly sampled, at `channel.rate` [Hz].
    problem : str
        Repair that was made; empty for none.

    Examples
    --------
    >>> time = np.array([0.0, 0.1, 0.2, 0.3, 0.5, 0.6])
    >>> channel, problem = on_grid(time_grid(time), RecordedChannel("a", "s", time, rate=0.0))
    >>> channel.values, problem
    (array([0. , 0.1, 0.2, 0.3, nan, 0.5, 0.6]), '1 sample is missing at 0.4 s')
    """
    count = int(grid.index[-1]) + 1
    channel = replace(channel, rate=whole_rate(1.0 / grid.step), start=grid.start)
    lost = count - channel.values.size
    if not lost:
        return channel, grid.remark
    filled = np.full(count, np.nan)
    filled[grid.index] = channel.values
    first = int(grid.index[np.argmax(np.diff(grid.index) > 1)]) + 1
    what = "1 sample is missing" if lost == 1 else f"{lost} samples are missing, the first"
    at = grid.start + first * grid.step
    return replace(channel, values=filled), f"{what} at {at:.6g} s"


def whole_rate(rate: float) -> float:
    """Return a rate within rounding of a whole one as that: 1 / 0.001 is not 1000.

    Examples
    --------
    >>> whole_rate(1.0 / 0.001)
    1000.0
    """
    return float(round(rate)) if abs(rate - round(rate)) < 1e-9 * rate else rate


def _check_rising(time: NDArray[np.float64]) -> None:
    if time.size < 2:
        message = f"needs at least 2 samples to know the rate, has {time.size}"
        raise ValueError(message)
    if not (finite := np.isfinite(time)).all():
        message = f"the time of sample {int(np.argmin(finite)) + 1} is no number"
        raise ValueError(message)
    steps = np.diff(time)
    if np.any(steps < 0):
        at = int(np.argmin(steps)) + 1
        message = f"time must rise; it goes from {time[at - 1]:.6g} to {time[at]:.6g} s"
        raise ValueError(message)
    repeated = np.flatnonzero(steps == 0)
    if repeated.size > MOST_REPEATED * time.size:
        coarse = 10 * repeated.size > time.size
        kind = "coarser than the samples, they tell no rate" if coarse else "rows may stand twice"
        message = (
            f"{repeated.size} of its {time.size} times repeat, the first is "
            f"{time[repeated[0]]:.6g} s: {kind}; "
            "state the sample rate, or export times with more digits"
        )
        raise ValueError(message)
    step = (time[-1] - time[0]) / (time.size - 1)
    if not 1e-12 < step < np.inf:
        message = f"its times rise by {step:.3g} s, no sample rate"
        raise ValueError(message)


@dataclass(frozen=True, slots=True, eq=False)
class ChannelOverview:
    """Figures of one channel.

    Attributes
    ----------
    name, unit, description : str
        As in the recording.
    rate, start, duration : float
        Samples a second [1/s], first time and length [s].
    samples, missing : int
        How many, and how many of them are NaN.
    least, mean, largest : float
        Of the values that are there; NaN where there are none.
    course : ndarray, shape (n_steps,)
        Mean over equal parts of the time, as a part of least to largest (0 to 1); NaN where a part
        has no values.
    """

    name: str
    unit: str
    description: str
    rate: float
    start: float
    duration: float
    samples: int
    missing: int
    least: float
    mean: float
    largest: float
    course: NDArray[np.float64]


def overview(channel: RecordedChannel, *, steps: int = 40) -> ChannelOverview:
    """Return the figures of a channel.

    Parameters
    ----------
    channel : RecordedChannel
        Of a recording.
    steps : int
        Parts of its course.

    Examples
    --------
    >>> values = np.array([0.0, 4.0, np.nan, 2.0])
    >>> row = overview(RecordedChannel("a", "V", values, rate=10.0), steps=2)
    >>> row.missing, row.mean, row.course
    (1, 2.0, array([0.5, 0.5]))
    """
    values = channel.values
    there = np.isfinite(values)
    some = bool(there.any())
    least = float(np.min(values, where=there, initial=np.inf)) if some else np.nan
    largest = float(np.max(values, where=there, initial=-np.inf)) if some else np.nan
    edges = np.linspace(0, values.size, min(steps, values.size) + 1).astype(int)
    parts = [values[a:b][there[a:b]] for a, b in zip(edges[:-1], edges[1:], strict=True)]
    with np.errstate(over="ignore"):  # of values near the largest number there is
        course = np.array([part.mean() if part.size else np.nan for part in parts])
        mean = float(np.mean(values, where=there)) if some else np.nan
        span = largest - least
        scaled = (course - least) / span if span > 0 else np.where(np.isnan(course), np.nan, 0.5)
    own = ("name", "unit", "description", "rate", "start", "duration")
    return ChannelOverview(
        **{key: getattr(channel, key) for key in own},
        samples=values.size,
        missing=int(values.size - np.count_nonzero(there)),
        least=least,
        mean=mean,
        largest=largest,
        course=scaled,
    )
