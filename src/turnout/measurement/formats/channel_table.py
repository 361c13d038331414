"""Channels of a table: the throws that it holds, and the times of each column.

Each column goes with the nearest column of times to its left, an index is never taken for a time,
and several throws in one table never become one channel.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import FileError, refused_of
from turnout.core.problems import choices, count_in_words
from turnout.measurement.formats.assemble import (
    FileColumn,
    assemble_recording,
    column_clock,
    tidy_unit,
)
from turnout.measurement.formats.clock import (
    NameKind,
    is_called,
    is_time_name,
    squeezed,
    unit_in_name,
)
from turnout.measurement.formats.file_table import (
    Floats,
    Table,
    count_filled,
    counts_throws,
    is_constant,
    label_of,
    restarts,
    sort_columns,
)
from turnout.measurement.formats.numbers import LEAST_CURVE
from turnout.measurement.formats.time_axis import (
    LARGEST_DEPARTURE,
    TimeAxis,
    counts,
    is_date,
    numeric_axis,
    rate_of,
    unit_remark,
)
from turnout.measurement.recording import Recording, time_grid

# Names of columns of a state, whose numbers are samples.
_STATE = re.compile(
    r"stat(?:e|us)|zustand|digital|\Ad(?:i|o|in|out)?\d*\Z|bit|flag|switch|contact|kontakt|"
    r"relay|relais|event|marker|trigger|trig|mode|modus|direction|richtung|position"
)
Rows = NDArray[np.intp]
"""Places of the rows of a throw."""
_MOST_SIGNALS = 256
ALL = ("*",)
"""In place of the labels of throws: all that a table holds."""
THROW = "throw"
"""Label of a recording that is one of several throws."""


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
        One, or one a throw: the error of each that cannot be read, as where a table holds several
        throws and none is chosen.

    Raises
    ------
    FileError
        When no sheet of several can be read.
    """
    if isinstance(held, Recording):
        return [held]
    if isinstance(held, Table):
        return _of_throws(held, throws or [None])
    if throws:
        tables = [sort_columns(item) for item in held if isinstance(item, Table)]
        with_throws = [table for table in tables if len(_throws(table)[0]) > 1]
        if len(with_throws) == 1:
            return _of_throws(with_throws[0], throws)
    return [_of_sheets(held)]


def _of_throws(table: Table, throws: Sequence[str | None]) -> list[Recording | FileError]:
    """Return several throws of a table, or the error of each that cannot be read."""
    found: list[Recording | FileError] = []
    try:
        table = sort_columns(table)
        parts, by = _throws(table)
    except FileError as error:
        return [error] * len(throws)
    if tuple(throws) == ALL:
        throws = list(parts) if len(parts) > 1 else [None]
    for throw in throws:
        try:
            with refused_of(table.source):
                cut = _cut(table, parts, by, throw)
                columns = _channel_columns(cut)
            recording = assemble_recording(
                columns,
                source=table.source,
                start_time=table.stated.start_time,
                problems=cut.problems,
                remedy=table.remedy,
            )
            found.append(replace(recording, labels=_labels(cut, throw)))
        except FileError as error:
            found.append(error)
    return found


def _labels(table: Table, throw: str | None) -> dict[str, str]:
    """Return the cells that are the same in all rows, by column."""
    labels = {THROW: throw} if throw else {}
    texts = {place: cells[0].strip() for place, cells in table.texts.items() if len({*cells}) == 1}
    numbers = {p: f"{v[0]:.9g}" for p, v in table.values.items() if is_constant(v)}
    for place, text in [*texts.items(), *numbers.items()]:
        labels.setdefault(label_of(table, place), text)
    return labels


def _of_sheets(tables: Sequence[Table | FileError]) -> Recording:
    """Return the recording of all tables with numbers; several give their names to channels."""
    found: dict[str, Recording] = {}
    reasons: list[str] = []
    for table in tables:
        read = table if isinstance(table, FileError) else _of_throws(table, [None])[0]
        if isinstance(table, FileError) or isinstance(read, FileError):
            reasons.append(str(read))
        else:
            found[table.title] = read
    throws = [reason for reason in reasons if "throws in one table" in reason]
    if not found or throws:
        raise FileError(throws[0] if throws else "; ".join(reasons))
    first, *others = found.values()
    if not others:
        return first
    channels = {
        f"{name}/{item.name}": replace(item, name=f"{name}/{item.name}")
        for name, recording in found.items()
        for item in recording.channels.values()
    }
    problems = [text for recording in found.values() for text in recording.problems]
    if any(recording.start_time != first.start_time for recording in others):
        problems.append(f"check the time: the sheets {choices(found)} start at different times")
    return Recording(channels, first.source, first.start_time, tuple(problems))


