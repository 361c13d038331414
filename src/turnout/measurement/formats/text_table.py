"""Text files of numbers: DewesoftX exports, loggers, oscilloscopes, MATLAB, Excel (CSV, TXT)."""

import io
import re
import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from pandas.errors import ParserWarning

from turnout.core.errors import MeasurementError, refused_of
from turnout.core.problems import choices, count_in_words
from turnout.measurement.formats.clock import StatedClock
from turnout.measurement.formats.extent import MOST_CHANNELS
from turnout.measurement.formats.file_table import Table, TableColumn
from turnout.measurement.formats.numbers import EMPTY, is_missing, is_number, unclear_mark
from turnout.measurement.formats.text_dialect import (
    SAMPLE_SIZE,
    TextLayout,
    split_line,
    text_layout,
    value_weight,
)
from turnout.measurement.recording import Recording

NO_TIME = "give a column 'Time (s)' or a line 'Sample rate: 1000 Hz' above the numbers"
_EMPTY_LINE = re.compile(r"\n[ \t]*(?=\n)")
_FORMULA = re.compile(rb'(^|[,;\t])="', re.MULTILINE)
"""A cell that Excel shall keep as a text: ="0.5"."""
_RULE = re.compile(rb"^[ \t]*(?=[^\n]*[|+])[|+]?[ \t]*:?-{3,}[-|+:= \t\r]*$", re.MULTILINE)
"""A line drawn between the rows of a table, as Markdown has one."""
_EDGES = tuple(re.compile(side, re.MULTILINE) for side in (rb"^[ \t]*\|", rb"\|[ \t\r]*$"))
"""The bars that may stand on its sides."""
_DECIMALS = re.compile(r"[+\-]?(\d+)(?:\.(\d*))?")
_ALIKE = 8
"""Last cells of one number of digits that show how many a whole one has."""
MOST_FOOTER = 40
"""Rows below a table that may be statistics of it; and rows beside it that may be a heading."""


@dataclass(frozen=True, slots=True)
class _Text:
    """Lines above the table and the table, with plain line ends, and how they are to be read."""

    layout: TextLayout
    above: list[str]
    body: str


def text_table(content: bytes, *, source: str) -> Table:
    """Return the table in a text, whatever its separators, decimal marks and headings.

    Empty cells and overloads are missing samples (NaN). A last line that was cut off is left out,
    and so are statistics below the table.

    Parameters
    ----------
    content : bytes
        Of a file, or made of another format.
    source : str
        The file, for messages.

    Raises
    ------
    FileError
        When there is none, or its rows differ in width.
    """
    content = _FORMULA.sub(rb'\1"', content) if b'="' in content else content
    content = _without_lines_drawn(content)
    layout = text_layout(content[:SAMPLE_SIZE], source=source)
    with refused_of(source):
        return _table(content, layout, source)


def _without_lines_drawn(content: bytes) -> bytes:
    """Leave out the lines drawn between heading and numbers, and bars that all rows have outside.

    One below a row of numbers is a row of gaps.
    """
    sample = content[:SAMPLE_SIZE]
    rules = list(_RULE.finditer(sample))
    framed = all(rule[0].lstrip().startswith(b"+") for rule in rules)
    if not rules or not (framed or len(rules) == 1):
        return content
    heading = sample[: rules[0].start()].rstrip().split(b"\n")[-1]
    rows = sample[rules[0].end() :].split(b"\n")
    rows = rows if sample.endswith(b"\n") else rows[:-1]
    if not framed:
        cells = heading.decode("latin-1").split("|")
        if all(
            any(is_number(cell.strip(), mark) for mark in ".,") for cell in cells if cell.strip()
        ):
            return content
        first = next((row for row in rows if row.strip()), b"")
        if b"|" not in heading or b"|" not in first:
            return content  # they part no columns
        rows = [heading, *rows]
    rows = [row for row in rows if b"|" in row and not _RULE.fullmatch(row)]
    content = _RULE.sub(b"", content, count=0 if framed else 1)
    for edge in _EDGES:
        if all(map(edge.search, rows)):
            content = edge.sub(b"", content)
    return content


