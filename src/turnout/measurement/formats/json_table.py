"""JSON: tables by rows or by columns, lists of channels, JSON lines."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import FileError, refused_of
from turnout.measurement.formats.assemble import FileColumn, assemble_recording, named_unit
from turnout.measurement.formats.channel_table import table_columns
from turnout.measurement.formats.clock import StatedClock, is_time_name, squeezed
from turnout.measurement.formats.extent import Declared
from turnout.measurement.formats.file_table import Table, TableColumn
from turnout.measurement.formats.named_arrays import gains_not_applied, stated_clock
from turnout.measurement.formats.text_dialect import encoding_of
from turnout.measurement.formats.time_axis import moment_of
from turnout.measurement.recording import Recording

NO_TIME = "give a column 'Time (s)' or a key 'sample_rate' [1/s]"
_VALUES = ("values", "data", "samples", "y", "ydata")
_NAMES = ("name", "label", "channel", "signal", "id")
_UNITS = ("unit", "units")
_CLOCKS = ("sampling", "clock", "timebase")
_LARGEST_DEPTH = 5


def read_json(path: Path) -> Recording | Table:
    """Read a table in JSON: a list of rows, lists by name, channels with their samples.

    Parameters
    ----------
    path : Path
        JSON, or one row in JSON a line.

    Raises
    ------
    FileError
        When it holds no table, or it is no JSON.
    """
    content = path.read_bytes()
    text = content.decode(encoding_of(content), errors="replace")
    Declared(path).add(text.count(","))
    try:
        held = json.loads(text)
    except json.JSONDecodeError as error:
        held = _rows_of_lines(text)
        if len(held) < 2:
            message = f"{path}: is no JSON (line {error.lineno}: {error.msg}); export it again"
            raise FileError(message) from None
    with refused_of(path):
        return _found(path, held)


def _rows_of_lines(text: str) -> list[Any]:
    """Return the rows of JSON lines; none if they are none."""
    try:
        return [json.loads(line) for line in text.splitlines() if line.strip()]
    except json.JSONDecodeError:
        return []


def _found(path: Path, held: Any) -> Recording | Table:
    units: dict[str, str] = {}
    facts: list[dict[str, Any]] = []
    for _ in range(_LARGEST_DEPTH):
        if isinstance(held, Mapping):
            facts += _facts(held, units)
            held = _by_name(held, units)
        table = _columns(held)
        if table is not None:
            break
        inner = list(held.values()) if isinstance(held, Mapping) else []
        inner = [v for v in inner if v and (_columns(v) is not None or _tables_in(v))]
        if len(inner) != 1:
            raise ValueError(_no_table(held))
        (held,) = inner
    else:
        message = f"its table is nested deeper than {_LARGEST_DEPTH}"
        raise ValueError(message)
    stated = stated_clock(*facts, own=True)
    if isinstance(held, list):
        channels, problems = _channels(held, stated, str(path))
        if channels:
            shown, begin = str(path), stated.start_time
            return assemble_recording(
                channels, source=shown, start_time=begin, problems=problems, remedy=NO_TIME
            )
    named = not all(name.isdigit() for name in table)
    columns = []
    for name, cells in table.items():
        bare, unit = named_unit(name if named else "", units.get(name, ""))
        columns.append(TableColumn(bare, cells, unit))
    return Table(columns, stated, str(path), named=named, remedy=NO_TIME)


def _no_table(held: Any) -> str:
    """Return why an object holds no table."""
    lists = held.items() if isinstance(held, Mapping) else ()
    sizes = [f"{key} {len(value)}" for key, value in lists if isinstance(value, list)]
    if len(sizes) > 1 and len({size.split()[-1] for size in sizes}) > 1:
        return f"its lists have different lengths ({', '.join(sizes[:4])}); export them alike"
    return "holds no table, or more than one; export one list of rows or of channels"


def _tables_in(held: Any) -> bool:
    return isinstance(held, Mapping) and any(
        _columns(v) is not None or _tables_in(v) for v in held.values()
    )


def _scalars(held: Mapping[Any, Any]) -> dict[str, Any]:
    """Return single values."""
    values = {str(key): _plain(value) for key, value in held.items()}
    return {key: value for key, value in values.items() if type(value) in (str, int, float)}


def _plain(value: Any) -> Any:
    """Return a number with its unit in an object of its own as a text; others as they are."""
    number, unit = _first_of(value, ("value", "magnitude"), None), _first_of(value, _UNITS, None)
    if type(number) not in (str, int, float):
        return value
    return f"{number} {unit}" if unit else number


def _flat(row: Mapping[Any, Any], around: tuple[str, ...] = ()) -> dict[tuple[str, ...], Any]:
    """Return the cells of a row and of its inner objects, by the names that lead to each."""
    cells: dict[tuple[str, ...], Any] = {}
    for key, value in row.items():
        name, cell = (*around, str(key)), _plain(value)
        cells |= _flat(cell, name) if isinstance(cell, Mapping) else {name: cell}
    return cells


def _by_rows_of_names(held: Sequence[Mapping[Any, Any]]) -> dict[str, NDArray[Any]]:
    """Return the columns of rows by name; equal names keep those of their objects: left.force."""
    opened = [_flat(row) for row in held]
    keys = list(dict.fromkeys(key for row in opened for key in row))
    count = Counter(key[-1] for key in keys)
    names = [key[-1] if count[key[-1]] == 1 else ".".join(key) for key in keys]
    if twice := [name for name, times in Counter(names).items() if times > 1]:
        message = f"its rows hold '{twice[0]}' more than once; export a name for each"
        raise ValueError(message)
    cells = [_cells([row.get(key) for row in opened]) for key in keys]
    return dict(zip(names, cells, strict=True))


def _first_of(held: Any, names: Sequence[str], default: Any) -> Any:
    """Return the first value of an object under one of some names."""
    keys = {squeezed(str(key)): key for key in held} if isinstance(held, Mapping) else {}
    return next((held[keys[name]] for name in names if name in keys), default)


def _by_name(held: Mapping[str, Any], units: dict[str, str]) -> Any:
    """Return channels that stand under their names as a list, or as lists with their times.

    They do not where another table stands beside them.
    """
    found = {str(k): v for k, v in held.items() if _is_channel(v)}
    others = {k: v for k, v in held.items() if str(k) not in found}
    by_number = {k: v for k, v in others.items() if isinstance(v, Mapping)}
    if not found or any(map(_holds_samples, others.values())) or _columns(by_number) is not None:
        return held
    times = [name for name in found if is_time_name(name)]
    if not times:
        return [{"name": name, **item} for name, item in found.items()]
    for name, item in found.items():
        if any(_is_clock(key, value) for key, value in item.items()):
            beside = "its times" if name in times else f"'{times[0]}'"
            message = f"'{name}' has a clock of its own beside {beside}; leave one"
            raise ValueError(message)
    named = {str(item.get("name", name)): item for name, item in found.items()}
    named = named if len(named) == len(found) and any(map(is_time_name, named)) else found
    units |= {name: str(_first_of(item, _UNITS, "")) for name, item in named.items()}
    return {name: _first_of(item, _VALUES, []) for name, item in named.items()}


def _is_channel(held: Any) -> bool:
    """Return True for an object with one curve, beside which only times may stand."""
    curves = {k: v for k, v in held.items() if _is_curve(v)} if isinstance(held, Mapping) else {}
    named = _is_curve(_first_of(held, _VALUES, None))
    return named and sum(not is_time_name(str(key)) for key in curves) == 1


def _is_clock(key: str, value: Any) -> bool:
    """Return True for times, and for a rate, an interval, a start or samples left out."""
    if is_time_name(str(key)) and isinstance(value, list):
        return True
    own = stated_clock(*_own_facts({key: value}), own=True)
    return bool(own.rates or own.weak or own.reduced or own.moments or own.first)


def _holds_samples(held: Any) -> bool:
    """Return True for a curve, and for rows or channels however deep."""
    if isinstance(held, Mapping):
        return any(map(_holds_samples, held.values()))
    rows = isinstance(held, list) and any(isinstance(item, Mapping | list) for item in held)
    return rows or (_is_curve(held) and len(held) > 1)


def _facts(held: Mapping[str, Any], units: dict[str, str]) -> list[dict[str, Any]]:
    """Return single values, also those of objects without lists, and take units of channels."""
    facts = []
    for key, value in held.items():
        if squeezed(key) in _UNITS and isinstance(value, Mapping):
            units |= {str(name): str(unit) for name, unit in value.items()}
        elif isinstance(value, Mapping) and not _holds_lists(value):
            # A rate of another object may be that of anything.
            rates = ("rate", "ratehz", "ratekhz")
            facts += [
                {name: fact for name, fact in single.items() if squeezed(name) not in rates}
                for single in _facts(value, {})
            ]
    return [*facts, _scalars(held)]


def _own_facts(item: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return single values of a channel, also those of objects called as its clock."""
    facts = []
    for key, value in item.items():
        if isinstance(value, Mapping):
            *inner, own = _own_facts(value)
            facts += [*inner, own] if squeezed(str(key)) in _CLOCKS else inner
    return [*facts, _scalars(item)]


