"""HDF5 and netCDF files: a dataset for each channel, with its unit and rate as attributes.

A file from elsewhere can refer to any other file of the machine (external links and storage,
virtual datasets), link groups in circles, and declare shapes that nothing fills. So each dataset is
visited once, and counted by `Declared` before it is read.
"""

import io
import math
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.errors import FileError, refused_of
from turnout.measurement.formats.assemble import FileColumn, assemble_recording, tidy_unit
from turnout.measurement.formats.channel_table import table_columns
from turnout.measurement.formats.clock import is_time_name, is_time_unit
from turnout.measurement.formats.extent import MOST_CHANNELS, Declared
from turnout.measurement.formats.file_table import Table, TableColumn
from turnout.measurement.formats.named_arrays import (
    NAME_LISTS,
    NO_TIME,
    columns_of_arrays,
    gains_not_applied,
    stated_clock,
    time_unit_of,
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

    def datasets(self) -> Iterator[tuple[str, h5py.Dataset, str]]:
        """Yield each dataset with its path in the file and the unit of times around it."""
        yield from self._within(self._file, "", 0, "")

    def _within(
        self, group: h5py.Group, prefix: str, depth: int, unit: str
    ) -> Iterator[tuple[str, h5py.Dataset, str]]:
        if depth > LARGEST_DEPTH:
            message = f"{self._path}: its groups are nested deeper than {LARGEST_DEPTH}"
            raise FileError(message + "; save it again, flatter")
        unit = time_unit_of(_attributes(group)) or unit
        for name, item in self.members(group, prefix):
            if isinstance(item, h5py.Group):
                yield from self._within(item, f"{name}/", depth + 1, unit)
            elif isinstance(item, h5py.Dataset):
                yield name, item, unit

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
    with h5py.File(path, "r") as file:
        content = Content(path, file, allow_outside=allow_outside)
        found = _Found(str(path))
        with refused_of(path):
            for name, item, unit in content.datasets():
                found.take_dataset(name, item, content, unit)
            found.take_groups(file)
        found.problems = [*content.problems, *found.problems]
        return found.recording(_attributes(file))


def read_netcdf3(path: Path) -> Recording:
    """Read a netCDF file of the classic format or with 64-bit offsets, as `read_hdf5` does.

    Raises
    ------
    FileError
        When it holds no channel or declares too much.
    """
    found = _Found(str(path))
    with xr.open_dataset(path, engine="scipy", decode_cf=False) as file:
        Declared(path).add(sum(item.size for item in file.variables.values()))
        attributes = {str(key).lower(): value for key, value in file.attrs.items()}
        with refused_of(path):
            for name, item in file.variables.items():
                own = {str(key).lower(): value for key, value in item.attrs.items()}
                found.take(str(name), item.to_numpy(), own, time_unit_of(attributes))
                found.scale(str(name), item.shape, item.dims)
    found.take_attributes("", attributes)
    return found.recording(attributes)


class _Found:
    """Contents of the datasets of a file, as they are met."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.arrays: dict[str, NDArray[Any]] = {}
        self.units: dict[str, str] = {}
        self.scales: dict[str, str] = {}
        self.texts: dict[str, list[str]] = {}
        self.columns: list[FileColumn] = []
        self.problems: list[str] = []

    def recording(self, attributes: dict[str, Any]) -> Recording:
        """Return the recording of all that was taken from a file with these attributes."""
        with refused_of(self.source):
            columns, problems = columns_of_arrays(
                self.arrays, self.texts, self.units, scales=self.scales
            )
        return assemble_recording(
            [*self.columns, *columns],
            source=self.source,
            start_time=_first(attributes, START_TIMES) or None,
            problems=[*self.problems, *problems],
            remedy=NO_TIME,
        )

    def take_dataset(self, name: str, item: h5py.Dataset, content: Content, time_unit: str) -> None:
        """Take a dataset of HDF5 as a table, a list of texts, a number or a channel."""
        if _text(item.attrs.get("NAME", "")).startswith(_NO_VARIABLE):
            return
        last = name.rsplit("/", 1)[-1]
        names = [[scale.name.lstrip("/") for scale in along.values()] for along in item.dims]
        own = name if h5py.h5ds.is_scale(item.id) else ""
        self.scale(name, item.shape or (), [(found or [own])[0] for found in names])
        wanted = last.lower() in (*NAME_LISTS, "units") or item.size == 1 or is_time_name(last)
        if item.dtype.kind in "OS" and wanted:
            self.texts[name] = [_text(value) for value in np.ravel(content.read(item))]
        if item.dtype.names:
            self._take_table(name, content.read(item), _attributes(item), time_unit)
        if item.dtype.kind in "biuf" and item.ndim <= 2:
            held = content.read(item) if item.size else np.zeros(0)
            self.take(name, held, _attributes(item), time_unit)

    def scale(self, name: str, shape: Sequence[int], dims: Sequence[Hashable]) -> None:
        """Keep the name of the dimension along which an array is longest, where it has one."""
        longest = max(range(len(shape)), key=lambda axis: shape[axis], default=None)
        if longest is not None and (along := str(dims[longest])):
            self.scales[name] = along

    def take(self, name: str, held: Any, attributes: dict[str, Any], time_unit: str) -> None:
        """Take an array with its attributes as a number or a channel; texts are left out."""
        held = np.asarray(held)
        if held.dtype.kind not in "biuf" or held.ndim > 2:
            return
        if not held.size:
            self.columns.append(FileColumn(name, np.zeros(0)))
            return
        last = name.rsplit("/", 1)[-1]
        clock = stated_clock(attributes, own=True, unit=time_unit)
        rate, unit = clock.rate_of_rows(), _first(attributes, UNITS)
        values = _unpacked(held, attributes)
        self.problems += gains_not_applied(name, attributes)
        since = " since " in unit or (is_time_unit(unit) and is_time_name(last))
        if rate is None or held.ndim > 1 or since:
            if rate is not None:
                self.arrays[f"{name}/sample_rate"] = np.array(rate[0])
            if clock.start is not None:
                self.arrays[f"{name}/start_sec"] = np.array(clock.start)
            for key, _, text in (said.partition(": ") for said in clock.reduced):
                self.texts[f"{name}/{key}"] = [text]
            self.arrays[name], self.units[name] = values, unit
            return
        shown, described = _first(attributes, ("name",)) or name, _first(attributes, DESCRIPTIONS)
        begin = moment_of(_first(attributes, START_TIMES))
        column = FileColumn(shown, values.reshape(-1), tidy_unit(unit), described)
        self.columns.append(replace(column, rate=rate[0], start=clock.start or 0.0, begin=begin))

    def _take_table(
        self, name: str, cells: Any, attributes: dict[str, Any], time_unit: str
    ) -> None:
        units = {key: _text(value) for key, value in attributes.items()}
        cells_of = [
            TableColumn(field, _cells(cells[field]), units.get(f"{field.lower()}_unit", ""))
            for field in cells.dtype.names
            if cells[field].ndim == 1
        ]
        source = f"{self.source}: '{name}'"
        table = Table(cells_of, stated_clock(attributes, unit=time_unit), source, alone=False)
        columns, remarks = table_columns(table)
        self.columns += columns
        self.problems += remarks

    def take_attributes(self, folder: str, attributes: dict[str, Any]) -> None:
        """Take single attributes of the file or a group as variables in it."""
        for key, value in attributes.items():
            single = np.ravel(value)
            if key == "x0":
                what = f"'{folder}{key}' ({value}) is not applied, as it may be a place"
                self.problems.append(f"{what}; a start of times is 'start' [s]")
            elif single.size == 1 and single.dtype.kind in "biuf":
                self.arrays.setdefault(f"{folder}{key}", single)
            elif single.size == 1 and isinstance(single[0], str | bytes):
                self.texts.setdefault(f"{folder}{key}", [_text(single)])

    def take_groups(self, file: h5py.File) -> None:
        """Take the rates that the file and its groups state for all they hold."""
        folders = {"": file}
        for name in [*self.arrays, *self.units]:
            for end in (place for place, letter in enumerate(name) if letter == "/"):
                folders[name[: end + 1]] = file[name[:end]]
        for folder, group in folders.items():
            self.take_attributes(folder, _attributes(group))


def _attributes(item: h5py.HLObject) -> dict[str, Any]:
    return {key.lower(): value for key, value in item.attrs.items()}


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
