"""Comparison of measured movements with simulated ones: bins, noise, alignment, nuisances.

What differs from movement to movement, and is not fitted, has a prior and is integrated out: the
true onset, the zero of each channel, and parameters that scatter, such as friction. Whitened
residuals therefore hold only what the parameters of a fit can explain.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky
from scipy.linalg.lapack import dtrtrs

from turnout.calibration.evaluate import Response
from turnout.calibration.measured_movements import BIN, OBJECT_FORCE, MeasuredMovement, Signal

Floats = NDArray[np.float64]
# A response is held for so long before it begins [s].
BEFORE = 1.0


def compared(
    movement: MeasuredMovement, channels: tuple[str, ...], window: tuple[float, float | None]
) -> list[tuple[Signal, NDArray[np.intp]]]:
    """Return the signals that are compared, and which of their bins.

    Parameters
    ----------
    movement : MeasuredMovement
        From `observe`: bins of `BIN` seconds with the samples in each.
    channels : tuple of str
        Of the stage.
    window : tuple
        From the onset [s].

    Returns
    -------
    list of (Signal, ndarray of int)
    """
    end = movement.length if window[1] is None else min(window[1], movement.length)
    found = []
    for signal in movement.signals:
        if signal.channel not in channels:
            continue
        inside = (signal.time >= window[0]) & (signal.time + 0.5 * BIN <= end)
        bins = np.flatnonzero(inside & np.isfinite(signal.values))
        if bins.size:
            found.append((signal, bins))
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """A response as the parts of a movement see it, integrated once for any onset.

    Attributes
    ----------
    centres : tuple of ndarray
        Of the bins of each part, from the onset [s].
    onset : float
        On the schedule of the response [s].
    edges : ndarray, shape (n + 1,)
        Of the cells of the response, and of a second before it, in which it stands still [s].
    totals : tuple of ndarray, shape (n + 1,)
        Integral of each part's signal from the start of the response to each edge.
    failed : bool
        Whether there is no response.
    """

    centres: tuple[Floats, ...]
    onset: float
    edges: Floats
    totals: tuple[Floats, ...]
    failed: bool

    def row(self, shift: float, rate: float = 0.0) -> Floats:
        """Return the means over all bins, part after part; NaN where the simulation failed.

        Within a cell a signal is a straight line with the slope between its neighbours: as steps,
        bins that end within cells would be smoothed by as much as samples 5 ms apart do.

        Parameters
        ----------
        shift : float
            How much later than its marked onset the movement truly began [s].
        rate : float
            Share by which the seconds of the recorder are too short [-].
        """
        if self.failed:
            return np.full(sum(centre.size for centre in self.centres), np.nan)
        rows = []
        for centre, total in zip(self.centres, self.totals, strict=True):
            middle = centre / (1.0 + rate) + (self.onset - shift)
            ends = np.concatenate((middle + 0.5 * BIN, middle - 0.5 * BIN))
            cells = (ends - self.edges[1]) / (self.edges[2] - self.edges[1])
            place = np.clip(cells.astype(np.intp), 1, total.size - 4) + 1
            share = np.clip(cells + 1.0 - place, 0.0, 1.0)
            bend = total[place + 2] - total[place + 1] - total[place] + total[place - 1]
            up_to = np.interp(ends, self.edges, total) - 0.25 * bend * share * (1.0 - share)
            rows.append((up_to[: middle.size] - up_to[middle.size :]) / BIN)
        return np.concatenate(rows)


def prediction(
    response: Response, movement: MeasuredMovement, parts: Sequence[tuple[Signal, NDArray[np.intp]]]
) -> Prediction:
    """Make a response ready to be compared with the parts of a movement.

    Parameters
    ----------
    response : Response
        Of the throw.
    movement : MeasuredMovement
        Its direction selects the movement of the response.
    parts : sequence of (Signal, ndarray of int)
        With channel, drive and bins.
    """
    centres = tuple(signal.time[bins] for signal, bins in parts)
    if response.failure:
        return Prediction(centres, 0.0, np.zeros(0), (), failed=True)
    cell = response.time[1] - response.time[0]
    edges = response.time[0] + cell * (np.arange(response.time.size + 1) - 0.5)
    return Prediction(
        centres,
        onset=response.onsets[movement.direction],
        edges=np.concatenate(([edges[0] - BEFORE], edges)),
        totals=tuple(_totals(response, signal) for signal, _ in parts),
        failed=False,
    )


@lru_cache(maxsize=2048)
def _totals(response: Response, signal: Signal) -> Floats:
    """Return the integral of a signal up to each edge of the cells of a response, and before it.

    Responses aside, of which slopes are, are asked for again with each alignment.
    """
    cell, row = response.time[1] - response.time[0], _recorded(response, signal)
    # A closed switch may press its rods with some kilonewtons before it begins to move.
    return np.concatenate(([-BEFORE * row[0], 0.0], np.cumsum(row, dtype=np.float64) * cell))


def predicted(
    response: Response,
    movement: MeasuredMovement,
    signal: Signal,
    bins: NDArray[np.intp],
    *,
    shift: float = 0.0,
) -> Floats:
    """Return the simulated means over bins.

    Parameters
    ----------
    response : Response
        Of the throw.
    movement : MeasuredMovement
        Its direction selects the movement of the response.
    signal : Signal
        With channel, drive and time.
    bins : ndarray of int, shape (n,)
        Numbers of bins of the movement, from 0.
    shift : float
        How much later than its marked onset the movement truly began [s].

    Returns
    -------
    ndarray, shape (n,)
        NaN where the simulation failed.
    """
    return prediction(response, movement, [(signal, bins)]).row(shift)


def _recorded(response: Response, signal: Signal) -> Floats:
    """Return a signal of a response as its recorder keeps it."""
    values = response.drive_force[signal.drive] if signal.drive else response.object_force
    return signal.recorder.applied(response.time, values) if signal.recorder else values


# The solver itself is not surer than this share of a channel's largest value [-].
FLOOR = 2e-4
# After an impact an object is held by friction that depends on every detail of it: steps of 1 and
# 0.25 ms leave forces that differ by this share of the channel's largest value, for good [-], [s].
AGREEMENT, AGREEMENT_TIME = {OBJECT_FORCE: 1e-3}, 1.0
# Rest before the onset, as the onset may have been found late [s].
REST_END = -0.1
# A rest of fewer bins says nothing of slow noise.
LEAST_REST = 10
# Errors that decay more slowly are much like those of a zero, which is an unknown [s].
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
    left : float
        Of the model error that all movements share, what its modes leave out from bin to bin.
    """

    white: float
    slow: float = 0.0
    slow_length: float = BIN
    missed: float = 0.0
    missed_length: float = BIN
    left: float = 0.0

    @property
    def total(self) -> float:
        """Standard deviation of a bin."""
        return float(np.sqrt(self.white**2 + self.slow**2 + self.missed**2 + self.left**2))

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
    covariance = (noise.white**2 + noise.left**2) * np.eye(time.size)
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