def table_columns(table: Table) -> tuple[list[FileColumn], list[str]]:
    """Return the channels of a table with their times, and remarks.

    Raises
    ------
    FileError
        When it holds several throws, or a time is none.
    """
    with refused_of(table.source):
        table = sort_columns(table)
        cut = _cut(table, *_throws(table), None)
        return _channel_columns(cut), cut.problems


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
    for place in [p for p in cut.values if is_called(label_of(table, p), "throw")]:
        del cut.values[place]
    return cut


def _axis_part(axis: TimeAxis, rows: NDArray[np.intp]) -> TimeAxis:
    seconds = axis.seconds[rows[rows < axis.seconds.size]]
    if axis.begin is None or not seconds.size:
        return replace(axis, seconds=seconds)
    return replace(axis, seconds=seconds - seconds[0], begin=axis.begin + float(seconds[0]))


def _throws(table: Table) -> tuple[dict[str, Rows], str]:
    """Return the rows of each throw by its label, and the column that tells them apart."""
    rows = max((len(column.cells) for column in table.columns), default=0)
    curves = bool(table.curves) and rows > 1
    for place, labels in _cells_called(table, "throw").items():
        starts = _changes(labels)
        names = [labels[i] for i in starts]
        if len(set(names)) == len(names) > 1 and (curves or 2 * len(names) <= len(labels)):
            return _rows(starts, len(labels), names), f"column '{label_of(table, place)}'"
    if curves:
        shown = label_of(table, next(iter(table.curves)))
        # An id that may be mistaken for the number of the row is the label.
        rank = {f"{number}" for number in range(1, rows + 1)}
        named = _cells_called(table, "id").values()
        ids = next((ids for ids in named if len({*ids}) == rows and rank & {*ids}), [])
        return _rows(range(rows), rows, ids), f"a curve in each cell of column '{shown}'"
    for place, turns in _cells_called(table, "direction").items():
        starts = _changes(turns)
        if 1 < len(starts) <= len(turns) / LEAST_CURVE and not table.axes:
            return _rows(starts, len(turns)), f"column '{label_of(table, place)}' changes"
    indices = {p: v for p, v in table.values.items() if is_called(table.columns[p].name, "index")}
    times = {place: axis.seconds for place, axis in table.axes.items()}
    for place, values in [*times.items(), *indices.items()]:
        again = restarts(values) if values.size > 2 else np.zeros(0, np.intp)
        few = (again.size + 1) * LEAST_CURVE > values.size
        if not again.size or few or (place in indices and not counts_throws(values)):
            continue
        if _signal_column(table) is not None:
            break
        return _rows([0, *again], values.size), f"'{label_of(table, place)}' starts again"
    return {}, ""


def _cells_called(table: Table, kind: NameKind) -> dict[int, list[str]]:
    """Return the cells, as texts, of the columns that may be of a kind."""
    names = {place: column.name for place, column in enumerate(table.columns)}
    numbers = {p: v for p, v in table.values.items() if is_called(names[p], kind)}
    texts = {p: cells for p, cells in table.texts.items() if is_called(names[p], kind)}
    return {**{p: [f"{cell:.15g}" for cell in v.tolist()] for p, v in numbers.items()}, **texts}


def _changes(cells: Sequence[object]) -> list[int]:
    """Return the rows at which a column has another cell than the row before, with the first."""
    return [0, *(i for i in range(1, len(cells)) if cells[i] != cells[i - 1])]


def _rows(starts: Sequence[int], size: int, names: Sequence[str] = ()) -> dict[str, Rows]:
    """Return the rows of each throw by its name, or by its number if there are no names."""
    edges = zip(starts, [*starts[1:], size], strict=True)
    names = names or [f"{number}" for number in range(1, len(starts) + 1)]
    return {name: np.arange(a, b) for name, (a, b) in zip(names, edges, strict=True)}


