"""Judgement of the recording of a throw: usable or not, every fault with its reason.

Faults that channels show only together are found here: truncation, pace, polarity, swaps.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from turnout.core.moving_average import moving_average
from turnout.measurement.campaign.find_throws import FoundThrow
from turnout.measurement.campaign.motion_signals import (
    CLOSING,
    OPENING,
    Floats,
    bridge_gaps,
    drift,
    exchanged_pairs,
    force_changes,
)
from turnout.measurement.quality.channel_faults import (
    Fault,
    Limits,
    channel_faults,
    measured_channels,
)

# The part of a throw that no object has a say in yet, and its samples [s].
EARLY, EARLY_STEP = 1.5, 0.02
# Of the rest before a closing and after an opening movement, where the zero is checked [s].
REST_WINDOW = 0.3
# Heights of a profile that another friction can explain.
GAINS = (0.75, 1.33)
PACES = np.exp(np.linspace(np.log(0.4), np.log(2.5), 93))


@dataclass(frozen=True, slots=True, eq=False)
class ForceProfile:
    """Start of throws of one direction: channels over time since the onset, less their rest.

    Attributes
    ----------
    forces, currents : ndarray, shape (n_drives, n)
        Every 20 ms for 1.5 s [N, A]; `currents` has no rows where none were measured.
    """

    forces: Floats
    currents: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Expected:
    """Facts about a throw known before its samples are examined.

    Attributes
    ----------
    direction : str or None
        "closing" or "opening", as the run sheet says.
    load_cell : bool
        Whether a load cell was mounted.
    rate : float or None
        Samples a second that all recordings of the campaign should have [1/s].
    profile : ForceProfile or None
        How most throws of the campaign in this direction begin.
    open_level : ndarray or None, shape (n_drives,)
        Force of the rods in most of them while the rail is open [N].
    """

    direction: str | None = None
    load_cell: bool = True
    rate: float | None = None
    profile: ForceProfile | None = None
    open_level: Floats | None = None


@dataclass(frozen=True, slots=True, eq=False)
class SeenThrow:
    """A throw to be judged.

    Attributes
    ----------
    dataset : xarray.Dataset
        The part of the recording that holds it, unfiltered.
    throw : FoundThrow
        Onset and end of the movement.
    limits : Limits
        From what size on something is a fault.
    expected : Expected
        Knowledge of the campaign.
    """

    dataset: xr.Dataset
    throw: FoundThrow
    limits: Limits
    expected: Expected

    @property
    def time(self) -> Floats:
        """Times of the samples, shape (n,) [s]."""
        return np.asarray(self.dataset["time"].values)

    @property
    def rate(self) -> float:
        """Samples a second [1/s]."""
        return (self.time.size - 1) / float(self.time[-1] - self.time[0])

    @property
    def drives(self) -> list[str]:
        """Names of the drives."""
        return [str(name) for name in self.dataset["drive"].values]


def early_profile(dataset: xr.Dataset, throw: FoundThrow) -> ForceProfile | None:
    """Return the profile of the start of a throw.

    Parameters
    ----------
    dataset : xarray.Dataset
        The recording, or the part of it that holds the throw; unfiltered.
    throw : FoundThrow
        Onset of the movement within the dataset [s].

    Returns
    -------
    ForceProfile or None
        None where the recording does not reach from the onset over its 1.5 s.
    """
    return next(iter(_at_paces(dataset, throw, [1.0])), None)


def _at_paces(
    dataset: xr.Dataset, throw: FoundThrow, paces: Iterable[float]
) -> list[ForceProfile | None]:
    """Return the profile of the start of a throw for a recording at each of several paces."""
    time = dataset["time"].values
    if throw.cut_start or throw.onset - 0.1 < time[0]:
        return [None for _ in paces]
    rate = (time.size - 1) / float(time[-1] - time[0])
    rest = (time >= throw.onset - 0.3) & (time < throw.onset - 0.01)
    smooth: dict[str, list[Floats]] = {"drive_force": [], "drive_current": []}
    for name in (name for name in smooth if name in dataset):
        rows = dataset[name].transpose("drive", "time").values
        means = moving_average(bridge_gaps(rows), rate=rate, window=0.04)
        smooth[name] = [row - np.median(row[rest]) for row in means]
    found: list[ForceProfile | None] = []
    for pace in paces:
        wanted = throw.onset + pace * np.arange(0.0, EARLY, EARLY_STEP)
        if wanted[-1] > time[-1]:
            found.append(None)
            continue
        at = np.clip(np.rint((wanted - time[0]) * rate).astype(int), 0, time.size - 1)
        profile = (np.array([r[at] for r in s]).reshape(-1, at.size) for s in smooth.values())
        found.append(ForceProfile(*profile))
    return found


def typical_profile(profiles: Sequence[ForceProfile]) -> ForceProfile | None:
    """Return the median of profiles, typical of the throws of a direction.

    Three are needed, as two that differ do not show which of them is wrong.

    Examples
    --------
    >>> some = [ForceProfile(np.full((1, 3), level), np.empty((0, 3))) for level in (1.0, 2.0, 9.0)]
    >>> typical_profile(some).forces
    array([[2., 2., 2.]])
    """
    if len(profiles) < 3:
        return None
    shape = max({p.currents.shape for p in profiles}, key=lambda s: s[0])
    currents = [p.currents for p in profiles if p.currents.shape == shape]
    forces = np.median([p.forces for p in profiles], axis=0)
    return ForceProfile(forces, np.median(currents, axis=0))


def truncation_faults(seen: SeenThrow) -> Iterator[Fault]:
    """Find a throw whose start or end is not in the recording."""
    throw, time, least_rest = seen.throw, seen.time, seen.limits.least_rest
    if throw.triggered:
        text = "the recording begins with the inrush, so what channels show at rest is not known"
        yield Fault("triggered", "", text, excludes=False)
    elif throw.cut_start or throw.onset - float(time[0]) < least_rest:
        yield Fault("truncated", "", "the recording begins after the onset of motion")
    if throw.cut_end or float(time[-1]) - throw.end < least_rest:
        yield Fault("truncated", "", "the recording ends before the motion does")


def drift_faults(seen: SeenThrow) -> Iterator[Fault]:
    """Find rod forces and a load cell whose zero wanders: they change alike before and after."""
    span, most = float(seen.time[-1] - seen.time[0]), seen.limits.most_drift
    for channel in measured_channels(seen.dataset):
        change = abs(slope := drift(channel.values, rate=channel.rate)) * span
        if channel.unit == "N" and change > most:
            text = f"{slope:.3g} N/s before and after the motion, {change:.3g} N in all"
            yield Fault("drift", channel.name, f"{text}, at most {most:g} N")


def open_level(dataset: xr.Dataset, throw: FoundThrow, *, direction: str | None) -> Floats | None:
    """Return the load of the rods with the rail open and no object acting, shape (n_drives,).

    Before a closing movement, after an opening one; None where that was not recorded [N].
    """
    time = dataset["time"].values
    if "drive_force" not in dataset:
        return None
    if direction == CLOSING and not throw.cut_start:
        part = (time >= throw.onset - REST_WINDOW) & (time < throw.onset - 0.01)
    elif direction == OPENING and not throw.cut_end:
        part = time > max(throw.end, time[-1] - REST_WINDOW)
    else:
        return None
    rows = dataset["drive_force"].transpose("drive", "time").values[:, part]
    filled = [row[np.isfinite(row)] for row in rows]
    if not all(row.size for row in filled):
        return None
    return np.array([float(np.median(row)) for row in filled])


def offset_faults(seen: SeenThrow) -> Iterator[Fault]:
    """Find channels whose zero is off.

    What a rod carries at rest is known from the rest of the campaign only; a current and a load
    cell rest at nothing.
    """
    limits, typical = seen.limits.channels, seen.expected.open_level
    own = open_level(seen.dataset, seen.throw, direction=seen.expected.direction)
    if own is not None and typical is not None and own.shape == typical.shape:
        for name, level, usual in zip(seen.drives, own, typical, strict=True):
            if abs(level - usual) > limits["drive_force"].offset:
                text = f"{level:.4g} N with the rail open, {usual:.4g} N in the rest of the "
                yield Fault("zero offset", f"drive_force {name}", f"{text}campaign", excludes=False)
    rest = seen.time < seen.throw.onset - 0.01
    for channel in measured_channels(seen.dataset):
        known = channel.values[rest & np.isfinite(channel.values)]
        allowed = limits[channel.key].offset
        if channel.key == "drive_force" or seen.throw.cut_start or not known.size:
            continue
        level, unit = float(np.median(known)), channel.unit
        if abs(level) > allowed:
            text = f"{level:.3g} {unit} at rest, at most {allowed:g} {unit} expected"
            yield Fault("zero offset", channel.name, text, excludes=False)


def rate_faults(seen: SeenThrow) -> Iterator[Fault]:
    """Find a sampling rate that is stated otherwise than agreed, or stated wrongly.

    A wrong statement stretches time: the early part of the throw, which no object has a say in,
    then fits the campaign's only at another pace, even if its height may change with friction. All
    forces must say so: an object that is met early changes some of them.
    """
    rate, profile, limits = seen.expected.rate, seen.expected.profile, seen.limits
    if rate is not None and abs(seen.rate / rate - 1.0) > limits.rate_share:
        text = f"{seen.rate:.6g} Hz stated, {rate:.6g} Hz in the rest of the campaign"
        yield Fault("sampling rate", "", text)
        return
    if profile is None:
        return
    own = _at_paces(seen.dataset, seen.throw, PACES.tolist())
    away = [_misfits(p, profile) for p in own]
    best = int(np.argmin([_rms(rows) for rows in away]))
    here = away[int(np.argmin(np.abs(np.log(PACES))))]
    pace = float(PACES[best])
    # An object that is met at once changes one force more than the others; a clock, all alike.
    if abs(np.log(pace)) > np.log1p(limits.pace_share) and np.all(away[best] < 0.5 * here):
        text = f"the throw begins at {1.0 / pace:.2f} times the pace of the campaign's others"
        yield Fault("sampling rate", "", text)


def direction_faults(seen: SeenThrow) -> Iterator[Fault]:
    """Find reversed channels, and a throw that goes the other way than its sheet says."""
    dataset, time, direction = seen.dataset, seen.time, seen.expected.direction
    least = seen.limits.polarity_force
    forces = np.empty((0, time.size))
    if "drive_force" in dataset:
        forces = dataset["drive_force"].transpose("drive", "time").values
    signs = {
        name: (CLOSING if change > 0 else OPENING)
        for name, change in zip(seen.drives, force_changes(forces, rate=seen.rate), strict=False)
        if abs(change) > least
    }
    wrong = [name for name, sign in signs.items() if direction and sign != direction]
    if wrong and len(wrong) == len(signs):
        text = f"the sheet says {direction}, the rod forces {signs[wrong[0]]}"
        yield Fault("direction", "", f"{text}; one of them is wrong")
    elif not direction and len(set(signs.values())) > 1:
        text = "rod forces of different sign in one throw"
        yield Fault("reversed polarity", "drive_force", text)
    else:
        text = f"it changes as in the {OPENING if direction == CLOSING else CLOSING} direction"
        for name in wrong:
            yield Fault("reversed polarity", f"drive_force {name}", text)
    inside = (time > seen.throw.onset + 0.2) & (time < seen.throw.end)
    for name in seen.drives if "drive_current" in dataset else []:
        level = np.median(bridge_gaps(dataset["drive_current"].sel(drive=name).values)[inside])
        if level < -0.2:
            text = f"{level:.2g} A while the motor runs"
            yield Fault("reversed polarity", f"drive_current {name}", text)
    if "object_force" in dataset:
        smooth = moving_average(bridge_gaps(dataset["object_force"].values), rate=seen.rate)
        before = smooth[time < seen.throw.onset]
        rest = float(np.median(before)) if before.size else 0.0
        if rest - smooth.min() > max(least, smooth.max() - rest):
            text = f"{smooth.min() - rest:.3g} N, a load cell is only squeezed"
            yield Fault("reversed polarity", "object_force", text)


def swap_faults(seen: SeenThrow) -> Iterator[Fault]:
    """Find channels of two drives that have changed places.

    The early part of the throw is compared with the campaign's, as it stands and swapped.
    """
    profile = seen.expected.profile
    own = early_profile(seen.dataset, seen.throw) if profile is not None else None
    if own is None or profile is None:
        return
    for key, rows, typical in (
        ("drive_force", own.forces, profile.forces),
        ("drive_current", own.currents, profile.currents),
    ):
        if rows.shape != typical.shape or not rows.size:
            continue
        # Inrush is common to all motors and identifies none.
        own_part, part = (item[:, round(0.2 / EARLY_STEP) :] for item in (rows, typical))
        straight = _rms(own_part - part)
        for one, two, swapped in exchanged_pairs(own_part):
            crossed = _rms(swapped - part)
            if straight > seen.limits.swap_gain * crossed and np.isfinite(straight):
                text = f"they fit the campaign {straight / crossed:.1f} times better swapped"
                channel = f"{key} {seen.drives[one]} and {seen.drives[two]}"
                yield Fault("swapped channels", channel, text)


def _misfits(own: ForceProfile | None, typical: ForceProfile) -> Floats:
    """Return the distance of each force of two profiles, whatever friction makes of its height."""
    count = len(typical.forces)
    if own is None or own.forces.shape != typical.forces.shape:
        return np.full(count, np.inf)
    square = np.sum(typical.forces**2, axis=1)
    heights = np.divide(
        np.sum(own.forces * typical.forces, axis=1), square, out=np.ones(count), where=square > 0
    )
    gains = np.clip(heights, *GAINS)[:, np.newaxis]
    return np.asarray(np.sqrt(np.mean((own.forces / gains - typical.forces) ** 2, axis=1)))


def _rms(rows: Floats) -> float:
    return float(np.sqrt(np.mean(rows**2)))


LOAD_CELL = "object_force"


@dataclass(frozen=True, slots=True, kw_only=True)
class ThrowQuality:
    """The faults of a throw: those that exclude it, and those that are worth a remark."""

    faults: tuple[Fault, ...] = field(default=())

    @property
    def usable(self) -> bool:
        """True if no fault excludes the throw."""
        return not any(fault.excludes for fault in self.faults)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Faults that exclude the throw, a sentence each."""
        return tuple(str(fault) for fault in self.faults if fault.excludes)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Faults that do not exclude the throw, a sentence each."""
        return tuple(str(fault) for fault in self.faults if not fault.excludes)


def judge_recording(
    dataset: xr.Dataset,
    throw: FoundThrow,
    *,
    expected: Expected | None = None,
    limits: Limits | None = None,
) -> ThrowQuality:
    """Look for every known fault of a throw.

    Parameters
    ----------
    dataset : xarray.Dataset
        The recording that the throw was found in: `drive_force` [N], and where measured
        `drive_current` [A] and `object_force` [N], unfiltered.
    throw : FoundThrow
        From `find_throws` on this dataset.
    expected : Expected, optional
        Knowledge of the campaign; without it fewer faults can be seen.
    limits : Limits, optional
        From what size on something is a fault.

    Returns
    -------
    ThrowQuality
        All faults, in a fixed order.

    Examples
    --------
    >>> import numpy as np
    >>> from turnout.measurement.campaign.find_throws import find_throws
    >>> time = np.arange(0.0, 4.5, 1e-3)
    >>> current = 1.2 * ((time >= 1.0) & (time < 5.0)) + 1e-3 * np.sin(700.0 * time)
    >>> data = xr.Dataset(
    ...     {"drive_force": (("drive", "time"), [1000.0 * np.clip(time - 1.0, 0.0, 3.0)]),
    ...      "drive_current": (("drive", "time"), [current])},
    ...     {"time": time, "drive": ["1"]},
    ... )
    >>> (throw,) = find_throws(data)
    >>> judge_recording(data, throw).reasons
    ('truncated: the recording ends before the motion does',)
    """
    chosen, known = limits or Limits(), expected or Expected()
    kept = dataset.isel(time=slice(throw.first, throw.stop))
    if LOAD_CELL in kept and not known.load_cell:
        kept = kept.drop_vars(LOAD_CELL)
    seen = SeenThrow(kept, throw, chosen, known)
    faults = (
        *truncation_faults(seen),
        *channel_faults(kept, throw, limits=chosen),
        *rate_faults(seen),
        *direction_faults(seen),
        *drift_faults(seen),
        *offset_faults(seen),
        *swap_faults(seen),
    )
    return ThrowQuality(faults=faults)
