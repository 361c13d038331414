"""Files of named arrays (MAT, HDF5): choice of channels among them, and their times."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turnout.measurement.formats.assemble import FileColumn, named_unit, split_unit
from turnout.measurement.formats.clock import (
    StatedClock,
    is_numbered_channel,
    is_time_name,
    is_time_unit,
    unit_in_name,
)
from turnout.measurement.formats.time_axis import (
    TimeAxis,
    is_stamp,
    may_be_time,
    moments_axis,
    numeric_axis,
    rate_remark,
    stamps_axis,
)

NO_TIME = "add an array 'time' [s] of the same length or a number 'sample_rate' [1/s]"
# Data1_Rod_1 has its times in Data1_time_Rod_1: the way of DewesoftX.
_DEWESOFT = re.compile(r"(Data\d+_)(?!time_)(.+)")
GAINS = ("gain", "scale", "scaling", "slope", "factor", "scale_to_unit", "sensitivity")
"""Attributes that some programs mean to be multiplied, others as facts of the sensor."""
NAME_LISTS = ("names", "channel_names", "labels", "channels")
UNIT_LISTS = ("units", "channel_units")
MOST_COLUMNS = 256


def columns_of_arrays(
    arrays: Mapping[str, NDArray[Any]],
    texts: Mapping[str, Sequence[str]],
    units: Mapping[str, str] | None = None,
    labels: Mapping[str, str] | None = None,
    scales: Mapping[str, str] | None = None,
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
    labels : mapping of str to str, optional
        Name of the channel by name of the array, where the file states another one.
    scales : mapping of str to str, optional
        Dimension along which an array lies, by its name; times of another one are not its times.

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
    units, labels, scales, problems = units or {}, labels or {}, scales or {}, list[str]()
    flat = {name: _vector(array) for name, array in arrays.items()}
    numbers = {k: v for k, v in flat.items() if v is not None and v.dtype.kind in "biuf"}
    single = {name: vector[0] for name, vector in numbers.items() if vector.size == 1}
    stated = _stated_clocks(single | {k: v[0] for k, v in texts.items() if len(v) == 1})
    times: dict[str, TimeAxis] = {}
    named = {
        name
        for name, a in arrays.items()
        if _is_time(name)
        or a.dtype.kind in "mM"
        or (scales.get(name) == name and is_time_unit(units.get(name, "").partition(" since ")[0]))
    }
    for name, vector in flat.items():
        if vector is None or name not in named:
            continue
        moments = vector.dtype.kind in "mM"
        bare, own = split_unit(_last(name))
        unit = units.get(name, "") or own
        if not unit and bare != "T" and not unit_in_name(bare):
            unit = _clock_of(name, stated).unit
        if not moments and vector.size < 2:
            continue
        if not moments and not _holds_time(bare, vector, unit, _clock_of(name, stated)):
            named.discard(name)
            continue
        try:
            times[name] = (
                moments_axis(vector)
                if moments
                else numeric_axis(vector.astype(np.float64), name=bare, unit=unit)
            )
        except ValueError as error:
            problems.append(f"array '{name}' is not used as time: {error}")
    for name, items in texts.items():
        if len(items) > 1 and _is_time(name) and all(map(is_stamp, items)):
            times[name] = stamps_axis(items)
    columns: list[FileColumn] = []
    for name, array in arrays.items():
        vector, clock, over = flat[name], _clock_of(name, stated), scales.get(name)
        along = {key: axis for key, axis in times.items() if over in (scales.get(key, over), None)}
        if name in named or (vector is not None and vector.size == 1):
            continue
        if vector is not None:
            shown, axis = labels.get(name) or _named(name), _time_of(name, vector.size, along)
            _, unit = named_unit(_last(name), units.get(name, ""))
            columns.append(_timed(shown, vector, unit, axis, clock))
        elif array.ndim == 2 and min(array.shape) <= MOST_COLUMNS:
            columns += _of_matrix(name, array, texts, along, clock, labels.get(name) or name)
        else:
            problems.append(f"array '{name}' has the shape {array.shape} and is no channel")
    return columns, problems


def stated_clock(*facts: Mapping[str, Any], own: bool = False, unit: str = "") -> StatedClock:
    """Return the clock that names and their single values state.

    Parameters
    ----------
    *facts : mapping of str to object
        Single values by name.
    own : bool
        Whether they describe one channel, of which a "rate" is the sample rate; that of a group
        may be a shaft's.
    unit : str
        Unit of times that is stated around them; their own goes before it.

    Examples
    --------
    >>> stated_clock({"bearing.sr": 97656.0, "bearing.rate": 25.0}).rate()
    (97656.0,)
    """
    stated = StatedClock(unit=time_unit_of(*facts) or unit)
    for values in facts:
        for name, value in values.items():
            its = str(values.get(f"{name}_unit", ""))
            for text in _single(value):
                stated.read(_last(name), [text], unit=its) or stated.read(name, [text], unit=its)
    stated.turning |= not own
    return stated


def time_unit_of(*facts: Mapping[str, Any]) -> str:
    """Return the unit of times that names and their single values state; empty if they do not."""
    stated = StatedClock()
    for name, value in (item for values in facts for item in values.items()):
        stated.read_unit(name, [str(text) for text in _single(value)])
    return stated.unit


def _single(value: Any) -> list[Any]:
    """Return the first item of a value, bytes as a text; empty if it has none."""
    items = np.ravel(value)[:1].tolist()
    return [item.decode(errors="replace") if isinstance(item, bytes) else item for item in items]


def gains_not_applied(name: str, attributes: Mapping[str, Any]) -> list[str]:
    """Return a remark on each attribute of a channel that may be a gain."""
    return [
        f"channel '{name}': its attribute '{key}' ({attributes[key]}) is not applied"
        for key in GAINS
        if key in attributes and np.any(np.ravel(attributes[key]) != np.array(1))
    ]


def _stated_clocks(values: Mapping[str, Any]) -> dict[str, StatedClock]:
    """Return the clock that is stated in each folder of the file."""
    folders: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        folders.setdefault(_folder(name), {})[name] = value
    clocks: dict[str, StatedClock] = {}
    for folder in sorted(folders, key=len):
        clocks[folder] = stated_clock(folders[folder], unit=_around(folder, clocks).unit)
    return clocks


def _clock_of(name: str, stated: Mapping[str, StatedClock]) -> StatedClock:
    """Return the clock of the folders around a name, or the only clock there is."""
    clock = _around(name, stated)
    rated = [clock for clock in stated.values() if clock.rates]
    return rated[0] if not clock.rates and len(rated) == 1 else clock


def _around(name: str, stated: Mapping[str, StatedClock]) -> StatedClock:
    """Return the clock of the folders around a name, the nearest first.

    An inner one may only tell when its channel starts.
    """
    clock, path = StatedClock(), f"{name}/"
    for end in (0, *(match.end() for match in re.finditer("[./]", path))):
        if inner := stated.get(path[:end]):
            clock = inner.within(clock)
    return clock


def _folder(name: str) -> str:
    match = re.match(r".*[./]", name)
    return match[0] if match else ""


def _timed(
    name: str, values: NDArray[Any], unit: str, axis: TimeAxis | None, clock: StatedClock
) -> FileColumn:
    if axis is not None:
        rate = clock.rate()
        remark = (rate_remark(axis.seconds, rate[0]) if rate else "") or axis.remark
        return FileColumn(name, values, unit, time=axis.seconds, begin=axis.begin, remark=remark)
    rate, start = clock.rate_of_rows(), clock.start or 0.0
    return FileColumn(name, values, unit, rate=rate[0] if rate else None, start=start)


def _vector(array: NDArray[Any]) -> NDArray[Any] | None:
    return array.reshape(-1) if array.size in (0, max((*array.shape, 1))) else None


def _last(name: str) -> str:
    return name.rsplit(".", 1)[-1].rsplit("/", 1)[-1]


def _is_time(name: str) -> bool:
    last = _last(name)
    return is_time_name(split_unit(last)[0]) or re.match(r"Data\d+_time_", last) is not None


def _holds_time(bare: str, values: NDArray[Any], unit: str, clock: StatedClock) -> bool:
    """Return False for a vector called t, T or Tempo 1 that holds something else."""
    if is_numbered_channel(bare, values.astype(np.float64), unit=unit):
        return False
    if len(bare) > 1 or is_time_unit(unit) or " since " in unit:
        return True
    rate = clock.rate()
    return not unit and may_be_time(values.astype(np.float64), bare, rate=rate[0] if rate else None)


def _named(name: str) -> str:
    match = _DEWESOFT.fullmatch(name)
    last = _last(name)
    return match[2] if match else name.removesuffix(last) + split_unit(last)[0]


def _time_of(name: str, size: int, times: Mapping[str, TimeAxis]) -> TimeAxis | None:
    match = _DEWESOFT.fullmatch(name)
    if match and f"{match[1]}time_{match[2]}" in times:
        return times[f"{match[1]}time_{match[2]}"]
    # A time in the nearest folder around the array goes before the only one in the file.
    fitting = [k for k, t in times.items() if t.seconds.size == size and "_time_" not in k]
    around = [key for key in fitting if name.startswith(_folder(key))]
    if around:
        nearest = max(around, key=lambda key: len(_folder(key)))
        beside = [key for key in around if _folder(key) == _folder(nearest)]
        # time_1 beside time_2 goes with the arrays of its number, time with those of none.
        fits = [key for key in beside if _number(key) == _number(name)]
        if fits or sum(bool(_number(key)) for key in beside) > 1:
            return times[fits[0]] if fits else None
        return times[next((key for key in beside if not _number(key)), nearest)]
    return times[fitting[0]] if len(fitting) == 1 else None


def _number(name: str) -> str:
    match = re.search(r"\d+\Z", name)
    return match[0] if match else ""


def _of_matrix(
    name: str,
    array: NDArray[Any],
    texts: Mapping[str, Sequence[str]],
    times: Mapping[str, TimeAxis],
    clock: StatedClock,
    label: str,
) -> list[FileColumn]:
    table = array if array.shape[0] >= array.shape[1] else array.T
    count = table.shape[1]
    names = _list(texts, NAME_LISTS, count) or [f"{label} {i}" for i in range(1, count + 1)]
    units = _list(texts, UNIT_LISTS, count) or [""] * count
    time = _time_of(name, table.shape[0], times)
    first = 0
    if time is None and is_time_name(split_unit(names[0])[0]):
        bare, unit = split_unit(names[0])
        given = np.ascontiguousarray(table[:, 0], dtype=np.float64)
        time, first = numeric_axis(given, name=bare, unit=units[0] or unit), 1
    columns = []
    for number in range(first, count):
        shown, unit = named_unit(names[number], units[number])
        values = np.ascontiguousarray(table[:, number], dtype=np.float64)
        columns.append(_timed(shown, values, unit, time, clock))
    return columns


def _list(
    texts: Mapping[str, Sequence[str]], wanted: Sequence[str], count: int
) -> list[str] | None:
    for name, items in texts.items():
        if _last(name).lower() in wanted and len(items) == count:
            return [str(item) for item in items]
    return None
