"""MATLAB files: version 5 (and 4) read and written, version 7.3 read."""

import io
import math
import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.io import loadmat, savemat

from turnout.measurement.formats.assemble import FileColumn, named_unit
from turnout.measurement.formats.clock import StatedClock
from turnout.measurement.formats.extent import MOST_CHANNELS
from turnout.measurement.formats.file_table import Table, TableColumn
from turnout.measurement.formats.hdf5 import Content, read_hdf5
from turnout.measurement.formats.named_arrays import ArrayFile, NamedArray
from turnout.measurement.recording import Recording

# Of lists that a file written here has beside its vectors, an entry a channel.
_PREFIX = "channel_"


def read_mat(path: Path) -> Recording:
    """Read a MATLAB file of version 4 to 7 (not 7.3).

    Raises
    ------
    FileError
        When it holds no channel or declares too much.
    """
    with path.open("rb") as file:
        is_version_5 = file.read(6) == b"MATLAB"
    if is_version_5:
        check_mat5(path)
    content = loadmat(path, squeeze_me=True, struct_as_record=False, chars_as_strings=True)
    held = {k: v for k, v in content.items() if not k.startswith("__") and k != "None"}
    # Objects (tables, dates) are kept apart from the variables that refer to them.
    return _recording(held, path, objects="__function_workspace__" in content)


def read_mat73(path: Path, *, allow_outside: bool = False) -> Recording:
    """Read a MATLAB file of version 7.3, which is HDF5.

    Parameters
    ----------
    path : Path
        MATLAB file of version 7.3, which is HDF5.
    allow_outside : bool
        Whether it may take samples from other files.

    Raises
    ------
    FileError
        When it holds no channel, refers to other files or declares too much.
    """
    with h5py.File(path, "r") as file:
        content = Content(path, file, allow_outside=allow_outside)
        found = {
            name: _from_hdf5(file, item, content)
            for name, item in content.members(file)
            if name[0] != "#" and "MATLAB_object_decode" not in item.attrs
        }
        objects = "#subsystem#" in file
    return _recording(found, path, objects=objects)


def read_hdf5_or_mat73(path: Path, *, allow_outside: bool = False) -> Recording:
    """Read an HDF5 file, or a MATLAB file of version 7.3 whose head was lost.

    Parameters
    ----------
    path : Path
        HDF5 file.
    allow_outside : bool
        Whether it may take samples from other files.

    Raises
    ------
    FileError
        When it holds no channel, refers to other files or declares too much.
    """
    with h5py.File(path, "r") as file:
        items = (
            file.get(key) for key in file if isinstance(file.get(key, getlink=True), h5py.HardLink)
        )
        is_matlab = any("MATLAB_class" in item.attrs for item in items if item is not None)
    read = read_mat73 if is_matlab else read_hdf5
    return read(path, allow_outside=allow_outside)


def mat_bytes(recording: Recording) -> bytes:
    """Return a recording as the content of a MATLAB file of version 5.

    Each channel is a vector; cells and vectors called `channel_...` hold names, units, rates.
    """
    channels = list(recording.channels.values())
    variables = _variables([channel.name for channel in channels])
    content: dict[str, Any] = {f"{_PREFIX}variables": _cells(variables)}
    for key in ("name", "unit", "description"):
        content[f"{_PREFIX}{key}s"] = _cells([getattr(channel, key) for channel in channels])
    for key in ("rate", "start"):
        content[f"{_PREFIX}{key}s"] = np.array([getattr(channel, key) for channel in channels])
    content["start_time"] = recording.start_time or ""
    content |= {name: item.values for name, item in zip(variables, channels, strict=True)}
    file = io.BytesIO()
    savemat(file, content, format="5", oned_as="column", long_field_names=True)  # type: ignore[arg-type]
    return file.getvalue()


