"""Files of named arrays (MAT, HDF5): choice of channels among them, and their times."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import FileError, refused_of
from turnout.measurement.formats.assemble import (
    FileColumn,
    assemble_recording,
    column_clock,
    named_unit,
    split_unit,
)
from turnout.measurement.formats.channel_table import table_columns
from turnout.measurement.formats.clock import (
    StatedClock,
    is_numbered_channel,
    is_time_name,
    is_time_unit,
    unit_in_name,
)
from turnout.measurement.formats.file_table import Table
from turnout.measurement.formats.time_axis import (
    TimeAxis,
    is_stamp,
    may_be_time,
    moments_axis,
    numeric_axis,
    stamps_axis,
    unit_remark,
)
from turnout.measurement.recording import Recording

NO_TIME = "add an array 'time' [s] of the same length or a number 'sample_rate' [1/s]"
# Data1_Rod_1 has its times in Data1_time_Rod_1: the way of DewesoftX.
_DEWESOFT = re.compile(r"(Data\d+_)(?!time_)(.+)")
GAINS = ("gain", "scale", "scaling", "slope", "factor", "scale_to_unit", "sensitivity")
"""Attributes that some programs mean to be multiplied, others as facts of the sensor."""
NAME_LISTS = ("names", "channel_names", "labels", "channels")
UNIT_LISTS = ("units", "channel_units")
MOST_COLUMNS = 256


@dataclass(slots=True, eq=False)
class NamedArray:
    """An array of a file, with its unit, names, dimension and clock.

    Attributes
    ----------
    values : ndarray
        Numbers of up to two dimensions.
    unit, label, description : str
        Where the file states them; the label goes before the name.
    along : str
        Dimension along which it lies; times of another one are not its times.
    clock : StatedClock
        Stated for it alone.
    begin : float or None
        Moment from which its start counts [s].
    """

    values: NDArray[Any]
    unit: str = ""
    label: str = ""
    description: str = ""
    along: str = ""
    clock: StatedClock = field(default_factory=StatedClock)
    begin: float | None = None

    @property
    def vector(self) -> NDArray[Any] | None:
        """Its values in one dimension; None if it is a matrix."""
        values = self.values
        return values.reshape(-1) if values.size in (0, max((*values.shape, 1))) else None


@dataclass(slots=True, eq=False)
class ArrayFile:
    """Named arrays, texts and tables of a file, from which its channels are chosen.

    Attributes
    ----------
    source : str
        The file, for messages.
    arrays : dict of str to NamedArray
        By name, folders parted by points or slashes.
    texts : dict of str to list of str
        Lists of texts, by name.
    tables : dict of str to Table
        Without the clock that is stated around them.
    columns : list of FileColumn
        Channels that need no choice.
    problems : list of str
        Remarks.
    """

    source: str
    arrays: dict[str, NamedArray] = field(default_factory=dict)
    texts: dict[str, list[str]] = field(default_factory=dict)
    tables: dict[str, Table] = field(default_factory=dict)
    columns: list[FileColumn] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)

    def recording(self, start_time: str | None) -> Recording:
        """Return the recording of all that was taken; FileError when it has no channel."""
        with refused_of(self.source):
            clocks = self._clocks()
            found, problems = columns_of_arrays(self.arrays, self.texts, clocks)
        for name, table in self.tables.items():
            stated = table.stated.within(_clock_of(name, clocks))
            try:
                columns, remarks = table_columns(replace(table, stated=stated))
            except FileError as error:
                problems.append(f"a table is left out: {error}")
            else:
                found += columns
                problems += remarks
        return assemble_recording(
            [*self.columns, *found],
            source=self.source,
            start_time=start_time or None,
            problems=[*self.problems, *problems],
            remedy=NO_TIME,
        )

    def _clocks(self) -> dict[str, StatedClock]:
        """Return the clock that the numbers and texts in each folder state."""
        folders: dict[str, dict[str, Any]] = {}
        single = {k: a.values.item() for k, a in self.arrays.items() if a.values.size == 1}
        single |= {name: items[0] for name, items in self.texts.items() if len(items) == 1}
        for name, value in single.items():
            folders.setdefault(_folder(name), {})[name] = value
        return {folder: stated_clock(values) for folder, values in folders.items()}


def columns_of_arrays(
    arrays: Mapping[str, NamedArray],
    texts: Mapping[str, Sequence[str]],
    clocks: Mapping[str, StatedClock],
) -> tuple[list[FileColumn], list[str]]:
    """Find the channels among named arrays.

    A vector is a channel; a matrix is one a column (or a row, where it is wider than long), named
    by a list of as many texts. Its own rate goes first. Times come from the array
    `Data1_time_NAME` of `Data1_NAME`, else from a vector called time of the same length, else from
    a number called sample rate.

    Parameters
    ----------
    arrays : mapping of str to NamedArray
        By name.
    texts : mapping of str to sequence of str
        Lists of texts, by name.
    clocks : mapping of str to StatedClock
        What the numbers in each folder state.

    Returns
    -------
    columns : list of FileColumn
        In the order of the file.
    problems : list of str
        Arrays that are none.

    Examples
    --------
    >>> arrays = {"t": NamedArray(np.arange(3) / 1e3), "rod": NamedArray(np.ones(3))}
    >>> columns, _ = columns_of_arrays(arrays, {}, {})
    >>> columns[0].name, columns[0].time
    ('rod', array([0.   , 0.001, 0.002]))
    """
    times, named, problems = _times(arrays, texts, clocks)
    columns: list[FileColumn] = []
    over = {name: array.along for name, array in arrays.items() if array.along}
    for name, array in arrays.items():
        vector, mine, own = array.vector, over.get(name), array.clock.rate_of_rows()
        clock = array.clock.within(_clock_of(name, clocks))
        along = {key: axis for key, axis in times.items() if mine in (over.get(key, mine), None)}
        if name in named or (vector is not None and vector.size == 1 and not own):
            continue
        if vector is not None:
            axis = None if own else _time_of(name, vector.size, along)
            shown, (_, unit) = array.label or _named(name), named_unit(_last(name), array.unit)
            columns.append(FileColumn(shown, vector, unit, **column_clock(axis, clock)))
        elif array.values.ndim == 2 and min(array.values.shape) <= MOST_COLUMNS:
            columns += _of_matrix(name, array, texts, along, clock)
        else:
            problems.append(f"array '{name}' has the shape {array.values.shape} and is no channel")
            continue
        if own and vector is not None:
            columns[-1] = replace(columns[-1], description=array.description, begin=array.begin)
    return columns, problems


def _times(
    arrays: Mapping[str, NamedArray],
    texts: Mapping[str, Sequence[str]],
    clocks: Mapping[str, StatedClock],
) -> tuple[dict[str, TimeAxis], set[str], list[str]]:
    """Return the times in arrays and texts, the names of all that stand for some, and remarks."""
    times: dict[str, TimeAxis] = {}
    named: set[str] = set()
    problems: list[str] = []
    for name, array in arrays.items():
        moments, bare_unit = array.values.dtype.kind in "mM", array.unit.partition(" since ")[0]
        if not (_is_time(name) or moments or (array.along == name and is_time_unit(bare_unit))):
            continue
        vector, clock = array.vector, array.clock.within(_clock_of(name, clocks))
        bare, own = split_unit(_last(name))
        unit = array.unit or own
        if not unit and bare != "T" and not unit_in_name(bare):
            unit = clock.unit
        several = vector is not None and vector.size > 1 and not moments
        if vector is not None and several and not _holds_time(bare, vector, unit, clock):
            continue
        named.add(name)
        if vector is None or not (several or moments):
            continue
        try:
            axis = (
                moments_axis(vector)
                if moments
                else numeric_axis(vector.astype(np.float64), name=bare, unit=unit)
            )
        except ValueError as error:
            problems.append(f"array '{name}' is not used as time: {error}")
            continue
        unstated = axis.begin is None and is_time_name(bare) and not (unit or unit_in_name(bare))
        remark = unit_remark(axis.seconds, name) if unstated and clock.rate() is None else ""
        times[name] = replace(axis, remark=remark or axis.remark)
    for name, items in texts.items():
        if len(items) > 1 and _is_time(name) and all(map(is_stamp, items)):
            times[name] = stamps_axis(items)
    return times, named, problems


def stated_clock(*facts: Mapping[str, Any], own: bool = False) -> StatedClock:
    """Return the clock that names and their single values state.

    Parameters
    ----------
    *facts : mapping of str to object
        Single values by name.
    own : bool
        Whether they describe one channel, of which a "rate" is the sample rate; that of a group
        may be a shaft's.

    Examples
    --------
    >>> stated_clock({"bearing.sr": 97656.0, "bearing.rate": 25.0}).rate()
    (97656.0,)
    """
    stated = StatedClock()
    for values in facts:
        for name, value in values.items():
            its = str(values.get(f"{name}_unit", ""))
            for text in _single(value):
                stated.read(_last(name), [text], unit=its) or stated.read(name, [text], unit=its)
    stated.turning |= not own
    return stated


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
    array: NamedArray,
    texts: Mapping[str, Sequence[str]],
    times: Mapping[str, TimeAxis],
    clock: StatedClock,
) -> list[FileColumn]:
    table, label = array.values, array.label or name
    table = table if table.shape[0] >= table.shape[1] else table.T
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
        columns.append(FileColumn(shown, values, unit, **column_clock(time, clock)))
    return columns


def _list(
    texts: Mapping[str, Sequence[str]], wanted: Sequence[str], count: int
) -> list[str] | None:
    for name, items in texts.items():
        if _last(name).lower() in wanted and len(items) == count:
            return [str(item) for item in items]
    return None
