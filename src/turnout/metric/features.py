"""Features of the forces of drives, one number for each drive and movement.

All measure the *effort* of a drive: its force in the direction of the movement. They take what a
simulation or a measurement has, and are NaN where something they need was not kept or measured.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import ResponseError
from turnout.core.moving_average import WINDOW, row_levels, window_samples
from turnout.core.running_current import running_time
from turnout.kernels.force_features import find_places, find_rises, integrate_work
from turnout.throw.slip import TIME_TOLERANCE, Span, movements

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
# Vibration is what the effort has beside its mean over this [s]: above 3 Hz, stick-slip of rails.
SLOW = 0.3
# A marker nearer than this to its last place has arrived [m].
ARRIVED = 1e-9


@dataclass(frozen=True, slots=True)
class Feature:
    """A row of the table: name, SI unit, and meaning."""

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
        Feature(
            "vibration", "N", "effort about its mean over 0.3 s in that half, root mean square"
        ),
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
        current=_currents(dataset),
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
    onsets: Floats | None = None,
) -> Floats:
    """Return the features of a run from bare arrays.

    Parameters
    ----------
    time : ndarray, shape (n_times,)
        [s]
    force : ndarray, shape (n_drives, n_times)
        Positive closing [N].
    spans : sequence of Span
        Start and end [s] and direction of each movement.
    limits : ndarray, shape (n_drives,)
        Force at which each drive slips [N].
    travel : ndarray, shape (n, n_times), optional
        Of the markers, positive closing; the n rows repeat until there is one for each drive [m].
    current : ndarray, shape (n_drives, n_times), optional
        Of the motors, of either sign [A].
    onsets : ndarray, shape (n_drives, n_spans), optional
        Of the movements of each row, between the same instants as those of `spans` [s].

    Returns
    -------
    ndarray, shape (n_features, n_drives, 2)
        In the order of `FEATURES` and `DIRECTIONS`.
    """
    bounds = [span.start for span in spans[1:]] + [np.inf]
    values = np.full((len(FEATURES), force.shape[0], len(DIRECTIONS)), np.nan)
    for number, (span, until) in enumerate(zip(spans, bounds, strict=True)):
        column, turned = (1, False) if span.to == "closed" else (0, True)
        first, last = np.searchsorted(time, [span.start - TIME_TOLERANCE, until - TIME_TOLERANCE])
        part = slice(int(first), int(last))
        values[:, :, column] = _features(
            time[part],
            -force[:, part] if turned else force[:, part],
            travel=None if travel is None else -travel[:, part] if turned else travel[:, part],
            current=None if current is None else current[:, part],
            limits=limits,
            length=span.end - span.start,
            onsets=np.full(force.shape[0], span.start) if onsets is None else onsets[:, number],
        )
    return values


def compile_features() -> None:
    """Compile the kernels of features if they are not at hand."""
    kernels: tuple[Any, ...] = (find_places, find_rises, integrate_work)
    if not all(kernel.is_kept() for kernel in kernels):
        load_features()
        movement_features(np.arange(3.0), np.zeros(3))


def load_features() -> None:
    """Load the kernels of features, so that the first throws do not wait for them."""
    movement_features(np.arange(3.0), np.zeros(3), travel=np.zeros(3))


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
        Of the motor, of either sign; its cut-off is the end of a movement where the marker is not
        known, see `turnout.core.running_current` [A].
    limit : float
        Force at which the drive slips [N].
    length : float
        Time of the movement, used where neither marker nor current show it [s].

    Returns
    -------
    ndarray, shape (n_features,)
        In the order of `FEATURES`; NaN for what cannot be said.
    """
    found = _features(
        elapsed,
        effort[np.newaxis],
        travel=None if travel is None else travel[np.newaxis],
        current=None if current is None else current[np.newaxis],
        limits=np.array([limit]),
        length=length,
        onsets=np.zeros(1),
    )
    one: Floats = found[:, 0]
    return one


def _features(
    time: Floats,
    effort: Floats,
    *,
    travel: Floats | None,
    current: Floats | None,
    limits: Floats,
    length: float,
    onsets: Floats,
) -> Floats:
    """Return the features of many drives in one movement at once, shape (n_features, n_drives).

    `time` is that of the run, `onsets` are those of the movement of each drive [s].
    """
    found = np.full((len(FEATURES), effort.shape[0]), np.nan)
    if time.size < 3:
        return found
    effort = np.require(effort, np.float64, ["C", "W"])  # as kernels take it
    travel = None if travel is None else np.require(travel, np.float64, ["C", "W"])
    rows, places = np.arange(effort.shape[0]), np.empty((effort.shape[0], 3), dtype=np.int64)
    find_places(effort, travel, np.nextafter(limits, -np.inf), ARRIVED, places)
    at, slip, moving = places.T
    peak = effort[rows, at]
    some = np.isfinite(peak)
    if not some.any():
        return found
    held = max(1, round(WINDOW * (time.size - 1) / (time[-1] - time[0])))
    duration = np.full(peak.size, length)
    if travel is not None:
        integrate_work(effort, travel, found[6])
        arrived = time[np.minimum(moving + 1, time.size - 1)]
        duration = np.where(moving >= 0, arrived - onsets, 0.0)
    elif current is not None:
        elapsed = [time - onset for onset in onsets.tolist()]
        duration = np.array(
            [
                running_time(t[t >= 0.0], i[t >= 0.0])[1]
                for t, i in zip(elapsed, current, strict=True)
            ]
        )
    plateau, found[9] = _plateaus(time, effort, onsets, duration)
    rise, slope = _build_ups(time, effort, plateau)
    ends = effort[:, -held:].mean(axis=1)
    found[:6] = rise - onsets, slope, peak, time[at] - onsets, plateau, ends
    found[7] = duration
    found[8] = np.where(slip >= 0, time[slip] - onsets, np.nan)
    found[:, ~some] = np.nan
    return found