def _objects(path: Path) -> tuple[dict[str, Any], list[str]]:
    """Return the dates, durations, time series, tables and timetables of a file, and remarks."""
    if find_spec("matio") is None:
        remark = "objects of MATLAB (tables, dates) need mat-io; pip install 'turnout[daq]', or "
        return {}, [remark + "save their columns as vectors"]
    import matio

    found: dict[str, Any] = {}
    problems: list[str] = []
    for name, value in matio.load_from_mat(str(path), add_table_attrs=True).items():
        kind = str(getattr(value, "classname", ""))
        dates = isinstance(value, np.ndarray) and value.dtype.kind in "mM"
        if dates or isinstance(value, pd.DataFrame) or kind == "timeseries":
            found[name] = value
        elif kind:
            problems.append(f"'{name}' is left out: objects of the class {kind} are not read")
    return found, problems


def _table(name: str, frame: pd.DataFrame) -> Table:
    """Return a table or timetable; its clock is that of the file."""
    units = [str(u) for u in frame.attrs.get("VariableUnits", frame.attrs.get("varUnits", []))]
    cells = [TableColumn("Time", np.asarray(frame.index))] * (frame.index.dtype.kind in "mM")
    for place, label in enumerate(frame.columns):
        bare, unit = named_unit(str(label), units[place] if place < len(units) else "")
        cells.append(TableColumn(bare, np.asarray(frame[label]), unit))
    return Table(cells, StatedClock(), f"'{name}'", alone=False)


def _recording(content: Mapping[str, Any], path: Path, *, objects: bool) -> Recording:
    found = ArrayFile(str(path))
    held, found.problems = _objects(path) if objects else ({}, [])
    for name, value, unit, label in _flat({**content, **held}, ""):
        if isinstance(value, str):
            found.texts[name] = [value]
        elif isinstance(value, pd.DataFrame):
            found.tables[name] = _table(name, value)
        elif _is_texts(value):
            found.texts[name] = [item if isinstance(item, str) else "" for item in np.ravel(value)]
        elif isinstance(value, np.ndarray | int | float | complex):
            array = np.asarray(value)
            if array.dtype.kind in "biufmM":
                found.arrays[name] = NamedArray(array, unit, label)
            elif array.dtype.kind == "c":
                found.problems.append(f"array '{name}' is left out: its numbers are complex")
    texts = found.texts.items()
    start_time = next((v[0] for k, v in texts if k.lower().endswith("start_time")), None)
    if f"{_PREFIX}variables" in found.texts and f"{_PREFIX}rates" in found.arrays:
        found.columns, found.arrays = _own_variable(found), {}
    return found.recording(start_time)


def _own_variable(found: ArrayFile) -> list[FileColumn]:
    """Read variables written by `mat_bytes`."""
    arrays, texts = {name: array.values for name, array in found.arrays.items()}, found.texts
    variables = texts[f"{_PREFIX}variables"]
    described = (
        [*texts.get(f"{_PREFIX}{key}", []), *[""] * len(variables)]
        for key in ("names", "units", "descriptions")
    )
    rates = np.ravel(arrays[f"{_PREFIX}rates"]).tolist()
    starts = np.ravel(arrays.get(f"{_PREFIX}starts", np.zeros(len(variables)))).tolist()
    return [
        FileColumn(name or variable, np.ravel(arrays[variable]), unit, text, None, rate, start)
        for variable, name, unit, text, rate, start in zip(
            variables, *described, rates, starts, strict=False
        )
        if variable in arrays
    ]


def _flat(content: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any, str, str]]:
    """Yield the variables of a file: dotted name, value, and unit and name that Simulink states."""
    for name, value in content.items():
        fields, path = _fields(value), f"{prefix}{name}"
        if fields is not None and {"Time", "Data", "TimeInfo"} <= set(fields):
            clock = _fields(fields["TimeInfo"]) or {}
            zero = _text_in(clock, "StartDate")
            unit = _text_in(clock, "Units") + f" since {zero}" * bool(zero)
            yield f"{path}.Time", _times_in(fields["Time"], fields["Data"], clock), unit, ""
            unit = _text_in(_fields(fields.get("DataInfo")) or {}, "Units")
            yield f"{path}.Data", np.squeeze(fields["Data"]), unit, _text_in(fields, "Name") or path
        elif fields is not None and "values" in fields and "label" in fields:
            yield f"{path}.values", np.squeeze(fields["values"]), "", _text_in(fields, "label")
        elif fields is not None:
            yield from _flat(fields, f"{path}.")
        elif isinstance(value, np.ndarray) and value.dtype.kind == "O" and not _is_texts(value):
            inner = {f"{name} {n}": item for n, item in enumerate(value.ravel(), start=1)}
            held = {k: v for k, v in inner.items() if _fields(v) is not None or np.ndim(v)}
            yield from _flat(held, prefix)
        else:
            yield path, value, "", ""


