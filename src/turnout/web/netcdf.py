"""Datasets (.nc) that the page sends, which may refer to no other file of this machine."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr

from turnout.errors import FileError
from turnout.measurement.formats.hdf5 import Content
from turnout.response.store import open_response

LIMIT_CHANNELS = ("pod", "a90", "touch_floor")
CONDITIONS = ("discrepancy", "false_alarm_rate", "history", "states", "bound")


def sent_dataset(path: Path) -> xr.Dataset:
    """Read a dataset that the page sent.

    Parameters
    ----------
    path : Path
        Where the server put it.

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
        ``places`` (name, x, touch floor, largest size thrown [m]), ``sizes`` [m], and for each
        channel ``pod`` (place, size), ``a90``, ``a90_low``, ``a90_high`` (place) [m]; None where
        it is beyond what was thrown.

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
    largest = dataset.get("largest_size", dataset["touch_floor"] * np.inf)
    channels = {}
    for name in dataset["channel"].values:
        one = dataset.sel(channel=name).transpose("place", "size", ...)
        channels[str(name)] = {
            "pod": _numbers(one["pod"].values),
            **{
                key: _numbers(one[key].values)
                for key in ("a90", "a90_low", "a90_high")
                if key in one
            },
        }
    return {
        "name": path.name,
        "places": [
            {"name": str(name), "x": float(x), "floor": _number(floor), "largest": _number(most)}
            for name, x, floor, most in zip(
                dataset["place"].values,
                dataset["x"].values,
                dataset["touch_floor"].values,
                largest.values,
                strict=True,
            )
        ],
        "sizes": _numbers(dataset["size"].values),
        "channels": channels,
        "conditions": {
            name: value.item() if isinstance(value, np.generic) else value
            for name in CONDITIONS
            if isinstance(value := dataset.attrs.get(name), str | float | int | np.generic)
        },
    }


def _number(value: float) -> float | None:
    return round(float(value), 6) if np.isfinite(value) else None


def _numbers(values: Any) -> Any:
    if np.ndim(values) > 1:
        return [_numbers(row) for row in values]
    return [_number(value) for value in values]