def _holds_lists(held: Mapping[str, Any]) -> bool:
    inner = [value for value in held.values() if isinstance(value, Mapping)]
    return any(isinstance(v, list) for v in held.values()) or any(map(_holds_lists, inner))


def _columns(held: Any) -> dict[str, NDArray[Any]] | None:
    """Return the columns of a table in one of its shapes; None if it is none."""
    if isinstance(held, list):
        if held and all(isinstance(row, Mapping) for row in held):
            return _by_rows_of_names(held)
        if len(held) > 1 and all(isinstance(row, list) for row in held):
            if all(isinstance(cell, str) for cell in held[0]):
                return _by_rows(held[0], held[1:])
            if len({len(row) for row in held}) == 1 and all(map(_are_numbers, held)):
                return {str(n): _cells(list(c)) for n, c in enumerate(zip(*held, strict=True))}
        return None
    if not isinstance(held, Mapping):
        return None
    names, rows = held.get("columns"), held.get("data")
    if isinstance(names, list) and isinstance(rows, list):
        return _by_rows(names, rows)
    lists = {str(k): v for k, v in held.items() if isinstance(v, list) and len(v) > 1}
    flat = {k: v for k, v in lists.items() if not _holds_rows(v)}
    if flat and len({len(v) for v in flat.values()}) == 1:
        return {key: _cells(values) for key, values in flat.items()}
    inner = {k: v for k, v in held.items() if isinstance(v, Mapping) and len(v) > 1}
    # As pandas writes them, by the number of the row, also beside facts.
    numbered = {k: v for k, v in inner.items() if all(map(str.isdigit, v))}
    nested = Mapping | list if numbered else Mapping | list | str
    found = numbered or (inner if len(inner) == len(held) else {})
    plain = not any(isinstance(cell, nested) for v in found.values() for cell in v.values())
    if plain and len(found) > 1 and len({tuple(v) for v in found.values()}) == 1:
        return {str(name): _cells(list(v.values())) for name, v in found.items()}
    return None