def _text_in(fields: Mapping[str, Any], key: str) -> str:
    """Return a text in a structure; empty if there is none."""
    value = fields.get(key)
    if isinstance(value, np.ndarray) and value.size == 1 and value.dtype.kind in "UOT":
        value = value.item()
    return value.strip() if isinstance(value, str) else ""


def _times_in(time: Any, data: Any, clock: Mapping[str, Any]) -> Any:
    """Return the times of a series, which may state an even step in their place."""
    step, start = (np.ravel(clock.get(key, np.nan)) for key in ("Increment", "Start"))
    if np.size(time) or step.size != 1 or not np.isfinite(step[0]):
        return time
    return np.nansum(start[:1]) + step[0] * np.arange(max(np.shape(data)))


def _fields(value: Any) -> Mapping[str, Any] | None:
    """Return the fields of a structure; None if it is none."""
    if isinstance(value, Mapping):
        return value
    if hasattr(value, "classname") and isinstance(value.properties, Mapping):  # an object
        return {name.rstrip("_"): item for name, item in value.properties.items()}
    if hasattr(value, "_fieldnames"):
        return {field: getattr(value, field) for field in value._fieldnames}
    return None


def _is_texts(value: object) -> bool:
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "OUS" or not value.size:
        return False
    # squeezing turns an empty text in a cell into an empty array
    return all(isinstance(item, str) or np.size(item) == 0 for item in np.ravel(value))


def _cells(items: Sequence[Any]) -> NDArray[np.object_]:
    cells = np.empty((len(items), 1), dtype=object)
    for place, item in enumerate(items):
        cells[place, 0] = item
    return cells


def _variables(names: list[str]) -> list[str]:
    """Return a MATLAB variable name for each channel, none twice."""
    taken: list[str] = []
    for name in names:
        base = re.sub(r"\W", "_", name, flags=re.ASCII)[:40]
        base = base if base[:1].isalpha() else f"x{base}"
        free, number = base, 1
        while free in taken or free.startswith(_PREFIX) or free == "start_time":
            number += 1
            free = f"x{base}_{number}"
        taken.append(free)
    return taken


def _from_hdf5(file: h5py.File, item: Any, content: Content) -> Any:
    """Return a variable of a version 7.3 file as `loadmat` would."""
    if isinstance(item, h5py.Group):
        return {name: _from_hdf5(file, inner, content) for name, inner in content.members(item)}
    if not isinstance(item, h5py.Dataset):
        return None
    kind = item.attrs.get("MATLAB_class", b"")
    kind = kind.decode() if isinstance(kind, bytes) else str(kind)
    if item.attrs.get("MATLAB_empty", 0):
        return "" if kind == "char" else np.zeros(0)
    if kind == "char":
        return "".join(chr(int(code)) for code in np.ravel(content.read(item)))
    if kind == "cell" or item.dtype.kind == "O":
        references = np.ravel(content.read(item))
        if references.size > MOST_CHANNELS:
            return None
        return _cells([_from_hdf5(file, file[reference], content) for reference in references])
    return np.squeeze(np.asarray(content.read(item))) if item.dtype.kind in "biuf" else None


HEADER, TAG = 128, 8
ORDERS = {b"IM": "<", b"MI": ">"}
MATRIX, COMPRESSED = 14, 15
CELL, STRUCTURE, OBJECT, CHARACTERS, SPARSE, LARGEST_NUMERIC = 1, 2, 3, 4, 5, 15
OPAQUE = 17
# Bytes of a number by the type of its element.
WIDTHS = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8, 16: 1, 17: 2, 18: 4}
Elements = list[tuple[int, memoryview]]
"""Type and data of elements."""


