"""Files of named arrays (MAT, HDF5): choice of channels among them, and their times."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turnout.measurement.formats.assemble import (
    RATE_NAME,
    FileColumn,
    is_time_name,
    seconds_of,
    split_unit,
    tidy_unit,
)

NO_TIME = "add an array 'time' [s] of the same length or a number 'sample_rate' [1/s]"
# Data1_Rod_1 has its times in Data1_time_Rod_1: the way of DewesoftX.
_DEWESOFT = re.compile(r"(Data\d+_)(?!time_)(.+)")
NAME_LISTS = ("names", "channel_names", "labels", "channels")
UNIT_LISTS = ("units", "channel_units")
MOST_COLUMNS = 256


def columns_of_arrays(
    arrays: Mapping[str, NDArray[Any]],
    texts: Mapping[str, Sequence[str]],
    units: Mapping[str, str] | None = None,
) -> tuple[list[FileColumn], list[str]]:
    """Find the channels among named arrays.

    A vector is a channel; a matrix is one a column (or a row, where it is wider than long), named
    by a list of as many texts. Times come from the array `Data1_time_NAME` of `Data1_NAME`, else
    from a vector called time of the same length, else from a number called sample rate.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        Numeric arrays of up to two dimensions, by name.
    texts : mapping of str to sequence of str
        Lists of texts, by name.
    units : mapping of str to str, optional
        Unit by name of the array, where the file states it.

    Returns
    -------
    columns : list of FileColumn
        In the order of the file.
    problems : list of str
        Arrays that are none.

    Examples
    --------
    >>> columns, _ = columns_of_arrays({"t": np.arange(3) / 1e3, "rod": np.ones(3)}, {})
    >>> columns[0].name, columns[0].time
    ('rod', array([0.   , 0.001, 0.002]))
    """
    units = units or {}
    flat = {name: _vector(array) for name, array in arrays.items()}
    rate = next(
        (float(v[0]) for k, v in flat.items() if v is not None and v.size == 1 and _is_rate(k)),
        None,
    )
    times: dict[str, NDArray[np.float64]] = {}
    problems: list[str] = []
    for name, vector in flat.items():
        if vector is not None and vector.size > 1 and _is_time(name):
            try:
                unit = units.get(name, "") or split_unit(name)[1]
                times[name] = vector.astype(np.float64) * seconds_of(unit)
            except ValueError as error:
                problems.append(f"array '{name}': {error}; it is left out")
    columns: list[FileColumn] = []
    for name, array in arrays.items():
        vector = flat[name]
        if name in times or (vector is not None and vector.size == 1):
            continue
        if not array.size:
            problems.append(f"array '{name}' is empty: no sample recorded")
            continue
        if vector is not None:
            shown, time = _named(name), _time_of(name, vector.size, times)
            unit = units.get(name, "") or split_unit(name)[1]
            columns.append(FileColumn(shown, vector, tidy_unit(unit), time=time, rate=rate))
        elif array.ndim == 2 and min(array.shape) <= MOST_COLUMNS:
            columns += _of_matrix(name, array, texts, times, rate)
        else:
            problems.append(f"array '{name}' has the shape {array.shape} and is no channel")
    return columns, problems


def _vector(array: NDArray[Any]) -> NDArray[Any] | None:
    return array.reshape(-1) if array.size == max((*array.shape, 1)) else None


def _is_rate(name: str) -> bool:
    return RATE_NAME.fullmatch(name.rsplit(".", 1)[-1].rsplit("/", 1)[-1]) is not None


def _is_time(name: str) -> bool:
    last = name.rsplit(".", 1)[-1].rsplit("/", 1)[-1]
    return is_time_name(last) or re.match(r"Data\d+_time_", last) is not None


def _named(name: str) -> str:
    match = _DEWESOFT.fullmatch(name)
    return match[2] if match else split_unit(name)[0]


def _time_of(
    name: str, size: int, times: Mapping[str, NDArray[np.float64]]
) -> NDArray[np.float64] | None:
    match = _DEWESOFT.fullmatch(name)
    if match and f"{match[1]}time_{match[2]}" in times:
        return times[f"{match[1]}time_{match[2]}"]
    # A time beside the array goes before one elsewhere in the file.
    folder = re.split(r"[./](?=[^./]*\Z)", name)[0] if re.search(r"[./]", name) else ""
    fitting = [key for key, time in times.items() if time.size == size and "_time_" not in key]
    beside = [key for key in fitting if folder and key.startswith(folder)]
    chosen = beside or fitting
    return times[chosen[0]] if chosen else None


def _of_matrix(
    name: str,
    array: NDArray[Any],
    texts: Mapping[str, Sequence[str]],
    times: Mapping[str, NDArray[np.float64]],
    rate: float | None,
) -> list[FileColumn]:
    table = array if array.shape[0] >= array.shape[1] else array.T
    count = table.shape[1]
    names = _list(texts, NAME_LISTS, count) or [f"{name} {i}" for i in range(1, count + 1)]
    units = _list(texts, UNIT_LISTS, count) or [""] * count
    time = _time_of(name, table.shape[0], times)
    first = 0
    if time is None and is_time_name(names[0]):
        time, first = np.ascontiguousarray(table[:, 0], dtype=np.float64), 1
    columns = []
    for number in range(first, count):
        shown, unit = split_unit(names[number])
        values = np.ascontiguousarray(table[:, number], dtype=np.float64)
        columns.append(
            FileColumn(shown, values, tidy_unit(units[number] or unit), time=time, rate=rate)
        )
    return columns


def _list(
    texts: Mapping[str, Sequence[str]], wanted: Sequence[str], count: int
) -> list[str] | None:
    for name, items in texts.items():
        if name.rsplit(".", 1)[-1].lower() in wanted and len(items) == count:
            return [str(item) for item in items]
    return None
