"""Tables as files hold them: columns of numbers, times, texts and curves.

Text files, workbooks, JSON, Parquet and tables within binary files all come here, whatever wrote
their cells: numbers with their unit, dates apart from times of day, curves that lie in rows.
"""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import refused_of
from turnout.core.problems import choices, count_in_words
from turnout.measurement.formats.assemble import is_unit, split_unit, tidy_unit
from turnout.measurement.formats.clock import (
    SECONDS,
    NameKind,
    StatedClock,
    is_called,
    is_numbered_channel,
    is_speed,
    is_time_name,
    is_time_unit,
    often_falls,
    seconds_of,
    squeezed,
    unit_in_name,
)
from turnout.measurement.formats.numbers import (
    LEAST_CURVE,
    curve_parts,
    is_number,
    numbers,
    numbers_with_unit,
    unclear_mark,
)
from turnout.measurement.formats.time_axis import (
    TimeAxis,
    counts,
    day_zero,
    gone_round,
    is_date,
    is_stamp,
    may_be_time,
    moments_axis,
    numeric_axis,
    rises_evenly,
    stamps_axis,
)

Floats = NDArray[np.float64]
# A column with fewer numbers than this share is one of texts, else its texts are errors.
_LEAST_NUMBERS = 0.1
# Columns with their number behind the name that are the samples of a curve.
_LEAST_NUMBERED = 8
_FIRST_WORD = re.compile(r"[^\W\d_]+")
_NUMBERED = re.compile(r"(.*?)[\s_\[(]*(\d+)[\])]?")


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


def sort_columns(table: Table) -> Table:
    """Return a table with its columns sorted, and the times found among its numbers.

    Raises
    ------
    FileError
        When a cell cannot be read, or a time is none.
    """
    table = replace(
        table,
        columns=list(table.columns),
        stated=deepcopy(table.stated),
        values={},
        axes={},
        problems=list(table.problems),
    )
    with refused_of(table.source):
        _sort_columns(table)
        _name_axes(table)
    return table


def label_of(table: Table, place: int) -> str:
    """Return the name of a column, or its number if it has none."""
    return table.columns[place].name or f"column {place + 1}"


def _sort_columns(table: Table) -> None:
    """Sort columns of numbers, stamps, lists and texts."""
    _turn_rows(table)
    if not table.decimal:
        texts = [cell for c in table.columns if c.cells.dtype.kind == "O" for cell in c.cells]
        table.decimal, remarks = _decimal_mark([cell for cell in texts if isinstance(cell, str)])
        table.problems += remarks
    _take_dates(table)
    for place, column in enumerate(table.columns):
        unstated = not (column.unit or unit_in_name(column.name)) and column.name != "T"
        if table.stated.unit and unstated and is_time_name(column.name):
            table.columns[place] = replace(column, unit=table.stated.unit)
    turning = any(is_speed(column.unit) or is_speed(column.name) for column in table.columns)
    table.stated.turning |= turning
    dates: dict[int, list[str]] = {}
    for place, column in enumerate(table.columns):
        cells = column.cells
        if cells.dtype.kind in "biuf":
            table.values[place] = cells.astype(np.float64)
        elif cells.dtype.kind in "mM":
            table.axes[place] = moments_axis(cells)
        elif any(isinstance(cell, list | tuple | np.ndarray) for cell in cells[:3]):
            try:
                table.curves[place] = _curves(label_of(table, place), cells)
            except TypeError as error:
                table.problems.append(str(error))
        else:
            _sort_texts(table, place, ["" if c is None else str(c) for c in cells], dates)
    _join_dates(table, dates)
    for place in list(table.values):
        values = table.values[place]
        if not table.columns[place].name and values.size and np.isnan(values).all():
            del table.values[place]