def _signal_column(table: Table, *, any_name: bool = False) -> int | None:
    """Return the column of a long table that says which signal a row holds.

    With `any_name` it may be one of texts that occur equally often, or of numbers, each once at
    each time, unless a rate is stated.
    """
    numbered = {
        p: v.tolist() for p, v in table.values.items() if any_name and np.all(v == np.rint(v))
    }
    for place, cells in {**table.texts, **numbered}.items():
        counts_of = Counter(cells)
        if not 1 < len(counts_of) <= min(_MOST_SIGNALS, len(cells) / 2):
            continue
        if is_called(table.columns[place].name, "signal"):
            return place
        if not any_name or len(set(counts_of.values())) != 1:
            continue
        if place not in numbered:
            return place
        if table.stated.rate() is None and _numbers_signals(table, place):
            shown = label_of(table, place)
            table.problems.append(f"column '{shown}' is taken for the number of the channel")
            return place
    return None


def _numbers_signals(table: Table, place: int) -> bool:
    """Return True if a column beside the time holds each of its numbers once at each time."""
    label = label_of(table, place)
    if is_called(label, "unit of time") or _STATE.search(squeezed(label)):
        return False
    values = table.values[place].tolist()
    for at, axis in table.axes.items():
        if abs(at - place) != 1:
            continue
        times = axis.seconds.tolist()
        pairs = len(set(zip(times, values, strict=False)))
        if len({*times}) * len({*values}) == len(values) == len(times) == pairs:
            return True
    return False


def _channel_columns(table: Table) -> list[FileColumn]:
    """Return the channels of one throw with their times."""
    columns = _long_columns(table)
    if not columns:
        _read_constants(table)
        columns = _curve_columns(table) if table.curves else _wide_columns(table)
    for place, texts in sorted(table.texts.items()):
        dates = all(is_date(text) for text in texts if text.strip())
        what = "dates without a time of day" if dates else "no numbers"
        if is_time_name(label_of(table, place)) and not dates:
            shown = next((text for text in texts if text.strip()), "")[:40]
            what = f"times of no known layout ('{shown}'); write them as 2026-11-28 08:14:00.000"
        table.problems.append(f"column '{label_of(table, place)}' is left out: it holds {what}")
    unknown = all(column.time is None and column.rate is None for column in columns)
    for shown in table.stated.no_rates() if unknown else ():
        table.problems.append(f"'{shown}' is not taken for the sample rate")
    rates = [column.rate for column in columns if column.rate is not None]
    for shown in table.stated.other_rates(rates[0]) if rates else ():
        table.problems.append(f"check the time: '{shown}' is stated as well")
    return columns


def _read_constants(table: Table) -> None:
    """Take the rate or interval that a column repeats, unless there are times; of curves the start.

    A column beside the samples that is called start may be a signal.
    """
    for place, values in [] if table.axes and not table.curves else [*table.values.items()]:
        column, before, stated = table.columns[place], table.stated, deepcopy(table.stated)
        known = is_constant(values) and (table.curves or values.size > 1)
        if (
            known
            and stated.read(column.name, [float(values[0])], unit=column.unit)
            and (table.curves or (stated.rates, stated.reduced) != (before.rates, before.reduced))
        ):
            table.stated = stated
            del table.values[place]


