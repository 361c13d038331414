r"""The benchmark as arrays: training and test throws as recorded, with labels and groups.

Training switches and test switches have no panel in common, and judged throws lie in other seasons
than the history of their switch. The stored throws are exact simulations. The recorded ones follow
from them and from the number of the switch alone, so that all methods see the same numbers:

.. math:: r = (1 + g)\,[y(t - \tau) + A\,(d_s + d_t)] + z + e

with the gain error :math:`g` and discrepancy :math:`d_s` fixed for a switch, and the onset error
:math:`\tau` of each movement, the discrepancy :math:`d_t`, the zero :math:`z` and the noise
:math:`e` drawn for each throw. :math:`d_s + d_t` has the standard deviation and the kernel
:math:`e^{-|t|/T}` of the reference case, half of its variance each.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from benchmarks.detection.definition import HISTORY, MARKERS, SEED, TEST, TRAIN, panels_study
from benchmarks.detection.make_throws import MISSING, data_digest, fine_layout, read_throws_file
from turnout.core.errors import StudyError
from turnout.detection.detector.allowances import Allowances
from turnout.detection.detector.throw_layout import Layout
from turnout.detection.detector.training import layout_of_panel

Floats = NDArray[np.float64]
CHANNELS = ("force", "current", "power")
TRACKS = (MARKERS, "machines")
SEASONS = ("winter", "spring", "summer", "autumn")
LABELS = (
    "role",
    "kind",
    "place",
    "machine",
    "panel",
    "size",
    "x",
    "level",
    "object_force",
    "locked",
)


@dataclass(frozen=True, eq=False)
class Side:
    """Training or test throws.

    Attributes
    ----------
    throw : ndarray of int, shape (n,)
        Number of each throw in the benchmark; verdicts name it.
    histories : ndarray, shape (n, n_signals, n_samples)
        As recorded, from 0.12 s before each movement on [N], [A] or [W].
    features : ndarray, shape (n, n_features)
        The same as means over windows of 80 ms (opening) and 40 ms (closing), signal by signal.
    labels : mapping of str to ndarray, shape (n,)
        role ("history", "sound", "object", or another cause), kind, place, size [m], x [m], level
        (friction) [-], object_force [N], locked, season, machine, panel.
    gaps : ndarray, shape (n, 4)
        After the throw, in the order of `positions` [m].
    groups : ndarray of int, shape (n,)
        Number of the switch.
    partner : ndarray of int, shape (n,)
        Row of the sound throw of the same switch in the same state; -1 of sound throws.
    clean : ndarray, shape (n, n_signals, n_samples)
        Simulated, without what a recorder adds; of training throws only, else empty.
    inputs : ndarray, shape (n, n_inputs)
        What is fixed for the switch; of training throws only, else empty.
    positions : tuple of str
        Of the gaps.
    """

    throw: NDArray[np.intp]
    histories: Floats
    features: Floats
    labels: Mapping[str, NDArray[Any]]
    gaps: Floats
    groups: NDArray[np.intp]
    partner: NDArray[np.intp]
    clean: Floats
    inputs: Floats
    positions: tuple[str, ...]

    @cached_property
    def judged(self) -> NDArray[np.bool_]:
        """Throws that are judged: all but the histories of the switches."""
        return np.asarray(self.labels["role"] != HISTORY)

    def known(self, history: int) -> NDArray[np.bool_]:
        """Return the first throws of the history of each switch.

        Parameters
        ----------
        history : int
            How many; fewer where a switch has fewer.
        """
        found = np.zeros(len(self.throw), dtype=bool)
        for switch in np.unique(self.groups):
            own = np.flatnonzero((self.groups == switch) & ~self.judged)
            found[own[:history]] = True
        return found

    def of(self, index: NDArray[Any]) -> "Side":
        """Return some throws; partners that are not among them become -1."""
        rows = np.arange(len(self.throw))[index]
        new = np.full(len(self.throw), -1)
        new[rows] = np.arange(len(rows))
        partner = self.partner[rows]
        return replace(
            self,
            throw=self.throw[rows],
            histories=self.histories[rows],
            features=self.features[rows],
            labels={name: item[rows] for name, item in self.labels.items()},
            gaps=self.gaps[rows],
            groups=self.groups[rows],
            partner=np.where(partner < 0, -1, new[partner]),
            clean=self.clean[rows] if len(self.clean) else self.clean,
            inputs=self.inputs[rows] if len(self.inputs) else self.inputs,
        )


@dataclass(frozen=True, eq=False)
class Benchmark:
    """The benchmark under one set of conditions; made by `open_benchmark`.

    Attributes
    ----------
    train, test : Side
        Throws.
    layout : Layout
        Windows of the features of one signal.
    time : ndarray, shape (n_samples,)
        Of the samples of a history, on the nominal throw [s].
    signals : tuple of str
        Such as "force 1".
    history : int
        Sound throws that are known of each switch.
    errors : Allowances
        What was added to the simulated throws.
    track : str
        "markers" or "machines".
    amplitude : mapping of str to ndarray, shape (n_signals,)
        Peak of the mean sound throw, by machine; markers have the name "".
    attrs : mapping of str to object
        Digests of definition, data, and those of this track (`track_data`); counts, version.
    """

    train: Side
    test: Side
    layout: Layout
    time: Floats
    signals: tuple[str, ...]
    history: int
    errors: Allowances
    track: str
    amplitude: Mapping[str, Floats]
    attrs: Mapping[str, Any]


def open_benchmark(
    folder: Path | str,
    *,
    history: int = 20,
    discrepancy: float = 0.05,
    channels: str = "force",
    track: str = MARKERS,
) -> Benchmark:
    """Open the benchmark that `python -m benchmarks.detection run` made.

    Parameters
    ----------
    folder : path-like
        That it was made in.
    history : int
        Sound throws that are known of each switch: `bench.test.known(bench.history)`.
    discrepancy : float
        Between model and switch, share of the peak force [-].
    channels : str
        "force", "current" or "power"; the last two of the track "machines" only.
    track : str
        "markers", whose drives follow a schedule, or "machines".

    Raises
    ------
    FileError
        When the folder holds no benchmark, or a damaged one.
    StudyError
        When conditions are not valid, with all of them.

    Examples
    --------
    >>> bench = open_benchmark("benchmark")  # doctest: +SKIP
    >>> bench.train.features.shape, bench.train.groups  # doctest: +SKIP
    """
    errors = _errors_under(history, discrepancy, channels, track)
    whole = read_throws_file(Path(folder))
    own = whole.isel(throw=np.flatnonzero(whole["track"].to_numpy() == track))
    signals = tuple(name for name in whole["signal"].to_numpy().tolist()
                    if name.startswith(channels))  # fmt: skip
    layout = layout_of_panel(panels_study().panel)
    clean = _clean(own, signals)
    sound = np.isin(own["role"].to_numpy(), [HISTORY, "sound"])
    training = own["split"].to_numpy() == TRAIN
    fine = fine_layout(layout)
    onsets = np.array([part.start for part in fine.parts])
    time = own["time"].to_numpy()
    machine = own["machine"].to_numpy()
    peak = {}
    for name in np.unique(machine):
        rows = sound & (machine == name)
        rows = rows & training if np.any(rows & training) else rows
        peak[str(name)] = amplitudes(clean[rows], time, onsets)
    seen = _recorded(own, clean, signals, fine, peak, errors)
    sides = {
        split: _side(own, np.flatnonzero(own["split"].to_numpy() == split), clean, seen, layout)
        for split in (TRAIN, TEST)
    }
    return Benchmark(
        train=sides[TRAIN], test=sides[TEST], layout=layout, time=time, signals=signals,
        history=history, errors=errors, track=track,
        amplitude=peak,
        attrs={**whole.attrs, "track_data": data_digest(own)},
    )  # fmt: skip


def judged_labels(
    folder: Path | str, *, history: int, discrepancy: float, channels: str, track: str
) -> Side:
    """Return the labels of the judged test throws, without their histories.

    That is all that a score needs, and takes a hundredth of the time. Conditions are those of
    `open_benchmark`.
    """
    _errors_under(history, discrepancy, channels, track)
    whole = read_throws_file(Path(folder), recorded=False)
    own = whole.isel(throw=np.flatnonzero(whole["track"].to_numpy() == track))
    nothing = np.zeros((own.sizes["throw"], 0, 0))
    rows = np.flatnonzero(own["split"].to_numpy() == TEST)
    side = _side(own, rows, nothing, nothing, None)
    return side.of(side.judged)


def _errors_under(history: int, discrepancy: float, channels: str, track: str) -> Allowances:
    """Return the errors of a recorder under some conditions; refuse invalid ones, all at once."""
    faults = []
    if history < 0:
        faults.append(f"history = {history}: must be a number of throws, 0 or more")
    if channels not in CHANNELS:
        faults.append(f'channels = "{channels}": allowed are {", ".join(CHANNELS)}')
    if track not in TRACKS:
        faults.append(f'track = "{track}": allowed are {" and ".join(TRACKS)}')
    elif channels != "force" and track == MARKERS:
        faults.append(f'channels = "{channels}": only switches of the track "machines" have them')
    if faults:
        raise StudyError(faults, source="benchmark")
    return Allowances(discrepancy=discrepancy)


def _clean(own: xr.Dataset, signals: tuple[str, ...]) -> NDArray[np.float64]:
    stored = own["history"].sel(signal=list(signals)).to_numpy()
    quantum = own["quantum"].sel(signal=list(signals)).to_numpy()
    return np.where(stored == MISSING, 0.0, stored * quantum[:, np.newaxis])


def _recorded(
    own: xr.Dataset,
    clean: Floats,
    signals: tuple[str, ...],
    fine: Layout,
    peak: Mapping[str, Floats],
    errors: Allowances,
) -> Floats:
    found = np.empty_like(clean)
    switches, machine = own["switch"].to_numpy(), own["machine"].to_numpy()
    for switch in np.unique(switches):
        rows = np.flatnonzero(switches == switch)
        recorder = Recorder(
            signals=signals, time=own["time"].to_numpy(), part=fine.part[: fine.windows],
            amplitude=peak[machine[rows[0]]], rate=float(own["rate"][rows[0]]),
        )  # fmt: skip
        found[rows] = recorded(clean[rows], recorder, switch=int(switch), errors=errors)
    return found


def _side(
    own: xr.Dataset,
    rows: NDArray[np.intp],
    clean: Floats,
    seen: Floats,
    layout: Layout | None,
) -> Side:
    """Return some throws; without a layout they have no features."""
    training = bool(len(rows)) and own["split"].to_numpy()[rows[0]] == TRAIN
    labels = {name: own[name].to_numpy()[rows] for name in LABELS}
    quarter = (4.0 * (own["moment"].to_numpy()[rows] + 1.0 / 12.0)).astype(int) % 4
    labels["season"] = np.array(SEASONS)[quarter]
    number = own["throw"].to_numpy()[rows]
    partner = own["partner"].to_numpy()[rows]
    return Side(
        throw=number.astype(np.intp),
        histories=seen[rows],
        features=np.zeros((len(rows), 0))
        if layout is None
        else window_features(seen[rows], layout),
        labels=labels,
        gaps=own["gap"].to_numpy()[rows],
        groups=own["switch"].to_numpy()[rows].astype(np.intp),
        partner=np.where(partner < 0, -1, np.searchsorted(number, partner)),
        clean=clean[rows] if training else clean[:0],
        inputs=own["inputs"].to_numpy()[rows] if training else own["inputs"].to_numpy()[:0],
        positions=tuple(own["position"].to_numpy().tolist()),
    )


def window_features(histories: Floats, layout: Layout) -> Floats:
    """Return means of histories over the windows of a layout, shape (n, signals * windows).

    Parameters
    ----------
    histories : ndarray, shape (n, n_signals, n_samples)
        Means over shorter windows that these consist of.
    layout : Layout
        Of the features.
    """
    fine = fine_layout(layout)
    found, at = [], 0
    for coarse, small in zip(layout.parts, fine.parts, strict=True):
        own = histories[..., at : at + small.count]
        at += small.count
        found.append(own.reshape(*own.shape[:-1], coarse.count, -1).mean(axis=-1))
    return np.asarray(np.concatenate(found, axis=-1).reshape(len(histories), -1))


# ---- recorder

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
    """Return the recorded histories of the throws of one switch.

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
