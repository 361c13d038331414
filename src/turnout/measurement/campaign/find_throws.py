"""Throws within a recording: start, end and direction of each.

Work is done on unfiltered channels in physical units, all at one rate. A motor current or power
shows to the millisecond when a throw begins; rod forces alone, which grow slowly at first, less
sharply. Records of monitoring systems are triggered by the contactor and begin with the inrush.
"""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from turnout.core.moving_average import moving_average
from turnout.core.running_current import running_time
from turnout.measurement.campaign.motion_signals import (
    Flags,
    Floats,
    bridge_gaps,
    drift,
    found_direction,
    true_runs,
    without_spikes,
)

# Time within which an inrush shows its peak [s], and how far that is above the run behind it.
INRUSH, INRUSH_SHARE = 0.1, 1.5
# Over which channels are averaged before they show motion [s].
SMOOTHED = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class Detection:
    """Criteria for a throw.

    Attributes
    ----------
    running_current : float
        Current above which a motor runs [A]. It finds throws in a recording; how long each motor
        of a throw ran is then measured by its own standstill and running current.
    running_power : float
        Power above which a motor runs, where no current was measured [W].
    moving_force : float
        Change of a rod force within `force_span` that counts as motion [N].
    force_span : float
        Time over which that change is taken [s].
    least_duration : float
        Shorter activity is no throw [s].
    bridged : float
        Activity that stops for less than this goes on [s].
    force_spike, current_spike : float
        Height of a single sample above its neighbours that is no motion [N, A].
    before, after : float
        Time kept before the onset and after the end [s].
    """

    running_current: float = 0.35
    running_power: float = 50.0
    moving_force: float = 40.0
    force_span: float = 0.3
    least_duration: float = 0.8
    bridged: float = 0.5
    force_spike: float = 500.0
    current_spike: float = 2.0
    before: float = 1.0
    after: float = 1.0


@dataclass(frozen=True, slots=True)
class FoundThrow:
    """One throw within a recording.

    Attributes
    ----------
    first, stop : int
        Samples to keep, as of a slice.
    onset, end : float
        Onset of motion, and when the last drive stops, on the time of the recording [s].
    drive_ends : tuple of float
        When each motor is switched off [s], see `turnout.core.running_current`; NaN where its
        current does not show it.
    source : str
        "current", "power" or "force": what the onset was taken from.
    direction : str
        "closing", "opening" or "unknown".
    cut_start, cut_end : bool
        Whether the recording begins after the onset, or ends before the motion does.
    triggered : bool
        Whether the recording begins with the inrush, without a rest before it.
    """

    first: int
    stop: int
    onset: float
    end: float
    drive_ends: tuple[float, ...]
    source: str
    direction: str
    cut_start: bool = False
    cut_end: bool = False
    triggered: bool = False

    @property
    def duration(self) -> float:
        """Time from the onset until the last drive stops [s]."""
        return self.end - self.onset