def _holds_rows(values: list[Any]) -> bool:
    """Return True if a list holds rows by name, or a row of names and rows of cells."""
    named = isinstance(values[0], list) and all(isinstance(cell, str) for cell in values[0])
    return named or any(isinstance(value, Mapping) for value in values)


def _by_rows(names: Sequence[Any], rows: Sequence[Any]) -> dict[str, NDArray[Any]] | None:
    if not all(isinstance(row, list) and len(row) == len(names) for row in rows):
        return None
    return {str(name): _cells([row[n] for row in rows]) for n, name in enumerate(names)}


def _cells(values: list[Any]) -> NDArray[Any]:
    """Return numbers as such, with NaN for null; other cells as objects."""
    if _are_numbers(values):
        return np.array([np.nan if v is None else float(v) for v in values])
    cells = np.empty(len(values), dtype=object)
    for place, value in enumerate(values):
        cells[place] = (
            [np.nan if v is None else v for v in value] if isinstance(value, list) else value
        )
    return cells


def _is_curve(values: Any) -> bool:
    return isinstance(values, list) and _are_numbers(values)


def _are_numbers(values: list[Any]) -> bool:
    return all(value is None or type(value) in (int, float) for value in values)


def _channels(
    held: list[Any], stated: StatedClock, source: str
) -> tuple[list[FileColumn], list[str]]:
    """Return channels that each have their name, clock and samples, and remarks.

    Both are empty if it is no such list.
    """
    found: list[FileColumn] = []
    problems: list[str] = []
    for item in held:
        values, name = _first_of(item, _VALUES, None), _first_of(item, _NAMES, None)
        if name is None or not _is_curve(values):
            return [], []
        bare, unit = named_unit(str(name), str(_first_of(item, _UNITS, "")))
        times = {str(k): v for k, v in item.items() if is_time_name(str(k)) and isinstance(v, list)}
        own = stated_clock(*_own_facts(item), own=True)
        clock = own.within(stated)
        columns = [TableColumn(key, _cells(cells)) for key, cells in times.items()]
        columns.append(TableColumn(bare, _cells(values), unit))
        table = Table(columns, clock, source, remedy=NO_TIME, alone=False)
        begin = moment_of(" ".join(own.moments))
        read, remarks = table_columns(table)
        found += [replace(c, begin=begin) if begin else c for c in read]
        problems += [*remarks, *gains_not_applied(bare, item)]
    distinct = len({column.name for column in found}) == len(found)
    return (found, problems) if distinct else ([], [])
