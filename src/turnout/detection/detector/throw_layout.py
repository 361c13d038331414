"""Features of a throw whatever its sampling: means over windows that begin with the movements.

Windows are laid out from the onset of the opening and of the closing movement, not from the start
of a recording, so that clocks and recorders do not matter. The mean over a window is that of the
straight lines between samples, exactly.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turnout.detection.features import CLOSING_WINDOW, OPENING_WINDOW

Floats = NDArray[np.float64]

OPENING, CLOSING = "opening", "closing"
LEAST_SAMPLES = 10
"""At which all drives are recorded, below which nothing is looked for or judged."""
TOGETHER = 30.0
"""An opening belongs to the closing that begins at most so long after its onset [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """Windows of one movement.

    Attributes
    ----------
    name : str
        "opening" or "closing".
    start : float
        When the movement begins in the nominal throw [s].
    before : float
        How long before its onset the first window begins [s].
    window : float
        Length of a window [s].
    count : int
        Windows.
    """

    name: str
    start: float
    before: float
    window: float
    count: int

    @property
    def edges(self) -> Floats:
        """Edges of the windows from the onset on, shape (count + 1,) [s]."""
        return _edges(self)


@lru_cache(maxsize=64)
def _edges(part: Part) -> Floats:
    """Return the edges of a movement, made once: a verdict needs them some twenty times."""
    found = np.asarray(part.window * np.arange(part.count + 1) - part.before, dtype=np.float64)
    found.flags.writeable = False
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """Windows of a throw: of the opening, if it is recorded, and of the closing.

    Attributes
    ----------
    parts : tuple of Part
        In the order of time.
    drives : tuple of str
        Names of the drives.
    """

    parts: tuple[Part, ...]
    drives: tuple[str, ...]

    @property
    def windows(self) -> int:
        """Of one drive."""
        return sum(part.count for part in self.parts)

    @property
    def size(self) -> int:
        """Features of a throw."""
        return self.windows * len(self.drives)

    @property
    def time(self) -> Floats:
        """Middle of the window of each feature on the nominal throw, shape (size,) [s]."""
        middle = [part.start + 0.5 * (part.edges[1:] + part.edges[:-1]) for part in self.parts]
        return np.tile(np.concatenate(middle), len(self.drives))

    @property
    def width(self) -> Floats:
        """Length of the window of each feature, shape (size,) [s]."""
        width = [np.full(part.count, part.window) for part in self.parts]
        return np.tile(np.concatenate(width), len(self.drives))

    @property
    def drive(self) -> NDArray[np.intp]:
        """Number of the drive of each feature, shape (size,)."""
        return np.repeat(np.arange(len(self.drives)), self.windows)

    @property
    def part(self) -> NDArray[np.intp]:
        """Number of the part of each feature, shape (size,)."""
        once = np.repeat(np.arange(len(self.parts)), [part.count for part in self.parts])
        return np.tile(once, len(self.drives))

    @property
    def before_onset(self) -> NDArray[np.bool_]:
        """True for each feature whose window ends before its movement begins, shape (size,)."""
        once = np.concatenate([part.edges[1:] <= 1e-9 for part in self.parts])
        return np.tile(once, len(self.drives))

    def only(self, name: str) -> "tuple[Layout, NDArray[np.intp]]":
        """Return the layout of one movement, and which features these are."""
        number = [part.name for part in self.parts].index(name)
        kept = Layout(parts=(self.parts[number],), drives=self.drives)
        return kept, np.flatnonzero(self.part == number)


def layout_of(
    movements: Sequence[tuple[str, float, float]],
    *,
    end: float,
    drives: Sequence[str],
    clearance: float = 0.06,
) -> Layout:
    """Lay out windows over the movements of a schedule.

    Parameters
    ----------
    movements : sequence of (str, float, float)
        "opening" or "closing", start and duration with any extra time [s].
    end : float
        Of the schedule [s].
    drives : sequence of str
        Names.
    clearance : float
        Free time at either end, for clocks [s].

    Examples
    --------
    >>> layout = layout_of(
    ...     [("opening", 0.2, 3.2), ("closing", 4.4, 3.4)], end=8.5, drives=["1", "2"]
    ... )
    >>> [(part.name, part.count) for part in layout.parts], layout.size
    ([('opening', 49), ('closing', 103)], 304)
    """
    parts = []
    for number, (name, start, duration) in enumerate(movements):
        before = min(BEFORE, start - clearance)
        follower = movements[number + 1][1] - BEFORE if number + 1 < len(movements) else end
        after = min(start + duration + AFTER, follower - clearance) - start
        window = OPENING_WINDOW if name == OPENING else CLOSING_WINDOW
        count = int(np.floor((before + after) / window + 1e-9))
        parts.append(Part(name=name, start=start, before=before, window=window, count=count))
    return Layout(parts=tuple(parts), drives=tuple(drives))


def stretched(features: Floats, layout: Layout, faster: Floats) -> Floats:
    r"""Return the features of throws whose drives all move faster, shape (n, layout.size) [N].

    Friction does not depend on speed here, so a throw that is faster by a share :math:`\varepsilon`
    shows at a time u after its onset what it showed at :math:`(1 + \varepsilon)\,u`.

    Parameters
    ----------
    features : ndarray, shape (n, layout.size)
        [N]
    layout : Layout
        Windows.
    faster : ndarray, shape (n,)
        Shares [-].

    Examples
    --------
    >>> layout = layout_of([("closing", 0.2, 0.5)], end=1.0, drives=["1"])
    >>> ramp = layout.time[np.newaxis] - 0.2
    >>> bool(np.allclose(stretched(ramp, layout, np.array([0.1]))[0, 3:-3], 1.1 * ramp[0, 3:-3]))
    True
    """
    found = np.empty_like(features)
    for number, part in enumerate(layout.parts):
        for drive in range(len(layout.drives)):
            rows = np.flatnonzero((layout.part == number) & (layout.drive == drive))
            since = layout.time[rows] - part.start
            for throw, values in enumerate(features[:, rows]):
                before = np.where(since > 0.0, (1.0 + faster[throw]) * since, since)
                found[throw, rows] = np.interp(before, since, values)
    return found


BEFORE, AFTER = 0.12, 0.6
"""Time before the onset and after the end of a movement that is used [s]."""


def throw_features(
    time: ArrayLike, force: ArrayLike, *, layout: Layout, onsets: ArrayLike
) -> Floats:
    """Return the features of throws that are sampled alike.

    Parameters
    ----------
    time : array_like, shape (n_times,)
        Rising, in any steps [s].
    force : array_like, shape (n_throws, n_drives, n_times)
        [N]; of a single throw for several onsets too.
    layout : Layout
        Windows.
    onsets : array_like, shape (n_throws, n_parts)
        When each movement begins [s].

    Returns
    -------
    ndarray, shape (n_throws, layout.size)
        Drive by drive [N]; NaN where a window reaches beyond the samples.

    Examples
    --------
    >>> layout = layout_of([("closing", 0.2, 0.5)], end=1.0, drives=["1"])
    >>> time = np.linspace(0.0, 1.0, 126)
    >>> found = throw_features(time, time[None, None], layout=layout, onsets=[[0.2]])
    >>> bool(np.allclose(found[0], layout.time))
    True
    """
    whole = Integral(time, force)
    starts = np.asarray(onsets, dtype=np.float64)
    found = []
    for number, part in enumerate(layout.parts):
        until = whole.until(starts[:, number, np.newaxis] + part.edges)
        found.append(np.diff(until, axis=-1) / part.window)
    joined = np.concatenate(found, axis=-1)
    return joined.reshape(len(joined), -1)


class Integral:
    """The integral of sampled forces over time, of the straight lines between samples.

    Parameters
    ----------
    time : array_like, shape (n_times,)
        Rising, in any steps [s].
    force : array_like, shape (n_throws, n_drives, n_times), or (n_drives, n_times) of one throw
        [N]
    """

    def __init__(self, time: ArrayLike, force: ArrayLike) -> None:
        self._time = np.asarray(time, dtype=np.float64)
        self._force = np.asarray(force, dtype=np.float64)
        self._step = np.diff(self._time)
        area = 0.5 * (self._force[..., 1:] + self._force[..., :-1]) * self._step
        self._total = np.zeros(self._force.shape)
        np.cumsum(area, axis=-1, out=self._total[..., 1:])
        self._bend = 0.5 * np.diff(self._force) / self._step

    def until(self, instants: Floats) -> Floats:
        """Return the integral from the first sample to some instants, NaN beyond the samples [N s].

        Parameters
        ----------
        instants : ndarray, shape (n_throws, n), or any shape of one throw
            [s]

        Returns
        -------
        ndarray, shape (n_throws, n_drives, n), or (n_drives, ...) of one throw
        """
        time = self._time
        at = np.searchsorted(time, instants, side="right") - 1
        np.clip(at, 0, self._step.size - 1, out=at)
        since = instants - time[at]
        found = self._at(self._bend, at)
        if self._force.ndim > 2:
            since = since[:, np.newaxis]
        for values in (self._force, self._total):
            found *= since
            found += self._at(values, at)
        outside = (instants < time[0] - 1e-9) | (instants > time[-1] + 1e-9)
        if outside.any():
            there = outside[:, np.newaxis] if self._force.ndim > 2 else outside
            found[np.broadcast_to(there, found.shape)] = np.nan
        return found

    def means(self, onsets: Floats, part: Part) -> Floats:
        """Return means of one throw over the windows of a movement for several onsets.

        Parameters
        ----------
        onsets : ndarray, shape (n,)
            Of the movement [s].
        part : Part
            Its windows.

        Returns
        -------
        ndarray, shape (n_drives, n_windows, n)
            NaN where a window reaches beyond the samples [N].
        """
        until = self.until(part.edges[:, np.newaxis] + onsets)
        return (until[:, 1:] - until[:, :-1]) / part.window

    def _at(self, values: Floats, place: NDArray[np.intp]) -> Floats:
        if values.ndim == 2:
            return values.take(place, axis=-1)
        rows, drives = max(len(values), len(place)), values.shape[1]
        index = np.broadcast_to(place[:, np.newaxis], (rows, drives, place.shape[-1]))
        return np.take_along_axis(values, index, axis=-1)


def means_on(layout: Layout, *, rate: float) -> tuple[Floats, Floats]:
    """Return instants of a nominal throw and the matrix that averages samples over windows.

    Parameters
    ----------
    layout : Layout
        Windows.
    rate : float
        Samples a second [Hz].

    Returns
    -------
    time : ndarray, shape (n_times,)
        [s]
    means : ndarray, shape (windows of a drive, n_times)
        Rows sum to 1.
    """
    first, last = layout.parts[0], layout.parts[-1]
    begin, end = first.start + first.edges[0], last.start + last.edges[-1]
    time = begin + np.arange(int(np.ceil((end - begin) * rate)) + 2) / rate
    one = Layout(parts=layout.parts, drives=layout.drives[:1])
    starts = np.tile([part.start for part in layout.parts], (time.size, 1))
    unit = np.eye(time.size)[:, np.newaxis, :]
    return time, throw_features(time, unit, layout=one, onsets=starts).T