def find_throws(
    dataset: xr.Dataset, *, detection: Detection | None = None
) -> tuple[FoundThrow, ...]:
    """Find every throw of a recording.

    Parameters
    ----------
    dataset : xarray.Dataset
        `drive_force` [N], `drive_current` [A], `drive_power` [W], all (drive, time) and those that
        were measured, unfiltered; `time` even [s].
    detection : Detection, optional
        Criteria of a throw.

    Returns
    -------
    tuple of FoundThrow
        In the order of time; empty where nothing moves.

    Examples
    --------
    >>> time = np.arange(0.0, 6.0, 1e-3)
    >>> running = (time >= 2.0) & (time < 5.0)
    >>> force = np.where(time < 2.0, 0.0, 1000.0 * np.minimum(time - 2.0, 3.0))
    >>> data = xr.Dataset(
    ...     {"drive_force": (("drive", "time"), [force]),
    ...      "drive_current": (("drive", "time"), [1.2 * running])},
    ...     {"time": time, "drive": ["1"]},
    ... )
    >>> [(throw.onset, throw.direction) for throw in find_throws(data)]
    [(2.0, 'closing')]
    """
    chosen = detection or Detection()
    time = dataset["time"].values
    if time.size < 3:
        return ()
    rate = (time.size - 1) / float(time[-1] - time[0])
    forces = _rows(dataset, "drive_force", rate=rate, spike=chosen.force_spike)
    currents = _rows(dataset, "drive_current", rate=rate, spike=chosen.current_spike)
    source, level = "current", chosen.running_current
    if not currents.size and "drive_power" in dataset:
        currents = _rows(dataset, "drive_power", rate=rate, spike=np.inf)
        source, level = "power", chosen.running_power
    smooth = moving_average(bridge_gaps(currents), rate=rate, window=SMOOTHED)
    running: Flags = np.abs(smooth) > level  # whichever way round its clamp is
    # A channel that never rests is no motor current: dead wires and swapped channels look so.
    switched = [
        bool(on.any() and (not on.all() or _begins_with_inrush(row, time.size, rate=rate)))
        for on, row in zip(running, currents, strict=True)
    ]
    if any(switched):
        active: Flags = np.any(running[switched], axis=0)
    else:
        # A zero that drifts is no motion; the direction of a throw does not need it.
        away = np.arange(time.size) / rate
        forces = np.array([row - drift(row, rate=rate) * away for row in forces]).reshape(
            forces.shape
        )
        active = _is_moving(forces, rate=rate, detection=chosen)
        source = "force"
    spans = _spans(active, rate=rate, detection=chosen)
    bounds = _bounds(spans, time.size, rate=rate, detection=chosen)
    rows = forces if source == "force" else currents[switched]
    throws = []
    for span, bound in zip(spans, bounds, strict=True):
        triggered = (
            source != "force"
            and span[0] == 0
            and any(_begins_with_inrush(row, span[1], rate=rate) for row in rows)
        )
        at = 0.0 if triggered else _onset(rows, span, rate=rate, source=source, level=level)
        kept = slice(*bound)
        throws.append(
            FoundThrow(
                *bound,
                onset=float(np.interp(at, np.arange(time.size), time)),
                end=float(time[span[1] - 1]),
                drive_ends=tuple(
                    running_time(time[kept], row[kept])[1] if known else float("nan")
                    for row, known in zip(currents, switched, strict=True)
                ),
                source=source,
                direction=found_direction(forces[:, kept], rate=rate),
                cut_start=span[0] == 0 and not triggered,
                cut_end=span[1] == time.size,
                triggered=triggered,
            )
        )
    return tuple(throws)


def _begins_with_inrush(row: Floats, stop: int, *, rate: float) -> bool:
    """Return True if the first samples are far above the run behind them."""
    size = np.abs(bridge_gaps(row[:stop]))
    first, behind = size[: max(2, round(INRUSH * rate))], size[round(3 * INRUSH * rate) :]
    return bool(behind.size and float(first.max()) > INRUSH_SHARE * float(np.median(behind)))


def _rows(dataset: xr.Dataset, name: str, *, rate: float, spike: float) -> Floats:
    """Return a row a drive, without spikes."""
    if name not in dataset:
        return np.empty((0, dataset.sizes["time"]))
    rows = np.asarray(dataset[name].transpose("drive", "time").values, dtype=np.float64)
    return np.array([without_spikes(row, rate=rate, least=spike) for row in rows]).reshape(
        rows.shape
    )


def _is_moving(forces: Floats, *, rate: float, detection: Detection) -> Flags:
    """Flag the samples at which rod forces change by more than noise."""
    filled = bridge_gaps(forces)
    smooth = moving_average(filled, rate=rate, window=SMOOTHED)
    half = max(1, round(0.5 * detection.force_span * rate))
    index, last = np.arange(forces.shape[1]), forces.shape[1] - 1
    change = smooth[:, np.minimum(index + half, last)] - smooth[:, np.maximum(index - half, 0)]
    steps = np.median(np.abs(np.diff(filled)), axis=1)
    noise = steps / 0.95 / np.sqrt(max(1.0, SMOOTHED * rate))
    least = np.maximum(detection.moving_force, 8.0 * noise)
    return np.asarray(np.any(np.abs(change) > least[:, np.newaxis], axis=0))


