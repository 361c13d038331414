r"""What a recorder makes of simulated throws: discrepancy, gain, zero, onset, noise, sampling.

The stored throws are exact simulations. What is recorded follows from them and from the number of
the switch alone, so that all methods see the same numbers:

.. math:: r = (1 + g)\,[y(t - \tau) + A\,(d_s + d_t)] + z + e

with the gain error :math:`g` and discrepancy :math:`d_s` fixed for a switch, and the onset error
:math:`\tau` of each movement, the discrepancy :math:`d_t`, the zero :math:`z` and the noise
:math:`e` drawn for each throw. :math:`d_s + d_t` has the standard deviation and the kernel
:math:`e^{-|t|/T}` of the reference case, half of its variance each.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.detection.detector.allowances import Allowances
from turnout.open_benchmark.definition import SEED

Floats = NDArray[np.float64]

INRUSH = 0.5
"""After the onset of a movement, left out of the amplitude [s]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recorder:
    """How one switch is recorded.

    Attributes
    ----------
    signals : tuple of str
        Such as "force 1".
    time : ndarray, shape (n_samples,)
        On the nominal throw [s].
    part : ndarray of int, shape (n_samples,)
        Movement of each sample.
    amplitude : ndarray, shape (n_signals,)
        That the discrepancy is a share of.
    rate : float
        Samples a second [Hz].
    """

    signals: tuple[str, ...]
    time: Floats
    part: NDArray[np.intp]
    amplitude: Floats
    rate: float


def recorded(clean: Floats, recorder: Recorder, *, switch: int, errors: Allowances) -> Floats:
    """Return what is recorded of the throws of one switch.

    Parameters
    ----------
    clean : ndarray, shape (n_throws, n_signals, n_samples)
        Simulated, in the order of the file.
    recorder : Recorder
        Of the switch.
    switch : int
        Its number, which all chance follows from.
    errors : Allowances
        Sizes of all errors.
    """
    rng = np.random.default_rng([SEED, 8, switch])
    count, signals, samples = clean.shape
    force = np.array([name.startswith("force") for name in recorder.signals])
    scale = recorder.amplitude[:, np.newaxis] * errors.discrepancy
    share = errors.fixed_share
    fixed = correlated(rng.standard_normal((1, signals, samples)), recorder.time, errors)
    gain = 1.0 + errors.gain * rng.standard_normal((1, signals, 1))
    shift = errors.timing * rng.standard_normal((count, 1, 2))[..., recorder.part]
    drawn = correlated(rng.standard_normal((count, signals, samples)), recorder.time, errors)
    zero = errors.zero * rng.standard_normal((count, signals, 1)) * force[:, np.newaxis]
    noise = rng.standard_normal((count, signals, samples))
    step = float(recorder.time[1] - recorder.time[0])
    each = np.array([errors.noise_of(name.split()[0]) for name in recorder.signals])
    each = each / np.sqrt(max(1.0, step * recorder.rate))
    moved = clean - shift * slopes(clean, recorder.part, step)
    whole = moved + scale * (np.sqrt(share) * fixed + np.sqrt(1.0 - share) * drawn)
    found = gain * whole + zero + each[:, np.newaxis] * noise
    return sampled(found, recorder.part, every=max(1, round(1.0 / (step * recorder.rate))))


def correlated(white: Floats, time: Floats, errors: Allowances) -> Floats:
    """Return a process of variance 1 with an exponential kernel, from white noise.

    Parameters
    ----------
    white : ndarray, shape (..., n_samples)
        Standard normal.
    time : ndarray, shape (n_samples,)
        [s]
    errors : Allowances
        With the correlation time.
    """
    keep = np.exp(-np.diff(time) / errors.correlation_time)
    found = np.empty_like(white)
    found[..., 0] = white[..., 0]
    for at, rho in enumerate(keep, 1):
        found[..., at] = rho * found[..., at - 1] + np.sqrt(1.0 - rho**2) * white[..., at]
    return found


def slopes(values: Floats, part: NDArray[np.intp], step: float) -> Floats:
    """Return the change of samples with time, movement by movement."""
    found = np.empty_like(values)
    for number in np.unique(part):
        own = part == number
        found[..., own] = np.gradient(values[..., own], step, axis=-1)
    return found


def sampled(values: Floats, part: NDArray[np.intp], *, every: int) -> Floats:
    """Return samples of which only every n-th was recorded, joined by straight lines.

    Examples
    --------
    >>> sampled(np.array([[0.0, 9.0, 2.0, 9.0, 4.0]]), np.zeros(5, int), every=2).tolist()
    [[0.0, 1.0, 2.0, 3.0, 4.0]]
    """
    if every == 1:
        return values
    found = values.copy()
    for number in np.unique(part):
        own = np.flatnonzero(part == number)
        kept = own[::every]
        for at in own:
            after = int(np.searchsorted(kept, at))
            if after == len(kept):
                found[..., at] = values[..., kept[-1]]
            elif kept[after] != at:
                left, right = kept[after - 1], kept[after]
                weight = (at - left) / (right - left)
                found[..., at] = (1 - weight) * values[..., left] + weight * values[..., right]
    return found


def amplitudes(clean: Floats, time: Floats, onsets: Floats) -> Floats:
    """Return the peak of each signal in the mean sound throw, the inrush of motors left out.

    Parameters
    ----------
    clean : ndarray, shape (n_throws, n_signals, n_samples)
        Sound throws.
    time : ndarray, shape (n_samples,)
        [s]
    onsets : ndarray, shape (n_movements,)
        [s]
    """
    since = time[:, np.newaxis] - onsets
    inrush = np.any((since > -0.1) & (since < INRUSH), axis=1)
    return np.asarray(np.abs(clean.mean(axis=0))[:, ~inrush].max(axis=1))
