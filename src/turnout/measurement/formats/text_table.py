"""Text files of numbers: DewesoftX exports, MATLAB, Excel (CSV, TXT)."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pandas.errors import ParserError, ParserWarning

from turnout.core.errors import FileError, MeasurementError
from turnout.core.problems import choices
from turnout.measurement.formats.assemble import (
    FileColumn,
    assemble_recording,
    is_time_name,
    seconds_of,
)
from turnout.measurement.formats.extent import MOST_CHANNELS
from turnout.measurement.formats.text_dialect import EMPTY, SAMPLE_SIZE, TextLayout, text_layout
from turnout.measurement.recording import Recording

NO_TIME = "give a column 'Time (s)' or a line 'Sample rate: 1000 Hz' above the numbers"
ROWS_AT_ONCE = 20_000


def read_text(path: Path) -> Recording:
    """Read a text file of numbers, whatever its separators, decimal marks and headings.

    Empty cells are missing samples (NaN). A last line that was cut off is left out.

    Raises
    ------
    FileError
        Naming line and column of what is no number.
    """
    with path.open("rb") as file:
        layout = text_layout(file.read(SAMPLE_SIZE), source=str(path))
    if len(layout.names) > MOST_CHANNELS:
        message = f"{path}: holds {len(layout.names)} columns, at most {MOST_CHANNELS} are read"
        raise FileError(message + "; export fewer")
    table, problems = _table(path, layout)
    time, columns = _timed(table, layout, path)
    rate = layout.rate
    if time is None and rate is None and _may_be_time(table[0], layout):
        time, columns = table[0], columns[1:]
    made = [
        FileColumn(
            layout.names[number],
            values,
            unit=layout.units[number],
            time=time,
            rate=None if time is not None else rate,
        )
        for number, values in columns
    ]
    for column in made:
        empty = int(np.count_nonzero(np.isnan(column.values)))
        if empty:
            cells = "cell is" if empty == 1 else "cells are"
            problems.append(f"channel '{column.name}': {empty} {cells} empty, taken as missing")
    return assemble_recording(
        made,
        source=str(path),
        start_time=layout.start_time,
        problems=problems,
        remedy=NO_TIME,
    )


Numbered = list[tuple[int, NDArray[np.float64]]]


def _timed(
    table: list[NDArray[np.float64]], layout: TextLayout, path: Path
) -> tuple[NDArray[np.float64] | None, Numbered]:
    """Return the time column [s] and the others, each with its number."""
    numbered = list(enumerate(table))
    if layout.clock:
        return table[0], numbered[1:]
    for number, name in enumerate(layout.names):
        if not is_time_name(name):
            continue
        try:
            factor = seconds_of(layout.units[number])
        except ValueError as error:
            message = f"{path}: column '{name}': {error}"
            raise FileError(message) from None
        time = table[number] if factor == 1.0 else table[number] * factor
        return time, [item for item in numbered if item[0] != number]
    return None, numbered


def _may_be_time(values: NDArray[np.float64], layout: TextLayout) -> bool:
    """Return True if the first of several columns rises evenly; only asked if none is named."""
    if layout.named or len(layout.names) < 2 or values.size < 3:
        return False
    steps = np.diff(values)
    return bool(np.all(steps > 0) and np.ptp(steps) <= 0.5 * float(np.mean(steps)))


def _table(path: Path, layout: TextLayout) -> tuple[list[NDArray[np.float64]], list[str]]:
    """Return the columns of numbers, and remarks on repairs."""
    try:
        frame = _frame(path, layout, dtype=None if layout.clock else np.float64)
    except (ValueError, OverflowError, ParserWarning) as error:
        raise FileError(_fault(path, layout, error)) from None
    if layout.clock:
        frame[0] = _clock_seconds(frame[0], path)
        if any(kind.kind not in "fiu" for kind in frame.dtypes):
            raise FileError(_fault(path, layout, ValueError("text among numbers")))
    # An empty line at the end is none; a row without its last cells was cut off.
    problems = []
    if len(frame) > 1 and _is_cut_off(path, layout) and pd.isna(frame.iloc[-1, -1]):
        frame = frame.iloc[:-1]
        problems.append("the last line is cut off and left out")
    return [frame[name].to_numpy(dtype=np.float64) for name in frame.columns], problems


def _frame(path: Path, layout: TextLayout, *, dtype: object, **options: object) -> Any:
    separator = r"\s+" if layout.separator == " " else layout.separator
    given: dict[str, object] = {
        "sep": separator,
        "decimal": layout.decimal,
        "header": None,
        "names": range(len(layout.names)),
        "index_col": False,
        "skiprows": layout.first_row,
        "skip_blank_lines": True,
        "encoding": layout.encoding,
        "dtype": dtype,
        "na_values": sorted(EMPTY - {"", "inf", "-inf"}),
        "skipinitialspace": True,
        "engine": "c",
        # Whatever its name: only text is read here.
        "compression": None,
        **options,
    }
    with warnings.catch_warnings():
        # Rows longer than the heading would lose their last cells with no more than a warning.
        warnings.simplefilter("error", ParserWarning)
        return pd.read_csv(path, **given)  # type: ignore[call-overload]


def _is_cut_off(path: Path, layout: TextLayout) -> bool:
    """Return True if the file ends without a line end."""
    size = 2 if layout.encoding.startswith("utf-16") else 1
    with path.open("rb") as file:
        file.seek(0, 2)
        file.seek(max(file.tell() - size, 0))
        return file.read(size).strip(b"\0") not in (b"\n", b"\r")


DATE_LENGTH = 8
"""Within which a date has a hyphen; in a time of day one stands before its zone only."""


def _clock_seconds(cells: "pd.Series[str]", path: Path) -> NDArray[np.float64]:
    """Return times of day or dates with times, also of time zones, as seconds from the first."""
    texts = cells.astype(str).str.replace(",", ".")
    dated = "-" in str(texts.iloc[0])[:DATE_LENGTH]
    moments = pd.to_datetime(
        texts if dated else "2000-01-01 " + texts, format="ISO8601", errors="coerce", utc=True
    )
    if moments.isna().any():
        at = int(moments.isna().to_numpy().argmax())
        message = f"{path}: row {at + 1} of the numbers: '{cells.iloc[at]}' is no time"
        raise FileError(message)
    seconds = (moments - moments.iloc[0]).dt.total_seconds().to_numpy(dtype=np.float64)
    if not dated:
        # Past midnight the time of day starts again.
        seconds = seconds + 86400.0 * np.cumsum(np.concatenate(([0], np.diff(seconds) < -43200.0)))
    return seconds.astype(np.float64)


def _fault(path: Path, layout: TextLayout, error: Exception) -> str:
    """Return the first departure from rows of numbers: read again, a block at a time, as text."""
    text = str(error)
    if "Expected" in text and "saw" in text:
        return f"{path}: {text.split('C error:')[-1].strip()}; give every row the same columns"
    if isinstance(error, ParserWarning):
        count = len(layout.names)
        return f"{path}: rows have more than {count} columns; give every row the same columns"
    if "EOF inside string" in text:
        return f"{path}: a quotation mark among the numbers is never closed; take it out"
    if isinstance(error, UnicodeDecodeError):
        return f"{path}: is no {layout.encoding} text (byte {error.start}); save it as UTF-8"
    try:
        found = _first_text(path, layout)
    except (ParserError, ParserWarning, ValueError):
        found = ""
    return f"{path}: {found or f'cannot be read as numbers ({text})'}"


def _first_text(path: Path, layout: TextLayout) -> str:
    """Return line and column of the first cell that is no number; empty if all are numbers."""
    row = layout.first_row
    # A point is no number's where the decimal mark is a comma.
    marks = {ord(","): ".", ord("."): "x"} if layout.decimal == "," else {}
    blocks: Any = _frame(
        path,
        layout,
        dtype=str,
        chunksize=ROWS_AT_ONCE,
        keep_default_na=False,
        na_values=[],
        skip_blank_lines=False,
        na_filter=False,
    )
    with blocks:
        for block in blocks:
            for name in block.columns[1 if layout.clock else 0 :]:
                cells = block[name].astype(str).str.strip()
                plain = cells.str.translate(marks)
                wrong = pd.to_numeric(plain, errors="coerce").isna() & ~cells.str.lower().isin(
                    EMPTY
                )
                if wrong.any():
                    at = int(wrong.to_numpy().argmax())
                    return (
                        f"line {row + at + 1}, column '{layout.names[name]}': "
                        f"'{cells.iloc[at][:40]}' is not a number"
                    )
            row += len(block)
    return ""


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