def _table(content: bytes, layout: TextLayout, source: str) -> Table:
    if layout.width > MOST_CHANNELS:
        message = f"holds {layout.width} columns, at most {MOST_CHANNELS} are read; export fewer"
        raise ValueError(message)
    try:
        whole = content.decode(layout.encoding)
    except UnicodeDecodeError as error:
        message = f"is no {layout.encoding} text (byte {error.start}); save it as UTF-8"
        raise ValueError(message) from None
    whole = whole.replace("\r\n", "\n").replace("\r", "\n") if "\r" in whole else whole
    # Not skipped by the reader of rows, for which a quoted cell goes over lines.
    *above, body = [*whole.split("\n", layout.first_row), ""][: layout.first_row + 1]
    text = _Text(layout, above, body)
    frame, problems = _cells(text)
    heading, width = layout.heading, layout.width
    if layout.decimal != layout.separator:
        problems += unclear_mark(body, layout.decimal)
    if layout.loose_rows > 1:
        problems.append(f"{layout.loose_rows} rows of numbers above the table are left out")
    if heading.stated.rates or heading.stated.weak:
        problems += _lost_lines(text)
    frame = _without_side_heading(frame, heading.stated, layout.decimal)
    names, units = ([*texts, *[""] * width] for texts in (heading.names, heading.units))
    return Table(
        [
            TableColumn(names[place], frame[place].to_numpy(), units[place])
            for place in frame.columns
            if place not in heading.empty
        ],
        heading.stated,
        source,
        decimal=layout.decimal,
        named=any(heading.names),
        line_of=lambda row: _line_of(text, row),
        remedy=NO_TIME,
        problems=problems,
    )


def _cells(text: _Text) -> tuple[Any, list[str]]:
    """Return the cells, columns of numbers as such, and remarks on repairs."""
    layout = text.layout
    text, problems = _without_footer(text)
    try:
        frame = _frame(text)
    except (ValueError, OverflowError, ParserWarning) as error:
        raise ValueError(_fault(layout, error)) from None
    while layout.width == 1 and len(frame) and frame.iloc[-1, 0] in ("", None):
        frame = frame.iloc[:-1]
    if layout.width == 1 and len(frame) and frame[0].dtype.kind == "f":
        frame = frame.iloc[: int(np.flatnonzero(frame[0].notna())[-1]) + 1]
    if layout.separator == " " and layout.width > 1:
        whole = frame if text.body.endswith("\n") else frame.iloc[:-1]
        _refuse_short_rows(text, np.flatnonzero(whole.iloc[:, -1].isna()))
    # An empty line at the end is none; a row without its last cells was cut off.
    unended = len(frame) > 1 and not problems and not text.body.endswith("\n")
    short = unended and pd.isna(frame.iloc[-1, -1]) and frame.iloc[:-1, -1].notna().any()
    cut, remarks = _ends_in_fewer_digits(text) if unended else (False, [])
    if short or cut:
        return frame.iloc[:-1], [*problems, "the last line is cut off and left out"]
    return frame, [*problems, *remarks]


def _ends_in_fewer_digits(text: _Text) -> tuple[bool, list[str]]:
    """Return whether the last number is cut off behind its mark, and a remark if it may be.

    It has fewer digits there than those above, which all have as many. It is cut off where its
    mark is its end, or where zeros at the ends of others show that they are not left out.
    """
    lines = [line for line in text.body.split("\n")[-MOST_FOOTER:] if line.strip()]
    *cells, last = [split_line(line, text.layout.separator)[-1] for line in lines]
    parts = [_DECIMALS.fullmatch(cell.replace(text.layout.decimal, ".")) for cell in (*cells, last)]
    *digits, held = [len(part[2] or "") if part else -1 for part in parts]
    if len(digits) < _ALIKE or len({*digits}) > 1 or not -1 < held < digits[0]:
        return False, []
    fixed = any(cell.endswith("0") for cell in cells)
    if last.endswith(text.layout.decimal) or (held and fixed):
        return True, []
    return False, [f"check the last line: '{last}' has fewer digits than the numbers above it"]


