"""Names and places of the members of a panel as coordinates of a dataset."""

from collections.abc import Callable, Container, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from turnout.core.lru_cache import LRUCache
from turnout.mechanism.mechanism import LawIndex, Mechanism
from turnout.panel.model import Panel
from turnout.panel.records import Drive, Placed
from turnout.throw.lock_and_control import DIRECTIONS
from turnout.throw.save import Save
from turnout.throw.signals import AXES, Channel, slip_forces, stop_names

if TYPE_CHECKING:
    import xarray as xr
    from xarray.core.indexes import Index

Floats = NDArray[np.float64]

_indexes = LRUCache[tuple["Index", "xr.Variable"]](64)


def output_stations(panel: Panel, mechanism: Mechanism, save: Save) -> Floats:
    """Return the places of `gap` and `lateral_displacement`, rising [m]."""
    if save.stations == "all":
        first = next(iter(panel.rail))
        return next(body.x.copy() for body in mechanism.rails if body.name == first)
    if save.stations is not None:
        return np.array(save.stations, dtype=float)
    return default_stations(panel)


def default_stations(panel: Panel) -> Floats:
    """Return the places of chairs and drives, rising [m]."""
    places = [item.x for family in (panel.chair, panel.drive) for item in family.values()]
    return np.unique(np.round(places, 9))


def dimensions_of(channels: Mapping[str, Channel]) -> set[str]:
    """Return the dimensions that some channels use."""
    return {dim for dims, _ in channels.values() for dim in dims}


def dataset_coordinates(
    panel: Panel, index: LawIndex, *, used: Container[str]
) -> dict[str, Channel]:
    """Return the coordinates of some dimensions, but time and "x", as bare arrays.

    Parameters
    ----------
    panel, index
        What was thrown, and its laws.
    used : container of str
        The dimensions.
    """
    stacked = shared_coordinates([panel], used=used)
    found = {name: v if v[0] == (name,) else (v[0], v[1][0]) for name, v in stacked.items()}
    return found | object_coordinate(index, used=used)


def shared_coordinates(panels: Sequence[Panel], *, used: Container[str]) -> dict[str, Channel]:
    """Return coordinates of some panels that differ in values alone.

    Returns
    -------
    dict of str to (dims, ndarray)
        Those of dimensions once, all others with panels first. Throws share the arrays, which none
        may change.
    """
    found: dict[str, Channel] = {}
    for dimension in _DIMENSIONS:
        if dimension == "drive" and dimension in used:
            found |= _of_drives(panels)
        elif dimension in used:
            made = [_MAKERS[dimension](panel) for panel in panels]
            found |= {
                name: (dims, v if dims == (name,) else np.array([one[name][1] for one in made]))
                for name, (dims, v) in made[0].items()
            }
    return found


def object_coordinate(index: LawIndex, *, used: Container[str]) -> dict[str, Channel]:
    """Return the names of the objects, if there are any and their dimension is used."""
    if "object" not in used or not index.object_parts:
        return {}
    return {"object": _names("object", index.object_parts)}


def _of_drives(panels: Sequence[Panel]) -> dict[str, Channel]:
    """Return the coordinates made for each throw, since most studies vary something of drives."""
    drives = [panel.drive.values() for panel in panels]
    return {
        "drive": _names("drive", panels[0].drive),
        "drive_x": _numbers("drive", [[drive.x for drive in own] for own in drives]),
        "saturation_force": (("drive",), np.array([slip_forces(panel) for panel in panels])),
        "drive_stiffness": _numbers("drive", [[*map(_stiffness, own)] for own in drives]),
    }


def _of_stops(panel: Panel) -> dict[str, Channel]:
    both = {**panel.stop, **{f"stud {name}": stud for name, stud in panel.stud.items()}}
    return {"stop": _names("stop", stop_names(panel)), "stop_x": _places("stop", both)}


def _of_sensors(panel: Panel) -> dict[str, Channel]:
    limits = [sensor.limit for sensor in panel.sensor.values()]
    return {
        "sensor": _names("sensor", panel.sensor),
        "sensor_x": _places("sensor", panel.sensor),
        "sensor_limit": _numbers("sensor", limits),
    }


_MAKERS: Mapping[str, Callable[[Panel], dict[str, Channel]]] = {
    "rail": lambda panel: {"rail": _names("rail", panel.rail)},
    "direction": lambda _: {"direction": _names("direction", DIRECTIONS)},
    "chair": lambda panel: _members("chair", panel.chair),
    "stop": _of_stops,
    "fastening": lambda panel: _members("fastening", panel.fastening),
    "axis": lambda _: {"axis": _names("axis", AXES)},
    "link": lambda panel: _members("link", panel.link),
    "sensor": _of_sensors,
}
"""Coordinates of each dimension, but of drives."""
_DIMENSIONS = ("rail", "drive", *(name for name in _MAKERS if name != "rail"))


def _members(dimension: str, family: Mapping[str, Placed]) -> dict[str, Channel]:
    """Return names and places of some members."""
    return {dimension: _names(dimension, family), f"{dimension}_x": _places(dimension, family)}


def indexed(dataset_coordinates: Mapping[str, Channel]) -> "xr.Coordinates":
    """Return coordinates with the indexes that xarray would make of them each time.

    Parameters
    ----------
    coordinates : dict of str to (dims, ndarray)
        Those named like their dimension have an index.
    """
    import xarray as xr

    variables: dict[str, xr.Variable] = {}
    indexes: dict[str, Index] = {}
    for name, (dims, values) in dataset_coordinates.items():
        if dims == (name,):
            indexes[name], variables[name] = _index_of(name, values)
        else:
            variables[name] = xr.Variable(dims, values)
    return xr.Coordinates(variables, indexes)


def _index_of(name: str, values: NDArray[np.generic]) -> "tuple[Index, xr.Variable]":
    """Return the index of a dimension; one of names is kept, since throws have the same ones."""
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
    """Return the one stiffness of a bushing [N/m]; NaN for a table, which has many."""
    return drive.stiffness if drive.extension is None else float("nan")


def _names(dimension: str, names: object) -> Channel:
    return (dimension,), np.array(list(names), dtype=np.str_)  # type: ignore[call-overload]


def _places(dimension: str, family: Mapping[str, Placed]) -> Channel:
    return _numbers(dimension, [item.x for item in family.values()])


def _numbers(dimension: str, values: list[float] | list[list[float]]) -> Channel:
    return (dimension,), np.array(values, dtype=float)
