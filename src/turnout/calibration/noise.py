"""Noise of a channel, its correlation in time, and the model error."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky

from turnout.calibration.measured_movements import BIN, OBJECT_FORCE, MeasuredMovement

Floats = NDArray[np.float64]
# The solver itself is not surer than this share of a channel's largest value [-].
FLOOR = 2e-4
# After an impact an object is held by friction that depends on every detail of it: steps of 1 and
# 0.25 ms leave forces that differ by this share of the channel's largest value, for good [-], [s].
AGREEMENT, AGREEMENT_TIME = {OBJECT_FORCE: 1e-3}, 1.0
# Rest before the onset, as the onset may have been found late [s].
REST_END = -0.1
LEAST_REST = 10
# A model that misses more than this share of a channel's largest value is not of what was measured:
# of drives 0.1 % are missed on twins, 3 % where the switch is free for a metre more. The blow on an
# object is missed by 2 % by a model that is right to 0.1 % in all its values [-].
MISSED, POOR = 0.02, {OBJECT_FORCE: 0.1}
LONGEST = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """Covariance of a channel over bins of time.

    Attributes
    ----------
    white : float
        Standard deviation of what differs from bin to bin [unit of the channel].
    slow, slow_length : float
        Of what decays exponentially over time: standard deviation, and time to a third [s].
    missed, missed_length : float
        The same of the model error; before a fit, of the difference between two solvers.
    """

    white: float
    slow: float = 0.0
    slow_length: float = BIN
    missed: float = 0.0
    missed_length: float = BIN

    @property
    def total(self) -> float:
        """Standard deviation of a bin."""
        return float(np.sqrt(self.white**2 + self.slow**2 + self.missed**2))

    def factor(self, time: Floats) -> Floats:
        """Return the lower Cholesky factor of the covariance at some times, read only.

        Movements share their bins, so it is kept: hundreds of alignments ask for a few factors.
        """
        return _factor(self, np.asarray(time, dtype=np.float64).tobytes())


@lru_cache(maxsize=256)
def _factor(noise: Noise, times: bytes) -> Floats:
    """Return the factor of a covariance for times as bytes, which can be a key."""
    time = np.frombuffer(times, dtype=np.float64)
    apart = np.abs(time[:, None] - time[None, :])
    covariance = noise.white**2 * np.eye(time.size)
    for size, length in ((noise.slow, noise.slow_length), (noise.missed, noise.missed_length)):
        if size > 0:
            covariance = covariance + size**2 * np.exp(-apart / length)
    found = np.asarray(cholesky(covariance, lower=True), dtype=np.float64)
    found.flags.writeable = False
    return found


def peaks_of(movements: Sequence[MeasuredMovement]) -> dict[tuple[str, str], float]:
    """Return the largest value of each channel and drive, over all movements."""
    peaks: dict[tuple[str, str], float] = {}
    for movement in movements:
        for signal in movement.signals:
            key = (signal.channel, signal.drive)
            peaks[key] = max(peaks.get(key, 0.0), float(np.nanmax(np.abs(signal.values))))
    return peaks


def measured_noise(movements: Sequence[MeasuredMovement]) -> dict[tuple[str, str], Noise]:
    """Estimate the noise of each channel from its rest before the onset of motion.

    Parameters
    ----------
    movements : sequence of MeasuredMovement
        From `observe`; their rests and repeats give the noise.

    Returns
    -------
    dict of (channel, drive) to Noise
        Never below what the solver itself is sure of.
    """
    rests: dict[tuple[str, str], list[Floats]] = {}
    for movement in movements:
        for signal in movement.signals:
            key = (signal.channel, signal.drive)
            rest = signal.values[(signal.time < REST_END) & np.isfinite(signal.values)]
            if rest.size >= LEAST_REST:
                rests.setdefault(key, []).append(rest - rest.mean())
    found = {}
    for key, peak in peaks_of(movements).items():
        least = FLOOR * max(peak, 1.0)
        white, slow, length = _split(rests.get(key, []))
        found[key] = Noise(
            white=float(np.hypot(white, least)),
            slow=slow,
            slow_length=length,
            missed=AGREEMENT.get(key[0], 0.0) * max(peak, 1.0),
            missed_length=AGREEMENT_TIME,
        )
    return found


def missed_by_model(residuals: Sequence[Floats], noise: Noise) -> tuple[float, float]:
    """Return size [unit of the channel] and decay time [s] of the model error.

    Parameters
    ----------
    residuals : sequence of ndarray, shape (n,)
        Of one channel, a series a movement, on even bins.
    noise : Noise
        Of the measurement.
    """
    covariance = _autocovariance(residuals, mean_removed=False)
    if covariance.size < 2:
        return 0.0, BIN
    extra = covariance[0] - noise.white**2 - noise.slow**2
    # Below a tenth of the noise's own variance it is not significant.
    if extra <= 0.1 * (noise.white**2 + noise.slow**2):
        return 0.0, BIN
    return float(np.sqrt(extra)), _first_below(covariance, extra)


def decay_time(row: Floats, variance: float) -> float:
    """Return the time in which a series with a known variance decays to a third [s]."""
    return _first_below(_autocovariance([row], mean_removed=False), variance)


def _first_below(covariance: Floats, variance: float) -> float:
    below = np.flatnonzero(covariance[1:] < variance * np.exp(-1.0))
    lag = int(below[0]) + 1 if below.size else max(covariance.size, 1)
    return float(np.clip(lag * BIN, BIN, LONGEST))


def _split(rests: Sequence[Floats]) -> tuple[float, float, float]:
    """Return white and slow parts of noise at rest, and the time in which the slow one decays."""
    covariance = _autocovariance(rests, mean_removed=True)
    if covariance.size < 3:
        return 0.0, 0.0, BIN
    count = sum(rest.size for rest in rests)
    if covariance[1] <= 2.0 * covariance[0] / np.sqrt(count):
        return float(np.sqrt(covariance[0])), 0.0, BIN
    decay = float(np.clip(covariance[2] / covariance[1], 0.05, 0.95))
    slow = min(float(covariance[1] / decay), float(covariance[0]))
    white = float(np.sqrt(max(covariance[0] - slow, 0.0)))
    return white, float(np.sqrt(slow)), float(-BIN / np.log(decay))


def _autocovariance(series: Sequence[Floats], *, mean_removed: bool) -> Floats:
    """Return the autocovariance of several series by lag."""
    usable = [row for row in series if row.size >= LEAST_REST]
    if not usable:
        return np.zeros(0)
    most = min(int(LONGEST / BIN), min(row.size for row in usable) // 2)
    lost = 1 if mean_removed else 0
    found = np.zeros(most)
    for lag in range(most):
        total = sum(float(row[lag:] @ row[: row.size - lag]) for row in usable)
        found[lag] = total / sum(row.size - lag - lost for row in usable)
    return found
