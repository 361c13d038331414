"""Measured movements as a fit sees them: movement, object, and means over short bins of time."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.errors import MeasurementError, PanelError
from turnout.core.problems import choices
from turnout.measurement.campaign.sheet_checks import exchange_remarks
from turnout.measurement.chain.channel_map import drives_together
from turnout.measurement.chain.recorder import (
    LEAST_INTERVAL,
    PERFECT,
    Recorder,
    stated_recorder,
)
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import LoadedPanel
from turnout.panel.markers import movement_time, ordered_movements
from turnout.study.virtual.record_throw import DIRECTIONS

Floats = NDArray[np.float64]
# Whole periods of mains of 50 Hz, so that hum averages out; short against a build-up of force [s].
BIN = 0.02
# A hold after the movement is compared for so long [s].
HOLD = 0.3
# Left out before an object is taken away, or the next movement begins [s].
CLEARANCE = 0.1
# Samples of a bin whose time differs from that of a bin by less than this share fit into it [-].
SAME_BIN = 1e-3
# Samples that are further apart are straight lines between them, in the simulation too [1/s].
LINES_BELOW = 1.0 / LEAST_INTERVAL
OBJECT_FORCE = "object_force"


def channel_name(channel: str, drive: str) -> str:
    """Name a channel, and its drive where it has one."""
    return f"{channel} of drive {drive}" if drive else channel


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Signal:
    """One channel of one movement, over bins of time.

    Attributes
    ----------
    channel : str
        Of the schema.
    drive : str
        Which drive; empty for a channel without.
    time : ndarray, shape (n,)
        Centres of the bins from the onset [s].
    values : ndarray, shape (n,)
        Means over the bins; NaN where nothing was recorded.
    recorder : Recorder
        What the recorder makes of it before it is kept.
    """

    channel: str
    drive: str
    time: Floats
    values: Floats
    recorder: Recorder = PERFECT


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredMovement:
    """One measured movement: what was thrown, and what was recorded.

    Attributes
    ----------
    name, direction : str
        As in the campaign.
    place, size : str, float
        Of the object; "none" and 0 without one [m].
    x : float
        Position of the object, NaN without one [m].
    signals : tuple of Signal
        From a second before the onset on.
    length : float
        Time from the onset in which a simulation can be compared [s].
    clocked : bool
        Whether the onset was found from motor currents.
    """

    name: str
    direction: str
    place: str
    size: float
    x: float
    signals: tuple[Signal, ...]
    length: float
    clocked: bool

    @property
    def foreign_object(self) -> ForeignObject | None:
        """The object that was trapped."""
        return ForeignObject(self.size, self.place) if self.size > 0 else None

    @property
    def text(self) -> str:
        """Return what was thrown, for messages."""
        what = f"{self.size * 1e3:g} mm at {self.place}" if self.size > 0 else "no object"
        return f"{self.name} ({self.direction}, {what})"


def observe(
    dataset: xr.Dataset, panel: LoadedPanel, *, exclude: Sequence[str] = ()
) -> tuple[MeasuredMovement, ...]:
    """Return the movements of a campaign as a fit sees them.

    Parameters
    ----------
    dataset : xarray.Dataset
        A built campaign: dimensions movement and time, `drive_force` (movement, drive, time).
    panel : LoadedPanel
        The switch that was measured; gives places, drives and the schedule.
    exclude : sequence of str
        Movements to leave out.

    Returns
    -------
    tuple of MeasuredMovement

    Raises
    ------
    MeasurementError
        When nothing is left, or movements do not fit the panel; with all problems.
    """
    source = str(dataset.attrs.get("title", "campaign"))
    problems = _problems(dataset, panel, exclude)
    movements = []
    if not problems:
        bins = _Bins.of(dataset["time"].values)
        for name in dataset["movement"].values:
            if str(name) in exclude:
                continue
            try:
                movements.append(_movement(dataset.sel(movement=name), panel, bins))
            except PanelError as error:
                problems += [f"{name}: {text}" for text in error.problems]
    if not problems and not movements:
        problems = ["every movement is excluded; keep at least one without an object"]
    if problems:
        raise MeasurementError(list(dict.fromkeys(problems)), source=source)
    return tuple(movements)


def _recorder(row: xr.Dataset, key: str) -> Recorder:
    """Return what the recorder makes of a force of a movement; few samples are lines between them.

    `key` is that of the channel map, such as "drive_force.1".
    """
    stated = stated_recorder(row.attrs)
    time = row["time"].values
    of_columns = json.loads(str(row.attrs.get("force_rates", "{}")))
    rates = [
        stated.rate,
        (time.size - 1) / float(time[-1] - time[0]),
        float(of_columns.get(str(row["movement"].values), {}).get(key, 0.0)),
    ]
    slow = [rate for rate in rates if 0.0 < rate < LINES_BELOW]
    return replace(stated, rate=min(slow, default=0.0))


def movement_length(panel: LoadedPanel, direction: str, *, trapped: bool) -> float:
    """Return the time from the onset in which a movement can be compared [s].

    Raises
    ------
    PanelError
        When the schedule has no movement in this direction.
    """
    ordered = [item for _, item in ordered_movements(panel)]
    movements = [item for item in ordered if DIRECTIONS[item.to] == direction]
    if not movements:
        problem = f"the panel's schedule has no {direction} movement; add one"
        raise PanelError([problem], source="panel")
    last = movements[-1]
    end = last.start + max(movement_time(last, name) for name in panel.drive) + HOLD
    limits = [item.start for item in ordered if item.start > last.start]
    gone = panel.object_defaults.disappears
    if trapped and gone is not None and gone > last.start:
        limits.append(gone)
    end = min([end, *(limit - CLEARANCE for limit in limits)])
    return min(end, panel.schedule.end) - last.start


def _problems(dataset: xr.Dataset, panel: LoadedPanel, exclude: Sequence[str]) -> list[str]:
    """Return what a campaign lacks to be compared with a panel."""
    if "movement" not in dataset.dims or "drive_force" not in dataset:
        return ["is not a built campaign with drive forces; see `turnout campaign build`"]
    names = [str(name) for name in dataset["movement"].values]
    problems = exchange_remarks(dataset.attrs)
    problems += [
        f"exclude {name}: there is no such movement; there are {choices(names)}"
        for name in exclude
        if name not in names
    ]
    names = [str(name) for name in dataset["drive"].values]
    unknown = [n for n in names if n not in panel.drive and not drives_together(n)]
    if unknown:
        problems.append(
            f"drive {choices(unknown)}: not in panel {panel.name}, which has "
            f"{choices(panel.drive)}; name the drives of the channel map as in the panel"
        )
    return problems


@dataclass(frozen=True, slots=True, eq=False)
class _Bins:
    """Bins of an even time: which sample is in which, their centres."""

    first: int
    samples: int
    centres: Floats
    time: Floats

    @classmethod
    def of(cls, time: Floats) -> "_Bins":
        """Return bins of whole samples; of none where these do not fit into bins."""
        rate = (time.size - 1) / float(time[-1] - time[0])
        samples = max(1, round(BIN * rate))
        if rate < LINES_BELOW or abs(samples / (BIN * rate) - 1.0) > SAME_BIN:
            edges = np.arange(np.ceil(time[0] / BIN), np.floor(time[-1] / BIN)) * BIN
            return cls(0, 0, edges + 0.5 * BIN, time)
        onset = int(np.argmin(np.abs(time)))
        first = onset % samples
        count = (time.size - first) // samples
        start = first + samples * np.arange(count)
        return cls(first, samples, time[start] + 0.5 * (samples - 1) / rate, time)

    def means(self, values: Floats) -> Floats:
        """Return the mean of each bin; NaN where a sample is missing."""
        count = self.centres.size
        if self.samples == 0:
            return _means_of_lines(self.time, values, self.centres)
        used = values[self.first : self.first + count * self.samples]
        return np.asarray(used.reshape(count, self.samples).mean(axis=1), dtype=np.float64)


def _means_of_lines(time: Floats, values: Floats, centres: Floats) -> Floats:
    r"""Return means over bins of the straight lines between samples.

    .. math:: \int_{t_i}^{t} F \, dt = v_i d + \frac{v_{i+1} - v_i}{2 h} d^2, \quad d = t - t_i
    """
    step = float(time[-1] - time[0]) / (time.size - 1)
    known = np.isfinite(values)
    filled = np.where(known, values, 0.0)
    whole = np.concatenate(([0.0], np.cumsum(0.5 * step * (filled[1:] + filled[:-1]))))
    edges = np.concatenate((centres - 0.5 * BIN, centres + 0.5 * BIN))
    place = np.clip(((edges - time[0]) / step).astype(int), 0, time.size - 2)
    d = edges - time[0] - step * place
    slope = (filled[place + 1] - filled[place]) / step
    integral = whole[place] + filled[place] * d + 0.5 * slope * d**2
    missing = np.concatenate(([0], np.cumsum(~known)))
    lost = missing[place[centres.size :] + 2] > missing[place[: centres.size]]
    means = (integral[centres.size :] - integral[: centres.size]) / BIN
    return np.asarray(np.where(lost, np.nan, means), dtype=np.float64)


def _movement(row: xr.Dataset, panel: LoadedPanel, bins: _Bins) -> MeasuredMovement:
    name, size = str(row["movement"].values), float(row["size"])
    direction, place = str(row["direction"].values), str(row["place"].values)
    trapped = size > 0
    x = resolve_objects(panel, [ForeignObject(size, place)])[-1].x if trapped else np.nan
    signals = []
    for channel in ("drive_force", OBJECT_FORCE):
        found = row.get(f"{channel}_unfiltered", row.get(channel))
        if found is None:
            continue
        rows: list[tuple[str, Any]] = [("", found)]
        if "drive" in found.dims:
            rows = [(str(d), found.sel(drive=d)) for d in found["drive"].values]
        elif not trapped:
            continue
        for drive, values in rows:
            means = bins.means(np.asarray(values.values, dtype=np.float64))
            if np.isfinite(means).any():
                signals.append(
                    Signal(
                        channel=channel,
                        drive=drive,
                        time=bins.centres,
                        values=means,
                        recorder=_recorder(row, f"{channel}.{drive}".rstrip(".")),
                    )
                )
    currents = row.get("drive_current")
    return MeasuredMovement(
        name=name,
        direction=direction,
        place=place,
        size=size,
        x=x,
        signals=tuple(signals),
        length=movement_length(panel, direction, trapped=trapped),
        clocked=currents is not None and bool(np.isfinite(currents.values).any()),
    )


def later(forces: Floats) -> Floats:
    r"""Return the change of forces with a later onset, :math:`-\dot F`.

    Parameters
    ----------
    forces : ndarray, shape (..., n_times)
        In bins of `BIN`; NaN after the end of a movement, next to which the difference is taken
        on one side [N].

    Returns
    -------
    ndarray, shape (..., n_times)
        [N/s]; NaN where the forces are.

    Examples
    --------
    >>> later(np.array([0.0, 2.0, 4.0, np.nan])).tolist()
    [-100.0, -100.0, -100.0, nan]
    """
    slope = np.gradient(forces, BIN, axis=-1)
    steps = np.diff(forces, axis=-1) / BIN
    ends = np.full((*forces.shape[:-1], 1), np.nan)
    for aside in (np.concatenate((ends, steps), axis=-1), np.concatenate((steps, ends), axis=-1)):
        slope = np.where(np.isnan(slope) & np.isfinite(forces), aside, slope)
    return np.asarray(-slope, dtype=np.float64)
