"""Errors of a recorder of forces and currents of a throw: gain, offset, resolution, clock."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from turnout.core.units import FORCE, TIME, Dimension

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RecorderError:
    """One error of a recorder.

    Attributes
    ----------
    kind : Dimension or type
        Of its values; float for plain numbers.
    none : float
        Value without an error.
    least, most : float
        Allowed range [SI].
    usual : str
        Usual range.
    origin : str
        Source of the usual range.
    """

    kind: Dimension | type
    none: float
    least: float
    most: float
    usual: str
    origin: str


ERRORS: Mapping[str, RecorderError] = MappingProxyType(
    {
        "gain": RecorderError(
            float, 1.0, 0.5, 2.0, "± 2 %", "assumption: gauge factor and mounting of gauges"
        ),
        "offset": RecorderError(
            FORCE, 0.0, -5e3, 5e3, "± 50 N", "assumption: zero of a bridge in the weather"
        ),
        "resolution": RecorderError(
            FORCE, 0.0, 0.0, 1e3, "0.4 to 6 N", "computed: 24 kN over 16 and 12 bits"
        ),
        "clock_rate": RecorderError(
            float, 0.0, -0.01, 0.01, "± 1e-4", "assumption: quartz to 100 ppm, untuned"
        ),
        "clock_offset": RecorderError(
            TIME, 0.0, -1.0, 1.0, "± 10 ms", "assumption: clocks set over a network"
        ),
    }
)
"""Errors of a recorder by their name in `Recorder`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Recorder:
    r"""A recorder of drive forces and motor currents, perfect unless said otherwise.

    Attributes
    ----------
    gain : float
        Recorded over true change of a force [-].
    offset : float
        Recorded force without load [N].
    resolution : float
        Step of the converter [N]; 0 for none.
    clock_rate : float
        Share by which the recorder's clock runs fast [-].
    clock_offset : float
        Reading of its clock at time zero [s].

    Notes
    -----
    With the true force :math:`F`, what is recorded at the shown time :math:`s` is

    .. math:: \hat F(s) = g F\left(\frac{s - s_0}{1 + r}\right) + F_0,

    rounded to the resolution. Currents have the clock alone.

    Examples
    --------
    >>> Recorder(clock_rate=1e-4).true_time(np.array([0.0, 10.001]))
    array([ 0., 10.])
    """

    gain: float = 1.0
    offset: float = 0.0
    resolution: float = 0.0
    clock_rate: float = 0.0
    clock_offset: float = 0.0

    def true_time(self, shown: Floats) -> Floats:
        """Return the time [s] at which the clock shows a time [s]."""
        return (shown - self.clock_offset) / (1.0 + self.clock_rate)

    @property
    def has_clock_error(self) -> bool:
        """True if its clock is wrong."""
        return self.clock_rate != 0.0 or self.clock_offset != 0.0


def recorder_faults(name: str, value: float) -> Iterator[str]:
    """Yield the faults in the value of an error of a recorder [SI].

    Examples
    --------
    >>> list(recorder_faults("clock_rate", 0.5))
    ['must be -0.01 to 0.01']
    """
    limits = ERRORS[name]
    if not limits.least <= value <= limits.most:
        unit = limits.kind.unit if isinstance(limits.kind, Dimension) else ""
        yield f"must be {limits.least:g} to {limits.most:g} {unit}".rstrip()


def clocked(values: Floats, time: Floats, recorder: Recorder) -> Floats:
    """Return a signal at the instants at which a recorder's clock shows the times.

    Parameters
    ----------
    values : ndarray, shape (..., n_times)
        True signal.
    time : ndarray, shape (n_times,)
        Its times, and those that the clock shows [s].
    recorder : Recorder
        With the error of its clock.

    Returns
    -------
    ndarray, shape (..., n_times)
        Linear in between; beyond the ends of the signal its first and last value.
    """
    if not recorder.has_clock_error:
        return values
    instants = recorder.true_time(time)
    rows = values.reshape(-1, time.size)
    return np.array([np.interp(instants, time, row) for row in rows]).reshape(values.shape)


def recorded_force(values: Floats, time: Floats, recorder: Recorder) -> Floats:
    """Return forces [N] as a recorder gives them; takes the arguments of `clocked`.

    Examples
    --------
    >>> time = np.array([0.0, 1.0, 2.0])
    >>> late = Recorder(gain=1.02, offset=50.0, resolution=10.0, clock_offset=0.5)
    >>> recorded_force(np.array([0.0, 1000.0, 2000.0]), time, late)
    array([  50.,  560., 1580.])
    """
    seen = clocked(values, time, recorder)
    if (recorder.gain, recorder.offset) != (1.0, 0.0):
        seen = recorder.gain * seen + recorder.offset
    if recorder.resolution > 0.0:
        seen = recorder.resolution * np.round(seen / recorder.resolution)
    return seen
