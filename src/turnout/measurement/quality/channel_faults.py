"""Faults of a single recorded channel: holes, held and clipped samples, silence, mains hum.

`Fault` and `Limits`, which all checks of a recording share, stand here too.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr

from turnout.core.moving_average import moving_average
from turnout.measurement.campaign.find_throws import FoundThrow
from turnout.measurement.campaign.motion_signals import (
    Floats,
    bridge_gaps,
    longest_true_run,
    spikes,
    without_spikes,
)

KINDS = (
    "unit",
    "clipping",
    "drop-out",
    "missing samples",
    "dead channel",
    "swapped channels",
    "reversed polarity",
    "direction",
    "sampling rate",
    "mains hum",
    "truncated",
    "triggered",
    "spikes",
    "drift",
    "zero offset",
    "quantisation",
)


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault of a recorded throw.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    channel : str
        Such as "drive_force 2"; empty for the whole throw.
    text : str
        Description, with the figure and its limit.
    excludes : bool
        Whether the throw must not be used.
    """

    kind: str
    channel: str
    text: str
    excludes: bool = True

    def __str__(self) -> str:
        """Give the line that a user reads."""
        where = f" of {self.channel}" if self.channel else ""
        return f"{self.kind}{where}: {self.text}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelLimits:
    """Sizes in a channel from which on a deviation is a fault, in its unit [N, A, W].

    Attributes
    ----------
    response : float
        Least change in a throw, else it is dead.
    hum : float
        Amplitude of a line of the mains.
    spike : float
        Height of a single sample above its neighbours.
    offset : float
        Departure of the zero: of a rod force from the rest of the campaign, of a current and of the
        load cell from nothing.
    step : float
        Least difference of two samples.
    """

    response: float = 0.0
    hum: float = np.inf
    spike: float = np.inf
    offset: float = np.inf
    step: float = np.inf


