"""Features of the forces of drives, one number for each drive and movement.

All look at the *effort* of a drive: its force in the direction of the movement. They take what a
simulation or a measurement has, and are NaN where something they need was not kept or measured.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from turnout.errors import ResponseError
from turnout.metric.movement import TIME_TOLERANCE, Span, movements
from turnout.metric.signal import FILTER_WINDOW, filtered_values

if TYPE_CHECKING:
    import xarray as xr

Floats = NDArray[np.float64]

DIRECTIONS = ("opening", "closing")
# A force that rises less than this above its plateau does not build up [N].
LEAST_RISE = 50.0
# Between these shares of a rise its slope is taken [-].
LOW, HIGH = 0.1, 0.9
# The plateau is looked for between these shares of a movement [-].
MIDDLE = (0.25, 0.75)
# A marker nearer than this to its last place has arrived [m].
ARRIVED = 1e-9


@dataclass(frozen=True, slots=True)
class Feature:
    """A row of the table: name, SI unit, and what it is."""

    name: str
    units: str
    long_name: str


FEATURES: Mapping[str, Feature] = {
    row.name: row
    for row in (
        Feature("buildup_onset", "s", "when the effort begins to rise to its peak"),
        Feature("buildup_slope", "N/s", "slope of the effort from 10 to 90 % of that rise"),
        Feature("peak_force", "N", "largest effort of the drive"),
        Feature("peak_time", "s", "when the effort is largest"),
        Feature("plateau_force", "N", "median effort in the middle half of the movement"),
        Feature("end_force", "N", "mean effort over the last 0.1 s before the next movement"),
        Feature("marker_work", "J", "work of the marker"),
        Feature("duration", "s", "from the onset until the drive has arrived"),
        Feature("slip_time", "s", "when the drive first slips"),
    )
}
"""Every feature; times count from the onset of the movement."""


def features(dataset: "xr.Dataset") -> "xr.Dataset":
    """Return the features of every drive.

    Parameters
    ----------
    dataset : xarray.Dataset
        A run with `drive_force` and its movements in ``attrs``, or a campaign of measured or
        simulated movements. Sampled evenly; finer is better, at least 100 Hz.

    Returns
    -------
    xarray.Dataset
        The variables of `FEATURES` by (drive, direction), of the last movement each way; by
        (movement, drive) for a campaign.

    Raises
    ------
    ResponseError
        When there is no force, or no movement is named.

    Examples
    --------
    >>> import xarray as xr
    >>> time = np.arange(0.0, 3.0, 0.01)
    >>> force = np.interp(time, [0.0, 0.5, 1.6, 2.0, 3.0], [0.0, 100.0, 100.0, 500.0, 500.0])
    >>> run = xr.Dataset(
    ...     {"drive_force": (("drive", "time"), force[np.newaxis])},
    ...     {"time": time, "drive": ["1"]},
    ...     {"movements": '[{"name": "m", "to": "closed", "start": 0.0, "end": 2.0}]'},
    ... )
    >>> found = features(run).sel(drive="1", direction="closing")
    >>> round(float(found["peak_force"])), round(float(found["buildup_slope"]), -2)
    (500, 1000.0)
    """
    if "drive_force" not in dataset:
        message = "features: the dataset has no drive_force; keep or measure it"
        raise ResponseError(message)
    if "movement" in dataset.dims:
        return _of_campaign(dataset)
    spans = movements(dataset)
    if not spans:
        message = "features: the dataset names no movement; build a campaign of it first"
        raise ResponseError(message)
    values = run_features(
        dataset["time"].to_numpy(),
        dataset["drive_force"].to_numpy(),
        spans=spans,
        limits=_limits(dataset),
        travel=_rows(dataset, "drive_displacement"),
        current=_rows(dataset, "drive_current"),
    )
    drives = dataset["drive"].to_numpy()
    coordinates = {"drive": drives, "direction": np.array(DIRECTIONS)}
    return _labelled(values, ("drive", "direction"), coordinates)


def run_features(
    time: Floats,
    force: Floats,
    *,
    spans: Sequence[Span],
    limits: Floats,
    travel: Floats | None = None,
    current: Floats | None = None,
) -> Floats:
    """Return the features of a run from bare arrays.

    Parameters
    ----------
    time : ndarray, shape (n_times,)
        [s]
    force : ndarray, shape (n_drives, n_times)
        Positive closing [N].
    spans : sequence of Span
        Its movements.
    limits : ndarray, shape (n_drives,)
        Force at which each drive slips [N].
    travel, current : ndarray, shape (n_drives, n_times), optional
        Of the markers, positive closing [m], and of the motors [A].

    Returns
    -------
    ndarray, shape (n_features, n_drives, 2)
        In the order of `FEATURES` and `DIRECTIONS`.
    """
    bounds = [span.start for span in spans[1:]] + [np.inf]
    values = np.full((len(FEATURES), force.shape[0], len(DIRECTIONS)), np.nan)
    for span, until in zip(spans, bounds, strict=True):
        sign, column = (1.0, 1) if span.to == "closed" else (-1.0, 0)
        first, last = np.searchsorted(time, [span.start - TIME_TOLERANCE, until - TIME_TOLERANCE])
        part = slice(int(first), int(last))
        for row in range(force.shape[0]):
            values[:, row, column] = movement_features(
                time[part] - span.start,
                sign * force[row, part],
                travel=None if travel is None else sign * travel[row, part],
                current=None if current is None else current[row, part],
                limit=limits[row],
                length=span.end - span.start,
            )
    return values


def movement_features(
    elapsed: Floats,
    effort: Floats,
    *,
    travel: Floats | None = None,
    current: Floats | None = None,
    limit: float = np.inf,
    length: float = np.nan,
) -> Floats:
    """Return the features of one drive in one movement.

    Parameters
    ----------
    elapsed : ndarray, shape (n,)
        Time since the onset, evenly sampled [s].
    effort : ndarray, shape (n,)
        Force of the drive on the rail, positive in the direction of the movement [N].
    travel : ndarray, shape (n,), optional
        Displacement of the marker in that direction [m].
    current : ndarray, shape (n,), optional
        Of the motor; tells the end of a movement where the marker is not known [A].
    limit : float
        Force at which the drive slips [N].
    length : float
        Time of the movement, used where neither marker nor current tell it [s].

    Returns
    -------
    ndarray, shape (n_features,)
        In the order of `FEATURES`; NaN for what cannot be said.
    """
    known = np.isfinite(effort)
    if elapsed.size < 3 or not known.any():
        return np.full(len(FEATURES), np.nan)
    at = int(np.argmax(effort) if known.all() else np.nanargmax(effort))
    slips = np.flatnonzero(effort >= limit)
    step = (elapsed[-1] - elapsed[0]) / (elapsed.size - 1)
    held = max(1, round(FILTER_WINDOW / step))
    duration = _duration(elapsed, travel, current, length=length)
    low, high = np.searchsorted(elapsed, [share * duration for share in MIDDLE])
    plateau = float(np.median(effort[low:high])) if high > low else np.nan
    onset, slope = _build_up(elapsed, effort, plateau=plateau)
    work = np.nan if travel is None else float(np.trapezoid(effort, travel))
    return np.array(
        [
            *(onset, slope, effort[at], elapsed[at], plateau, float(np.mean(effort[-held:]))),
            *(work, duration, elapsed[slips[0]] if slips.size else np.nan),
        ]
    )


def _build_up(elapsed: Floats, effort: Floats, *, plateau: float) -> tuple[float, float]:
    """Return onset [s] and slope [N/s] of the last rise to the largest filtered effort."""
    smooth = filtered_values(effort, time=elapsed)
    top = int(np.argmax(smooth))
    rise = float(smooth[top]) - plateau
    if not rise >= LEAST_RISE:
        return np.nan, np.nan
    below = np.flatnonzero(smooth[: top + 1] <= plateau + LOW * rise)
    if not below.size:
        return np.nan, np.nan
    first = int(below[-1])
    last = first + int(np.argmax(smooth[first : top + 1] >= plateau + HIGH * rise))
    slope = float((smooth[last] - smooth[first]) / (elapsed[last] - elapsed[first]))
    return float(elapsed[first]), slope


def _duration(
    elapsed: Floats, travel: Floats | None, current: Floats | None, *, length: float
) -> float:
    if travel is not None:
        moving = np.flatnonzero(np.abs(travel - travel[-1]) > ARRIVED)
        return float(elapsed[min(moving[-1] + 1, elapsed.size - 1)]) if moving.size else 0.0
    if current is not None:
        running = np.flatnonzero((current > 0) & (elapsed >= 0))
        return float(elapsed[running[-1]]) if running.size else np.nan
    return length


def _of_campaign(dataset: "xr.Dataset") -> "xr.Dataset":
    """Return features by movement and drive; a campaign has time zero at each onset."""
    time, limits = dataset["time"].to_numpy(), _limits(dataset)
    signs = np.where(dataset["direction"].to_numpy() == "closing", 1.0, -1.0)
    force = dataset["drive_force"].transpose("movement", "drive", "time").to_numpy()
    travel, current = _rows(dataset, "drive_displacement"), _rows(dataset, "drive_current")
    values = np.full((len(FEATURES), *force.shape[:2]), np.nan)
    for number, sign in enumerate(signs):
        for row in range(force.shape[1]):
            known = (time >= -TIME_TOLERANCE) & np.isfinite(force[number, row])
            values[:, number, row] = movement_features(
                time[known],
                sign * force[number, row, known],
                travel=None if travel is None else sign * travel[number, row, known],
                current=None if current is None else current[number, row, known],
                limit=limits[row],
            )
    coordinates = {
        "movement": dataset["movement"].to_numpy(),
        "drive": dataset["drive"].to_numpy(),
        "direction": ("movement", dataset["direction"].to_numpy()),
    }
    return _labelled(values, ("movement", "drive"), coordinates)


def _labelled(
    values: Floats, dims: tuple[str, ...], coordinates: Mapping[str, object]
) -> "xr.Dataset":
    import xarray as xr  # those who want bare arrays need not wait for it

    variables = {
        name: (dims, row, {"units": feature.units, "long_name": feature.long_name})
        for (name, feature), row in zip(FEATURES.items(), values, strict=True)
    }
    return xr.Dataset(variables, coordinates)


def _limits(dataset: "xr.Dataset") -> Floats:
    """Return the force at which each drive slips; infinite where that is not known [N]."""
    if "saturation_force" not in dataset.coords:
        return np.full(dataset.sizes["drive"], np.inf)
    return dataset["saturation_force"].to_numpy()


def _rows(dataset: "xr.Dataset", name: str) -> Floats | None:
    """Return a channel with drive and time last; None where it is not there."""
    return dataset[name].transpose(..., "drive", "time").to_numpy() if name in dataset else None