# Onsets are found by slopes over so much to either side, half a cell of a response; how far off a
# mark may be, beyond which it is of something else [s]; and in so many steps.
ONSET_STEP, MAX_ONSET_SHIFT, ONSET_ITERATIONS = 2e-3, 0.4, 12
Key = tuple[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Uncertainty:
    """Standard uncertainties of the measurement, and of the model's scale.

    What step, mesh and modes of the solver change is thrown.

    Attributes
    ----------
    clocked_onset, onset : float
        Of the marked onset, where found from motor currents and where from forces only [s].
    zero : float
        Of the zero of a force channel [N].
    gain : float
        Of the sensitivity of a channel, cross-talk included, from movement to movement [-].
    common_gain, cross_talk : float
        Of the sensitivity where the channel map states none, and of what each channel takes up of
        each other one, in all movements alike [-].
    common_zero : float
        Of the zero of a force channel, in all movements alike [N].
    clock : float
        Of the time that the recorder states, as a share of it [-].
    scale : float
        Of all forces and stiffnesses together, where gains are free and the model is the only
        scale: what is left by errors that act like a gain, such as a zero that drifts within a
        movement [-].
    """

    clocked_onset: float = 0.005
    onset: float = 0.05
    zero: float = 20.0
    gain: float = 1e-3
    common_gain: float = 1e-2
    cross_talk: float = 5e-4
    common_zero: float = 10.0
    clock: float = 1e-3
    scale: float = 4e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Settings of the comparison of movements.

    Attributes
    ----------
    noise : mapping of (channel, drive) to Noise
        Of each channel.
    channels : tuple of str
        Of the schema.
    window : tuple
        From the onset [s]; None for the end of the movement and its rest.
    scatter : mapping of str to float
        Relative standard deviation of parameters from movement to movement.
    uncertainty : Uncertainty
        Of onset, zero and gain.
    gains : mapping of (channel, drive) to float
        Standard deviation of the sensitivity that all movements share [-]; empty where neither
        gains nor zeros nor the clock are unknowns.
    common_zero, clock, cross_talk : float
        As of `Uncertainty` [N, -, -]; 0 for none.
    discrepancy : mapping of (channel, drive, direction) to (float, float)
        Size [N] and correlation time [s] of what the model misses alike in all movements.
    lead : float
        How much later than marked movements begin, where all say so [s].
    rate : float
        Share by which the recorder's seconds are too short where its clock is linearised [-].
    outlier_limit : float
        Residuals beyond this many standard deviations count less [-]; infinite far from the fit,
        where they say where to go.
    """

    noise: Mapping[Key, Noise]
    channels: tuple[str, ...] = ("drive_force", "object_force")
    window: tuple[float, float | None] = (0.0, None)
    scatter: Mapping[str, float] = field(default_factory=dict)
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    gains: Mapping[Key, float] = field(default_factory=dict)
    common_zero: float = 0.0
    clock: float = 0.0
    cross_talk: float = 0.0
    discrepancy: Mapping[tuple[str, str, str], tuple[float, float]] = field(default_factory=dict)
    lead: float = 0.0
    rate: float = 0.0
    outlier_limit: float = float("inf")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sensitivity:
    """Response of a movement to a parameter that scatters.

    Attributes
    ----------
    simulated, stepped : Response
        At the movement's own value, and one step aside.
    step, effect : float
        The step, and the difference of the movement's own value from the common one, as shares of
        the common one.
    """

    simulated: Response
    stepped: Response
    step: float
    effect: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Alignment:
    """Comparison of one movement: bins, onset, and the whitening of its residuals.

    Attributes
    ----------
    movement : MeasuredMovement
        Measured means over bins of each channel, forces [N].
    parts : list of (Signal, ndarray of int)
        What is compared.
    measured : ndarray, shape (n,)
        All parts in a row.
    shift, lead : float
        How much later than marked the movement began, as estimated, and as expected [s].
    columns : ndarray, shape (n, 1 + s)
        Change of the prediction with the onset [1/s] and with the share of each scattering
        parameter.
    clock : ndarray, shape (n,)
        Change of the prediction with the share that the recorder's seconds are too short [N].
    rate : float
        That share, where the movement is compared [-].
    effects : mapping of str to float
        By scattering parameter: where the movement is simulated, as a share of the common value.
    factors : tuple of ndarray
        Cholesky factor of the noise of each part.
    basis, shrink : ndarray, shape (n, q) and (q,)
        Whitened directions of the nuisances, and how far residuals are shrunk along them.
    estimator : ndarray, shape (1 + s, n)
        From a noise-whitened row to the estimates of onset and movement effects.
    estimates : mapping of str to (float, float)
        Mean and standard deviation: "onset" [s], scattering parameters as shares.
    channels : tuple of (float, float)
        Zero [N] and gain [-] of each part, as estimated beside those that all movements share.
    """

    movement: MeasuredMovement
    parts: list[tuple[Signal, NDArray[np.intp]]]
    measured: Floats
    shift: float
    lead: float
    columns: Floats
    clock: Floats
    rate: float
    effects: Mapping[str, float]
    factors: tuple[Floats, ...]
    basis: Floats
    shrink: Floats
    estimator: Floats
    estimates: Mapping[str, tuple[float, float]]
    channels: tuple[tuple[float, float], ...]

    @property
    def pieces(self) -> list[tuple[Signal, NDArray[np.intp], slice]]:
        """The parts, each with its place in the row of all."""
        return _pieces(self.parts)

    def reduced(self, response: Response, effects: Mapping[str, float] | None = None) -> Floats:
        """Return the prediction of a response, carried back to zero nuisances.

        Parameters
        ----------
        response : Response
            To the movement.
        effects : mapping of str to float, optional
            At which the response was simulated; default those of the alignment.
        """
        places = [
            self.rate,
            self.shift - self.lead,
            *(effects if effects is not None else self.effects).values(),
        ]
        columns = np.column_stack([self.clock, self.columns])
        return np.asarray(self.predicted(response) - columns @ np.array(places))

    def shows(self, name: str) -> bool:
        """Return whether the prediction changes with a parameter that scatters."""
        names = list(self.effects)
        return name in names and bool(self.columns[:, 1 + names.index(name)].any())

    def effects_from(self, row: Floats) -> dict[str, float]:
        """Return the movement effects from a row of measured less `reduced`."""
        found = self.estimator @ self.noise_whitened(row)
        return {name: float(found[n]) for n, name in enumerate(self.effects, 1)}

    def predicted(self, response: Response) -> Floats:
        """Return the prediction of a response at the estimated onset."""
        return prediction(response, self.movement, self.parts).row(self.shift, self.rate)

    def noise_whitened(self, row: Floats) -> Floats:
        """Return a row with its noise made independent; nuisances are left in."""
        return _without_noise(row, self.factors)

    def whitened(self, row: Floats) -> Floats:
        """Return a row, or each of several columns, made independent, nuisances shrunk."""
        clean = self.noise_whitened(row)
        return np.asarray(clean - (self.basis * self.shrink) @ (self.basis.T @ clean))

    def remaining_residuals(
        self, response: Response, *, shared: Floats | None = None
    ) -> list[Floats]:
        """Return the residuals of each part, less what the nuisances of this movement explain.

        Parameters
        ----------
        response : Response
            To the movement.
        shared : ndarray, shape (n,), optional
            What is known of all movements, taken off before [N].
        """
        row = self.measured - self.reduced(response)
        if shared is not None:
            row = row - shared
        clean = self.noise_whitened(row)
        explained = 1.0 - (1.0 - self.shrink) ** 2
        clean = clean - self.basis @ (explained * (self.basis.T @ clean))
        places = zip(self.factors, self.pieces, strict=True)
        return [factor @ clean[place] for factor, (_, _, place) in places]


def _pieces(
    parts: Sequence[tuple[Signal, NDArray[np.intp]]],
) -> list[tuple[Signal, NDArray[np.intp], slice]]:
    """Return parts, each with its place in the row of all."""
    ends = np.cumsum([bins.size for _, bins in parts]).tolist()
    return [
        (signal, bins, slice(end - bins.size, end))
        for (signal, bins), end in zip(parts, ends, strict=True)
    ]


def _without_noise(row: Floats, factors: Sequence[Floats]) -> Floats:
    """Return a row, or each of several columns, with its noise made independent."""
    found, first = [], 0
    for factor in factors:
        piece = row[first : first + factor.shape[0]]
        # As solve_triangular does it, without what that takes longer to look for than to solve.
        solved, _ = dtrtrs(factor.T, piece, lower=0, trans=1)
        found.append(np.ascontiguousarray(solved))
        first += factor.shape[0]
    return np.concatenate(found)


def align(
    movement: MeasuredMovement,
    response: Response,
    *,
    comparison: Comparison,
    sensitivities: Mapping[str, Sensitivity],
    shift: float | None = None,
) -> Alignment:
    """Align a measured movement with a response.

    Parameters
    ----------
    movement : MeasuredMovement
        Measured means over bins of each channel, forces [N].
    response : Response
        Simulated at the point about which nuisances are linearised.
    comparison : Comparison
        How movements are compared.
    sensitivities : mapping of str to Sensitivity
        For each parameter that scatters.
    shift : float, optional
        Onset at which the search for it begins, such as that of an alignment near by [s]; default
        the lead of the comparison.
    """
    shift = comparison.lead if shift is None else shift
    parts = compared(movement, comparison.channels, comparison.window)
    factors = tuple(
        comparison.noise[signal.channel, signal.drive].factor(signal.time[bins])
        for signal, bins in parts
    )
    alignment = _align(movement, response, parts, factors, comparison, sensitivities, shift)
    if comparison.outlier_limit == float("inf"):
        return alignment
    rest = alignment.remaining_residuals(response, shared=alignment.rate * alignment.clock)
    # What is far off once all is aligned, such as an impact, counts less.
    trusted = [
        factor
        * np.maximum(1.0, np.abs(row) / (comparison.outlier_limit * deviations(factor)))[:, None]
        for factor, row in zip(factors, rest, strict=True)
    ]
    again = tuple(trusted)
    return _align(movement, response, parts, again, comparison, sensitivities, shift)


def deviations(factor: Floats) -> Floats:
    """Return the standard deviation of each bin from the factor of its covariance."""
    return np.asarray(np.sqrt((factor**2).sum(axis=1)), dtype=np.float64)


def _align(
    movement: MeasuredMovement,
    response: Response,
    parts: list[tuple[Signal, NDArray[np.intp]]],
    factors: tuple[Floats, ...],
    comparison: Comparison,
    sensitivities: Mapping[str, Sensitivity],
    shift: float,
) -> Alignment:
    """Estimate the nuisances of a movement, the onset iteratively, and whiten by them."""
    measured = np.concatenate([signal.values[bins] for signal, bins in parts])
    spread = (
        comparison.uncertainty.clocked_onset if movement.clocked else comparison.uncertainty.onset
    )
    names = ["onset", *sensitivities]
    scales = [spread, *(comparison.scatter[name] for name in sensitivities)]
    channels = _without_noise(_channel_columns(parts, measured, comparison.uncertainty), factors)
    ahead = prediction(response, movement, parts)
    pairs = [
        (prediction(s.stepped, movement, parts), prediction(s.simulated, movement, parts), s.step)
        for s in sensitivities.values()
    ]
    lead, rate = comparison.lead, comparison.rate
    time = np.concatenate([signal.time[bins] for signal, bins in parts])
    for _ in range(ONSET_ITERATIONS):
        turned = (ahead.row(shift + ONSET_STEP, rate) - ahead.row(shift - ONSET_STEP, rate)) / (
            2.0 * ONSET_STEP
        )
        columns = [turned] + [
            (aside.row(shift, rate) - here.row(shift, rate)) / step for aside, here, step in pairs
        ]
        places = np.array([shift - lead, *(s.effect for s in sensitivities.values())])
        plain = np.column_stack(columns)
        clock = time * turned / (1.0 + rate) ** 2
        rest = measured - ahead.row(shift, rate) + plain @ places
        both = _without_noise(np.column_stack([plain * scales, rest]), factors)
        clean = np.column_stack([both[:, :-1], channels])
        inverse = np.linalg.inv(np.eye(clean.shape[1]) + clean.T @ clean)
        solve = inverse @ clean.T
        found = solve @ both[:, -1]
        before = shift
        shift = float(np.clip(lead + found[0] * spread, -MAX_ONSET_SHIFT, MAX_ONSET_SHIFT))
        if abs(shift - before) < 1e-4:
            break
    basis, sizes, _ = np.linalg.svd(clean, full_matrices=False)
    return Alignment(
        movement=movement,
        parts=parts,
        measured=measured,
        shift=before,
        lead=lead,
        columns=plain,
        clock=clock,
        rate=rate,
        effects={name: s.effect for name, s in sensitivities.items()},
        factors=factors,
        basis=basis,
        shrink=1.0 - 1.0 / np.sqrt(1.0 + sizes**2),
        estimator=np.array(scales)[:, None] * solve[: len(scales)],
        estimates={
            name: (
                float(found[n] * scale) + (lead if n == 0 else 0.0),
                float(np.sqrt(inverse[n, n]) * scale),
            )
            for n, (name, scale) in enumerate(zip(names, scales, strict=True))
        },
        channels=_channel_estimates(found[len(scales) :], comparison.uncertainty),
    )


def _channel_estimates(found: Floats, known: Uncertainty) -> tuple[tuple[float, float], ...]:
    """Return zero [N] and gain [-] of each part, from what `_channel_columns` are taken by."""
    return tuple(
        (float(zero) * known.zero, float(gain) * known.gain) for zero, gain in found.reshape(-1, 2)
    )


def _channel_columns(
    parts: Sequence[tuple[Signal, NDArray[np.intp]]], measured: Floats, uncertainty: Uncertainty
) -> Floats:
    """Return a column for the zero and one for the gain of each part."""
    columns = np.zeros((measured.size, 2 * len(parts)))
    for number, (_, _, place) in enumerate(_pieces(parts)):
        columns[place, 2 * number] = uncertainty.zero
        columns[place, 2 * number + 1] = uncertainty.gain * measured[place]
    return columns