def _refuse_short_rows(text: _Text, rows: Any) -> None:
    """Refuse rows without one of their cells where blanks part them: which one is not known."""
    lines = [line for line in text.body.split("\n") if line.strip()] if len(rows) else []
    for row in rows:
        count = len(split_line(lines[row], " "))
        if count < text.layout.width:
            message = (
                f"{_line_of(text, row)} has {count} of {text.layout.width} cells; where blanks "
                "part them, write NaN for an empty one"
            )
            raise ValueError(message)


def _frame(text: _Text) -> Any:
    layout = text.layout
    with warnings.catch_warnings():
        # Rows longer than the heading would lose their last cells with no more than a warning.
        warnings.simplefilter("error", ParserWarning)
        frame = pd.read_csv(
            io.BytesIO(text.body.encode()),
            sep=r"\s+" if layout.separator == " " else layout.separator,
            decimal=layout.decimal,
            header=None,
            names=range(layout.width),
            index_col=False,
            # In a column of its own an empty line is a missing sample.
            skip_blank_lines=layout.width > 1,
            na_values=sorted(EMPTY - {""}),
            skipinitialspace=True,
            low_memory=False,
        )
    for name in frame.columns:
        kind = frame[name].dtype
        if kind.kind == "b" or not isinstance(kind, np.dtype):
            frame[name] = frame[name].astype(object).where(frame[name].notna(), "")
        elif kind.kind == "O":
            frame[name] = frame[name].where(frame[name].notna(), "").astype(str)
    return frame


