"""HDF5 and netCDF files: a dataset for each channel, with its unit and rate as attributes.

A file from elsewhere can refer to any other file of the machine (external links and storage,
virtual datasets), link groups in circles, and declare shapes that nothing fills. So each dataset is
visited once, and counted by `Declared` before it is read.
"""

import io
import math
from collections.abc import Hashable, Iterator, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.errors import FileError, refused_of
from turnout.measurement.formats.clock import is_time_name
from turnout.measurement.formats.extent import MOST_CHANNELS, Declared
from turnout.measurement.formats.file_table import Table, TableColumn
from turnout.measurement.formats.named_arrays import (
    NAME_LISTS,
    ArrayFile,
    NamedArray,
    gains_not_applied,
    stated_clock,
)
from turnout.measurement.formats.time_axis import moment_of
from turnout.measurement.recording import Recording

LARGEST_DEPTH = 50
_NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable"


class Content:
    """Content of an HDF5 file.

    Parameters
    ----------
    path : Path
        HDF5 file; used for messages and to recognise links out of its folder.
    file : h5py.File
        That file, opened for reading.
    allow_outside : bool
        Whether it may refer to other files.

    Attributes
    ----------
    problems : list of str
        Links that lead nowhere.
    """

    def __init__(self, path: Path, file: h5py.File, *, allow_outside: bool) -> None:
        self.problems: list[str] = []
        self._path, self._file, self._allow_outside = path, file, allow_outside
        self._declared = Declared(path)
        self._seen: set[Any] = set()

    def datasets(self) -> Iterator[tuple[str, h5py.Dataset]]:
        """Yield each dataset with its path in the file."""
        yield from self._within(self._file, "", 0)

    def _within(
        self, group: h5py.Group, prefix: str, depth: int
    ) -> Iterator[tuple[str, h5py.Dataset]]:
        if depth > LARGEST_DEPTH:
            message = f"{self._path}: its groups are nested deeper than {LARGEST_DEPTH}"
            raise FileError(message + "; save it again, flatter")
        for name, item in self.members(group, prefix):
            if isinstance(item, h5py.Group):
                yield from self._within(item, f"{name}/", depth + 1)
            elif isinstance(item, h5py.Dataset):
                yield name, item

    def members(self, group: h5py.Group, prefix: str = "") -> Iterator[tuple[str, Any]]:
        """Yield the members of a group that no group before it held, with their paths."""
        for key in group:
            name = f"{prefix}{key}"
            link = group.get(key, getlink=True)
            if isinstance(link, h5py.ExternalLink) and not self._allow_outside:
                raise FileError(self._outside(name, "is a link to", link.filename))
            item = group.get(key)
            if item is None:
                self.problems.append(f"'{name}' is left out: its link leads nowhere")
                continue
            place = h5py.h5o.get_info(item.id)
            if (place.fileno, place.addr) in self._seen:
                continue
            self._seen.add((place.fileno, place.addr))
            if len(self._seen) > MOST_CHANNELS:
                message = f"{self._path}: holds more than {MOST_CHANNELS} groups and datasets"
                raise FileError(message + "; export fewer channels")
            yield name, item

    def read(self, item: h5py.Dataset) -> Any:
        """Return the samples of a dataset, unless they are too many or in another file.

        Raises
        ------
        FileError
            Saying which.
        """
        name = (item.name or "").lstrip("/")
        if not self._allow_outside:
            if item.external:
                raise FileError(self._outside(name, "takes its samples from", item.external[0][0]))
            others = [s.file_name for s in item.virtual_sources()] if item.is_virtual else []
            other = next((file for file in others if file != "."), None)
            if other is not None:
                raise FileError(self._outside(name, "takes its samples from", other))
        # A chunk is read as a whole, however little of it the dataset needs.
        self._declared.add(max(item.size or 0, math.prod(item.chunks or (0,)), 1))
        return item[()]

    def _outside(self, name: str, what: str, other: str) -> str:
        return (
            f"{self._path}: '{name}' {what} another file ({other}), which is not read; export it "
            "into one file, or permit it by --allow-outside (in Python allow_outside=True)"
        )


UNITS = ("unit", "units", "unit_string")
DESCRIPTIONS = ("description", "long_name", "comment")
START_TIMES = ("start_time", "start_store_time", "date")


def read_hdf5(path: Path, *, allow_outside: bool = False) -> Recording:
    """Read an HDF5 file: numeric datasets, with their rates in attributes or times beside them.

    A rate may be an attribute of the dataset, of a group around it or of the file. Values packed
    with scale_factor and add_offset are unpacked; a compound dataset is a table.

    Parameters
    ----------
    path : Path
        HDF5 file; used for messages and to recognise links out of its folder.
    allow_outside : bool
        Whether it may take samples from other files.

    Raises
    ------
    FileError
        When it holds no channel, refers to other files or declares too much.
    """
    found = ArrayFile(str(path))
    with h5py.File(path, "r") as file:
        content = Content(path, file, allow_outside=allow_outside)
        with refused_of(path):
            for name, item in content.datasets():
                _take_dataset(found, name, item, content)
            _take_groups(found, file)
        found.problems = [*content.problems, *found.problems]
        return found.recording(_first(_attributes(file), START_TIMES))


def read_netcdf3(path: Path) -> Recording:
    """Read a netCDF file of the classic format or with 64-bit offsets, as `read_hdf5` does.

    Raises
    ------
    FileError
        When it holds no channel or declares too much.
    """
    found = ArrayFile(str(path))
    with xr.open_dataset(path, engine="scipy", decode_cf=False) as file:
        Declared(path).add(sum(item.size for item in file.variables.values()))
        with refused_of(path):
            for name, item in file.variables.items():
                _take(found, str(name), item.to_numpy(), _attributes(item), item.dims)
        attributes = _attributes(file)
    _take_attributes(found, "", attributes)
    return found.recording(_first(attributes, START_TIMES))


