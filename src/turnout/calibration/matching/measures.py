"""Numbers that facts are about, each from a throw of a panel; a few throw it again.

Limits that are states of a switch, such as "slips" and "locks", are measured as lengths, positive
on one side and negative on the other, so that they can be interpolated between panels.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from turnout.core.units import CURRENT, FORCE, FORCE_RATE, LENGTH, Dimension
from turnout.metric.channel_features import filtered
from turnout.metric.features import features
from turnout.metric.panel_check import concerns, flutter_concerns
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel
from turnout.panel.lock_rule import LOCK_RULES, DriveStates
from turnout.panel.markers import movement_time, ordered_movements
from turnout.solver.record import TIME_TOLERANCE
from turnout.throw.slip import last_instant_at, movements

if TYPE_CHECKING:
    import xarray as xr

Floats = NDArray[np.float64]

SHARE = Dimension("share", "", "0.1")

LAST = 0.4
"""Over which end forces are averaged [s]."""
SEEN = 50.0
"""Change of an end force from which an object is visible [N]."""
LARGEST_SIZE, SIZE_STEP = 40e-3, 1e-4
"""A visible size is sought up to the first, to within the second [m]."""
FLUTTER_CUTOFF = 300.0
"""Modes above are computed only where those below can flutter [Hz].

On the default panel without chair dashpots, which flutters at 110 Hz, growth rates without them
are within 0.02 1/s of those of all modes; those of slow modes, near 5 Hz, are too large by 0.1 1/s
at most.
"""


@dataclass(frozen=True, slots=True)
class Thrown:
    """A throw of a panel, from which measures are taken.

    Attributes
    ----------
    panel : LoadedPanel
        With the values of the throw.
    dataset : xarray.Dataset
        Of the throw.
    throw : callable
        Throws the panel once more, with a foreign object.
    """

    panel: LoadedPanel
    dataset: "xr.Dataset"
    throw: Callable[[ForeignObject], "xr.Dataset"]


@dataclass(frozen=True, slots=True)
class ThrowMeasure:
    """A number of a throw.

    Attributes
    ----------
    dimension : Dimension
        Of its value; `SHARE` for plain numbers.
    meaning : str
        What it is.
    of : str
        What it is taken of: "drive", "sensor", "place", or empty for the whole throw.
    compute : callable
        From a throw and the name of what it is taken of to the value in SI.
    cost : int
        Processor time in throws, about; what costs more is tried later.
    by_machines : bool
        Whether it is one of a throw whose drives are machines.
    """

    dimension: Dimension
    meaning: str
    of: str
    compute: Callable[[Thrown, str], float]
    cost: int = 1
    by_machines: bool = False


def end_forces(ds: "xr.Dataset") -> Floats:
    """Return the mean force of every drive over the last 0.4 s [N], shape (n_drives,)."""
    time = ds["time"].to_numpy()
    force = ds["drive_force"].transpose("drive", "time").to_numpy()
    return np.asarray(force[:, time > time[-1] - LAST].mean(axis=1))


def end_force(thrown: Thrown, drive: str) -> float:
    """Return the mean force of a drive over the last 0.4 s [N]."""
    return float(end_forces(thrown.dataset)[list(thrown.panel.drive).index(drive)])


def open_force(thrown: Thrown, drive: str) -> float:
    """Return the force with which a drive holds the rail open at rest [N]."""
    return -float(last_instant_at(thrown.dataset, to="open")["drive_force"].sel(drive=drive))


def _feature(name: str, direction: str) -> Callable[[Thrown, str], float]:
    def compute(thrown: Thrown, drive: str) -> float:
        return float(features(thrown.dataset)[name].sel(drive=drive, direction=direction))

    return compute


def end_gap(thrown: Thrown, drive: str) -> float:
    """Return the raw gap at a drive at the end [m]."""
    return float(thrown.dataset["end_gap"].sel(drive=drive))


def open_gap(thrown: Thrown, drive: str) -> float:
    """Return the gap at a drive at rest in the open position [m]."""
    return float(last_instant_at(thrown.dataset, to="open")["drive_gap"].sel(drive=drive))


def sensor_gap(thrown: Thrown, sensor: str) -> float:
    """Return the gap at a sensor at the end [m]."""
    return float(thrown.dataset["sensor_gap"].sel(sensor=sensor)[-1])


def least_sensor_gap(thrown: Thrown, sensor: str) -> float:
    """Return the least gap at a sensor while the instrumented rail should be closed [m].

    An object of a smaller size there is never touched.
    """
    gap = thrown.dataset["sensor_gap"].sel(sensor=sensor).to_numpy()
    time, closed = thrown.dataset["time"].to_numpy(), np.ones(gap.size, dtype=np.bool_)
    for span in movements(thrown.dataset):
        closed[time >= span.start - TIME_TOLERANCE] = span.to == "closed"
    return float(gap[closed].min())


def slip_travels(panel: LoadedPanel, ds: "xr.Dataset", *, closing: bool) -> Floats:
    """Return how far each drive's bushing comes beyond its slip level [m], shape (n_drives,).

    Negative before: the travel that is left until it slips. Below the slip level the bushing yields
    with its stiffness, beyond with its saturated stiffness, so that the travel is continuous.
    """
    spans = [span for span in movements(ds) if span.to == "closed"]
    time = ds["time"].to_numpy()
    start = spans[-1].start if closing and spans else -np.inf
    during = time >= start - TIME_TOLERANCE
    force = ds["drive_force"].transpose("drive", "time").to_numpy()[:, during]
    effort = force.max(axis=1) if closing else np.abs(force).max(axis=1)
    return _as_travel(panel, effort - ds["saturation_force"].to_numpy())


def _as_travel(panel: LoadedPanel, excess: Floats) -> Floats:
    """Return forces beyond a level [N] as travels of the drives' bushings [m]."""
    drives = list(panel.drive.values())
    soft = np.array([d.saturated_stiffness or d.stiffness for d in drives])
    stiff = np.array([drive.stiffness for drive in drives])
    return np.asarray(np.where(excess > 0.0, excess / soft, excess / stiff))


