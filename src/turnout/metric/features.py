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
from turnout.core.moving_average import WINDOW, whole_count, window_samples
from turnout.core.running_current import running_time
from turnout.metric.force_features import COUNT, FEWEST, SCRATCH_ROWS, measure_movements
from turnout.solver.record import TIME_TOLERANCE
from turnout.throw.slip import Span, movements

if TYPE_CHECKING:
    import xarray as xr

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

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
    ends: Ints | None = None,
) -> Floats:
    """Return the features of a run, or of rows of many runs, from bare arrays.

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
        Of the movements of each row; default those of `spans` [s].
    ends : ndarray of int, shape (n_drives,)
        Instants that each row has; default all.

    Returns
    -------
    ndarray, shape (n_features, n_drives, 2)
        In the order of `FEATURES` and `DIRECTIONS`.
    """
    count = force.shape[0]
    if onsets is None:
        onsets = np.tile([span.start for span in spans], (count, 1))
    force, travel = _as_kernels_take(force), None if travel is None else _as_kernels_take(travel)
    instants = _movement_windows(time, onsets, ends)
    lengths = np.array([span.end - span.start for span in spans])
    values = np.full((len(FEATURES), count, len(DIRECTIONS)), np.nan)
    for number, span in enumerate(spans):
        column, sign = (1, 1.0) if span.to == "closed" else (0, -1.0)
        windows = np.ascontiguousarray(instants[:, number : number + 2])
        length = np.full(count, lengths[number])
        if travel is None and current is not None:
            length = _running_times(time, current, windows, onsets[:, number])
        values[:, :, column] = _measured(
            time, force, travel, windows, (limits, onsets[:, number], length), sign
        )
    return values


def _movement_windows(time: Floats, onsets: Floats, ends: Ints | None) -> Ints:
    """Return the first instants of the movements of each row, and that after its last one."""
    found = np.empty((onsets.shape[0], onsets.shape[1] + 1), dtype=np.int64)
    found[:, :-1] = np.searchsorted(time, onsets - TIME_TOLERANCE)
    found[:, -1] = time.size if ends is None else ends
    return found


def _as_kernels_take(values: Floats) -> Floats:
    """Return an array, or a copy of it, as kernels take it."""
    return np.require(values, np.float64, ["C", "W"])


def _running_times(time: Floats, current: Floats, windows: Ints, onsets: Floats) -> Floats:
    """Return for how long the motor of each row runs in its movement [s]."""
    found = []
    for row, (first, last), onset in zip(current, windows.tolist(), onsets.tolist(), strict=True):
        elapsed = time[first:last] - onset
        known = elapsed >= 0.0
        found.append(
            running_time(elapsed[known], row[first:last][known])[1] if known.any() else 0.0
        )
    return np.array(found)


def _measured(
    time: Floats,
    force: Floats,
    travel: Floats | None,
    windows: Ints,
    of_rows: tuple[Floats, Floats, Floats],
    sign: float,
) -> Floats:
    """Return the features of one movement of each row, shape (n_features, n_rows).

    `of_rows` are limits, onsets, and times of the movement where there is no travel.
    """
    found = np.full((force.shape[0], COUNT), np.nan)
    if time.size >= FEWEST:
        limits, onsets, lengths = of_rows
        rate = (time.size - 1) / (time[-1] - time[0])
        choices = np.array([sign, ARRIVED, LEAST_RISE, LOW, HIGH, *MIDDLE])
        halves = [window_samples(window, rate=rate) // 2 for window in (WINDOW, SLOW)]
        samples = np.array([*halves, max(1, whole_count(WINDOW * rate))])
        measure_movements(
            _as_kernels_take(time),
            force,
            travel,
            windows,
            np.nextafter(limits, -np.inf),
            np.ascontiguousarray(onsets),
            lengths,
            choices,
            samples,
            np.empty((SCRATCH_ROWS, time.size + 1)),
            found,
        )
    return found.T


def compile_features() -> None:
    """Compile the kernels of features if they are not at hand."""
    kernel: Any = measure_movements
    if not kernel.is_kept():
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
    windows, onset = np.array([[0, elapsed.size]]), np.zeros(1)
    lengths, path = np.array([length]), None
    if travel is not None:
        path = _as_kernels_take(travel[np.newaxis])
    elif current is not None:
        lengths = _running_times(elapsed, current[np.newaxis], windows, onset)
    of_rows = np.array([limit]), onset, lengths
    force = _as_kernels_take(effort[np.newaxis])
    one: Floats = _measured(elapsed, force, path, windows, of_rows, 1.0)[:, 0]
    return one


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
