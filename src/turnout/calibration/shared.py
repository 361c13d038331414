r"""Sensitivities of the channels and the discrepancy of each, which all movements share.

Both are Gaussian with known directions, so they are integrated out. With the movements whitened one
by one, the covariance of all residuals together is

.. math:: C = I + B B^T, \quad r = C^{-1/2} r_0

with a column of `B` for each of them, whitened, times its standard deviation. The discrepancy of a
channel, :math:`\delta(t)`, is a Gaussian process over the time from the onset, the same in all
movements of a direction (Kennedy and O'Hagan 2001, doi 10.1111/1467-9868.00294), written in the
leading eigenvectors of its covariance :math:`s^2 e^{-|t-t'|/\tau}`. More movements do not average
it out, so intervals do not shrink below it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.comparison import (
    LONGEST,
    Alignment,
    Comparison,
    Key,
    Noise,
    decay_time,
    peaks_of,
)
from turnout.calibration.measured_movements import BIN, OBJECT_FORCE, MeasuredMovement

Floats = NDArray[np.float64]
# Eigenvectors of a discrepancy that are kept at most, and the share of its variance that is enough.
MOST_MODES, ENOUGH = 24, 0.95
# A shared discrepancy below this share of the noise is left out [-], as are directions below this.
LEAST_SHARED, LEAST_SIZE = 0.3, 1e-6
# A discrepancy that all share is one only where several movements show it.
LEAST_MOVEMENTS = 3
# Less than this share of a channel's peak another solver of the same mechanics misses too [-]: a
# right model 0.1 % of drives on twins, and 2 % of the blow on an object. So many times that is
# something that the model lacks, such as a metre more of rail, which is 3 % of drives. Noise of a
# channel hides more than that, but never more than `POOR` of the peak.
WORTH, WORTH_DRIVE, CLEARLY = {OBJECT_FORCE: 0.02}, 1.5e-3, 3.0
POOR, POOR_DRIVE = {OBJECT_FORCE: 0.1}, 0.02
DiscrepancyKey = tuple[str, str, str]
"""Channel, drive and direction."""
GAIN, ZERO, CLOCK, CROSS_TALK = "gain", "zero", "clock", "cross-talk"


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorColumn:
    """One unknown of the measuring chain that all movements share.

    Attributes
    ----------
    kind : str
        `GAIN`, `ZERO`, `CLOCK` or `CROSS_TALK`.
    channel, drive : str
        Of the schema; empty for the clock.
    source : tuple of str
        Channel and drive that cross-talk comes from.
    stated : float
        Standard deviation before the measurement [-, N, -, -].
    """

    kind: str
    channel: str = ""
    drive: str = ""
    source: Key = ("", "")
    stated: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shared:
    """Directions in which the residuals of all movements move together.

    Attributes
    ----------
    sensors : tuple of SensorColumn
        What the first columns stand for.
    columns : ndarray, shape (n, q)
        Whitened, for one standard deviation each.
    gram : ndarray, shape (q, q)
        Inner products of the columns.
    plain : tuple of ndarray, shape (n_m, q)
        The same in newtons, for each movement.
    basis, sizes : ndarray, shape (n, k) and (k,)
        Orthonormal directions and standard deviations along them.
    """

    sensors: tuple["SensorColumn", ...]
    columns: Floats
    gram: Floats
    plain: tuple[Floats, ...]
    basis: Floats
    sizes: Floats

    def whitened(self, rows: Floats) -> Floats:
        """Return whitened rows with what is shared made independent too, shape (n,) or (n, p)."""
        shrink = 1.0 - 1.0 / np.sqrt(1.0 + self.sizes**2)
        return np.asarray(rows - (self.basis * shrink) @ (self.basis.T @ rows))

    def estimates(self, rows: Floats) -> Floats:
        """Return the likeliest size of each column, in deviations, from whitened rows."""
        normal = np.eye(self.columns.shape[1]) + self.gram
        return np.asarray(np.linalg.solve(normal, self.columns.T @ rows))

    @property
    def log_determinant(self) -> float:
        """Logarithm of the determinant of what is shared."""
        return float(np.log1p(self.sizes**2).sum())


def shared_of(alignments: Sequence[Alignment], comparison: Comparison) -> Shared | None:
    """Return what the movements share; None where nothing is uncertain.

    Parameters
    ----------
    alignments : sequence of Alignment
        Of all movements.
    comparison : Comparison
        With the uncertainty of gains and the size of discrepancies.
    """
    sensors = sensor_columns(comparison)
    blocks = [_sensor_block(item, sensors) for item in alignments]
    for key, (size, length) in comparison.discrepancy.items():
        if size > 0.0:
            modes = _discrepancy_columns(alignments, key, size=size, length=length)
            blocks = [np.hstack(pair) for pair in zip(blocks, modes, strict=True)]
    if not blocks or not blocks[0].shape[1]:
        return None
    columns = np.concatenate(
        [item.whitened(block) for item, block in zip(alignments, blocks, strict=True)]
    )
    gram = columns.T @ columns
    squares, vectors = np.linalg.eigh(gram)
    kept = squares > LEAST_SIZE
    sizes = np.sqrt(squares[kept])
    return Shared(
        sensors=sensors,
        columns=columns,
        gram=gram,
        plain=tuple(blocks),
        basis=columns @ vectors[:, kept] / sizes,
        sizes=sizes,
    )


def _places(alignment: Alignment) -> list[tuple[Key, Floats, slice]]:
    """Return channel, times and place in the row of each part of a movement."""
    return [
        ((signal.channel, signal.drive), signal.time[bins], place)
        for signal, bins, place in alignment.pieces
    ]


def sensor_columns(comparison: Comparison) -> tuple[SensorColumn, ...]:
    """List the unknowns of the measuring chain: gains, zeros, cross-talk, then the clock."""
    found = [
        SensorColumn(kind=GAIN, channel=channel, drive=drive, stated=share)
        for (channel, drive), share in comparison.gains.items()
        if share > 0.0
    ]
    if comparison.common_zero > 0.0:
        found += [
            SensorColumn(kind=ZERO, channel=channel, drive=drive, stated=comparison.common_zero)
            for channel, drive in comparison.noise
        ]
    if comparison.cross_talk > 0.0:
        found += [
            SensorColumn(
                kind=CROSS_TALK,
                channel=channel,
                drive=drive,
                source=source,
                stated=comparison.cross_talk,
            )
            for (channel, drive), source in permutations(comparison.noise, 2)
        ]
    if comparison.clock > 0.0:
        found.append(SensorColumn(kind=CLOCK, stated=comparison.clock))
    return tuple(found)


def _sensor_block(alignment: Alignment, sensors: Sequence[SensorColumn]) -> Floats:
    r"""Return the change of a movement with one standard deviation of each unknown of its chain.

    A recorder whose seconds are a share `c` too short writes
    :math:`F(t / (1 + c)) \approx F(t) - c t \dot F(t)`.
    """
    block = np.zeros((alignment.measured.size, len(sensors)))
    for column, item in enumerate(sensors):
        for signal, bins, place in alignment.pieces:
            scale: Floats | float = 0.0
            if item.kind == CLOCK:
                scale = alignment.clock[place]
            elif (signal.channel, signal.drive) == (item.channel, item.drive):
                if item.kind == CROSS_TALK:
                    scale = measured_at(alignment.movement, item.source, bins)
                else:
                    scale = alignment.measured[place] if item.kind == GAIN else 1.0
            block[place, column] = item.stated * scale
    return block


def measured_at(movement: MeasuredMovement, source: Key, bins: NDArray[np.intp]) -> Floats:
    """Look up the measured values of a channel in some bins; missing ones are 0."""
    for signal in movement.signals:
        if (signal.channel, signal.drive) == source:
            return np.asarray(np.nan_to_num(signal.values[bins]), dtype=np.float64)
    return np.zeros(bins.size)


def _discrepancy_columns(
    alignments: Sequence[Alignment], key: DiscrepancyKey, *, size: float, length: float
) -> list[Floats]:
    """Return the change of each movement with one deviation of each mode of a discrepancy."""
    channel, drive, direction = key
    parts = [
        {k: (time, place) for k, time, place in _places(item)}.get((channel, drive))
        if item.movement.direction == direction
        else None
        for item in alignments
    ]
    ends = [part[0] for part in parts if part is not None]
    if not ends:
        return [np.zeros((item.measured.size, 0)) for item in alignments]
    time = max(ends, key=lambda times: float(times[-1]))
    modes = discrepancy_modes(time, size=size, length=length)
    found = []
    for item, part in zip(alignments, parts, strict=True):
        block = np.zeros((item.measured.size, modes.shape[1]))
        if part is not None:
            at = np.clip(np.rint((part[0] - time[0]) / BIN).astype(int), 0, time.size - 1)
            block[part[1]] = modes[at]
        found.append(block)
    return found


def discrepancy_modes(time: Floats, *, size: float, length: float) -> Floats:
    r"""Return the leading modes of a Gaussian process, each for one standard deviation.

    .. math:: K = \sum_k \phi_k \phi_k^T, \quad K_{ij} = s^2 e^{-|t_i - t_j| / \tau}

    Parameters
    ----------
    time : ndarray, shape (n,)
        Even [s].
    size, length : float
        Standard deviation `s` [unit of the channel] and correlation time `tau` [s].

    Returns
    -------
    ndarray, shape (n, k)

    Examples
    --------
    >>> modes = discrepancy_modes(np.arange(20) * 0.02, size=3.0, length=1.0)
    >>> bool(np.allclose((modes**2).sum(axis=1), 9.0, rtol=0.1))
    True
    """
    return np.asarray(size * _unit_modes(time.tobytes(), length))


@lru_cache(maxsize=64)
def _unit_modes(times: bytes, length: float) -> Floats:
    """Return the leading modes of a process of size 1, for times as bytes, which can be a key."""
    time = np.frombuffer(times, dtype=np.float64)
    variances, vectors = np.linalg.eigh(np.exp(-np.abs(time[:, None] - time[None, :]) / length))
    order = np.argsort(-variances)
    share = np.cumsum(variances[order]) / variances.sum()
    count = min(MOST_MODES, int(np.searchsorted(share, ENOUGH)) + 1)
    kept = order[:count]
    modes = np.asarray(vectors[:, kept] * np.sqrt(np.maximum(variances[kept], 0.0)))
    modes.flags.writeable = False
    return modes


def left_out(count: int, *, size: float, length: float) -> float:
    """Return the standard deviation that the leading modes leave out, over so many bins.

    It has to be somewhere: directions without any noise would be taken for perfectly known.

    Examples
    --------
    >>> 0.0 < left_out(150, size=1.0, length=0.3) < 0.4
    True
    """
    time: Floats = np.asarray(BIN * np.arange(count), dtype=np.float64)
    modes = discrepancy_modes(time, size=size, length=length)
    return float(np.sqrt(max(size**2 - float((modes**2).sum(axis=1).mean()), 0.0)))


def shared_discrepancy(
    series: Mapping[DiscrepancyKey, Sequence[Floats]], noise: Mapping[Key, Noise]
) -> dict[DiscrepancyKey, tuple[float, float]]:
    """Estimate what the model misses alike in all movements of a direction.

    The product of residuals of two movements at the same time has the variance of what they share
    as its mean, whatever each has for itself.

    Parameters
    ----------
    series : mapping of (channel, drive, direction) to sequence of ndarray, shape (n_m,)
        Residuals of each movement from the onset, on even bins.
    noise : mapping of (channel, drive) to Noise
        Of the measurement.

    Returns
    -------
    dict of (channel, drive, direction) to (float, float)
        Standard deviation [unit of the channel] and correlation time [s].

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> own = [rng.standard_normal(200) for _ in range(6)]
    >>> wave = 5.0 * np.sin(np.arange(200) / 20.0)
    >>> key = ("drive_force", "1", "closing")
    >>> found = shared_discrepancy({key: [row + wave for row in own]}, {key[:2]: Noise(white=1.0)})
    >>> 3.0 < found[key][0] < 4.0
    True
    """
    found = {}
    for key, rows in series.items():
        if len(rows) < LEAST_MOVEMENTS:
            continue
        length = max(row.size for row in rows)
        whole = np.full((len(rows), length), np.nan)
        for number, row in enumerate(rows):
            whole[number, : row.size] = row
        counts = np.isfinite(whole).sum(axis=0)
        several = counts >= LEAST_MOVEMENTS
        if not several.any():
            continue
        whole, counts = whole[:, several], counts[several]
        sums, squares = np.nansum(whole, axis=0), np.nansum(whole**2, axis=0)
        variance = float(np.mean((sums**2 - squares) / (counts * (counts - 1))))
        known = noise[key[0], key[1]]
        floor = LEAST_SHARED**2 * (known.white**2 + known.slow**2)
        if variance > floor:
            time = decay_time(sums / counts, variance)
            found[key] = (float(np.sqrt(variance)), min(time, LONGEST))
    return found


def without_common(rows: Sequence[Floats]) -> list[Floats]:
    """Return series without their mean at each time, of the variance that they had beside it.

    Examples
    --------
    >>> [row.tolist() for row in without_common([np.array([1.0, 2.0]), np.array([3.0])])]
    [[-1.4142135623730951, 2.0], [1.4142135623730951]]
    """
    whole = np.full((len(rows), max(row.size for row in rows)), np.nan)
    for number, row in enumerate(rows):
        whole[number, : row.size] = row
    counts = np.isfinite(whole).sum(axis=0)
    shared = np.where(counts > 1, np.nansum(whole, axis=0) / np.maximum(counts, 1), 0.0)
    scale = np.sqrt(np.where(counts > 1, counts / np.maximum(counts - 1, 1), 1.0))
    return [(row - shared[: row.size]) * scale[: row.size] for row in rows]


def model_error(comparison: Comparison, key: Key) -> float:
    """Return the standard deviation of what the model misses in a channel [N]."""
    shared = [size for (*own, _), (size, _) in comparison.discrepancy.items() if tuple(own) == key]
    return float(np.hypot(comparison.noise[key].missed, max(shared, default=0.0)))


def missing_more(
    comparison: Comparison, movements: Sequence[MeasuredMovement], *, share: float = 1.0
) -> dict[Key, float]:
    """Return the channels that a model misses more of than so many times another solver.

    Returns
    -------
    dict of (channel, drive) to float
        What it misses [N].
    """
    return {
        key: missed
        for key, peak in peaks_of(movements).items()
        for missed in [model_error(comparison, key)]
        for least in [max(WORTH.get(key[0], WORTH_DRIVE) * peak, 1.5 * comparison.noise[key].white)]
        if missed > min(share * least, POOR.get(key[0], POOR_DRIVE) * peak)
    }


def effective_samples(alignments: Sequence[Alignment], comparison: Comparison) -> float:
    r"""Return how many independent samples the movements are worth, for the mean of each channel.

    .. math:: n = \sum_c \sigma_c^2 \, 1^T C_c^{-1} 1

    with the covariance of noise and of both discrepancies, over all movements together, and the
    variance of a bin: what all movements share counts once only.
    """
    modes = shared_of(
        alignments, replace(comparison, gains={}, common_zero=0.0, clock=0.0, cross_talk=0.0)
    )
    blocks = (
        modes.plain if modes is not None else [np.zeros((a.measured.size, 0)) for a in alignments]
    )
    total = 0.0
    for key in {key for item in alignments for key, _, _ in _places(item)}:
        ones = [
            np.concatenate(
                [np.full(time.size, float(other == key)) for other, time, _ in _places(item)]
            )
            for item in alignments
        ]
        w = np.concatenate([a.noise_whitened(row) for a, row in zip(alignments, ones, strict=True)])
        P = np.concatenate([a.noise_whitened(b) for a, b in zip(alignments, blocks, strict=True)])
        across = P.T @ w
        inner = np.linalg.solve(np.eye(P.shape[1]) + P.T @ P, across)
        variance = comparison.noise[key].total ** 2 + model_error(comparison, key) ** 2
        variance -= comparison.noise[key].missed ** 2
        total += variance * float(w @ w - across @ inner)
    return total


def chain_key(kind: str, channel: str = "", drive: str = "", *, source: Key = ("", "")) -> str:
    """Return the key of an unknown of the measuring chain.

    Examples
    --------
    >>> chain_key(GAIN, "drive_force", "1"), chain_key(ZERO, "object_force"), chain_key(CLOCK)
    ('gain drive_force.1', 'zero object_force', 'clock')
    >>> chain_key(CROSS_TALK, "drive_force", "1", source=("object_force", ""))
    'cross-talk drive_force.1 object_force'
    """
    names = [".".join(filter(None, key)) for key in ((channel, drive), source)]
    return " ".join(filter(None, (kind, *names)))
