r"""Recorder of forces and currents of a throw: clock, low-pass, mean, sampling, gain, offset, step.

Clock, low-pass, mean over the past and sampling are linear and the same at any time. A measurement
is compared with a simulation that went through them too: filtering the measurement backwards
instead would raise its noise.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turnout.core.units import FORCE, TIME, Dimension

Floats = NDArray[np.float64]
BUTTERWORTH, BESSEL, RC = "butterworth", "bessel", "rc"
HIGHEST_ORDER = 8
# Means over less time than this [s], and samples closer than this, change nothing that is compared.
LEAST_AVERAGE, LEAST_INTERVAL = 1e-6, 4e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class LowPass:
    """A causal low-pass.

    Attributes
    ----------
    kind : str
        "butterworth", "bessel" or "rc".
    order : int
        Number of poles, 1 to 8; 1 for "rc".
    corner : float
        Frequency at which the amplitude has fallen by 3 dB [Hz].
    """

    kind: str = BUTTERWORTH
    order: int = 2
    corner: float

    @property
    def text(self) -> str:
        """Return the filter as the channel map states it.

        Examples
        --------
        >>> LowPass(corner=6.0).text
        '{ kind = "butterworth", order = 2, corner = "6 Hz" }'
        >>> LowPass(kind="rc", order=1, corner=6.0).text
        '{ kind = "rc", corner = "6 Hz" }'
        """
        order = "" if self.kind == RC else f"order = {self.order}, "
        return f'{{ kind = "{self.kind}", {order}corner = "{self.corner:.3g} Hz" }}'


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
        "saturation": RecorderError(
            FORCE, 0.0, 0.0, 1e6, "12 kN", "computed: half of 24 kN, the range of a converter"
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
    low_pass : LowPass or None
        Of the amplifier or the recorder.
    average : float
        Time before each sample over which it averages; 0 for none [s].
    rate : float
        Samples a second that it takes, where the file holds more, interpolated; 0 for those of the
        file [1/s].
    gain : float
        Recorded over true change of a force [-].
    offset : float
        Recorded force without load [N].
    resolution : float
        Step of the converter [N], of a current [A]; 0 for none.
    saturation : float
        Largest recorded force of either sign [N]; 0 for none.
    clock_rate : float
        Share by which the recorder's clock runs fast [-].
    clock_offset : float
        Reading of its clock at time zero [s].

    Notes
    -----
    With the true force :math:`F`, low-passed, averaged and sampled, what is recorded at the shown
    time :math:`s` is

    .. math:: \hat F(s) = g F\left(\frac{s - s_0}{1 + r}\right) + F_0,

    clipped at the saturation and rounded to the resolution. Currents have the clock alone.

    Examples
    --------
    >>> Recorder(clock_rate=1e-4).true_time(np.array([0.0, 10.001]))
    array([ 0., 10.])
    """

    low_pass: LowPass | None = None
    average: float = 0.0
    rate: float = 0.0
    gain: float = 1.0
    offset: float = 0.0
    resolution: float = 0.0
    saturation: float = 0.0
    clock_rate: float = 0.0
    clock_offset: float = 0.0

    def true_time(self, shown: Floats) -> Floats:
        """Return the time [s] at which the clock shows a time [s]."""
        return (shown - self.clock_offset) / (1.0 + self.clock_rate)

    @property
    def has_clock_error(self) -> bool:
        """True if its clock is wrong."""
        return self.clock_rate != 0.0 or self.clock_offset != 0.0

    @property
    def text(self) -> str:
        """Return the response in words; empty if there is none.

        Examples
        --------
        >>> Recorder(average=0.1, low_pass=LowPass(kind="bessel", corner=10.0)).text
        'a Bessel low-pass of order 2 at 10 Hz, a mean over the last 0.1 s'
        """
        parts = []
        if self.low_pass is not None:
            item = self.low_pass
            name = "an RC" if item.kind == RC else f"a {item.kind.capitalize()}"
            parts.append(f"{name} low-pass of order {item.order} at {item.corner:.3g} Hz")
        if self.average:
            parts.append(f"a mean over the last {self.average:g} s")
        if self.rate:
            parts.append(f"{self.rate:g} samples a second")
        return ", ".join(parts)

    def __bool__(self) -> bool:
        """Return True if there is any response."""
        return self != PERFECT

    def applied(self, time: Floats, values: Floats) -> Floats:
        """Return a signal behind low-pass, mean and sampling, in the mean over the phase.

        Parameters
        ----------
        time : ndarray, shape (n,)
            Even [s].
        values : ndarray, shape (n,)
            At these times, or means over cells about them, as what is returned then is too; before
            the first the signal is taken as constant.
        """
        if self.low_pass is not None:
            values = low_passed(time, _ends_of_lines(values), self.low_pass)
        if self.average > LEAST_AVERAGE:
            values = trailing_mean(time, values, self.average)
        if self.rate and 1.0 / self.rate > LEAST_INTERVAL:
            values = between_samples(time, values, self.rate)
        return values

    def recorded(self, time: Floats, values: Floats, *, phase: float = 0.0) -> Floats:
        """Return one recording of forces: with all errors, and samples at times of its own.

        Parameters
        ----------
        time : ndarray, shape (n,)
            Even, those that the clock shows [s].
        values : ndarray, shape (..., n)
            At these times; before the first the signal is taken as constant.
        phase : float
            Of an interval between samples, 0 to 1, from the first time to the first sample.

        Examples
        --------
        >>> time = np.arange(5) * 0.5
        >>> Recorder(rate=1.0).recorded(time, time**2, phase=0.0)
        array([0. , 0.5, 1. , 2.5, 4. ])
        >>> late = Recorder(gain=1.02, offset=50.0, resolution=10.0, clock_offset=0.5)
        >>> late.recorded(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1000.0, 2000.0]))
        array([  50.,  560., 1580.])
        """
        seen = clocked(values, time, self)
        if self.low_pass is not None or self.average or self.rate:
            rows = [self._sampled(time, row, phase) for row in seen.reshape(-1, time.size)]
            seen = np.array(rows).reshape(seen.shape)
        if (self.gain, self.offset) != (1.0, 0.0):
            seen = self.gain * seen + self.offset
        if self.saturation > 0.0:
            seen = np.clip(seen, -self.saturation, self.saturation)
        return in_steps(seen, self.resolution)

    def _sampled(self, time: Floats, values: Floats, phase: float) -> Floats:
        """Return straight lines between the samples that it takes of a filtered signal."""
        seen = replace(self, rate=0.0).applied(time, values)
        if not self.rate:
            return seen
        count = int(np.ceil((time[-1] - time[0]) * self.rate)) + 2
        samples = time[0] + (np.arange(count) + phase - 1.0) / self.rate
        return np.asarray(np.interp(time, samples, np.interp(samples, time, seen)))

    def map_lines(self) -> list[str]:
        """Return the lines of a channel map that state it.

        Examples
        --------
        >>> Recorder(average=0.1, rate=20.0).map_lines()
        ['recorded_average = "0.1 s"', 'recorded_rate = "20 Hz"']
        """
        lines = []
        if self.low_pass is not None:
            lines.append(f"recorded_filter = {self.low_pass.text}")
        if self.average:
            lines.append(f'recorded_average = "{self.average:g} s"')
        if self.rate:
            lines.append(f'recorded_rate = "{self.rate:g} Hz"')
        return lines

    def attributes(self) -> dict[str, Any]:
        """Return the attributes of a dataset for the response; none without one."""
        found: dict[str, Any] = {}
        if self.average:
            found["recorded_average"] = self.average
        if self.low_pass is not None:
            item = self.low_pass
            found["recorded_filter"] = json.dumps(
                {"kind": item.kind, "order": item.order, "corner": item.corner}
            )
        if self.rate:
            found["recorded_rate"] = self.rate
        return found


