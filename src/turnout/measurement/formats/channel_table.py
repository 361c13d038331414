"""Tables: the columns that are times, indices, numbers of throws or texts, and the channels left.

Text files, workbooks, JSON, Parquet and tables within binary files all come here, so that each
column goes with the nearest column of times to its left, an index is never taken for a time, and
several throws in one table never become one channel.
"""

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import FileError
from turnout.core.problems import choices
from turnout.measurement.formats.assemble import (
    FileColumn,
    assemble_recording,
    is_unit,
    split_unit,
    tidy_unit,
)
from turnout.measurement.formats.clock import (
    StatedClock,
    is_abscissa_name,
    is_date_name,
    is_direction_name,
    is_index_name,
    is_letter,
    is_signal_name,
    is_throw_name,
    is_time_name,
    is_time_unit,
    is_time_word,
    squeezed,
    unit_in_name,
)
from turnout.measurement.formats.numbers import (
    LEAST_CURVE,
    curve_parts,
    is_number,
    numbers,
    numbers_with_unit,
)
from turnout.measurement.formats.time_axis import (
    LARGEST_DEPARTURE,
    TimeAxis,
    counts,
    day_zero,
    is_date,
    is_stamp,
    may_be_time,
    moments_axis,
    numeric_axis,
    rises_evenly,
    stamps_axis,
)
from turnout.measurement.recording import Recording, time_grid

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
"""Places of the rows of a throw."""

# A column with fewer numbers than this share is one of texts, else its texts are errors.
_LEAST_NUMBERS = 0.1
_MOST_SIGNALS = 256
ALL = ("*",)
"""In place of the labels of throws: all that a table holds."""
THROW = "throw"
"""Label of a recording that is one of several throws."""
# Columns with their number behind the name that are the samples of a curve.
_LEAST_NUMBERED = 8
_NUMBERED = re.compile(r"(.*?)[\s_\[(]*(\d+)[\])]?")
# A column without a unit that steps less or more than this may not be in seconds [s].
_USUAL_STEP = (1e-5, 0.5)


@dataclass(frozen=True, slots=True, eq=False)
class TableColumn:
    """One column of a table as a file holds it.

    Attributes
    ----------
    name, unit, description : str
        As the file writes them.
    cells : ndarray, shape (n,)
        Numbers, dates (datetime64, timedelta64), or objects that are texts or lists of numbers.
    """

    name: str
    cells: NDArray[np.generic]
    unit: str = ""
    description: str = ""


def _row_number(row: int) -> str:
    return f"row {row + 1}"


@dataclass(slots=True)
class Table:
    """The columns of a table: numbers, times, texts and curves.

    Attributes
    ----------
    columns : list of TableColumn
        In the order of the file.
    stated : StatedClock
        Stated beside them.
    source : str
        The file, for messages.
    decimal : str
        Decimal mark in its texts; found in them if empty.
    named : bool
        Whether the file names its columns.
    line_of : callable
        Name of the line that holds a row.
    remedy : str
        What to do where the time is unknown.
    title : str
        Name of its sheet; empty where the file has none.
    alone : bool
        Whether the file holds nothing else, so that one of its throws may be chosen.
    values : dict of int to ndarray
        Columns of numbers by their place.
    axes : dict of int to TimeAxis
        Columns of times by their place; a date and its time of day make one.
    texts, curves : dict
        Columns of texts, and of lists of numbers in their cells.
    overloads : dict of int to int
        How many cells of a column hold no number but an overload.
    problems : list of str
        Remarks on the columns.
    """

    columns: list[TableColumn]
    stated: StatedClock
    source: str
    decimal: str = ""
    named: bool = True
    line_of: Callable[[int], str] = _row_number
    remedy: str = ""
    title: str = ""
    alone: bool = True
    values: dict[int, Floats] = field(default_factory=dict)
    axes: dict[int, TimeAxis] = field(default_factory=dict)
    texts: dict[int, list[str]] = field(default_factory=dict)
    curves: dict[int, list[Floats]] = field(default_factory=dict)
    overloads: dict[int, int] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)


