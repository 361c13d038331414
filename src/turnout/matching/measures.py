"""Numbers that facts are about: each from the dataset of one throw.

Limits that are states of a switch, such as "slips" and "locks", are measured as lengths, positive
on one side and negative on the other, so that they can be interpolated between panels.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from turnout.analysis.panel_check import concerns, flutter_concerns
from turnout.core.units import FORCE, FORCE_RATE, LENGTH, Dimension
from turnout.metric.features import features
from turnout.metric.slip import last_instant_at, movements
from turnout.panel.load import LoadedPanel

if TYPE_CHECKING:
    import xarray as xr

Floats = NDArray[np.float64]

SHARE = Dimension("share", "", "0.1")

LAST = 0.4
"""Over which end forces are averaged [s]."""
TIME_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True)
class Measure:
    """A number of a throw.

    Attributes
    ----------
    dimension : Dimension
        Of its value; `SHARE` for plain numbers.
    meaning : str
        What it is.
    of : str
        What it is taken of: "drive", "sensor", or empty for the whole throw.
    compute : callable
        From panel, dataset and name to the value in SI.
    """

    dimension: Dimension
    meaning: str
    of: str
    compute: Callable[[LoadedPanel, "xr.Dataset", str], float]


def end_force(_: LoadedPanel, ds: "xr.Dataset", drive: str) -> float:
    """Return the mean force of a drive over the last 0.4 s [N]."""
    time = ds["time"].to_numpy()
    force = ds["drive_force"].sel(drive=drive).to_numpy()
    return float(force[time > time[-1] - LAST].mean())


def open_force(_: LoadedPanel, ds: "xr.Dataset", drive: str) -> float:
    """Return the force with which a drive holds the rail open at rest [N]."""
    return -float(last_instant_at(ds, to="open")["drive_force"].sel(drive=drive))


def _feature(name: str, direction: str) -> Callable[[LoadedPanel, "xr.Dataset", str], float]:
    def compute(_: LoadedPanel, ds: "xr.Dataset", drive: str) -> float:
        return float(features(ds)[name].sel(drive=drive, direction=direction))

    return compute


def end_gap(_: LoadedPanel, ds: "xr.Dataset", drive: str) -> float:
    """Return the raw gap at a drive at the end [m]."""
    return float(ds["end_gap"].sel(drive=drive))


def open_gap(_: LoadedPanel, ds: "xr.Dataset", drive: str) -> float:
    """Return the gap at a drive at rest in the open position [m]."""
    return float(last_instant_at(ds, to="open")["drive_gap"].sel(drive=drive))


def sensor_gap(_: LoadedPanel, ds: "xr.Dataset", sensor: str) -> float:
    """Return the gap at a sensor at the end [m]."""
    return float(ds["sensor_gap"].sel(sensor=sensor)[-1])


def least_sensor_gap(_: LoadedPanel, ds: "xr.Dataset", sensor: str) -> float:
    """Return the least gap at a sensor at any time [m]: what is smaller there is never touched."""
    return float(ds["sensor_gap"].sel(sensor=sensor).min())


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
    excess = effort - ds["saturation_force"].to_numpy()
    drives = list(panel.drive.values())
    soft = np.array([d.saturated_stiffness or d.stiffness for d in drives])
    stiff = np.array([drive.stiffness for drive in drives])
    return np.asarray(np.where(excess > 0.0, excess / soft, excess / stiff))


def slip_travel(panel: LoadedPanel, ds: "xr.Dataset", drive: str) -> float:
    """Return the slip travel of a drive in the last closing; without a name the largest [m]."""
    found = slip_travels(panel, ds, closing=True)
    return float(found[list(panel.drive).index(drive)] if drive else found.max())


def slip_travel_anywhere(panel: LoadedPanel, ds: "xr.Dataset", drive: str) -> float:
    """Return the slip travel in both directions [m]."""
    found = slip_travels(panel, ds, closing=False)
    return float(found[list(panel.drive).index(drive)] if drive else found.max())


def lock_excess(panel: LoadedPanel, ds: "xr.Dataset", _: str) -> float:
    """Return by how much the closed switch misses its lock [m]; negative where it locks.

    The largest of slip travels and of gaps at drives less their limits, by the rule of the panel.
    """
    limits = np.array(list(panel.gap_limits().values()))
    gaps = ds["end_gap"].to_numpy() - limits
    at_end = ds.isel(time=slice(-2, None))
    slips = slip_travels(panel, at_end, closing=False)
    used = {"slip or gap": (gaps, slips), "no slip": (slips,), "raw gap": (gaps,)}
    return float(np.nanmax(np.concatenate(used[panel.lock.rule])))


def least_margin(_: LoadedPanel, ds: "xr.Dataset", drive: str) -> float:
    """Return the least force margin of a drive, or of all, as a share of the slip level [-]."""
    shares = ds["force_margin"] / ds["saturation_force"]
    if drive:
        shares = shares.sel(drive=drive)
    return float(shares.min())


def flangeway(_: LoadedPanel, ds: "xr.Dataset", __: str) -> float:
    """Return the least flangeway [m]."""
    return float(ds["least_flangeway"])


def object_force(_: LoadedPanel, ds: "xr.Dataset", __: str) -> float:
    """Return the largest force on the foreign object; 0 without any [N]."""
    return float(ds["object_force"].max()) if "object_force" in ds else 0.0


def object_end_force(_: LoadedPanel, ds: "xr.Dataset", __: str) -> float:
    """Return the force on the foreign object at the end; 0 without any [N]."""
    return float(ds["object_force"][-1]) if "object_force" in ds else 0.0


def least_chair_load(_: LoadedPanel, ds: "xr.Dataset", __: str) -> float:
    """Return the largest normal force of the chair that carries least [N]."""
    return float(ds["chair_normal_force"].max("time").min())


def throw_warnings(_: LoadedPanel, ds: "xr.Dataset", __: str) -> float:
    """Return how many warnings of `turnout panel check` follow from a throw."""
    return float(len(concerns(ds)))


def flutter_warnings(panel: LoadedPanel, _: "xr.Dataset", __: str) -> float:
    """Return how many warnings `turnout panel check` gives about flutter; takes seconds."""
    return float(len(flutter_concerns(panel)))


VISIBLE = "visible size"
"""The one measure that takes several throws: see `turnout.matching.meet_facts.visible_size`."""


def _takes_throws(_: LoadedPanel, __: "xr.Dataset", place: str) -> float:
    message = f"the visible size at {place} takes more than one throw"
    raise NotImplementedError(message)


MEASURES: Mapping[str, Measure] = {
    "end force": Measure(FORCE, "mean force of a drive over the last 0.4 s", "drive", end_force),
    "open force": Measure(FORCE, "force that holds the rail open at rest", "drive", open_force),
    "peak opening force": Measure(
        FORCE, "largest effort on opening", "drive", _feature("peak_force", "opening")
    ),
    "plateau force": Measure(
        FORCE,
        "median effort in the middle half of closing",
        "drive",
        _feature("plateau_force", "closing"),
    ),
    "build-up": Measure(
        FORCE_RATE,
        "slope from 10 to 90 % of the rise on closing",
        "drive",
        _feature("buildup_slope", "closing"),
    ),
    "end gap": Measure(LENGTH, "raw gap at a drive at the end", "drive", end_gap),
    "open gap": Measure(LENGTH, "gap at a drive at rest in the open position", "drive", open_gap),
    "sensor gap": Measure(LENGTH, "gap at a sensor at the end", "sensor", sensor_gap),
    "least sensor gap": Measure(
        LENGTH, "least gap at a sensor at any time", "sensor", least_sensor_gap
    ),
    "slip travel": Measure(
        LENGTH, "bushing beyond its slip level on closing, negative before", "drive?", slip_travel
    ),
    "slip travel anywhere": Measure(
        LENGTH, "the same, in both directions", "drive?", slip_travel_anywhere
    ),
    "lock excess": Measure(
        LENGTH, "by how much lock is missed, negative where it locks", "", lock_excess
    ),
    "least margin": Measure(
        SHARE, "least force margin as a share of the slip level", "drive?", least_margin
    ),
    "least flangeway": Measure(LENGTH, "least distance for the wheel", "", flangeway),
    "object force": Measure(FORCE, "largest force on the object", "", object_force),
    "object end force": Measure(FORCE, "force on the object at the end", "", object_end_force),
    "least chair load": Measure(
        FORCE, "largest load of the chair that carries least", "", least_chair_load
    ),
    "throw warnings": Measure(
        SHARE, "warnings of `turnout panel check` that follow from a throw", "", throw_warnings
    ),
    "flutter warnings": Measure(
        SHARE, "warnings of `turnout panel check` about flutter", "", flutter_warnings
    ),
    VISIBLE: Measure(
        LENGTH,
        "smallest object at a place that changes an end force by more than 50 N",
        "place",
        _takes_throws,
    ),
}
"""All measures by name. "drive?" is of one drive, or of the worst where none is named."""
