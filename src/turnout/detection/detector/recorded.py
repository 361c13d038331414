"""Throws as they come from recorders: what can be judged, and when each movement begins.

Only numpy and scipy are used here; files are read in `turnout.detection.detector.reading`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turnout.detection.conditions import FORCE, UNITS
from turnout.detection.detector.judging import CYCLE, View
from turnout.detection.detector.throw_layout import CLOSING, OPENING, Integral, Layout, Part
from turnout.measurement.campaign.motion_signals import longest_true_run, spikes, true_runs

Floats = NDArray[np.float64]

LEAST_RATE = 20.0
"""Samples a second below which windows of a closing movement stay empty [Hz]."""
MOST_HOLES = 0.1
"""Longest gap between samples that is bridged [s]."""
CLIPPED = 5
"""Equal samples in a row at the largest force from which on a channel counts as clipped."""
LARGEST_FORCE = 50e3
"""Beyond this a drive force is in the wrong unit [N]."""
RIVAL = 0.02
"""Correlation by which the best match must exceed any other of the same movement [-]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recorded:
    """One throw as it was recorded.

    Attributes
    ----------
    name : str
        Of file or movement.
    time : ndarray, shape (n_times,)
        [s]
    force : ndarray, shape (n_drives, n_times)
        [N], positive closing; NaN where nothing was recorded. Motor current [A] or power [W] for a
        detector that was trained on these.
    drives : tuple of str
        Names of the rows.
    onsets : mapping of str to float
        When "opening" and "closing" begin, as far as they are recorded [s].
    exact : bool
        Whether onsets are those of the commands of a simulated schedule; others are found again,
        and current or power is not judged from them.
    fault : str
        Why it cannot be judged; empty otherwise.
    labels : mapping of str to object
        What is known besides, such as size and place of a test object.
    marked : bool
        Whether onsets come from a current, a run sheet or a table. Else this is a whole recording
        of forces alone, which may hold several throws; the detector finds them by their likeness
        to sound ones.
    single : bool
        Whether it must hold one closing only, as a row of a table.
    shown : sequence of mapping of str to float
        Onsets of each closing, with its opening, that the forces of such a recording show [s].
    listed : mapping of str to mapping
        Names of the closings that a run sheet lists for it, in the order of time, with labels.
    panel : (str, str)
        Name and hash of the panel that its file names; empty where it names none.
    """

    name: str
    time: Floats
    force: Floats
    drives: tuple[str, ...]
    onsets: Mapping[str, float]
    exact: bool = False
    fault: str = ""
    labels: Mapping[str, Any] = field(default_factory=dict)
    marked: bool = True
    single: bool = False
    shown: Sequence[Mapping[str, float]] = ()
    listed: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    panel: tuple[str, str] = ("", "")


@dataclass(frozen=True, slots=True, kw_only=True)
class Match:
    """A movement where the recording looks most like it.

    Attributes
    ----------
    name : str
        "opening" or "closing".
    onset : float
        [s]
    stop : float
        End of the movement, rest left out [s].
    likeness : float
        Correlation with sound throws [-].
    rival : float
        Highest correlation at another instant of the same movement [-].
    """

    name: str
    onset: float
    stop: float
    likeness: float
    rival: float = -1.0

    @property
    def doubt(self) -> str:
        """Why it is not taken; empty where it is."""
        if self.likeness - self.rival < RIVAL:
            return (
                f"when {self.name} begins is not clear: sound throws fit as well at another "
                f"instant (correlation {self.likeness:.2f} and {self.rival:.2f})"
            )
        return ""


