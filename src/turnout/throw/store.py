"""Datasets in netCDF files, written whole or not at all.

All is read back to the last bit but fields: what is sampled along a rail or at each of its many
chairs, stops and fastenings is kept in single precision, in steps of 1/16 N and 1/4 um.
"""

import json
from collections.abc import Hashable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from turnout.core.channels import CONVENTIONS, SCHEMA_VERSION
from turnout.core.errors import FileError
from turnout.core.files import require_regular_file, write_atomic

SUFFIXES = (".nc",)
ENGINE: Any = "h5netcdf"
# What a small file may declare, and a larger one for each of its bytes; rest compresses well.
LEAST_CONTENT, CONTENT_A_BYTE = 300_000_000, 100
LONGEST_SHOWN = 100
COMPRESSION = {"zlib": True, "complevel": 1, "shuffle": True}
FIELD_DIMENSIONS = frozenset({"x", "chair", "stop", "fastening"})
FIELD_STEP = {"m": 2.0**-22, "N": 2.0**-4, "N m": 2.0**-4}
"""Steps of fields by unit, far below the error of a run; a file takes 3 MB in place of 11."""
# netCDF has neither logical values nor None: they travel as JSON, and this attribute names them.
JSON_ATTRIBUTES = "json_attributes"


def save_response(dataset: xr.Dataset, path: Path | str) -> None:
    """Write a dataset to a netCDF-4 file, completely or not at all.

    Parameters
    ----------
    dataset : xarray.Dataset
        Simulated or measured.
    path : path-like
        File to write; an existing one is replaced.

    Raises
    ------
    FileError
        When the file cannot be written; nothing half-written stays behind.
    """
    # In memory first: on a full disk the HDF5 library crashes instead of reporting it.
    write_atomic(path, _content(dataset))


def response_bytes(dataset: xr.Dataset) -> bytes:
    """Return the content of the netCDF-4 file that `save_response` writes.

    Examples
    --------
    >>> response_bytes(xr.Dataset())[1:4]
    b'HDF'
    """
    return bytes(_content(dataset))


def _content(dataset: xr.Dataset) -> memoryview:
    """Return the content of the file as it lies in memory, not copied."""
    stored = dataset.assign({name: _field(v) for name, v in dataset.items() if _is_field(v)})
    stored.attrs = _encoded({"Conventions": CONVENTIONS, **dataset.attrs})
    encoding = {
        name: dict(COMPRESSION)
        for name, variable in stored.variables.items()
        if variable.ndim and variable.size and variable.dtype.kind in "fb"
    }
    return memoryview(stored.to_netcdf(engine=ENGINE, encoding=encoding))


def _is_field(variable: xr.DataArray) -> bool:
    dims = set(variable.dims)
    return "time" in dims and not dims.isdisjoint(FIELD_DIMENSIONS) and variable.dtype.kind == "f"


def _field(variable: xr.DataArray) -> xr.DataArray:
    """Return a field in single precision, in whole steps of its unit."""
    step = FIELD_STEP.get(variable.attrs.get("units", ""))
    rounded = variable if step is None else (variable / step).round() * step
    return rounded.astype(np.float32).assign_attrs(variable.attrs)


def open_response(path: Path | str) -> xr.Dataset:
    """Read a dataset that `save_response` wrote.

    Parameters
    ----------
    path : path-like
        A netCDF-4 file.

    Returns
    -------
    xarray.Dataset
        In memory, in double precision; the file is closed again.

    Raises
    ------
    FileError
        When the file is missing, no netCDF-4 file, or of another version of the schema.
    """
    file = Path(path)
    require_regular_file(file)
    try:
        with xr.open_dataset(
            file, engine=ENGINE, decode_times=False, decode_timedelta=False
        ) as opened:
            _check_size(file, opened)
            dataset = opened.load()
    except PermissionError:
        message = f"{file}: may not be read; change its permissions"
        raise FileError(message) from None
    except (OSError, RuntimeError, ValueError, KeyError, TypeError, AttributeError):
        message = f"{file}: is no netCDF-4 file, or a damaged one; write it again with turnout"
        raise FileError(message) from None
    found = dataset.attrs.get("schema_version")
    # A number of NumPy, or whatever else the file has under this name.
    if not isinstance(found, int | np.integer) or found != SCHEMA_VERSION:
        said = "has no schema_version" if found is None else f"has schema_version {found}"
        said = said if len(said) < LONGEST_SHOWN else f"{said[:LONGEST_SHOWN]} ..."
        message = f"{file}: {said}, this turnout reads {SCHEMA_VERSION}; write it again with it"
        raise FileError(message)
    _check_instants(file, dataset)
    try:
        return _restored(dataset)
    except (KeyError, TypeError, ValueError):
        message = f"{file}: its attributes are damaged; write it again with turnout"
        raise FileError(message) from None


def _check_size(file: Path, dataset: xr.Dataset) -> None:
    """Refuse a small file that declares a large dataset."""
    size = file.stat().st_size
    most = max(LEAST_CONTENT, CONTENT_A_BYTE * size)
    if dataset.nbytes > most:
        message = f"{file}: declares {dataset.nbytes} bytes of data in {size}, at most {most} are "
        raise FileError(message + "read; write it again with turnout")


def _check_instants(file: Path, dataset: xr.Dataset) -> None:
    """Refuse a run without an instant, and movements without a duration."""
    least = 2 if "movement" in dataset.dims else 1
    count = dataset.sizes.get("time", least)
    if count < least:
        what = "no instant" if count == 0 else "one instant only"
        message = f"{file}: holds {what}, nothing that moves; simulate or record it again"
        raise FileError(message)


def _encoded(attributes: Mapping[Any, Any]) -> dict[Any, Any]:
    """Return attributes that netCDF can hold."""
    encoded, as_json = {}, []
    for name, value in attributes.items():
        if value is None or isinstance(value, bool | np.bool_):
            encoded[name] = json.dumps(None if value is None else bool(value))
            as_json.append(name)
        else:
            encoded[name] = value
    encoded[JSON_ATTRIBUTES] = " ".join(as_json)
    return encoded


def _restored(dataset: xr.Dataset) -> xr.Dataset:
    """Restore texts and attributes to their form before storing."""
    texts: dict[Hashable, Any] = {
        name: (variable.dims, variable.values.astype(np.str_), variable.attrs)
        for name, variable in dataset.variables.items()
        if variable.dtype.kind in "OTSU"
    }
    fields = {name: v.astype(np.float64) for name, v in dataset.items() if _is_field(v)}
    dataset = dataset.assign(fields)
    restored = dataset.assign_coords({k: v for k, v in texts.items() if k in dataset.coords})
    restored = restored.assign({k: v for k, v in texts.items() if k in dataset.data_vars})
    attributes = {name: _plain(value) for name, value in dataset.attrs.items()}
    for name in str(attributes.pop(JSON_ATTRIBUTES, "")).split():
        attributes[name] = json.loads(attributes[name])
    restored.attrs = attributes
    for variable in restored.variables.values():
        variable.encoding = {}
    restored.encoding = {}
    return restored


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value