def _plateaus(
    time: Floats, effort: Floats, onsets: Floats, duration: Floats
) -> tuple[Floats, Floats]:
    """Return median and vibration in the middle of the movement of each row [N]."""
    found, swing = np.full((2, duration.size), np.nan)
    rate = (time.size - 1) / (time[-1] - time[0])
    half = window_samples(SLOW, rate=rate) // 2
    cases, of_case = np.unique(np.stack((onsets, duration)), axis=1, return_inverse=True)
    middle = [
        np.searchsorted(time - start, np.multiply(length, MIDDLE)) for start, length in cases.T
    ]
    bounds, of_each = np.unique(np.array(middle)[of_case.ravel()], axis=0, return_inverse=True)
    for number, (low, high) in enumerate(bounds.tolist()):  # mostly a few
        if high > low:
            alike = of_each == number if len(bounds) > 1 else slice(None)
            found[alike] = _medians(effort[alike, low:high])
            if half and low >= half and high + half <= time.size:
                swing[alike] = _swings(effort[alike, low - half : high + half], half)
    return found, swing


def _swings(values: Floats, half: int) -> Floats:
    """Return the root mean square of rows about their means over ``2 half + 1`` samples.

    Half a window at either end serves the means alone.
    """
    inner = values[:, half : values.shape[1] - half]
    sums = np.cumsum(np.pad(values - inner[:, :1], ((0, 0), (1, 0))), axis=1)
    width = 2 * half + 1
    means = (sums[:, width:] - sums[:, :-width]) / width + inner[:, :1]
    return np.asarray(np.sqrt(np.square(inner - means).mean(axis=1)), dtype=np.float64)


def _medians(values: Floats) -> Floats:
    """Return the `numpy.median` of each row, in a third of its time for short rows."""
    rising, half = np.sort(values, axis=1), values.shape[1] // 2
    middle = rising[:, half]
    if values.shape[1] % 2 == 0:
        middle = 0.5 * (rising[:, half - 1] + middle)
    return np.where(np.isnan(rising[:, -1]), np.nan, middle)  # NaN comes last


def _build_ups(time: Floats, effort: Floats, plateau: Floats) -> tuple[Floats, Floats]:
    """Return onset [s] and slope [N/s] of the last rise of each row to its largest filtered effort.

    NaN where there is none.
    """
    rate = (time.size - 1) / (time[-1] - time[0])
    half = min(window_samples(WINDOW, rate=rate) // 2, time.size - 1)
    scratch, places = np.empty((3, time.size)), np.empty((plateau.size, 2), dtype=np.int64)
    heights, level = np.full((plateau.size, 2), np.nan), row_levels(effort)
    rising = (LOW, HIGH)
    find_rises(effort, level, plateau, half, LEAST_RISE, rising, scratch, places, heights)
    first, last = places.T
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (heights[:, 1] - heights[:, 0]) / (time[last] - time[first])
    return np.where(first >= 0, time[first], np.nan), np.where(first >= 0, slope, np.nan)


def _of_campaign(dataset: "xr.Dataset") -> "xr.Dataset":
    """Return features by movement and drive; a campaign has time zero at each onset."""
    time, limits = dataset["time"].to_numpy(), _limits(dataset)
    signs = np.where(dataset["direction"].to_numpy() == "closing", 1.0, -1.0)
    force = dataset["drive_force"].transpose("movement", "drive", "time").to_numpy()
    travel, current = _rows(dataset, "drive_displacement"), _currents(dataset)
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
    """Return the force at which each drive slips; infinite if unknown [N]."""
    if "saturation_force" not in dataset.coords:
        return np.full(dataset.sizes["drive"], np.inf)
    return dataset["saturation_force"].to_numpy()


def _rows(dataset: "xr.Dataset", name: str) -> Floats | None:
    """Return a channel with drive and time last, or None if it is missing."""
    return dataset[name].transpose(..., "drive", "time").to_numpy() if name in dataset else None


def _currents(dataset: "xr.Dataset") -> Floats | None:
    """Return the currents as recorded: a filter spreads the braking current over the cut-off."""
    sharp = _rows(dataset, "drive_current_unfiltered")
    return sharp if sharp is not None else _rows(dataset, "drive_current")