def _take_dataset(found: ArrayFile, name: str, item: h5py.Dataset, content: Content) -> None:
    """Take a dataset of HDF5 as a table, a list of texts, a number or a channel."""
    if _text(item.attrs.get("NAME", "")).startswith(_NO_VARIABLE):
        return
    last, attributes = name.rsplit("/", 1)[-1], _attributes(item)
    wanted = last.lower() in (*NAME_LISTS, "units") or item.size == 1 or is_time_name(last)
    if item.dtype.kind in "OS" and wanted:
        found.texts[name] = [_text(value) for value in np.ravel(content.read(item))]
    if item.dtype.names:
        held = content.read(item)
        units = {key: _text(value) for key, value in attributes.items()}
        cells = [
            TableColumn(field, _cells(held[field]), units.get(f"{field.lower()}_unit", ""))
            for field in held.dtype.names
            if held[field].ndim == 1
        ]
        source = f"{found.source}: '{name}'"
        found.tables[name] = Table(cells, stated_clock(attributes), source, alone=False)
    if item.dtype.kind in "biuf" and item.ndim <= 2:
        own = name if h5py.h5ds.is_scale(item.id) else ""
        names = [[scale.name.lstrip("/") for scale in along.values()] for along in item.dims]
        held = content.read(item) if item.size else np.zeros(0)
        _take(found, name, held, attributes, [(along or [own])[0] for along in names])


def _take(
    found: ArrayFile, name: str, held: Any, attributes: dict[str, Any], dims: Sequence[Hashable]
) -> None:
    """Take an array with its attributes as a number or a channel; texts are left out."""
    held = np.asarray(held)
    if held.dtype.kind not in "biuf" or held.ndim > 2:
        return
    found.problems += gains_not_applied(name, attributes)
    clock = stated_clock(attributes, own=True)
    longest = int(np.argmax(held.shape)) if held.size and held.ndim else None
    found.arrays[name] = NamedArray(
        _unpacked(held, attributes),
        _first(attributes, UNITS),
        _first(attributes, ("name",)) if clock.rate() else "",
        _first(attributes, DESCRIPTIONS),
        "" if longest is None else str(dims[longest]),
        clock,
        moment_of(_first(attributes, START_TIMES)),
    )


def _take_attributes(found: ArrayFile, folder: str, attributes: dict[str, Any]) -> None:
    """Take single attributes of the file or a group as variables in it."""
    for key, value in attributes.items():
        single = np.ravel(value)
        if key == "x0":
            what = f"'{folder}{key}' ({value}) is not applied, as it may be a place"
            found.problems.append(f"{what}; a start of times is 'start' [s]")
        elif single.size == 1 and single.dtype.kind in "biuf":
            found.arrays.setdefault(f"{folder}{key}", NamedArray(single))
        elif single.size == 1 and isinstance(single[0], str | bytes):
            found.texts.setdefault(f"{folder}{key}", [_text(single)])


def _take_groups(found: ArrayFile, file: h5py.File) -> None:
    """Take the rates that the file and its groups state for all they hold."""
    folders = {"": file}
    for name in (*found.arrays, *found.tables):
        for end in (place for place, letter in enumerate(name) if letter == "/"):
            folders[name[: end + 1]] = file[name[:end]]
    for folder, group in folders.items():
        _take_attributes(found, folder, _attributes(group))


def _attributes(item: Any) -> dict[str, Any]:
    return {str(key).lower(): value for key, value in item.attrs.items()}


def _cells(column: NDArray[Any]) -> NDArray[Any]:
    if column.dtype.kind in "biufmM":
        return column
    return np.array([_text(cell) for cell in column], dtype=object)


def _unpacked(values: NDArray[Any], attributes: dict[str, Any]) -> NDArray[Any]:
    """Return values that CF packs (scale_factor, add_offset), NaN where one is missing."""
    missing = np.zeros(values.shape, dtype=bool)
    for key in ("_fillvalue", "missing_value"):
        if key in attributes and values.dtype.kind in "iuf":
            missing |= values == np.ravel(attributes[key])[0]
    scale, offset = (
        float(np.ravel(attributes.get(key, default))[0])
        for key, default in (("scale_factor", 1.0), ("add_offset", 0.0))
    )
    if scale == 1.0 and offset == 0.0 and not missing.any():
        return values
    scaled: NDArray[Any] = np.where(missing, np.nan, values * scale + offset)
    return scaled


def hdf5_bytes(recording: Recording) -> bytes:
    """Return a recording as the content of an HDF5 file: a compressed dataset a channel.

    The name, unit, rate, start and description of a channel are attributes of its dataset.
    """
    # In memory first: on a full disk the HDF5 library crashes instead of reporting it.
    content = io.BytesIO()
    with h5py.File(content, "w", track_order=True) as file:
        if recording.start_time:
            file.attrs["start_time"] = recording.start_time
        for channel in recording.channels.values():
            # A slash would make a group.
            key = channel.name.replace("/", "|")
            item = file.create_dataset(
                key, data=channel.values, compression="gzip", compression_opts=1, shuffle=True
            )
            for name in ("name", "unit", "rate", "start", "description"):
                item.attrs[name] = getattr(channel, name)
    return content.getvalue()


def _first(attributes: dict[str, Any], keys: tuple[str, ...]) -> str:
    return next((_text(attributes[key]) for key in keys if key in attributes), "")


def _text(value: Any) -> str:
    if isinstance(value, np.ndarray):
        value = value.reshape(-1)[0] if value.size else ""
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
