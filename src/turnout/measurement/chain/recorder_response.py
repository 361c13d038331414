r"""Response of a recorder to a force: a low-pass, a mean over the past, sampling.

All three are linear and the same at any time, so that their order does not matter. A measurement is
compared with a simulation that went through them too: filtering the measurement backwards instead
would raise its noise.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
BUTTERWORTH, BESSEL, RC = "butterworth", "bessel", "rc"
KINDS = (BUTTERWORTH, BESSEL, RC)
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


@dataclass(frozen=True, slots=True, kw_only=True)
class RecorderResponse:
    """Response of a recorder in every force channel; none unless said otherwise.

    Attributes
    ----------
    low_pass : LowPass or None
        Of the amplifier or the recorder.
    average : float
        Time before each sample over which it averages; 0 for none [s].
    rate : float
        Samples a second that it takes, where the file holds more, interpolated; 0 for those of the
        file [1/s].
    """

    low_pass: LowPass | None = None
    average: float = 0.0
    rate: float = 0.0

    @property
    def text(self) -> str:
        """Return the response in words; empty if there is none.

        Examples
        --------
        >>> RecorderResponse(average=0.1, low_pass=LowPass(kind="bessel", corner=10.0)).text
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
        return self != NO_RESPONSE

    def applied(self, time: Floats, values: Floats) -> Floats:
        """Return a signal as the recorder keeps it.

        Parameters
        ----------
        time : ndarray, shape (n,)
            Even [s].
        values : ndarray, shape (n,)
            Means over cells about these times; before the first the signal is taken as constant.
        """
        if self.low_pass is not None:
            values = low_passed(time, values, self.low_pass)
        if self.average > LEAST_AVERAGE:
            values = trailing_mean(time, values, self.average)
        if self.rate and 1.0 / self.rate > LEAST_INTERVAL:
            values = between_samples(time, values, self.rate)
        return values

    def recorded(self, time: Floats, values: Floats, *, phase: float) -> Floats:
        """Return one recording of a signal: as `applied`, with samples at times of its own.

        Parameters
        ----------
        time : ndarray, shape (n,)
            Even [s].
        values : ndarray, shape (n,)
            At these times; before the first the signal is taken as constant.
        phase : float
            Of an interval between samples, 0 to 1, from the first time to the first sample.

        Examples
        --------
        >>> time = np.arange(5) * 0.5
        >>> RecorderResponse(rate=1.0).recorded(time, time**2, phase=0.0)
        array([0. , 0.5, 1. , 2.5, 4. ])
        """
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
        >>> RecorderResponse(average=0.1, rate=20.0).map_lines()
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


NO_RESPONSE = RecorderResponse()


def recorder_response_of(attributes: Mapping[Any, Any]) -> RecorderResponse:
    """Return the response of the recorder that the attributes of a dataset state.

    Examples
    --------
    >>> recorder_response_of(RecorderResponse(average=0.1).attributes()).average
    0.1
    """
    stated = attributes.get("recorded_filter")
    return RecorderResponse(
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
        Means over cells about these times.
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
    cell = float(time[1] - time[0]) if time.size > 1 else 0.0
    if average <= LEAST_AVERAGE or not cell:
        return np.asarray(values, dtype=np.float64)
    integral = np.concatenate(
        ([0.0], np.cumsum(0.5 * cell * (values[1:] + values[:-1]), dtype=np.float64))
    )
    before = np.minimum(time - average - time[0], 0.0) * values[0]
    past = np.interp(time - average, time, integral) + before
    return np.asarray((integral - past) / average)


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
        Means over cells about these times.
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
    twice = trailing_mean(longer, trailing_mean(longer, held, interval), interval)
    return np.asarray(np.interp(time + interval, longer, twice))
