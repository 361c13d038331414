"""Names and places of the members of a panel as coordinates of a dataset."""

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from turnout.core.lru_cache import LRUCache
from turnout.mechanism.drive_machines import slip_force
from turnout.mechanism.mechanism import Mechanism
from turnout.panel.model import Panel
from turnout.panel.records import Drive
from turnout.response.labels import DIRECTIONS
from turnout.response.save import Save
from turnout.response.signals import AXES, Variable, stop_names

if TYPE_CHECKING:
    import xarray as xr
    from xarray.core.indexes import Index

Floats = NDArray[np.float64]

MOST_KEPT = 64
"""Indexes of names are kept in memory, the latest used: making one takes longer than a channel."""
_indexes = LRUCache[tuple["Index", "xr.Variable"]](MOST_KEPT)

MOST_PANELS = 8
"""Panels whose coordinates and stations are kept in memory, the latest used."""

# Throws share what names and places are of. It is named by identity, and kept beside so that
# nothing else takes its place.
_of_members = LRUCache[tuple[dict[str, Variable], object]](MOST_PANELS)
_stations = LRUCache[tuple[Floats, object]](MOST_PANELS)


def stations(panel: Panel, mechanism: Mechanism, save: Save) -> Floats:
    """Return the places of `gap` and `lateral_displacement`, rising [m]."""
    if save.stations == "all":
        first = next(iter(panel.rail))
        return next(body.x.copy() for body in mechanism.rails if body.name == first)
    if save.stations is not None:
        return np.array(save.stations, dtype=float)
    families = (panel.chair, panel.drive)
    key = tuple(map(id, families))
    kept = _stations.get(key)
    if kept is None:
        places = [item.x for family in families for item in family.values()]
        kept = _stations.put(key, (np.unique(np.round(places, 9)), families))
    return kept[0].copy()


def coordinates(
    panel: Panel, mechanism: Mechanism, *, time: Floats, used: Collection[str] | None = None
) -> dict[str, Variable]:
    """Return every coordinate that some channel may use, but for "x", see `stations`.

    Those of other dimensions than the `used` ones are left out.
    """
    families = (
        *(panel.rail, panel.drive, panel.machine, panel.chair, panel.stop, panel.stud),
        *(panel.fastening, panel.link, panel.sensor),
    )
    key = tuple(map(id, families))
    kept = _of_members.get(key)
    if kept is None:
        kept = _of_members.put(key, (_member_coordinates(panel), families))
    found: dict[str, Variable] = {"time": (("time",), time)}
    for name, (dims, values) in kept[0].items():
        if used is None or dims[0] in used:
            found[name] = dims, values.copy()
    if mechanism.index.object_parts and (used is None or "object" in used):
        found["object"] = _names("object", mechanism.index.object_parts)
    return found


def _member_coordinates(panel: Panel) -> dict[str, Variable]:
    """Return names, places and properties of what a panel has."""
    found: dict[str, Variable] = {
        "rail": _names("rail", panel.rail),
        "drive": _names("drive", panel.drive),
        "drive_x": _numbers("drive", [drive.x for drive in panel.drive.values()]),
        "saturation_force": _numbers("drive", [slip_force(panel, name) for name in panel.drive]),
        "drive_stiffness": _numbers("drive", [_stiffness(drive) for drive in panel.drive.values()]),
        "direction": _names("direction", DIRECTIONS),
    }
    if panel.chair:
        found["chair"] = _names("chair", panel.chair)
        found["chair_x"] = _numbers("chair", [chair.x for chair in panel.chair.values()])
    if stops := [*panel.stop.values(), *panel.stud.values()]:
        found["stop"] = _names("stop", stop_names(panel))
        found["stop_x"] = _numbers("stop", [stop.x for stop in stops])
    if panel.fastening:
        found["fastening"] = _names("fastening", panel.fastening)
        found["fastening_x"] = _numbers("fastening", [f.x for f in panel.fastening.values()])
        found["axis"] = _names("axis", AXES)
    if panel.link:
        found["link"] = _names("link", panel.link)
        found["link_x"] = _numbers("link", [link.x for link in panel.link.values()])
    if panel.sensor:
        sensors = panel.sensor.values()
        found["sensor"] = _names("sensor", panel.sensor)
        found["sensor_x"] = _numbers("sensor", [sensor.x for sensor in sensors])
        found["sensor_limit"] = _numbers("sensor", [sensor.limit for sensor in sensors])
    return found


def indexed(coordinates: Mapping[str, Variable]) -> "xr.Coordinates":
    """Return coordinates with the indexes that xarray would make of them each time.

    Parameters
    ----------
    coordinates : dict of str to (dims, ndarray)
        Those named like their dimension have an index.
    """
    import xarray as xr

    variables: dict[str, xr.Variable] = {}
    indexes: dict[str, Index] = {}
    for name, (dims, values) in coordinates.items():
        if dims == (name,):
            indexes[name], variables[name] = _index_of(name, values)
        else:
            variables[name] = xr.Variable(dims, values)
    return xr.Coordinates(variables, indexes)


def _index_of(name: str, values: NDArray[np.generic]) -> "tuple[Index, xr.Variable]":
    """Return the index of a dimension, kept where it holds names: throws have the same ones."""
    import pandas as pd
    import xarray as xr

    key = (name, values.dtype.str, values.tobytes())
    kept = _indexes.get(key)
    if kept is not None:
        return kept
    held = values.copy()
    held.flags.writeable = False  # datasets of other throws may share the index
    # Of an array xarray makes the same index, but first loads every library of arrays it knows.
    index = xr.indexes.PandasIndex(pd.Index(held), name, coord_dtype=values.dtype)
    made: tuple[Index, xr.Variable] = index, index.create_variables()[name]
    return _indexes.put(key, made) if values.dtype.kind == "U" else made


def _stiffness(drive: Drive) -> float:
    """Return the one stiffness of a bushing [N/m]; NaN where its law is a table, which has many."""
    return drive.stiffness if drive.extension is None else float("nan")


def _names(dimension: str, names: object) -> Variable:
    return (dimension,), np.array(list(names), dtype=np.str_)  # type: ignore[call-overload]


def _numbers(dimension: str, values: list[float]) -> Variable:
    return (dimension,), np.array(values, dtype=float)