PERFECT = Recorder()


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


def in_steps(values: Floats, step: float) -> Floats:
    """Return values as a converter with a step gives them out; as they are for a step of 0.

    Examples
    --------
    >>> in_steps(np.array([0.4, 1.6]), 1.0)
    array([0., 2.])
    """
    return np.asarray(step * np.round(values / step)) if step > 0.0 else values


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


def stated_recorder(attributes: Mapping[Any, Any]) -> Recorder:
    """Return the response of the recorder that the attributes of a dataset state.

    Examples
    --------
    >>> stated_recorder(Recorder(average=0.1).attributes()).average
    0.1
    """
    stated = attributes.get("recorded_filter")
    return Recorder(
        low_pass=LowPass(**json.loads(str(stated))) if stated else None,
        average=float(attributes.get("recorded_average", 0.0)),
        rate=float(attributes.get("recorded_rate", 0.0)),
    )


def trailing_mean(time: Floats, values: Floats, average: float) -> Floats:
    r"""Return a signal averaged over the time before each instant.

    .. math:: \bar F(t) = \frac{1}{T} \int_{t-T}^{t} F \, dt

    Before its first sample the signal is taken as constant.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Even [s].
    values : ndarray, shape (n,)
        At these times, with Akima's cubics in between; from a NaN on, NaN is returned.
    average : float
        `T` [s].

    Returns
    -------
    ndarray, shape (n,)

    Examples
    --------
    >>> time = np.arange(6) * 0.01
    >>> trailing_mean(time, 100.0 * time, 0.02).round(2)
    array([0.  , 0.25, 1.  , 2.  , 3.  , 4.  ])
    """
    if average <= LEAST_AVERAGE or time.size < 2:
        return np.asarray(values, dtype=np.float64)
    integral, past = _integrals(time, values, 1, [time, time - average])
    return np.asarray(values[0] + (integral - past) / average)