def slip_travel(thrown: Thrown, drive: str) -> float:
    """Return the slip travel of a drive in the last closing; without a name the largest [m]."""
    found = slip_travels(thrown.panel, thrown.dataset, closing=True)
    return float(found[list(thrown.panel.drive).index(drive)] if drive else found.max())


def slip_travel_anywhere(thrown: Thrown, drive: str) -> float:
    """Return the slip travel in both directions [m]."""
    found = slip_travels(thrown.panel, thrown.dataset, closing=False)
    return float(found[list(thrown.panel.drive).index(drive)] if drive else found.max())


def lock_excess(thrown: Thrown, _: str) -> float:
    """Return by how much the closed switch misses its lock [m]; negative where it locks.

    The largest of what the criteria of the panel's rule measure at drives less their limits, forces
    as travels of bushings. A machine that went to its limit contact is locked in whatever force it
    holds, so that a criterion which does not refuse it says nothing beyond its limit.
    """
    panel, ds = thrown.panel, thrown.dataset
    end = ds.isel(time=slice(-2, None)).transpose("drive", ..., "time")
    drives = DriveStates(
        slipping=end["drive_slipping"].to_numpy(),
        force=end["drive_force"].to_numpy(),
        gap=ds["end_gap"].to_numpy()[:, np.newaxis],
        slip_limit=ds["saturation_force"].to_numpy(),
        gap_limit=np.array(list(panel.gap_limits().values())),
    )
    found = []
    for item in LOCK_RULES[panel.lock.rule]:
        excess = item.value(drives).max(axis=-1) - item.limit(drives)
        excess[(excess > 0.0) & ~item.refuses(drives).any(axis=-1)] = np.nan
        found.append(excess if item.unit == "m" else _as_travel(panel, excess))
    return float(np.fmax.reduce(found, axis=None))


def least_margin(thrown: Thrown, drive: str) -> float:
    """Return the least force margin of a drive, or of all, as a share of the slip level [-]."""
    shares = thrown.dataset["force_margin"] / thrown.dataset["saturation_force"]
    if drive:
        shares = shares.sel(drive=drive)
    return float(shares.min())


def flangeway(thrown: Thrown, _: str) -> float:
    """Return the least flangeway [m]."""
    return float(thrown.dataset["least_flangeway"])


def least_gauge(thrown: Thrown, _: str) -> float:
    """Return the least track gauge at the end of a movement less its design [m]."""
    gauge = thrown.panel.gauge
    return float("nan") if gauge is None else float(thrown.dataset["least_gauge"]) - gauge.nominal


def closing_current(thrown: Thrown, drive: str) -> float:
    """Return the largest motor current in the second half of closing, averaged over 0.1 s [A].

    The inrush is in the first half, and so is what an object cannot change.
    """
    closings = [item for _, item in ordered_movements(thrown.panel) if item.to == "closed"]
    closing = closings[-1]
    current = filtered(thrown.dataset["drive_current"].sel(drive=drive))
    middle = closing.start + 0.5 * movement_time(closing, drive)
    return float(current.sel(time=slice(middle, None)).max())


def object_force(thrown: Thrown, _: str) -> float:
    """Return the largest force on the foreign object; 0 without any [N]."""
    return float(thrown.dataset["object_force"].max()) if "object_force" in thrown.dataset else 0.0