CHANNEL_LIMITS: Mapping[str, ChannelLimits] = {
    "drive_force": ChannelLimits(response=60.0, hum=60.0, spike=500.0, offset=750.0, step=50.0),
    "drive_current": ChannelLimits(response=0.2, hum=0.1, spike=2.0, offset=0.15, step=0.05),
    "drive_voltage": ChannelLimits(),
    "drive_power": ChannelLimits(response=50.0, step=25.0),
    "object_force": ChannelLimits(response=40.0, hum=60.0, spike=5000.0, offset=200.0, step=50.0),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Sizes from which on a deviation is a fault.

    Attributes
    ----------
    longest_hole : float
        Missing samples in a row [s].
    missing_share : float
        Missing samples of all.
    least_run : int
        Equal samples in a row, in a channel that has noise.
    clipped_share : float
        Samples at the very largest or least value.
    channels : mapping of str to ChannelLimits
        By channel.
    mains : tuple of float
        Frequencies of lines that mains put into cables [Hz].
    rate_share : float
        Departure of a stated sampling rate.
    pace_share : float
        Departure of the pace of a throw from that of the campaign; voltage alone makes some.
    least_rest : float
        Rest before the onset and after the end [s].
    polarity_force : float
        Change of a rod force against the direction [N].
    swap_gain : float
        How many times better channels must fit when they are swapped.
    most_drift : float
        Change of the zero of a force in the time that is kept of a throw [N].
    """

    longest_hole: float = 0.01
    missing_share: float = 0.005
    least_run: int = 6
    clipped_share: float = 0.005
    channels: Mapping[str, ChannelLimits] = field(default_factory=lambda: CHANNEL_LIMITS)
    mains: tuple[float, ...] = (50.0 / 3.0, 50.0, 60.0, 100.0, 150.0)
    rate_share: float = 0.002
    pace_share: float = 0.12
    least_rest: float = 0.15
    polarity_force: float = 100.0
    swap_gain: float = 2.0
    most_drift: float = 200.0


UNITS = {
    "drive_force": "N",
    "drive_current": "A",
    "drive_voltage": "V",
    "drive_power": "W",
    "object_force": "N",
}
"""Units of what is measured."""
MEASURED = tuple(UNITS)
# A run of equal samples is by chance once in this many throws.
CHANCE = 1e-4
# A switch is thrown with some kilonewtons, and no object bears more than this [N].
MOST_FORCE = 2e5
# A tenth of the samples beyond it are no spikes.
SPIKE_QUANTILE = 0.9
# Over which a calibration takes means of measured forces [s].
BIN = 0.02
# So many equal samples from the start on are a rest without noise.
LEAST_REST = 10


@dataclass(frozen=True, slots=True, eq=False)
class RawChannel:
    """A measured channel of a throw.

    Attributes
    ----------
    name, key : str
        Such as "drive_force 2", and its variable "drive_force".
    values : ndarray, shape (n,)
        Samples [`unit`].
    rate : float
        Samples a second [1/s].
    begin, finish : int
        Samples at which the movement begins and ends.
    """

    name: str
    key: str
    values: Floats
    rate: float
    begin: int = 0
    finish: int = 0

    @property
    def unit(self) -> str:
        """Unit of the samples."""
        return UNITS[self.key]


def channel_faults(dataset: xr.Dataset, throw: FoundThrow, *, limits: Limits) -> list[Fault]:
    """Find the faults of each channel on its own.

    Parameters
    ----------
    dataset : xarray.Dataset
        One throw, unfiltered.
    throw : FoundThrow
        Onset and end of the movement within the dataset [s].
    limits : Limits
        From what size on something is a fault.

    Returns
    -------
    list of Fault
    """
    return [f for channel in measured_channels(dataset, throw) for f in _faults(channel, limits)]


def _faults(raw: RawChannel, limits: Limits) -> Iterator[Fault]:
    """Yield the faults of a channel; those that another one explains are not looked for."""
    if raw.key == "drive_force" and not np.isfinite(raw.values).any():
        yield Fault("dead channel", raw.name, "it was not recorded")
        return
    holes = list(hole_fault(raw, limits))
    yield from holes
    channel = replace(raw, values=bridge_gaps(raw.values))
    if not mostly_beyond(channel.values, key=channel.key):
        yield from quantisation_fault(channel, limits)
        teeth = list(spike_fault(channel, limits))
        yield from teeth
        if any(fault.excludes for fault in teeth):
            return
    gross = list(unit_fault(channel)) or list(dead_fault(channel, limits))
    yield from gross
    if gross:
        return
    if not holes:
        yield from run_faults(channel, limits)
    yield from hum_faults(channel, limits)


def measured_channels(dataset: xr.Dataset, throw: FoundThrow | None = None) -> Iterator[RawChannel]:
    """Yield each measured channel; without a throw it has no beginning and end.

    Examples
    --------
    >>> data = xr.Dataset(
    ...     {"drive_force": (("drive", "time"), [[0.0, 1.0]])}, {"drive": ["2"], "time": [0.0, 0.5]}
    ... )
    >>> [(channel.name, channel.rate) for channel in measured_channels(data)]
    [('drive_force 2', 2.0)]
    """
    time = dataset["time"].values
    rate = (time.size - 1) / float(time[-1] - time[0])
    ends = (throw.onset, throw.end) if throw is not None else (time[0], time[0])
    begin, finish = (int(np.searchsorted(time, at)) for at in ends)
    for key in (key for key in MEASURED if key in dataset):
        of_drives = "drive" in dataset[key].dims
        anything = bool(np.isfinite(dataset[key].values).any())
        for drive in dataset["drive"].values if of_drives else [""]:
            row = dataset[key].sel(drive=drive) if of_drives else dataset[key]
            # One current for two machines is no force, and theirs are no currents of their own.
            own = "+" not in str(drive) if key == "drive_force" else not anything
            if not (own or np.isfinite(row.values).any()):
                continue
            yield RawChannel(f"{key} {drive}".rstrip(), key, row.values, rate, begin, finish)


def hole_fault(channel: RawChannel, limits: Limits) -> Iterator[Fault]:
    """Find missing samples: one long hole, or many short ones."""
    missing = ~np.isfinite(channel.values)
    if not missing.any():
        return
    longest, share = longest_true_run(missing) / channel.rate, float(missing.mean())
    text = f"{100 * share:.1f} % of the samples, {1e3 * longest:.0f} ms in a row"
    excludes = longest > limits.longest_hole or share > limits.missing_share
    allowed = f"at most {100 * limits.missing_share:g} % or {1e3 * limits.longest_hole:g} ms"
    text += f"; {allowed}" if excludes else ", bridged by straight lines"
    yield Fault("missing samples", channel.name, text, excludes=excludes)


def spike_fault(channel: RawChannel, limits: Limits) -> Iterator[Fault]:
    """Find samples that stand alone, as a bad contact or a radio makes them.

    A rail that strikes an object makes a peak of a sample or two as well, so on a load cell a
    spike is remarked and excludes nothing.
    """
    values, rate, unit = channel.values, channel.rate, channel.unit
    most = limits.channels[channel.key].spike
    count = int(spikes(values, rate=rate, least=most).sum())
    if not count:
        return
    height = float(np.max(np.abs(values - without_spikes(values, rate=rate, least=most))))
    what = "1 sample stands" if count == 1 else f"{count} samples stand"
    text = f"{what} up to {in_words(height, unit)} above or below the ones around, which is more "
    text += f"than {most:g} {unit}"
    yield Fault("spikes", channel.name, text, excludes=channel.key != "object_force")


def quantisation_fault(channel: RawChannel, limits: Limits) -> Iterator[Fault]:
    """Find a converter with steps that are too large for its signal.

    Examples
    --------
    >>> coarse = 2000.0 * np.round(np.linspace(0.0, 3.0, 50))
    >>> str(*quantisation_fault(RawChannel("drive_force 1", "drive_force", coarse, 1e3), Limits()))
    'quantisation of drive_force 1: it has steps of 2 kN, at most 50 N expected'
    """
    levels = np.unique(channel.values)
    steps = np.diff(levels)
    steps = steps[steps > 1e-9 * max(float(np.ptp(levels)), 1e-300)]
    most, unit = limits.channels[channel.key].step, channel.unit
    if not steps.size or float(steps.min()) <= most:
        return
    text = f"it has steps of {in_words(float(steps.min()), unit)}, at most {most:g} {unit} expected"
    yield Fault("quantisation", channel.name, text, excludes=False)


def mostly_beyond(values: Floats, *, key: str) -> bool:
    """Return True if a force is too large for a rod for more than a moment, unlike spikes."""
    return UNITS[key] == "N" and float(np.quantile(np.abs(values), SPIKE_QUANTILE)) > MOST_FORCE


def in_words(value: float, unit: str) -> str:
    """Return a value with its unit, large forces in kN.

    Examples
    --------
    >>> in_words(80512.0, "N"), in_words(7.2e6, "N"), in_words(0.12345, "A")
    ('80.5 kN', '7200 kN', '0.123 A')
    """
    if unit == "N" and value >= 1e3:
        kilo = value / 1e3
        return f"{kilo:.0f} kN" if kilo >= 100.0 else f"{kilo:.3g} kN"
    return f"{value:.3g} {unit}"


def unit_fault(channel: RawChannel) -> Iterator[Fault]:
    """Find a force that no rod carries, as with newtons taken for kilonewtons.

    Examples
    --------
    >>> str(*unit_fault(RawChannel("drive_force 1", "drive_force", np.array([0.0, 7.2e6]), 1e3)))
    'unit of drive_force 1: up to 7200 kN, at most 200 kN are believed; check its unit'
    """
    largest = float(np.max(np.abs(channel.values), initial=0.0))
    if channel.unit == "N" and largest > MOST_FORCE:
        most = in_words(MOST_FORCE, "N")
        text = f"up to {in_words(largest, 'N')}, at most {most} are believed; check its unit"
        yield Fault("unit", channel.name, text)


def dead_fault(channel: RawChannel, limits: Limits) -> Iterator[Fault]:
    """Find a channel that does not answer to a throw.

    A load cell is only remarked upon: an object that the rail does not reach is not squeezed.
    """
    around = round(0.2 * channel.rate)
    smooth = moving_average(channel.values, rate=channel.rate)
    smooth = smooth[max(0, channel.begin - around) : channel.finish + around]
    least = limits.channels[channel.key].response
    response = float(np.ptp(smooth)) if smooth.size else 0.0
    if response >= least:
        return
    # Rounding errors of a constant column are no response.
    size, unit = response if response > 1e-6 * least else 0.0, channel.unit
    text = f"it changes by {size:.3g} {unit} in the throw, at least {least:g} {unit} expected"
    yield Fault("dead channel", channel.name, text, excludes=channel.key != "object_force")


def run_faults(channel: RawChannel, limits: Limits) -> Iterator[Fault]:
    """Find samples held at one value: at the edge of the range it is clipping, else a drop-out.

    A channel whose samples repeat at rest and after the throw has no noise to judge by, nor has one
    that is exactly constant from the first sample until the motion begins: held by chance, it
    would not wake with the motion.
    """
    values, name, begin = channel.values, channel.name, channel.begin
    if is_noise_free(values[: max(0, begin - 5)], span=float(np.ptp(values))):
        return
    repeats = repeated_share(values, begin, channel.finish)
    if repeats > 0.7:
        return
    allowed = limits.least_run
    if repeats > 0.0:
        by_chance = 1.0 + np.log(CHANCE / values.size) / np.log(repeats)
        allowed = max(allowed, int(np.ceil(by_chance)))
    largest, least = float(values.max()), float(values.min())
    span = largest - least
    rest = float(np.median(values[: max(begin, 1)]))
    held = np.ones(values.size, dtype=bool)
    for edge in (largest, least):
        at_edge = np.abs(values - edge) <= 1e-9 * span
        # A range ends away from the rest, where a quiet channel lies.
        if abs(edge - rest) < 0.1 * span:
            continue
        count, run = int(at_edge.sum()), longest_true_run(at_edge)
        if run >= allowed or count > max(limits.clipped_share * values.size, allowed):
            text = f"{count} samples at the edge of the range, {run} of them in a row"
            yield Fault("clipping", name, text)
            held &= ~at_edge
    same = np.abs(np.diff(values)) <= 1e-9 * span
    run = longest_true_run(same & held[1:] & held[:-1]) + 1
    if run >= allowed:
        text = f"{run} equal samples in a row, fewer than {allowed} expected of its noise"
        yield Fault("drop-out", name, text)


def is_noise_free(rest: Floats, *, span: float) -> bool:
    """Return True if a rest has no noise at all, as in a recording that a program wrote.

    Examples
    --------
    >>> is_noise_free(np.zeros(20), span=1e3), is_noise_free(np.r_[np.zeros(19), 0.1], span=1e3)
    (True, False)
    """
    return rest.size >= LEAST_REST and bool(np.ptp(rest) <= 1e-7 * span)


def repeated_share(values: Floats, begin: int, finish: int) -> float:
    """Return the share of samples at rest that are equal to the one before.

    Of the rest before and the hold after, the livelier counts, as the other may be held. One where
    samples do not go up and down by turns has no noise.
    """
    shares = [1.0]
    for part in (values[: max(0, begin - 5)], values[finish + 5 :]):
        if part.size <= 50:
            continue
        steps = np.diff(part)
        turns = float(np.mean(steps[1:] * steps[:-1] < 0.0))
        if turns > 0.2:
            shares.append(float(np.mean(steps == 0)))
    return min(shares)


def hum_faults(channel: RawChannel, limits: Limits) -> Iterator[Fault]:
    """Find a steady line of the mains whose amplitude is above its limit, after the inrush.

    A load cell that is struck rings at a few tens of hertz and dies away; mains do not.
    """
    rate, unit = channel.rate, channel.unit
    part = channel.values[channel.begin + round(0.2 * rate) : channel.finish]
    most = limits.channels[channel.key].hum
    for frequency in limits.mains:
        if frequency > 0.4 * rate or part.size * frequency < 10 * rate:
            continue
        amplitude = steady_amplitude(part, frequency=frequency, rate=rate)
        if amplitude > most:
            text = f"{amplitude:.3g} {unit} at {frequency:.4g} Hz, at most {most:g} {unit}"
            # A whole number of its periods is in each bin of 20 ms that a calibration compares.
            cancelled = frequency * BIN == round(frequency * BIN)
            text += "; means over 20 ms cancel it" if cancelled else ""
            yield Fault("mains hum", channel.name, text, excludes=not cancelled)


# A line is looked for in overlapping parts of a movement, of so many periods at least.
PARTS, PERIODS = 4, 10


def steady_amplitude(values: Floats, *, frequency: float, rate: float) -> float:
    """Return the amplitude that a line has throughout: the median over overlapping parts.

    A part is a quarter of the whole, at least ten periods of the line. Of what dies away, as a
    ringing after an impact, most parts hold nothing.

    Examples
    --------
    >>> time = np.arange(3000) / 1000.0
    >>> line = 80.0 * np.sin(2.0 * np.pi * 50.0 * time)
    >>> round(steady_amplitude(line, frequency=50.0, rate=1000.0), 1)
    80.0
    >>> ringing = np.where(time > 1.5, line * np.exp(-(time - 1.5) / 0.15), 0.0)
    >>> steady_amplitude(8.0 * ringing, frequency=50.0, rate=1000.0) < 20.0
    True
    """
    length = min(values.size, max(values.size // PARTS, int(np.ceil(PERIODS * rate / frequency))))
    starts = np.unique(np.linspace(0, values.size - length, 2 * PARTS - 1).astype(int))
    return float(
        np.median(
            [
                line_amplitude(values[start : start + length], frequency=frequency, rate=rate)
                for start in starts
            ]
        )
    )


def line_amplitude(values: Floats, *, frequency: float, rate: float) -> float:
    """Return the amplitude of a line in a spectrum, whatever slower the channel does.

    A slow cubic is taken off first; a Hann window keeps the rest of it away from the line.

    Examples
    --------
    >>> time = np.arange(3000) / 1000.0
    >>> hum = 20.0 * np.sin(2.0 * np.pi * 50.0 * time) + 500.0 * time
    >>> round(line_amplitude(hum, frequency=50.0, rate=1000.0), 2)
    20.0
    """
    index = np.arange(values.size)
    scaled = 2.0 * index / max(1, values.size - 1) - 1.0
    slow = np.polynomial.polynomial.polyfit(scaled, values, 3)
    fast = values - np.polynomial.polynomial.polyval(scaled, slow)
    window = np.hanning(values.size)
    wave = np.exp(-2j * np.pi * frequency / rate * index)
    return float(2.0 * np.abs(np.sum(window * fast * wave)) / np.sum(window))