def _spans(active: Flags, *, rate: float, detection: Detection) -> list[tuple[int, int]]:
    """Return first and one past the last sample of each activity that is long enough."""
    starts, stops = true_runs(active)
    spans: list[tuple[int, int]] = []
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        if spans and start - spans[-1][1] < detection.bridged * rate:
            spans[-1] = (spans[-1][0], stop)
        else:
            spans.append((start, stop))
    return [span for span in spans if span[1] - span[0] >= detection.least_duration * rate]


def _bounds(
    spans: list[tuple[int, int]], size: int, *, rate: float, detection: Detection
) -> list[tuple[int, int]]:
    """Return the kept samples of each throw: no more than half-way to its neighbours."""
    before, after = round(detection.before * rate), round(detection.after * rate)
    bounds = []
    for number, (start, stop) in enumerate(spans):
        least = 0 if number == 0 else (spans[number - 1][1] + start) // 2
        most = size if number == len(spans) - 1 else (stop + spans[number + 1][0]) // 2
        bounds.append((max(least, start - before), min(most, stop + after)))
    return bounds


def _onset(rows: Floats, span: tuple[int, int], *, rate: float, source: str, level: float) -> float:
    """Return the sample at which the first drive begins, between samples for forces."""
    if source != "force":
        return min(_first_inrush(row, span, rate=rate, level=level) for row in rows)
    if span[0] == 0:
        return 0.0
    found = [_first_pull(row, span, rate=rate) for row in rows]
    pulls = [pull for pull, _ in found]
    # Drives that begin together show the same moment: their mean scatters less than the first.
    onset = float(np.mean([pull for pull in pulls if pull <= min(pulls) + 0.02 * rate]))
    # A force that grows slowly is followed back too far; some drive shows within 0.1 s.
    return max(onset, min(seen for _, seen in found) - 0.1 * rate)


def _first_inrush(row: Floats, span: tuple[int, int], *, rate: float, level: float) -> float:
    """Return the first of two samples in a row above the running current, near the span's start."""
    reach = round(0.05 * rate)
    first = max(0, span[0] - reach)
    high = np.abs(bridge_gaps(row)[first : span[0] + 4 * reach]) > level
    pairs = np.flatnonzero(high[:-1] & high[1:])
    return float(first + pairs[0]) if pairs.size else float(span[1])


def _first_pull(row: Floats, span: tuple[int, int], *, rate: float) -> tuple[float, float]:
    """Return the sample at which a rod force leaves its rest, and the first above the noise.

    A marker that starts softly pulls with the cube of time at first; the line through the cube
    roots of the force, from where it leaves the noise, is followed back to zero.
    """
    count = max(3, round(0.3 * rate))
    smooth = moving_average(bridge_gaps(row), rate=rate, window=SMOOTHED)
    start = max(0, span[0] - round(0.2 * rate))
    rest = smooth[max(0, start - count) : start + 1]
    away = smooth[start : span[1]] - np.median(rest)
    level = max(20.0, 6.0 * float(np.std(rest)))
    high = int(np.argmax(np.abs(away) > 5.0 * level))
    rise = away[:high] * np.sign(away[high])
    below = np.flatnonzero(rise < 1.5 * level)
    low = int(below[-1]) + 1 if below.size else 0
    if high == 0:
        return float(span[1]), float(span[1])
    if high - low < 2:  # a jump, as where an object is squeezed at once
        return float(start + low), float(start + low)
    slope, zero = np.polyfit(np.arange(low, high), np.cbrt(rise[low:]), 1)
    pull = float(start + max(0.0, -zero / slope)) if slope > 0.0 else float(span[1])
    return pull, float(start + low)