def recording_fault(throw: Recorded, layout: Layout, quantity: str = FORCE) -> str:
    """Return why a recording cannot be judged; empty where it can.

    Parameters
    ----------
    throw : Recorded
        As it came.
    layout : Layout
        That must be covered.
    quantity : str
        What of the drives is judged.
    """
    if throw.fault:
        return throw.fault
    lacking = [name for name in layout.drives if name not in throw.drives]
    if lacking:
        there = f"; there are {', '.join(throw.drives)}: name them as the panel does"
        fault = f"no {quantity} of drive {', '.join(lacking)} is recorded"
        return fault + there if throw.drives else fault
    if CLOSING not in throw.onsets:
        return "no closing movement was found in it"
    if throw.time.size < 2 or not np.all(np.diff(throw.time) > 0.0):
        return "its time does not rise"
    for name in layout.drives:
        fault = _channel_fault(throw, throw.drives.index(name), layout, quantity)
        if fault:
            return f"drive {name}: {fault}"
    for first, second in combinations(layout.drives, 2):
        one, other = (throw.force[throw.drives.index(name)] for name in (first, second))
        some = slice(None, None, max(one.size // 20, 1))  # where nearly all that differ do so
        if all(np.array_equal(one[i], other[i], equal_nan=True) for i in (some, slice(None))):
            return f"drives {first} and {second} hold the same samples: one channel twice"
    return ""


def _channel_fault(throw: Recorded, row: int, layout: Layout, quantity: str) -> str:
    part = layout.parts[-1]
    begin = throw.onsets[CLOSING] + part.edges[0]
    end = throw.onsets[CLOSING] + part.edges[-1]
    time, force = throw.time, throw.force[row]
    known = np.isfinite(force)
    if not known.all():
        time, force = time[known], force[known]
    if time.size < 2:
        return "holds no numbers"
    own = _between(time, begin - MOST_HOLES, end)
    inside = time[own]
    if inside.size < 2 or inside[-1] < end - END_MISSING:
        last = time[-1] - throw.onsets[CLOSING]
        return (
            f"recorded until {last:.1f} s after the onset of closing; "
            f"{part.edges[-1] - END_MISSING:.1f} s are needed"
        )
    if inside[0] > begin + START_MISSING:
        return "the recording begins after the onset of closing"
    steps = np.diff(inside)
    longest = steps.max()
    if longest > 1.0 / LEAST_RATE and np.median(steps) > 1.0 / LEAST_RATE:
        return f"{1.0 / np.median(steps):.0f} samples a second; {LEAST_RATE:.0f} are needed"
    if longest > MOST_HOLES:
        return f"{longest:.2f} s without samples"
    fault = value_fault(force[own], quantity=quantity)
    if fault or quantity != FORCE:
        return fault
    first = min(throw.onsets.values()) + min(p.edges[0] for p in layout.parts)
    whole = _between(time, first, end)
    for at in np.flatnonzero(spikes(force[whole], rate=np.inf, least=SPIKE)):
        since = time[whole][at] - throw.onsets[CLOSING]
        return f"a spike of {force[whole][at]:.0f} N, {since:.2f} s after the onset of closing"
    since, long = held_run(time[whole], force[whole])
    if long < LONGEST_HELD or since > end - END_MISSING:
        return ""
    return f"constant for {long:.2f} s from {since - throw.onsets[CLOSING]:.2f} s after the onset"


def _between(time: Floats, first: float, last: float) -> slice:
    """Return which samples lie between two instants, both included."""
    return slice(int(np.searchsorted(time, first)), int(np.searchsorted(time, last, side="right")))


SPIKE = 5e3
"""Height of a sample above those around it that no switch makes [N].

Recorders write -9999 or 32767 for what they could not measure; a mean over a window with it looks
like a seat that is reached too early or too late.
"""
LONGEST_HELD = 0.3
"""Equal samples of a force with noise from which on its channel counts as held [s]."""
NOISY = 0.3
"""Share of samples at which a force with noise turns; without, hardly any do [-]."""


def held_run(time: Floats, force: Floats) -> tuple[float, float]:
    """Return since when and how long a force is held that is noisy elsewhere [s].

    Nothing is held in a force that is smooth, as a simulation at rest is, or coarse, so that many
    of its samples are equal.

    Examples
    --------
    >>> time = np.arange(200) / 100.0
    >>> noise = np.random.default_rng(1).standard_normal(200)
    >>> held_run(time, np.where(time < 1.5, noise, 0.25))
    (1.5, 0.49)
    >>> held_run(time, np.minimum(time, 1.5))
    (0.0, 0.0)
    """
    steps = np.diff(force)
    if steps.all():  # as nearly always
        return 0.0, 0.0
    starts, stops = true_runs(steps == 0.0)
    longest = int(np.argmax(stops - starts))
    first, stop = int(starts[longest]), int(stops[longest]) + 1
    others = np.delete(steps, np.arange(max(first - 1, 0), min(stop, steps.size)))
    if others.size < LEAST_OTHERS:
        return 0.0, 0.0
    turns = np.mean(others[1:] * others[:-1] < 0.0)
    coarse = np.mean(others == 0.0) > 0.5 * NOISY
    if turns < NOISY or coarse:
        return 0.0, 0.0
    return float(time[first]), float(round(time[stop - 1] - time[first], 9))


LEAST_OTHERS = 20
"""Samples beside a run of equal ones that noise is seen in."""
END_MISSING = 0.5
"""Of the rest after the movement, not needed: the last value counts for it [s]."""
START_MISSING = 0.1
"""Of the rest before the onset, not needed: the first value counts for it [s]."""


def value_fault(values: Floats, *, quantity: str = FORCE) -> str:
    """Return what is wrong with the samples of a channel, shape (n,) [N]; empty if nothing is."""
    unit = UNITS[quantity]
    high, low = float(values.max()), float(values.min())
    largest = max(high, -low)
    if largest > LARGEST_FORCE:
        return f"up to {largest:.3g} {unit}; is the unit right?"
    if high == low:
        return "does not change: a dead channel"
    for limit in (high, low):
        if abs(limit) <= 0.2 * largest or longest_true_run(values == limit) < CLIPPED:
            continue
        # values that are often equal come from a coarse recorder or a simulation at rest
        others = values[values != limit]
        if 2 * (longest_true_run(np.diff(others) == 0.0) + 1) < CLIPPED:
            return f"clipped at {1e-3 * limit:.2f} k{unit}"
    return ""


def known_forces(throw: Recorded, layout: Layout) -> tuple[Floats, Floats]:
    """Return the samples [s, N] at which the forces of all drives of a layout are known."""
    force = throw.force
    if throw.drives != layout.drives:
        force = force[[throw.drives.index(name) for name in layout.drives]]
    known = np.isfinite(force).all(axis=0)
    if known.all():  # as nearly always: that copy takes as long as judging a movement
        return throw.time, force
    return throw.time[known], force[:, known]


def features_of_recorded(
    throw: Recorded,
    layout: Layout,
    onsets: Mapping[str, float],
    sums: Mapping[str, Integral] | None = None,
) -> Floats:
    """Return the features of a throw, NaN in movements that were not recorded.

    Parameters
    ----------
    throw : Recorded
        Without fault.
    layout : Layout
        Of the detector.
    onsets : mapping of str to float
        Of the movements [s].
    sums : mapping of str to Integral, optional
        From `sums_about` for some movements, where nothing was held.
    """
    known = sums or {}
    found = np.full((len(layout.drives), layout.windows), np.nan)
    end = 0
    for part in layout.parts:
        first, end = end, end + part.count
        if part.name in onsets:
            onset = np.array([onsets[part.name]])
            own = known.get(part.name) or sums_about(throw, layout, part, onset)[0]
            found[:, first:end] = own.means(onset, part)[..., 0]
    return found.ravel()


def sums_about(
    throw: Recorded, layout: Layout, part: Part, onsets: Floats
) -> tuple[Integral, bool]:
    """Return the integral of the forces of a throw about one movement, and whether any is held.

    Parameters
    ----------
    throw : Recorded
        Without fault.
    layout : Layout
        Of the detector.
    part : Part
        The movement.
    onsets : ndarray
        Between which it may begin, rising [s].
    """
    time, force = known_forces(throw, layout)
    ends = onsets[[0, -1]]
    begin, end = ends + part.edges[0], ends + part.edges[-1]
    samples = time.size
    time, force = held_at_ends(time, force, begin, end)
    first = max(int(np.searchsorted(time, begin[0])) - 1, 0)
    own = slice(first, int(np.searchsorted(time, end[-1])) + 1)
    return Integral(time[own], force[:, own]), time.size > samples


def held_at_ends(time: Floats, force: Floats, begin: Floats, end: Floats) -> tuple[Floats, Floats]:
    """Return samples whose first and last values are held where the rest beside them was cut.

    Parameters
    ----------
    time : ndarray, shape (n_times,)
        [s]
    force : ndarray, shape (n_drives, n_times)
        [N]
    begin, end : ndarray
        Of the first and the last window, of all onsets that are tried [s].
    """
    first, last = begin.min(), end.max()
    if time[0] > first and time[0] < begin.max() + START_MISSING + MOST_HOLES:
        time = np.concatenate([[first - 1e-3], time])
        force = np.concatenate([force[:, :1], force], axis=1)
    if time[-1] < last and time[-1] > end.min() - END_MISSING - MOST_HOLES:
        count = max(1, force.shape[1] // 100)
        time = np.concatenate([time, [last + 1e-3]])
        force = np.concatenate([force, force[:, -count:].mean(axis=1, keepdims=True)], axis=1)
    return time, force


ZEROED = "forces are zeroed at rest; record them against the unloaded rods, without taring"
NEARLY_ZERO = 60.0
"""Mean force at rest below which a channel may have been zeroed there [N]."""
CLEARLY_LOADED = 4.0
"""Deviations from 0 of what sound switches hold at rest, for that to be noticed [-]."""


class ForcesAtRest:
    """The windows before each movement, and what sound switches hold there.

    A recorder that is zeroed before each throw takes the preload out of all samples; a switch that
    was not pressed home begins at no force too, but is loaded like others from then on.

    Parameters
    ----------
    view : View
        That throws of this part are judged with.
    layout : Layout
        Of all features.
    """

    def __init__(self, view: View, layout: Layout) -> None:
        usual, spread = view.usual
        drive, part = layout.drive[view.features], layout.part[view.features]
        before = layout.before_onset[view.features]
        self._loaded = []
        for number in np.unique(part):
            rest = [
                np.flatnonzero(before & (part == number) & (drive == row))
                for row in range(len(layout.drives))
            ]
            self._loaded.append(
                [
                    view.features[rows]
                    for rows in rest
                    if rows.size and np.all(np.abs(usual[rows]) > CLEARLY_LOADED * spread[rows])
                ]
            )
        first, last = before & (part == 0), before & (part == part.max())
        self._last, self._usual = view.features[last], usual[last]
        if len(self._loaded) > 1:
            rows = range(int(drive.max()) + 1)
            taken = np.array([usual[first & (drive == row)].mean() for row in rows])
            self._taken = taken[drive[last]]

    def zeroed(self, features: Floats) -> bool:
        """Return True if a recorder was zeroed at rest, not for a start without load.

        Parameters
        ----------
        features : ndarray, shape (n_features,)
            Of the throw [N].
        """
        zero = [
            bool(loaded) and all(abs(float(features[rows].mean())) < NEARLY_ZERO for rows in loaded)
            for loaded in self._loaded
        ]
        if zero[-1] or not zero[0]:
            return zero[-1]
        off = features[self._last] - self._usual
        return bool(np.abs(off + self._taken).sum() < np.abs(off).sum())


def part_of(throw: Recorded, layout: Layout) -> str:
    """Return what of a throw can be judged: the whole cycle, or the closing alone."""
    if len(layout.parts) == 1:
        return CYCLE
    whole = all(part.name in throw.onsets for part in layout.parts)
    if not whole:
        return CLOSING
    opening = layout.parts[0]
    begin = throw.onsets[OPENING] + opening.edges[0]
    end = throw.onsets[OPENING] + opening.edges[-1]
    own = _between(throw.time, begin, end)
    found = throw.time[own][np.isfinite(throw.force[:, own]).all(axis=0)]
    covered = (
        found.size > 2
        and found[0] < begin + START_MISSING
        and found[-1] > end - END_MISSING
        and np.diff(found).max() < MOST_HOLES
    )
    return CYCLE if covered else CLOSING