def _decimal_mark(texts: Sequence[str]) -> tuple[str, list[str]]:
    """Return the decimal mark in texts, and a remark if they may be read with the other.

    A comma if one is no number without, or if there is no point.
    """
    marked = [text for text in texts if "," in text or "." in text]
    commas = [text for text in marked if is_number(text, ",")]
    points = [text for text in marked if is_number(text, ".")]
    if any(not is_number(text, ".") for text in commas):
        return ",", []
    grouped = [text for text in commas if "," in text]
    if not grouped:
        return ".", unclear_mark("\n".join(points), ".")
    if all(is_number(text, ",", thousands=False) for text in points):
        return ",", unclear_mark("\n".join(points), ",")
    return ".", [f"check the values: ',' is taken to part thousands ('{grouped[0].strip()}')"]


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
        message = f"column '{name}' is left out: a list in it holds no numbers"
        raise TypeError(message) from None
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
    kinds: tuple[NameKind, ...] = ("throw", "direction", "id")
    numbers_throw = any(is_called(column.name, kind) for column in columns for kind in kinds)
    if size >= _LEAST_NUMBERED and numbers_throw:
        places = [place for place, match in enumerate(matches) if match and match[1] == stem]
        curves = np.empty(count, dtype=object)
        curves[:] = [[columns[place].cells[row] for place in places] for row in range(count)]
        kept = [column for place, column in enumerate(columns) if place not in places]
        unit = columns[places[0]].unit
        table.columns = [*kept, TableColumn(stem.strip() or "curve", curves, unit)]


def _sort_texts(table: Table, place: int, texts: list[str], dates: dict[int, list[str]]) -> None:
    name = label_of(table, place)
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
    elif (wrong or overload) and (held := _with_unit(texts, len(filled), table.decimal)):
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
            what = f"{count_in_words(number, 'cell')} overload ({choices(sorted(overload))})"
            table.problems.append(f"channel '{name}': {what}, taken as missing")


def _with_unit(texts: list[str], filled: int, decimal: str) -> tuple[Floats, list[str]] | None:
    """Return a column that repeats a known unit in most of its cells; None if it does not."""
    held = numbers_with_unit(texts, decimal) if 2 * filled > len(texts) else None
    return held if held is not None and all(map(is_unit, held[1])) else None


def _take_units(table: Table, place: int, values: Floats, units: list[str]) -> None:
    """Take a column that repeats its unit in each cell."""
    if len(units) > 1:
        message = (
            f"column '{label_of(table, place)}': its cells are in {choices(units)}; export one"
        )
        raise ValueError(message)
    column, held = table.columns[place], tidy_unit(units[0])
    given = column.unit or unit_in_name(column.name)
    if not is_unit(given) and given.lower() in ("", held.lower(), held.lower().lstrip("°")):
        given = held
    times = is_time_unit(given) and is_time_unit(held)
    if seconds_of(given) != seconds_of(held) if times else tidy_unit(given) != held:
        message = (
            f"column '{label_of(table, place)}': its heading states '{given}', its cells "
            f"'{units[0]}'; leave one of the two units"
        )
        raise ValueError(message)
    table.values[place] = values
    table.columns[place] = replace(column, unit=held)


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
        if following and SECONDS.get(squeezed(following[0].name)) == 1e-3:
            later = table.values.pop(place + 1, np.zeros(0))[:used] / 1e3
            if later.size == used and np.all(axis.seconds == np.rint(axis.seconds)):
                begin = None if axis.begin is None else axis.begin + float(later[0])
                axis = replace(axis, seconds=axis.seconds + later - later[0], begin=begin)
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
        given = values[: count_filled(values)]
        with suppress(ValueError):
            if is_time_unit(unit := column.unit or unit_in_name(column.name)):
                given = gone_round(given, seconds_of(unit))
        letter, timed = len(squeezed(column.name)) == 1, is_time_unit(column.unit)
        even = rises_evenly(given)
        rises = place == 0 and even
        another = (even or _has_holes(given)) and _is_another_time(table, place)
        word = is_called(column.name, "unit of time") or (
            column.name == "s" and _names_units(table)
        )
        bare = column.name.rstrip("0123456789 _") if timed else column.name
        named = is_time_name(bare) or (rises and word)
        by_unit = timed and (rises or is_called(column.name, "abscissa"))
        beside = any(_is_of_another_name(table, before, place) for before in table.axes)
        if (
            not (named or by_unit or another or place in days)
            or (letter and column.unit and not timed)
            or is_numbered_channel(column.name, given, unit=column.unit, beside=beside)
            or ((table.axes or rate is not None) and not timed and often_falls(given))
            or (letter and not timed and not may_be_time(given, column.name, rate=single))
        ):
            continue
        if rate is not None and not timed and (counts_throws(given) or _counts_with_holes(given)):
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