def _without_footer(text: _Text) -> tuple[_Text, list[str]]:
    """Leave out lines of statistics below the numbers; refuse a second table there."""
    layout = text.layout
    lines = text.body.rstrip("\n").split("\n")
    probes = [
        split_line(lines[len(lines) * part // 8], layout.separator) for part in range(1, 8, 2)
    ]
    leading = next(
        (
            place
            for place in range(layout.width)
            if sum(
                value_weight(row[place], layout.decimal) > 0 for row in probes if len(row) > place
            )
            > 1
        ),
        None,
    )
    if leading is None:
        return text, []
    _refuse_second_table(text, leading)
    count = 0
    for line in lines[: -MOST_FOOTER - 2 : -1]:
        cells = split_line(line, layout.separator)
        cell = cells[leading] if len(cells) > leading else "".join(cells[:1])
        values = [c for c in cells if c] if cells and not cell else [cell]
        if any(values) and all(
            not c[:1].isalpha() or is_missing(c) or value_weight(c, layout.decimal) for c in values
        ):
            break
        count += 1
    first = len(lines) - count
    while count and not lines[first].strip():
        first, count = first + 1, count - 1
    if not 0 < count <= MOST_FOOTER or first < 2:
        return text, []
    shown = split_line(lines[first], layout.separator)[0][:40]
    what = "line below the table is" if count == 1 else "lines below it are"
    kept = replace(text, body="\n".join(lines[:first]) + "\n")
    return kept, [f"{count} {what} left out: '{shown}'"]


def _refuse_second_table(text: _Text, leading: int) -> None:
    """Refuse a line below the numbers that begins with the name of their first column."""
    name = next((name.strip() for name in text.layout.heading.names if name), "")
    if not name or value_weight(name, text.layout.decimal) or name not in text.body:
        return
    for row, line in enumerate(text.body.split("\n")):
        cells = split_line(line, text.layout.separator) if row and name in line else []
        if re.split(r" [(\[]", [*cells, *[""] * leading, ""][leading])[0] == name:
            message = (
                f"a second table begins at line {len(text.above) + 1 + row}, below the first; "
                "save each in a file of its own"
            )
            raise ValueError(message)


def _without_side_heading(frame: Any, stated: StatedClock, decimal: str) -> Any:
    """Read a heading that stands in the first columns beside the first rows of numbers."""
    beside: list[int] = []
    for name in frame.columns[:-1] if frame[0].dtype == object else ():
        filled = np.flatnonzero((frame[name].notna() & (frame[name].astype(str) != "")).to_numpy())
        if len(filled) and filled[-1] >= min(MOST_FOOTER, len(frame) - 1):
            break
        beside.append(name)
    if len(beside) < 2 or frame[beside[0]].dtype != object:
        return frame
    for row in frame[beside].head(MOST_FOOTER).astype(str).itertuples(index=False):
        values = [cell for cell in row[1:] if isinstance(cell, str) and cell not in ("", "nan")]
        if values:
            stated.read(str(row[0]), values, decimal=decimal)
    return frame.drop(columns=beside)


def _lost_lines(text: _Text) -> list[str]:
    """Return a remark on empty lines, which may stand for samples where a rate gives the time."""
    filled = [bool(line.strip(f" \n{text.layout.separator}")) for line in text.above]
    before = filled[::-1].index(True) if any(filled) else len(filled)
    inside = len(_EMPTY_LINE.findall(text.body.rstrip())) if text.layout.width > 1 else 0
    # One line often parts a heading from its table.
    count = inside + (before if before > 1 else 0)
    return [f"check the time: {count_in_words(count, 'empty line')} left out"] if count else []


def _line_of(text: _Text, row: int) -> str:
    """Return the line of a row; empty lines between them are no rows."""
    lines = enumerate(text.body.split("\n"), start=len(text.above) + 1)
    kept = [number for number, line in lines if text.layout.width == 1 or line.strip()]
    return f"line {kept[row]}" if row < len(kept) else "a line"


def _fault(layout: TextLayout, error: Exception) -> str:
    """Return why a file is no table of numbers."""
    said = str(error)
    if "Expected" in said and "saw" in said:
        counted = re.sub(r"line (\d+)", lambda m: f"line {int(m[1]) + layout.first_row}", said)
        counted = counted.split("C error:")[-1].strip()
        return f"{counted}; give every row the same columns"
    if isinstance(error, ParserWarning):
        return f"rows have more than {layout.width} columns; give all the same columns"
    if "EOF inside string" in said:
        return "a quotation mark among the numbers is never closed; take it out"
    return f"cannot be read as numbers ({said[:200]})"


def csv_bytes(recording: Recording) -> bytes:
    """Return a recording as the content of a CSV file, laid out as DewesoftX exports them.

    Lines on top hold the start and the sample rate; a heading names each column with its unit.

    Raises
    ------
    MeasurementError
        When the channels do not share their times; a table has one time a row.
    """
    channels = list(recording.channels.values())
    first = channels[0]
    other = [
        channel.name
        for channel in channels
        if (channel.rate, channel.start, channel.values.size)
        != (first.rate, first.start, first.values.size)
    ]
    if other:
        text = f"{choices(other)} and '{first.name}' have different times, a CSV file has one; "
        raise MeasurementError([text + "write .h5 or .mat instead"], source=recording.source)
    heading = [f"Sample rate: {first.rate!r} Hz"]
    if recording.start_time:
        heading.insert(0, f"Start time: {recording.start_time}")
    table = pd.DataFrame({"Time (s)": np.round(first.time, 9)})
    for channel in channels:
        table[f"{channel.name} [{channel.unit or '-'}]"] = channel.values
    return "\n".join([*heading, "", table.to_csv(index=False, lineterminator="\n")]).encode()