def recordings_of(
    held: "Recording | Table | Sequence[Table | FileError]", throws: Sequence[str] = ()
) -> list[Recording | FileError]:
    """Return the recording that a file holds, or a recording for each of some throws of a table.

    Parameters
    ----------
    held : Recording, Table or sequence of Table or FileError
        As a reader found it; several are the sheets of a workbook.
    throws : sequence of str
        Labels of the throws, as the table has them, or `ALL`; none where the file holds one.

    Returns
    -------
    list of Recording or FileError
        One, or one a throw: the error of each that cannot be read.

    Raises
    ------
    FileError
        When it holds several throws and none is chosen, or nothing can be read.
    """
    if isinstance(held, Recording):
        return [held]
    if isinstance(held, Table):
        return _of_throws(held, throws) if throws else [table_recording(held)]
    tables = [item for item in held if isinstance(item, Table)]
    if throws:
        with_throws = [table for table in tables if len(_sorted_throws(table)[0]) > 1]
        if len(with_throws) == 1:
            return _of_throws(with_throws[0], throws)
    return [_of_sheets(held)]


def table_recording(table: Table) -> Recording:
    """Return the recording in a table.

    Raises
    ------
    FileError
        When it holds several throws, or no channel; naming what is wrong.
    """
    return _assembled(table, table_columns(table))


def _assembled(table: Table, columns: list[FileColumn], throw: str = "") -> Recording:
    recording = assemble_recording(
        columns,
        source=table.source,
        start_time=table.stated.start_time,
        problems=table.problems,
        remedy=table.remedy,
    )
    labels = {THROW: throw} if throw else {}
    for place, cells in table.texts.items():
        if len(set(cells)) == 1:
            labels.setdefault(_label(table, place), cells[0].strip())
    for place, values in table.values.items():
        if values.size and np.all(values == values[0]):
            labels.setdefault(_label(table, place), f"{values[0]:.9g}")
    return replace(recording, labels=labels)


def _of_throws(table: Table, throws: Sequence[str]) -> list[Recording | FileError]:
    """Return several throws of a table, or the error of each that cannot be read."""
    found: list[Recording | FileError] = []
    try:
        parts, by = _sorted_throws(table)
    except FileError as error:
        return [error] * len(throws)
    if tuple(throws) == ALL:
        throws = list(parts) if len(parts) > 1 else [""]
    for throw in throws:
        try:
            cut = _cut(table, parts, by, throw or None)
            found.append(_assembled(cut, _channel_columns(cut), throw))
        except FileError as error:
            found.append(error)
        except ValueError as error:
            found.append(FileError(f"{table.source}: {error}"))
    return found


def _of_sheets(tables: Sequence[Table | FileError]) -> Recording:
    """Return the recording of all tables with numbers; several give their names to channels."""
    found: dict[str, Recording] = {}
    reasons: list[str] = []
    for table in tables:
        try:
            if isinstance(table, FileError):
                raise table
            found[table.title] = table_recording(table)
        except FileError as error:
            reasons.append(str(error))
    throws = [reason for reason in reasons if "throws in one table" in reason]
    if not found or throws:
        raise FileError(throws[0] if throws else "; ".join(reasons))
    if len(found) == 1:
        return next(iter(found.values()))
    channels = {
        f"{name}/{item.name}": replace(item, name=f"{name}/{item.name}")
        for name, recording in found.items()
        for item in recording.channels.values()
    }
    starts = {recording.start_time for recording in found.values()}
    problems = [text for recording in found.values() for text in recording.problems]
    if len(starts) > 1:
        problems.append(f"check the time: the sheets {choices(found)} start at different times")
    first = next(iter(found.values()))
    return Recording(channels, first.source, first.start_time, tuple(problems))


def table_columns(table: Table) -> list[FileColumn]:
    """Return the channels of a table with their times; remarks are added to its problems.

    Raises
    ------
    FileError
        When it holds several throws, or a time is none.
    """
    try:
        cut = _cut(table, *_sorted_throws(table), None)
        columns = _channel_columns(cut)
    except ValueError as error:
        message = f"{table.source}: {error}"
        raise FileError(message) from None
    table.problems[:] = cut.problems
    return columns


def _sorted_throws(table: Table) -> tuple[dict[str, Rows], str]:
    """Sort the columns and find the times among them; return `_throws` of the table."""
    try:
        _sort_columns(table)
        _name_axes(table)
    except ValueError as error:
        message = f"{table.source}: {error}"
        raise FileError(message) from None
    return _throws(table)