def _integrals(
    time: Floats, values: Floats, order: int, instants: Sequence[Floats]
) -> list[Floats]:
    """Return integrals of the rise of a signal over its first value, at several instants.

    Straight lines instead of a curve would smooth it further, by a variance of `h^2 / 6` for each
    integral over samples `h` apart: of 4 ms, as much as samples taken at 54 Hz in place of 50 do.
    Akima's cubics are exact for parabolas, as a spline is, but do not ring at a step. From the
    last sample before a NaN on, integrals are NaN.
    """
    from scipy.interpolate import Akima1DInterpolator  # loads slowly

    rise = np.asarray(values, dtype=np.float64) - values[0]
    known = int(np.argmin([*np.isfinite(rise), False]))
    if known < 2:
        return [np.full(np.shape(instant), np.nan) for instant in instants]
    # Beyond its last sample it gives NaN.
    integral = Akima1DInterpolator(time[:known], rise[:known]).antiderivative(order)
    return [np.asarray(integral(np.maximum(instant, time[0]))) for instant in instants]


def low_passed(time: Floats, values: Floats, low_pass: LowPass) -> Floats:
    r"""Return a signal behind a causal low-pass, with its lag.

    With the poles `p` of the analogue filter and the residues `r` of its transfer function
    :math:`H(s) = \sum_k r_k / (s - p_k)`, :math:`H(0) = 1`,

    .. math:: y(t) = F_0 + \sum_k r_k \int_0^t e^{p_k (t - t')} (F(t') - F_0) \, dt',

    exact for a signal that runs straight between its samples, whatever their interval.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Even [s].
    values : ndarray, shape (n,)
        At these times; before the first the signal is taken as constant.
    low_pass : LowPass
        Kind, order and corner frequency.

    Returns
    -------
    ndarray, shape (n,)

    Examples
    --------
    >>> time = np.arange(3) * 0.5 / np.pi
    >>> filter = LowPass(kind="rc", order=1, corner=1.0)  # time constant 1 / 2 pi
    >>> ramp = low_passed(time, time, filter)  # lags by that: t - T (1 - exp(-t / T))
    >>> bool(np.allclose(ramp, time - (1.0 - np.exp(-2 * np.pi * time)) / (2 * np.pi)))
    True
    """
    from scipy.signal import lfilter  # loads slowly, and few recorders filter

    values = np.asarray(values, dtype=np.float64)
    if values.size < 2:
        return values
    step = float(time[1] - time[0])
    rise = values - values[0]
    found = np.zeros_like(values) + values[0]
    for pole, residue in zip(*_poles(low_pass), strict=True):
        decay = np.exp(pole * step)
        level = (decay - 1.0) / pole
        slope = (decay - 1.0 - pole * step) / (pole**2 * step)
        part = residue * lfilter([slope, level - slope], [1.0, -decay], rise)
        found = np.asarray(found + part.real, dtype=np.float64)
    return np.asarray(found, dtype=np.float64)


def _ends_of_lines(values: Floats) -> Floats:
    r"""Return the ends of straight lines that have the mean of a smooth signal between its samples.

    Lines between its own values lie :math:`h^2 F'' / 12` beside it in the mean.
    """
    bend = np.diff(values, 2, prepend=values[:1], append=values[-1:])
    return np.asarray(values - bend / 12.0, dtype=np.float64)


@lru_cache(maxsize=64)
def _poles(low_pass: LowPass) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return poles [1/s] and residues [1/s] of a low-pass with a gain of one at rest."""
    from scipy.signal import bessel, butter

    angular = 2.0 * np.pi * low_pass.corner
    order = low_pass.order
    made = (
        bessel(order, angular, analog=True, output="zpk", norm="mag")
        if low_pass.kind == BESSEL
        else butter(order, angular, analog=True, output="zpk")
    )
    poles, gain = np.asarray(made[1], dtype=np.complex128), float(made[2])
    apart = poles[:, np.newaxis] - poles[np.newaxis, :]
    np.fill_diagonal(apart, 1.0)
    return poles, np.asarray(gain / apart.prod(axis=1), dtype=np.complex128)


def between_samples(time: Floats, values: Floats, rate: float) -> Floats:
    r"""Return a signal as straight lines between samples show it, in the mean over their phase.

    When in the interval `T` the samples of a movement fall is not known. In the mean the lines are

    .. math:: \bar F(t) = \int_{-T}^{T} \frac{T - |u|}{T^2} F(t + u) \, du,

    the mean of means over `T`, half of it earlier and half later.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Even [s].
    values : ndarray, shape (n,)
        At these times, with Akima's cubics in between; from a NaN on, NaN is returned.
    rate : float
        `1 / T` [1/s].

    Returns
    -------
    ndarray, shape (n,)
    """
    if time.size < 2:
        return np.asarray(values, dtype=np.float64)
    interval, step = 1.0 / rate, float(time[1] - time[0])
    # After its end the signal is taken as constant too.
    after = np.arange(1, int(np.ceil(interval / step)) + 2)
    longer = np.concatenate((time, time[-1] + step * after))
    held = np.concatenate((values, np.full(after.size, values[-1])))
    before, here, later = _integrals(longer, held, 2, [time - interval, time, time + interval])
    return np.asarray(values[0] + (later - 2.0 * here + before) / interval**2)
