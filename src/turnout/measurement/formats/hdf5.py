"""HDF5 files: a dataset for each channel, with its unit and rate as attributes.

A file from elsewhere can refer to any other file of the machine (external links and storage,
virtual datasets), link groups in circles, and declare shapes that nothing fills. So each dataset is
visited once, and counted by `Declared` before it is read.
"""

import io
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import FileError
from turnout.core.problems import choices
from turnout.measurement.formats.assemble import (
    RATE_NAME,
    FileColumn,
    assemble_recording,
    tidy_unit,
)
from turnout.measurement.formats.extent import MOST_CHANNELS, Declared
from turnout.measurement.formats.named_arrays import NAME_LISTS, NO_TIME, columns_of_arrays
from turnout.measurement.recording import Recording

LARGEST_DEPTH = 50


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
STEPS = ("dt", "sample_interval", "wf_increment")
STARTS = ("start", "wf_start_offset")
DESCRIPTIONS = ("description", "long_name", "comment")
START_TIMES = ("start_time", "start_store_time", "date")


def read_hdf5(path: Path, *, allow_outside: bool = False) -> Recording:
    """Read an HDF5 file: numeric datasets, with their rates in attributes or times beside them.

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
    arrays: dict[str, NDArray[Any]] = {}
    units: dict[str, str] = {}
    texts: dict[str, list[str]] = {}
    own: list[FileColumn] = []
    empty: list[str] = []

    def visit(name: str, item: h5py.Dataset) -> None:
        if item.dtype.kind in "OS" and name.rsplit("/", 1)[-1].lower() in (*NAME_LISTS, "units"):
            texts[name.replace("/", ".")] = [_text(value) for value in np.ravel(content.read(item))]
        if item.dtype.kind not in "biuf" or item.ndim > 2:
            return
        if not item.size:
            empty.append(name)
            return
        attributes = {key.lower(): value for key, value in item.attrs.items()}
        rate = _rate(attributes)
        if rate is None or item.ndim > 1:
            arrays[name], units[name] = content.read(item), _first(attributes, UNITS)
            return
        start = _first(attributes, STARTS)
        own.append(
            FileColumn(
                _first(attributes, ("name",)) or name,
                content.read(item),
                tidy_unit(_first(attributes, UNITS)),
                _first(attributes, DESCRIPTIONS),
                rate=rate,
                start=float(start) if start else 0.0,
            )
        )

    with h5py.File(path, "r") as file:
        content = Content(path, file, allow_outside=allow_outside)
        for name, item in content.datasets():
            visit(name, item)
        attributes = {key.lower(): value for key, value in file.attrs.items()}
    rate = _rate(attributes)
    if rate is not None:
        arrays["sample_rate"] = np.array(rate)
    columns, problems = columns_of_arrays(arrays, texts, units)
    return assemble_recording(
        [*own, *columns],
        source=str(path),
        start_time=_first(attributes, START_TIMES) or None,
        problems=[*content.problems, *problems, *_empty(empty)],
        remedy=NO_TIME,
    )


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
            item.attrs["name"] = channel.name
            item.attrs["unit"] = channel.unit
            item.attrs["rate"] = channel.rate
            item.attrs["start"] = channel.start
            item.attrs["description"] = channel.description
    return content.getvalue()


def _empty(names: list[str]) -> list[str]:
    """Name the datasets that hold no sample."""
    if not names:
        return []
    what = "is empty" if len(names) == 1 else "are empty"
    return [f"dataset{'s' if len(names) > 1 else ''} {choices(names)} {what}: no sample recorded"]


def _first(attributes: dict[str, Any], keys: tuple[str, ...]) -> str:
    return next((_text(attributes[key]) for key in keys if key in attributes), "")


def _text(value: Any) -> str:
    if isinstance(value, np.ndarray):
        value = value.reshape(-1)[0] if value.size else ""
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _rate(attributes: dict[str, Any]) -> float | None:
    """Return a sample rate from attributes that hold it or its inverse."""
    try:
        for key, value in attributes.items():
            if RATE_NAME.fullmatch(key):
                return float(np.ravel(value)[0])
            if key in STEPS:
                return 1.0 / float(np.ravel(value)[0])
    except (ValueError, TypeError, IndexError, ZeroDivisionError):
        return None
    return None