def check_mat5(path: Path) -> None:
    """Check that the elements of a version 5 file fill it, and hold as many values as they say.

    Raises
    ------
    ValueError
        Saying what is wrong.
    """
    content = memoryview(path.read_bytes())
    order = ORDERS.get(bytes(content[HEADER - 2 : HEADER]))
    if order is None:
        message = "its header is damaged"
        raise ValueError(message)
    for kind, variable in _elements(content[HEADER:], order, (MATRIX, COMPRESSED)):
        if kind == MATRIX:
            _check_matrix(variable, order)


def _check_matrix(content: memoryview, order: str) -> None:
    """Check that flags, dimensions, name and values of a matrix fit each other."""
    if not content.nbytes:
        return  # an empty cell
    parts = _elements(content, order, (MATRIX, *WIDTHS))
    kinds = [kind for kind, _ in parts[:3]]
    flagged = kinds[:1] == [6] and parts[0][1].nbytes == TAG
    word = struct.unpack(f"{order}I", parts[0][1][:4])[0] if flagged else 0
    if word & 0xFF == OPAQUE:
        return  # an object, whose values stand elsewhere
    # Some programs write unsigned dimensions, and names in UTF-8.
    if not flagged or len(parts) < 3 or kinds[1] not in (5, 6) or kinds[2] not in (1, 2, 16):
        message = "a variable lacks its flags, dimensions or name"
        raise ValueError(message)
    held = parts[1][1]
    sizes = struct.unpack(f"{order}{held.nbytes // 4}i", held) if held.nbytes % 4 == 0 else ()
    if len(sizes) < 2 or min(sizes) < 0:
        message = "the dimensions of a variable are damaged"
        raise ValueError(message)
    _check_values(parts[3:], word, math.prod(sizes), order)


def _check_values(parts: Elements, word: int, count: int, order: str) -> None:
    """Check the values after the name of a matrix, by its class."""
    kind = word & 0xFF
    inner = [values for part, values in parts if part == MATRIX]
    if kind in (CELL, STRUCTURE, OBJECT):
        fields = _fields_of(parts, order) if kind == STRUCTURE else 1
        whole = kind != CELL or len(inner) == len(parts)
        if kind != OBJECT and (len(inner) != count * fields or fields < 0 or not whole):
            what = "cell array" if kind == CELL else "structure"
            message = f"a {what} does not hold as many values as it says"
            raise ValueError(message)
        for values in inner:
            _check_matrix(values, order)
        return
    # Characters may take several bytes; sparse matrices hold fewer values than their dimensions.
    if kind in (CHARACTERS, SPARSE) or kind > LARGEST_NUMERIC:
        return
    # Real values, and imaginary ones where a flag says so.
    wanted = 2 if word & 0x0800 else 1
    if len(parts) != wanted or any(v.nbytes != count * WIDTHS.get(part, -1) for part, v in parts):
        message = "a variable does not hold as many numbers as it says"
        raise ValueError(message)


def _fields_of(parts: Elements, order: str) -> int:
    """Return the number of fields of a structure; -1 if their names are not as long as it says."""
    kinds = [part for part, _ in parts[:2]]
    if kinds != [5, 1] or parts[0][1].nbytes != 4:
        return -1
    length, names = struct.unpack(f"{order}i", parts[0][1])[0], parts[1][1].nbytes
    return names // length if length > 0 and names % length == 0 else -1


def _elements(content: memoryview, order: str, kinds: Sequence[int]) -> Elements:
    """Return the elements within a file or a matrix, all of some types."""
    found: Elements = []
    at = 0
    while at < content.nbytes:
        if content.nbytes - at < TAG:
            message = "it is cut off within a tag"
            raise ValueError(message)
        kind, size = struct.unpack(f"{order}II", content[at : at + TAG])
        start = at + TAG
        if kind >> 16:  # up to 4 bytes, packed into the tag
            size, kind, start = kind >> 16, kind & 0xFFFF, at + 4
            at += TAG
        else:
            at = start + size + (-size % 8 if kind in WIDTHS else 0)
        if kind not in kinds:
            message = f"it holds an element of type {kind} where none may be"
            raise ValueError(message)
        if start + size > content.nbytes:
            message = "it is cut off within a variable"
            raise ValueError(message)
        found.append((kind, content[start : start + size]))
    return found