def object_end_force(thrown: Thrown, _: str) -> float:
    """Return the force on the foreign object at the end; 0 without any [N]."""
    return float(thrown.dataset["object_force"][-1]) if "object_force" in thrown.dataset else 0.0


def least_chair_load(thrown: Thrown, _: str) -> float:
    """Return the largest normal force of the chair that carries least [N]."""
    return float(thrown.dataset["chair_normal_force"].max("time").min())


def throw_warnings(thrown: Thrown, _: str) -> float:
    """Return how many warnings of `turnout panel check` follow from a throw."""
    return float(len(concerns(thrown.dataset)))


def flutter_warnings(thrown: Thrown, _: str) -> float:
    """Return how many warnings `turnout panel check` gives about flutter."""
    return float(len(flutter_concerns(thrown.panel, cutoff_frequency=FLUTTER_CUTOFF)))


def visible_size(thrown: Thrown, place: str) -> float:
    """Return the smallest size at a place that changes an end force by more than `SEEN` [m].

    By bisection, so for forces that grow with size; the largest size where none does. It is
    compared with the throw itself, which should have no object.
    """
    without = end_forces(thrown.dataset)
    unseen, seen = 0.0, LARGEST_SIZE
    while seen - unseen > SIZE_STEP:
        middle = 0.5 * (unseen + seen)
        changed = end_forces(thrown.throw(ForeignObject(middle, place)))
        if np.abs(changed - without).max() > SEEN:
            seen = middle
        else:
            unseen = middle
    return seen


MEASURES: Mapping[str, ThrowMeasure] = {
    "end force": ThrowMeasure(
        FORCE, "mean force of a drive over the last 0.4 s", "drive", end_force
    ),
    "open force": ThrowMeasure(
        FORCE, "force that holds the rail open at rest", "drive", open_force
    ),
    "peak opening force": ThrowMeasure(
        FORCE, "largest effort on opening", "drive", _feature("peak_force", "opening")
    ),
    "plateau force": ThrowMeasure(
        FORCE,
        "median effort in the middle half of closing",
        "drive",
        _feature("plateau_force", "closing"),
    ),
    "build-up": ThrowMeasure(
        FORCE_RATE,
        "slope from 10 to 90 % of the rise on closing",
        "drive",
        _feature("buildup_slope", "closing"),
    ),
    "end gap": ThrowMeasure(LENGTH, "raw gap at a drive at the end", "drive", end_gap),
    "open gap": ThrowMeasure(
        LENGTH, "gap at a drive at rest in the open position", "drive", open_gap
    ),
    "sensor gap": ThrowMeasure(LENGTH, "gap at a sensor at the end", "sensor", sensor_gap),
    "least sensor gap": ThrowMeasure(
        LENGTH, "least gap at a sensor of the closing rail", "sensor", least_sensor_gap
    ),
    "slip travel": ThrowMeasure(
        LENGTH, "bushing beyond its slip level on closing, negative before", "drive?", slip_travel
    ),
    "slip travel anywhere": ThrowMeasure(
        LENGTH, "the same, in both directions", "drive?", slip_travel_anywhere
    ),
    "lock excess": ThrowMeasure(
        LENGTH, "by how much lock is missed, negative where it locks", "", lock_excess
    ),
    "least margin": ThrowMeasure(
        SHARE, "least force margin as a share of the slip level", "drive?", least_margin
    ),
    "least flangeway": ThrowMeasure(LENGTH, "least distance for the wheel", "", flangeway),
    "least gauge": ThrowMeasure(
        LENGTH, "least track gauge less the nominal one, at the end of a movement", "", least_gauge
    ),
    "closing current": ThrowMeasure(
        CURRENT,
        "largest current in the second half of closing, mean over 0.1 s, drives as machines",
        "drive",
        closing_current,
        by_machines=True,
    ),
    "object force": ThrowMeasure(FORCE, "largest force on the object", "", object_force),
    "object end force": ThrowMeasure(FORCE, "force on the object at the end", "", object_end_force),
    "least chair load": ThrowMeasure(
        FORCE, "largest load of the chair that carries least", "", least_chair_load
    ),
    "throw warnings": ThrowMeasure(
        SHARE, "warnings of `turnout panel check` that follow from a throw", "", throw_warnings
    ),
    "flutter warnings": ThrowMeasure(
        SHARE, "warnings of `turnout panel check` about flutter", "", flutter_warnings, 40
    ),
    "visible size": ThrowMeasure(
        LENGTH,
        "smallest object at a place that changes an end force by more than 50 N",
        "place",
        visible_size,
        10,
    ),
}
"""All measures by name. "drive?" is of one drive, or of the worst where none is named."""
