"""What a studio process knows, as bytes without pickles, for the process that replaces it."""

import json
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.stored_arrays import arrays_from_bytes, arrays_to_bytes
from turnout.web.measured import Measured

PURPOSE = "movement of the studio"
HEADER = "header"


def measured_to_bytes(measured: Measured) -> bytes:
    """Return a measured movement as bytes.

    Parameters
    ----------
    measured : Measured
        Its dataset has texts and numbers alone.

    Examples
    --------
    >>> time = np.array([0.0, 0.1])
    >>> run = xr.Dataset({"drive_force": ("time", time)}, {"time": time}, {"kind": "measurement"})
    >>> kept = measured_from_bytes(measured_to_bytes(Measured("a", "closing", 0.0, "", run)))
    >>> kept.title, kept.dataset.identical(run)
    ('a', True)
    """
    dataset = measured.dataset
    header = {
        "fields": [measured.title, measured.direction, float(measured.size), measured.place],
        "attributes": dataset.attrs,
        "coordinates": [str(name) for name in dataset.coords],
        "variables": {
            str(name): {"dims": list(item.dims), "attributes": item.attrs}
            for name, item in dataset.variables.items()
        },
    }
    arrays: dict[str, NDArray[Any]] = {HEADER: np.array(json.dumps(header, default=_plain))}
    for name, item in dataset.variables.items():
        values = item.values
        arrays[f"values {name}"] = values.astype(str) if values.dtype.hasobject else values
    return arrays_to_bytes(arrays, PURPOSE)


def measured_from_bytes(content: bytes) -> Measured:
    """Return the movement that `measured_to_bytes` made bytes of."""
    arrays = arrays_from_bytes(content, PURPOSE)
    header = json.loads(str(arrays[HEADER]))
    variables = {
        name: (item["dims"], arrays[f"values {name}"], item["attributes"])
        for name, item in header["variables"].items()
    }
    dataset = xr.Dataset(variables, attrs=header["attributes"])
    dataset = dataset.set_coords([name for name in header["coordinates"] if name in dataset])
    title, direction, size, place = header["fields"]
    return Measured(title, direction, size, place, dataset)


def _plain(value: Any) -> Any:
    """Return a number of NumPy as one of JSON."""
    return value.tolist()
