"""What is in a recording at a glance: a row of figures a channel, and its course in a few steps."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.measurement.recording import Channel


@dataclass(frozen=True, slots=True)
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


def overview(channel: Channel, *, steps: int = 40) -> ChannelOverview:
    """Return the figures of a channel.

    Parameters
    ----------
    channel : Channel
        Of a recording.
    steps : int
        Parts of its course.

    Examples
    --------
    >>> row = overview(Channel("a", "V", np.array([0.0, 4.0, np.nan, 2.0]), rate=10.0), steps=2)
    >>> row.missing, row.mean, row.course
    (1, 2.0, array([0.5, 0.5]))
    """
    values = channel.values
    there = np.isfinite(values)
    some = bool(there.any())
    least = float(np.min(values, where=there, initial=np.inf)) if some else np.nan
    largest = float(np.max(values, where=there, initial=-np.inf)) if some else np.nan
    with np.errstate(over="ignore"):
        return _overview(channel, there, least, largest, steps)


def _overview(
    channel: Channel, there: NDArray[np.bool_], least: float, largest: float, steps: int
) -> ChannelOverview:
    """Return the figures; those of values near the largest number there is may be infinite."""
    values, some = channel.values, bool(there.any())
    edges = np.linspace(0, values.size, min(steps, values.size) + 1).astype(int)
    parts = [values[a:b][there[a:b]] for a, b in zip(edges[:-1], edges[1:], strict=True)]
    course = np.array([part.mean() if part.size else np.nan for part in parts])
    span = largest - least
    return ChannelOverview(
        name=channel.name,
        unit=channel.unit,
        description=channel.description,
        rate=channel.rate,
        start=channel.start,
        duration=channel.duration,
        samples=values.size,
        missing=int(values.size - np.count_nonzero(there)),
        least=least,
        mean=float(np.mean(values, where=there)) if some else np.nan,
        largest=largest,
        course=(course - least) / span if span > 0 else np.where(np.isnan(course), np.nan, 0.5),
    )