def _curve_columns(table: Table) -> list[FileColumn]:
    """Return the curves in cells."""
    stated = table.stated
    times = [p for p in table.curves if is_time_name(table.columns[p].name)]
    axes = list(table.axes.values())
    if times:
        column, cells = table.columns[times[0]], np.concatenate(table.curves[times[0]])
        axes = [numeric_axis(cells, name=column.name, unit=column.unit), *axes]
    begin = next((axis.begin for axis in axes if axis.begin is not None), None)
    clock = column_clock(axes[0] if times else None, stated) | {"begin": begin}
    return [
        FileColumn(
            label_of(table, place),
            np.concatenate(curves),
            table.columns[place].unit,
            table.columns[place].description,
            **clock,
        )
        for place, curves in table.curves.items()
        if place not in times
    ]


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
        if p != by and not (is_called(table.columns[p].name, "index") and counts_throws(v))
    ]
    if not places or np.all(np.diff(axis.seconds) > 0):
        return []
    held = table.texts.pop(by, None) or [f"{value:g}" for value in table.values[by]]
    signals = np.array(held)
    names = {squeezed(label_of(table, p)): p for p in table.texts}
    unit_of = table.texts.pop(names.get("unit", names.get("units", -1)), None)
    found = []
    for signal in dict.fromkeys(held):
        rows = np.flatnonzero(signals == signal)
        times = axis.seconds[rows]
        for place in places:
            column, samples = table.columns[place], table.values[place][rows]
            name = signal if not signal.isdigit() else f"{label_of(table, by)} {signal}"
            name = name if len(places) == 1 else f"{name} {label_of(table, place)}"
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
    found, used = [], set[int]()
    for number, place in enumerate(channels):
        column, values = table.columns[place], table.values[place]
        left = [p for p in axes if p < place] or list(axes)[:1]
        axis = axes[left[-1]] if left else None
        if left and axis is None and rate is None:
            axis = axes.get(left[-1] - 1) or axes.get(left[-1] + 1)
        used |= {p for p, other in axes.items() if other is axis}
        several = len(axes) > 1 or (rate is not None and len(set(rate)) > 1)
        if several:
            values = values[: count_filled(values)]
        name = column.name or f"column {place + 1}"
        clock = column_clock(axis, table.stated, number=number)
        if axis is not None:
            values = _to_length(values, axis.seconds.size)
        elif left:
            only = "its times only tell its start"
            clock |= {"begin": table.axes[left[-1]].begin, "remark": only}
        empty = int(np.count_nonzero(np.isnan(values))) - table.overloads.get(place, 0)
        if empty > 0:
            what = f"{count_in_words(empty, 'cell')} empty, taken as missing"
            table.problems.append(f"channel '{name}': {what}")
        found.append(FileColumn(name, values, column.unit, column.description, **clock))
    _compare_unused(table, {p: axis for p, axis in axes.items() if axis is not None}, used)
    return found


def _compare_unused(table: Table, axes: Mapping[int, TimeAxis], used: set[int]) -> None:
    """Remark on times of no channel that differ from those of the channels."""
    shown = {place: (label_of(table, place), rate_of(axis.seconds)) for place, axis in axes.items()}
    for place in shown.keys() - used if used else ():
        for other in shown.keys() & used:
            (name, rate), (taken, its) = shown[place], shown[other]
            if abs(rate - its) > LARGEST_DEPARTURE * its:
                remark = f"check the time: '{name}' shows {rate:.6g} Hz, '{taken}' {its:.6g} Hz"
                table.problems.append(f"{remark}, which is taken")


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
        index = table.named and is_called(name, "index") and not letter and counts_throws(values)
        if headless or index:
            step = float(np.median(np.diff(values)))
            beside = bool(table.axes) and index and step != 1.0
            rows = f"; check the time: its steps are {step:g}, are rows missing?" * beside
            shown = f"column '{label_of(table, place)}'"
            table.problems.append(f"{shown} is left out: it counts samples and is no time{rows}")
        elif is_called(name, "throw") and (is_constant(values) or counts(values)):
            table.problems.append(f"column '{name}' is left out: it numbers the throw")
        else:
            found.append(place)
    return found


def _usable(
    table: Table, place: int, axis: TimeAxis, rate: tuple[float, ...] | None
) -> TimeAxis | None:
    """Return an axis; None when it is too coarse and a rate is stated beside it."""
    name = label_of(table, place)
    try:
        stamps = table.columns[place].cells.dtype.kind == "O"
        if stamps and _in_whole_seconds(axis.seconds) and rate is None:
            table.problems.append(f"check the time: '{name}' is in whole seconds")
        time_grid(axis.seconds)
    except ValueError as error:
        another = [p for p in (place - 1, place + 1) if _is_even(table.axes.get(p), axis)]
        if rate is None and not another:
            message = f"column '{name}': {error}"
            raise ValueError(message) from None
        used = f"'{label_of(table, another[0])}'" if rate is None else "the stated rate"
        table.problems.append(f"column '{name}' is not used, {used} is: {error}")
        return None
    column = table.columns[place]
    numeric = column.cells.dtype.kind in "iuf" and axis.begin is None
    unstated = numeric and not (column.unit or unit_in_name(column.name))
    if rate is None and unstated and (remark := unit_remark(axis.seconds, name)):
        table.problems.append(remark)
    return axis


def _is_even(axis: TimeAxis | None, other: TimeAxis) -> bool:
    """Return True if an axis gives each sample of another one a time."""
    if axis is None or axis.seconds.size != other.seconds.size:
        return False
    try:
        return bool(time_grid(axis.seconds).step)
    except ValueError:
        return False


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