def _is_of_another_name(table: Table, before: int, place: int) -> bool:
    """Return True if a time stands before a column that is not numbered as another of that name.

    Right beside it, a time with its unit may have that name.
    """
    held, later = (table.columns[number] for number in (before, place))
    stems = {squeezed(column.name).rstrip("0123456789") for column in (held, later)}
    return before < place and (len(stems) == 2 or (before == place - 1 and is_time_unit(held.unit)))


def _has_holes(values: Floats) -> bool:
    """Return True if most steps of numbers that rise are alike, and others longer."""
    steps = np.diff(values)
    if not steps.size or np.any(steps <= 0):
        return False
    typical = float(np.median(steps))
    return bool(np.mean(np.abs(steps - typical) <= 0.25 * typical) > 0.7)


def _names_units(table: Table) -> bool:
    """Return True if all columns are called by a unit: "s,Volts1,Volts2"."""
    return all(is_unit(column.name.rstrip("0123456789 ")) for column in table.columns)


def _is_another_time(table: Table, place: int) -> bool:
    """Return True if a column is called as a time before it, or has a unit of time beside one.

    "Time F" goes with "Time I", and t2 with t; the first has channels of its own.
    """
    column = table.columns[place]
    if place - 1 in table.axes:
        return False
    first = [_FIRST_WORD.match(table.columns[p].name) for p in (place, *table.axes)]
    own, *others = [match[0] if match else "" for match in first]
    alike = own in others and own != "" and not column.unit
    return alike or (bool(table.axes) and is_time_unit(column.unit))


def _days(table: Table) -> set[int]:
    """Return the columns of days in numbers; a time of day beside one is added to it."""
    found = set()
    for place, column in enumerate(table.columns):
        values = table.values.get(place)
        if values is None or column.unit or not is_called(column.name, "date"):
            continue
        if day_zero(values[: count_filled(values)]) is None:
            continue
        found.add(place)
        parts = table.values.get(place + 1)
        if parts is None or not is_time_name(table.columns[place + 1].name):
            continue
        given = parts[: count_filled(parts)]
        if np.all(given >= 0) and np.all(given < 1) and np.all(values == np.rint(values)):
            table.values[place] = values + table.values.pop(place + 1)
    return found


def _index_axis(table: Table, rate: float) -> None:
    """Take an index that leaves numbers out as times: samples are missing there."""
    for place, values in table.values.items():
        name = table.columns[place].name
        steps = np.diff(values)
        if is_called(name, "index") and len(name) > 1 and counts(values) and steps[0] > 1:
            message = (
                f"column '{name}' counts in steps of {steps[0]:g} beside a stated rate of {rate:g} "
                "Hz, so that of the rows is not known; leave the column out, or state their rate"
            )
            raise ValueError(message)
        if is_called(name, "index") and _counts_with_holes(values) and not counts_throws(values):
            table.axes[place] = TimeAxis((values - values[0]) / rate)
            del table.values[place]
            return


def _counts_with_holes(values: Floats) -> bool:
    """Return True if whole numbers mostly rise by one."""
    whole = values.size > 1 and np.isfinite(values).all() and np.all(values == np.rint(values))
    return bool(whole and np.median(np.diff(values)) == 1)


def is_constant(values: Floats) -> bool:
    """Return True if all values are the same, and there are any."""
    return bool(values.size and np.all(values == values[0]))


def count_filled(values: Floats) -> int:
    """Return the number of values up to the last that is there."""
    there = np.flatnonzero(np.isfinite(values))
    return int(there[-1]) + 1 if there.size else 0


def restarts(values: Floats) -> NDArray[np.intp]:
    """Return the places at which times or an index start again."""
    steps = np.diff(values)
    rising = steps[steps > 0]
    near = float(values[0]) + (0.5 * float(np.median(rising)) if rising.size else 0.0)
    with np.errstate(invalid="ignore"):
        return np.flatnonzero((steps < 0) & (values[1:] < near)) + 1


def counts_throws(values: Floats) -> bool:
    """Return True if whole numbers count, from one or from several beginnings."""
    if values.size < 2 or not np.isfinite(values).all():
        return False
    parts = np.split(values, restarts(values))
    counting = [part for part in parts if part.size > 1]
    return 2 * len(counting) >= len(parts) and all(map(counts, counting))
