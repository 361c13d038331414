"""Datasets (.nc) that the page sends, which may refer to no other file of this machine."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr

from turnout.core.errors import FileError, ResponseError
from turnout.measurement.formats.hdf5 import Content
from turnout.metric.blade_map import PlaceSeen, blade_maps
from turnout.throw.store import open_response

LIMIT_CHANNELS = ("pod", "a90", "touch_floor")
CONDITIONS = ("discrepancy", "false_alarm_rate", "history", "states", "bound")
PANEL = ("panel", "panel_hash")


def sent_dataset(path: Path) -> xr.Dataset:
    """Read a dataset that the page sent.

    Parameters
    ----------
    path : Path
        Path on the server.

    Raises
    ------
    FileError
        When it is none, or takes content from another file.
    """
    try:
        with h5py.File(path, "r") as file:
            content = Content(path, file, allow_outside=False)
            for _, item in content.datasets():
                content.read(item)
    except (OSError, RuntimeError, ValueError, KeyError, TypeError):
        message = f"{path.name}: is no netCDF-4 file, or a damaged one; write it again with turnout"
        raise FileError(message) from None
    except FileError as error:
        text = str(error).partition(", or permit it by ")[0]
        raise FileError(text.replace(str(path), path.name)) from None
    try:
        return open_response(path)
    except FileError as error:
        raise FileError(str(error).replace(str(path), path.name)) from None


def limit_record(path: Path) -> dict[str, Any]:
    """Return the map of `turnout limit` as plain data.

    Returns
    -------
    dict
        ``places`` (name, x, touch floor [m]), ``sizes`` [m], and for each channel ``pod``,
        ``known_pod`` and ``untouched`` (place, size), ``a90``, ``a90_low``, ``a90_high``,
        ``known_a90`` (place) [m]; None where it is beyond what was thrown, or not in the map;
        ``conditions`` and ``panel`` (name and hash) as far as the file states them.

    Raises
    ------
    FileError
        When the file is no such map.
    """
    dataset = sent_dataset(path)
    lacking = [name for name in LIMIT_CHANNELS if name not in dataset]
    if lacking or not {"channel", "place", "size"} <= set(dataset.dims):
        message = f"{path.name}: is no map of `turnout limit` (no {', '.join(lacking) or 'sizes'})"
        raise FileError(message)
    sizes = dataset["size"].values
    try:
        seen = {
            str(name): blade_maps(dataset, sizes, channel=str(name))
            for name in dataset["channel"].values
        }
    except ResponseError as error:
        message = f"{path.name}: {error}"
        raise FileError(message) from None
    channels = {name: _channel(dataset.sel(channel=name), rows) for name, rows in seen.items()}
    return {
        "name": path.name,
        "places": [
            {"name": place.place, "x": place.x, "floor": _number(place.touch_floor)}
            for place in next(iter(seen.values()))[0]
        ],
        "sizes": _numbers(dataset["size"].values),
        "channels": channels,
        "conditions": _attributes(dataset, CONDITIONS),
        "panel": _attributes(dataset, PANEL),
    }


def _attributes(dataset: xr.Dataset, names: Sequence[str]) -> dict[str, Any]:
    """Return attributes that are numbers or texts, as far as they are there."""
    return {
        name: value.item() if isinstance(value, np.generic) else value
        for name in names
        if isinstance(value := dataset.attrs.get(name), str | float | int | np.generic)
    }


def _channel(dataset: xr.Dataset, rows: list[list[PlaceSeen]]) -> dict[str, Any]:
    """Return the values of one channel, place by place; rows are those of each size."""
    places = range(len(rows[0]))
    found: dict[str, Any] = {
        key: [[getattr(row[place], key) for row in rows] for place in places]
        for key in ("pod", "known_pod", "untouched")
    }
    found |= {
        key: [getattr(rows[0][place], key) for place in places] for key in ("a90", "known_a90")
    }
    ends = {key: _numbers(dataset[key].values) for key in ("a90_low", "a90_high") if key in dataset}
    for key in ("pod", "known_pod", "a90", "known_a90"):
        found[key] = _numbers(found[key])
    return found | ends


def _number(value: float | None) -> float | None:
    return round(float(value), 6) if value is not None and np.isfinite(value) else None


def _numbers(values: Any) -> Any:
    if np.ndim(values) > 1:
        return [_numbers(row) for row in values]
    return [_number(value) for value in values]