def _label(table: Table, place: int) -> str:
    return table.columns[place].name or f"column {place + 1}"


def _sort_columns(table: Table) -> None:
    """Sort columns of numbers, stamps, lists and texts."""
    _turn_rows(table)
    table.decimal = table.decimal or _decimal_mark(table.columns)
    _take_dates(table)
    dates: dict[int, list[str]] = {}
    for place, column in enumerate(table.columns):
        cells = column.cells
        if cells.dtype.kind in "biuf":
            table.values[place] = cells.astype(np.float64)
        elif cells.dtype.kind in "mM":
            table.axes[place] = moments_axis(cells)
        elif any(isinstance(cell, list | tuple | np.ndarray) for cell in cells[:3]):
            table.curves[place] = _curves(_label(table, place), cells)
        else:
            _sort_texts(table, place, ["" if c is None else str(c) for c in cells], dates)
    _join_dates(table, dates)
    for place in list(table.values):
        values = table.values[place]
        if not table.columns[place].name and values.size and np.isnan(values).all():
            del table.values[place]


def _decimal_mark(columns: Sequence[TableColumn]) -> str:
    """Return the decimal mark in the texts of columns: a comma if one is no number without."""
    texts = [cell for c in columns if c.cells.dtype.kind == "O" for cell in c.cells]
    texts = [cell for cell in texts if isinstance(cell, str) and "," in cell]
    return "," if any(is_number(t, ",") and not is_number(t, ".") for t in texts) else "."


def _take_dates(table: Table) -> None:
    """Take a column that repeats one date for the day of a column of times beside it."""
    for place, column in enumerate(table.columns):
        held, others = column.cells, [c.name for c in table.columns if c is not column]
        one = held.dtype.kind == "M" and held.size > 1 and bool(np.all(held == held[0]))
        if one and any(map(is_time_name, others)):
            table.stated.moments.append(str(held[0].astype("datetime64[s]")))
            cells = np.array([str(held[0])[:10]] * held.size, dtype=object)
            table.columns[place] = replace(column, cells=cells)


def _curves(name: str, cells: NDArray[np.generic]) -> list[Floats]:
    """Return the lists of numbers in the cells of a column."""
    try:
        curves = [np.asarray(cell, dtype=np.float64) for cell in cells]
    except (TypeError, ValueError):
        message = f"column '{name}': a list in it holds no numbers"
        raise ValueError(message) from None
    if any(curve.ndim > 1 for curve in curves) or all(c.size < LEAST_CURVE for c in curves):
        message = f"column '{name}': its cells hold pairs of numbers; export a column for each"
        raise ValueError(message)
    return [np.atleast_1d(curve) for curve in curves]


def _turn_rows(table: Table) -> None:
    """Read curves that lie in rows: with a name in front, or in columns with a number each."""
    columns = table.columns
    count = max((len(column.cells) for column in columns), default=0)
    if len(columns) <= max(_LEAST_NUMBERED, 2 * count) or not count:
        return
    first = [str(cell).strip() for cell in columns[0].cells]
    if not table.named and len(set(first)) == count and all(cell[:1].isalpha() for cell in first):
        table.columns, table.named = [], True
        for row, name in enumerate(first):
            bare, unit = split_unit(name)
            texts = np.array([str(column.cells[row]) for column in columns[1:]], dtype=object)
            table.columns.append(TableColumn(bare, texts, unit))
        return
    if not table.named:
        message = (
            f"has {len(columns)} columns without a name and {count} rows, so curves may lie in its "
            "rows; export a column per channel, with its name"
        )
        raise ValueError(message)
    matches = [_NUMBERED.fullmatch(column.name) for column in columns]
    stems = Counter(match[1] for match in matches if match)
    stem, size = stems.most_common(1)[0] if stems else ("", 0)
    if size >= _LEAST_NUMBERED:
        places = [place for place, match in enumerate(matches) if match and match[1] == stem]
        curves = np.empty(count, dtype=object)
        curves[:] = [[columns[place].cells[row] for place in places] for row in range(count)]
        kept = [column for place, column in enumerate(columns) if place not in places]
        unit = columns[places[0]].unit
        table.columns = [*kept, TableColumn(stem.strip() or "curve", curves, unit)]


def _sort_texts(table: Table, place: int, texts: list[str], dates: dict[int, list[str]]) -> None:
    name = _label(table, place)
    filled = [text for text in texts if text.strip() and text.strip().lower() != "nan"]
    if not filled:
        table.values[place] = np.full(len(texts), np.nan)
        return
    sample = filled[:: max(1, len(filled) // 50)]
    dated = sum(map(is_date, sample)) > 0.9 * len(sample)
    if dated or sum(map(is_stamp, sample)) > 0.9 * len(sample):
        dates[place] = texts
        return
    values, wrong, overload = numbers(texts, table.decimal)
    count = len(filled) - len(wrong)
    if wrong and all(curve_parts(text, table.decimal) for text in filled):
        parts = [curve_parts(text, table.decimal) for text in texts]
        table.curves[place] = [numbers(items, table.decimal)[0] for items in parts]
    elif (wrong or overload) and (held := numbers_with_unit(texts, table.decimal)):
        _take_units(table, place, *held)
    elif wrong and count < _LEAST_NUMBERS * len(filled) or not np.isfinite(values).any():
        table.texts[place] = texts
    elif wrong:
        text = texts[wrong[0]].strip()[:40]
        message = f"{table.line_of(wrong[0])}, column '{name}': '{text}' is not a number"
        raise ValueError(message)
    else:
        table.values[place] = values
        if overload:
            number = sum(text.strip() in overload for text in texts)
            table.overloads[place] = number
            what = "cell is" if number == 1 else "cells are"
            shown = choices(sorted(overload))
            table.problems.append(
                f"channel '{name}': {number} {what} overload ({shown}), taken as missing"
            )


def _take_units(table: Table, place: int, values: Floats, units: list[str]) -> None:
    """Take a column that repeats its unit in each cell."""
    if len(units) > 1:
        message = f"column '{_label(table, place)}': its cells are in {choices(units)}; export one"
        raise ValueError(message)
    table.values[place] = values
    column = table.columns[place]
    unit = tidy_unit(units[0]) if is_unit(units[0]) else units[0]
    table.columns[place] = replace(column, unit=column.unit or unit)


def _join_dates(table: Table, dates: dict[int, list[str]]) -> None:
    """Make axes of stamps; a date alone goes with the time of day beside it."""
    alone = {place for place, texts in dates.items() if is_date(next(filter(str.strip, texts)))}
    clocks = [place for place in dates if place not in alone]
    for place in clocks:
        texts = dates[place]
        beside = next((p for p in (place - 1, place + 1) if p in alone), None)
        if beside is not None and not any(c.isdigit() and "-" in t for t in texts[:1] for c in t):
            texts = [f"{day} {text}" for day, text in zip(dates[beside], texts, strict=True)]
            alone.discard(beside)
        used = _filled(texts)
        axis = stamps_axis(texts[:used])
        following = table.columns[place + 1 : place + 2]
        if following and squeezed(following[0].name) in (
            "ms",
            "millisecond",
            "milliseconds",
            "msec",
        ):
            thousandths = table.values.pop(place + 1, np.zeros(0))[:used]
            if thousandths.size == used and np.all(axis.seconds == np.rint(axis.seconds)):
                seconds = axis.seconds + thousandths / 1e3
                first = float(thousandths[0]) / 1e3
                begin = None if axis.begin is None else axis.begin + first
                axis = replace(axis, seconds=seconds - first, begin=begin)
        table.axes[place] = axis
    for place in alone:
        table.texts[place] = dates[place]


def _filled(texts: Sequence[str]) -> int:
    """Return the number of cells up to the last that is filled."""
    count = len(texts)
    while count and (not texts[count - 1].strip() or texts[count - 1].strip().lower() == "nan"):
        count -= 1
    return count


def _name_axes(table: Table) -> None:
    """Find the columns of numbers that are times."""
    rate = table.stated.rate()
    single = rate[0] if rate else None
    days = _days(table)
    for place in sorted(table.values):
        column, values = table.columns[place], table.values[place]
        given = values[: _count(values)]
        letter, rises = is_letter(column.name), place == 0 and rises_evenly(given)
        named = is_time_name(column.name) or (rises and is_time_word(column.name))
        if (
            not named
            and place not in days
            and not (is_time_unit(column.unit) and (rises or is_abscissa_name(column.name)))
        ):
            continue
        if letter and column.unit and not is_time_unit(column.unit):
            continue
        bare = letter and not is_time_unit(column.unit)
        if bare and not may_be_time(given, column.name, rate=single):
            continue
        index = _counts_throws(given) or _counts_with_holes(given)
        if rate is not None and not is_time_unit(column.unit) and index:
            continue  # an index beside a rate
        try:
            unit = "d" if place in days else column.unit
            axis = numeric_axis(given, name=column.name, unit=unit)
        except ValueError as error:
            message = f"column '{column.name}': {error}"
            raise ValueError(message) from None
        table.axes[place] = axis
        del table.values[place]
    if not table.axes and single is not None:
        _index_axis(table, single)
    if not table.axes and not table.named and 0 in table.values and len(table.columns) > 1:
        first = table.values[0]
        fits = may_be_time(first, "", rate=single) and rises_evenly(first)
        if first.size > 2 and fits and not counts(first):
            table.axes[0] = TimeAxis(table.values.pop(0))
            if single is None:
                table.problems.append("column 1 rises evenly and is taken for the time [s]")


def _days(table: Table) -> set[int]:
    """Return the columns of days in numbers; a time of day beside one is added to it."""
    found = set()
    for place, column in enumerate(table.columns):
        values = table.values.get(place)
        if values is None or column.unit or not is_date_name(column.name):
            continue
        if day_zero(values[: _count(values)]) is None:
            continue
        found.add(place)
        parts = table.values.get(place + 1)
        if parts is None or not is_time_name(table.columns[place + 1].name):
            continue
        given = parts[: _count(parts)]
        if np.all(given >= 0) and np.all(given < 1) and np.all(values == np.rint(values)):
            table.values[place] = values + table.values.pop(place + 1)
    return found


def _index_axis(table: Table, rate: float) -> None:
    """Take an index that leaves numbers out as times: samples are missing there."""
    for place, values in table.values.items():
        name = table.columns[place].name
        steps = np.diff(values)
        if is_index_name(name) and len(name) > 1 and counts(values) and steps[0] > 1:
            message = (
                f"column '{name}' counts in steps of {steps[0]:g} beside a stated rate of {rate:g} "
                "Hz, so that of the rows is not known; leave the column out, or state their rate"
            )
            raise ValueError(message)
        if is_index_name(name) and _counts_with_holes(values) and not _counts_throws(values):
            table.axes[place] = TimeAxis((values - values[0]) / rate)
            del table.values[place]
            return


def _counts_with_holes(values: Floats) -> bool:
    """Return True if whole numbers mostly rise by one."""
    whole = values.size > 1 and np.isfinite(values).all() and np.all(values == np.rint(values))
    return bool(whole and np.median(np.diff(values)) == 1)


def _count(values: Floats) -> int:
    there = np.flatnonzero(np.isfinite(values))
    return int(there[-1]) + 1 if there.size else 0


def _restarts(values: Floats) -> NDArray[np.intp]:
    """Return the places at which times or an index start again."""
    steps = np.diff(values)
    rising = steps[steps > 0]
    near = float(values[0]) + (0.5 * float(np.median(rising)) if rising.size else 0.0)
    with np.errstate(invalid="ignore"):
        return np.flatnonzero((steps < 0) & (values[1:] < near)) + 1


def _counts_throws(values: Floats) -> bool:
    """Return True if whole numbers count, from one or from several beginnings."""
    if values.size < 2 or not np.isfinite(values).all():
        return False
    parts = np.split(values, _restarts(values))
    return all(part.size < 2 or counts(part) for part in parts)


def _cut(table: Table, parts: Mapping[str, Rows], by: str, throw: str | None) -> Table:
    """Return the table of one throw; ValueError when there are several and none is chosen."""
    if len(parts) < 2:
        if throw is not None and throw not in parts:
            message = f"there is one throw in it; leave out the choice of throw '{throw}'"
            raise ValueError(message)
        return table
    if throw is None or throw not in parts:
        unknown = f"no throw '{throw}'; " if throw is not None else ""
        choose = f"choose one with --throw {next(iter(parts))} (in Python throw=), or "
        message = (
            f"{unknown}there are {len(parts)} throws in one table ({by}): {choices(parts)}; "
            f"{choose * table.alone}save a file per throw"
        )
        raise ValueError(message)
    rows = parts[throw]
    cut = replace(
        table,
        values={place: values[rows] for place, values in table.values.items()},
        axes={place: _axis_part(axis, rows) for place, axis in table.axes.items()},
        texts={place: [texts[row] for row in rows] for place, texts in table.texts.items()},
        curves={place: [items[row] for row in rows] for place, items in table.curves.items()},
        overloads={},
        problems=[*table.problems, f"throw '{throw}', one of {len(parts)} in the table"],
    )
    for place in [p for p in cut.values if is_throw_name(_label(table, p))]:
        del cut.values[place]
    return cut


def _axis_part(axis: TimeAxis, rows: NDArray[np.intp]) -> TimeAxis:
    seconds = axis.seconds[rows[rows < axis.seconds.size]]
    if axis.begin is None or not seconds.size:
        return replace(axis, seconds=seconds)
    return replace(axis, seconds=seconds - seconds[0], begin=axis.begin + float(seconds[0]))


def _throws(table: Table) -> tuple[dict[str, Rows], str]:
    """Return the rows of each throw by its label, and the column that tells them apart."""
    size = max((len(column.cells) for column in table.columns), default=0)
    labels: dict[int, list[str]] = {
        place: [f"{value:g}" for value in values]
        for place, values in table.values.items()
        if is_throw_name(table.columns[place].name)
    }
    labels |= {p: t for p, t in table.texts.items() if is_throw_name(table.columns[p].name)}
    curves = bool(table.curves) and size > 1
    held = {**table.texts, **{place: values.tolist() for place, values in table.values.items()}}
    turns = {p: cells for p, cells in held.items() if is_direction_name(table.columns[p].name)}
    for place, cells in labels.items():
        starts = [0, *(i for i in range(1, len(cells)) if cells[i] != cells[i - 1])]
        names = [cells[i] for i in starts]
        if len(set(names)) == len(names) > 1 and (curves or len(names) <= len(cells) / 2):
            edges = [*starts, len(cells)]
            rows = {n: np.arange(a, b) for n, a, b in zip(names, edges, edges[1:], strict=False)}
            return rows, f"column '{_label(table, place)}'"
    if curves:
        place = next(iter(table.curves))
        rows = {f"{row + 1}": np.array([row]) for row in range(size)}
        return rows, f"a curve in each cell of column '{_label(table, place)}'"
    for place, cells in turns.items():
        starts = [0, *(i for i in range(1, len(cells)) if cells[i] != cells[i - 1])]
        if 1 < len(starts) <= len(cells) / LEAST_CURVE and not table.axes:
            parts = zip(starts, [*starts[1:], len(cells)], strict=True)
            rows = {f"{n}": np.arange(a, b) for n, (a, b) in enumerate(parts, start=1)}
            return rows, f"column '{_label(table, place)}' changes"
    indices = {p: v for p, v in table.values.items() if is_index_name(table.columns[p].name)}
    times = {place: axis.seconds for place, axis in table.axes.items()}
    for place, values in [*times.items(), *indices.items()]:
        again = _restarts(values) if values.size > 2 else np.zeros(0, np.intp)
        if not again.size or (place in indices and not _counts_throws(values)):
            continue
        if _signal_column(table) is not None:
            return {}, ""
        edges = [0, *again.tolist(), values.size]
        parts = zip(edges, edges[1:], strict=False)
        rows = {f"{n}": np.arange(a, b) for n, (a, b) in enumerate(parts, start=1)}
        return rows, f"'{_label(table, place)}' starts again"
    return {}, ""


def _signal_column(table: Table, *, any_name: bool = False) -> int | None:
    """Return the column of a long table that says which signal a row holds."""
    numbered = {p: v.tolist() for p, v in table.values.items() if any_name and _are_numbers(v)}
    for place, texts in {**table.texts, **numbered}.items():
        counts_of = Counter(texts)
        named = is_signal_name(table.columns[place].name)
        alike = any_name and len(set(counts_of.values())) == 1
        most = min(_MOST_SIGNALS, len(texts) / 2)
        if (named or alike) and 1 < len(counts_of) <= most:
            return place
    return None


def _are_numbers(values: Floats) -> bool:
    return bool(np.all(values == np.rint(values)))


def _channel_columns(table: Table) -> list[FileColumn]:
    """Return the channels of one throw with their times."""
    columns = _long_columns(table)
    if not columns:
        columns = _curve_columns(table) if table.curves else _wide_columns(table)
    for place, texts in sorted(table.texts.items()):
        dates = all(is_date(text) for text in texts if text.strip())
        what = "dates without a time of day" if dates else "no numbers"
        if is_time_name(_label(table, place)) and not dates:
            shown = next((text for text in texts if text.strip()), "")[:40]
            what = f"times of no known layout ('{shown}'); write them as 2026-11-28 08:14:00.000"
        table.problems.append(f"column '{_label(table, place)}' is left out: it holds {what}")
    for shown in table.stated.doubtful if table.stated.rate() is None else ():
        table.problems.append(f"'{shown}' is not taken for the sample rate")
    for shown in table.stated.reduced if table.stated.rate() is not None else ():
        table.problems.append(f"check the time: '{shown}' is stated beside the sample rate")
    return columns


def _curve_columns(table: Table) -> list[FileColumn]:
    """Return the curves in cells; a cell beside them may state their rate, interval or start."""
    stated = replace(table.stated, rates=[*table.stated.rates], weak=[*table.stated.weak])
    for place, values in table.values.items():
        if values.size and np.all(values == values[0]):
            column = table.columns[place]
            stated.read(column.name, [float(values[0])], unit=column.unit)
    rate = stated.rate()
    begin = next((axis.begin for axis in table.axes.values()), None)
    times = [p for p in table.curves if is_time_name(table.columns[p].name)]
    axis = None
    for place in times[:1]:
        column, cells = table.columns[place], np.concatenate(table.curves[place])
        axis = numeric_axis(cells, name=column.name, unit=column.unit)
    time = None if axis is None else axis.seconds
    begin = begin if axis is None or axis.begin is None else axis.begin
    found = []
    for place, curves in table.curves.items():
        if place in times:
            continue
        column = table.columns[place]
        found.append(
            FileColumn(
                _label(table, place),
                np.concatenate(curves),
                column.unit,
                column.description,
                time=time,
                rate=rate[0] if rate and time is None else None,
                start=stated.start,
                begin=begin,
            )
        )
    return found


def _long_columns(table: Table) -> list[FileColumn]:
    """Return the channels of a table with a signal and a value a row; none if it is not one."""
    by = _signal_column(table)
    repeat = any(np.any(np.diff(axis.seconds) == 0) for axis in table.axes.values())
    if by is None and repeat:
        by = _signal_column(table, any_name=True)
    if by is None or len(table.axes) != 1:
        return []
    (axis,) = table.axes.values()
    places = [
        p
        for p, v in table.values.items()
        if p != by and not (is_index_name(table.columns[p].name) and _counts_throws(v))
    ]
    if not places or np.all(np.diff(axis.seconds) > 0):
        return []
    held = table.texts.pop(by, None) or [f"{value:g}" for value in table.values[by]]
    signals = np.array(held)
    units = next((p for p in table.texts if squeezed(_label(table, p)) in ("unit", "units")), None)
    unit_of = None if units is None else table.texts.pop(units)
    found = []
    for signal in dict.fromkeys(held):
        rows = np.flatnonzero(signals == signal)
        times = axis.seconds[rows]
        for place in places:
            column, samples = table.columns[place], table.values[place][rows]
            name = signal if not signal.isdigit() else f"{_label(table, by)} {signal}"
            name = name if len(places) == 1 else f"{name} {_label(table, place)}"
            unit = tidy_unit(unit_of[rows[0]]) if unit_of else column.unit
            found.append(FileColumn(name, samples, unit, time=times, begin=axis.begin))
    return found


def _wide_columns(table: Table) -> list[FileColumn]:
    rate = table.stated.rate()
    axes = {p: _usable(table, p, axis, rate) for p, axis in sorted(table.axes.items())}
    channels = _channels(table)
    if rate is not None and len(rate) > 1 and len(rate) != len(channels):
        message = f"{len(rate)} sample rates are stated for {len(channels)} columns; state one each"
        raise ValueError(message)
    found = []
    for number, place in enumerate(channels):
        column, values = table.columns[place], table.values[place]
        left = [p for p in axes if p < place] or list(axes)[:1]
        axis = axes[left[-1]] if left else None
        several = len(axes) > 1 or (rate is not None and len(set(rate)) > 1)
        if several:
            values = values[: _count(values)]
        name = column.name or f"column {place + 1}"
        if axis is None:
            own = None if rate is None else rate[number if len(rate) > 1 else 0]
            begin, start, time, remark = None, table.stated.start, None, ""
            if left:
                begin, remark = table.axes[left[-1]].begin, "its times only tell its start"
        else:
            own, start, begin, remark = None, 0.0, axis.begin, axis.remark
            values = _to_length(values, axis.seconds.size)
            time = axis.seconds
        empty = int(np.count_nonzero(np.isnan(values))) - table.overloads.get(place, 0)
        if empty > 0:
            cells = "cell is" if empty == 1 else "cells are"
            table.problems.append(f"channel '{name}': {empty} {cells} empty, taken as missing")
        described = (name, values, column.unit, column.description)
        found.append(
            FileColumn(*described, time=time, rate=own, start=start, begin=begin, remark=remark)
        )
    return found


def _to_length(values: Floats, size: int) -> Floats:
    """Return as many values as there are times; cells behind them must be empty."""
    if values.size > size and not np.isnan(values[size:]).all():
        message = f"a column has samples behind the last of its {size} times; fill the times"
        raise ValueError(message)
    return np.concatenate((values[:size], np.full(max(size - values.size, 0), np.nan)))


def _channels(table: Table) -> list[int]:
    """Return the places of the channels; indices and numbers of one throw are left out."""
    found = []
    for place in sorted(table.values):
        name, values = table.columns[place].name, table.values[place]
        headless = not table.named and place == 0 and counts(values) and len(table.values) > 1
        # Beside a time a letter may be anything that counts up.
        letter = bool(table.axes) and len(name) == 1 and name.isalpha()
        index = table.named and is_index_name(name) and not letter and _counts_throws(values)
        if headless or index:
            shown = f"column '{_label(table, place)}'"
            table.problems.append(f"{shown} is left out: it counts samples and is no time")
        elif is_throw_name(name) and values.size and np.all(values == values[0]):
            table.problems.append(f"column '{name}' is left out: it numbers the throw")
        else:
            found.append(place)
    return found


def _usable(
    table: Table, place: int, axis: TimeAxis, rate: tuple[float, ...] | None
) -> TimeAxis | None:
    """Return an axis; None when it is too coarse and a rate is stated beside it."""
    name = _label(table, place)
    try:
        stamps = table.columns[place].cells.dtype.kind == "O"
        if stamps and _in_whole_seconds(axis.seconds) and rate is None:
            table.problems.append(f"check the time: '{name}' is in whole seconds")
        grid = time_grid(axis.seconds)
    except ValueError as error:
        if rate is None:
            message = f"column '{name}': {error}"
            raise ValueError(message) from None
        table.problems.append(f"column '{name}' is not used, the stated rate is: {error}")
        return None
    column = table.columns[place]
    numeric = column.cells.dtype.kind in "iuf" and axis.begin is None
    unstated = numeric and not (column.unit or unit_in_name(column.name))
    least, most = _USUAL_STEP
    if rate is None and unstated and not least < grid.step < most:
        table.problems.append(f"check the time: '{name}' states no unit and is taken as seconds")
    if rate is not None and abs(rate[0] * grid.step - 1.0) > LARGEST_DEPARTURE:
        table.problems.append(
            f"check the time: column '{name}' has {1 / grid.step:.6g} samples per second, the file "
            f"states {rate[0]:.6g}"
        )
    return axis


def _in_whole_seconds(seconds: Floats) -> bool:
    """Return True for even stamps in whole seconds; ValueError for uneven ones."""
    steps = np.diff(seconds)
    if not np.all(steps == np.rint(steps)):
        return False
    if np.unique(steps).size > 1 and np.all(steps >= 0):
        message = (
            "its times are in whole seconds, coarser than the samples, and tell no rate; state the "
            "sample rate, or export times with more digits"
        )
        raise ValueError(message)
    return True
