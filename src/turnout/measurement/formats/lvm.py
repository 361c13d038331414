"""LabVIEW measurement files (.lvm): a heading per segment, columns of one, several or no times."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import FileError
from turnout.measurement.formats.assemble import named_unit
from turnout.measurement.formats.clock import StatedClock, StatedRates
from turnout.measurement.formats.file_table import Table, TableColumn
from turnout.measurement.formats.numbers import numbers
from turnout.measurement.formats.text_dialect import encoding_of
from turnout.measurement.formats.time_axis import is_stamp, stamps_axis

_END = "***End_of_Header***"
_START = ("date", "time")
_SAME_START = 1e-3
"""Difference of the starts of channels that tasks of one program leave [s]."""
_SEPARATORS = {"tab": "\t", "comma": ",", "semicolon": ";"}


def read_lvm(path: Path) -> Table:
    """Read a LabVIEW measurement file.

    Raises
    ------
    FileError
        When it holds several segments, or numbers cannot be read.
    """
    facts, own, body, decimal = _parts(path)
    names = [name.strip() for name in body[0]] if body else []
    if "Comment" in names:
        names = names[: names.index("Comment")]
    stated_count = own.get("channels", ["1"])[0].strip()
    count = int(stated_count) if stated_count.isdigit() else len(names)
    # Per channel a value in each column of samples; times take a column each or none.
    places = [n for n, name in enumerate(names) if name.lower() != "x_value"]
    # They may stand in the columns of the times too.
    by_channel = {
        key: [value.strip() for value in values if value.strip()][:count]
        for key, values in own.items()
    }
    over = {value.lower() for value in by_channel.get("x_dimension", [])} - {"time"}
    if over:
        message = f"{path}: is recorded over {', '.join(sorted(over))}, not over time"
        raise FileError(message)
    with_times = facts.get("x_columns", "One").lower() != "no"
    steps = [] if with_times else _steps(by_channel, decimal, path)
    later = _later(by_channel, len(places))
    if later.any() and with_times and len(names) < 2 * len(places):
        message = (
            f"{path}: its channels start at different times and share one column of times; "
            "export a column of times for each"
        )
        raise FileError(message)
    if steps:
        first = numbers(by_channel.get("x0", ["0"]), decimal)[0]
        later = later + (first if first.size == later.size else first[0])
    stated = StatedClock()
    stated.moments = [" ".join(facts[key] for key in ("date", "time") if key in facts)]
    units = by_channel.get("y_unit_label", [])
    alike = bool(steps) and np.unique(later).size == 1
    if alike:
        stated.rates.append(StatedRates("Delta_X", tuple(1.0 / step for step in steps)))
        stated.first = (float(later[0]), False)
    columns = []
    for place, name in enumerate(names):
        if place not in places and not with_times:
            continue
        cells = [row[place] if place < len(row) else "" for row in body[1:]]
        number = sum(item < place for item in places)
        if place not in places:
            own_times = numbers(cells, decimal)[0] + later[min(number, later.size - 1)]
            columns.append(TableColumn("Time", own_times, "s"))
            continue
        if steps and not alike:
            filled = sum(bool(cell.strip()) for cell in cells)
            even = later[number] + steps[min(number, len(steps) - 1)] * np.arange(filled)
            columns.append(TableColumn("Time", even, "s"))
        bare, unit = named_unit(name, units[number] if number < len(units) else "")
        columns.append(TableColumn(bare, np.array(cells, dtype=object), unit))
    return Table(columns, stated, str(path), decimal=decimal, alone=False)


def _parts(path: Path) -> tuple[dict[str, str], dict[str, list[str]], list[list[str]], str]:
    """Return the facts of the file and of its channels, the rows, and the decimal mark."""
    content = path.read_bytes()
    lines = content.decode(encoding_of(content), errors="replace").splitlines()
    ends = [number for number, line in enumerate(lines) if line.strip().startswith(_END)]
    if len(ends) != 2:
        reason = "no table of numbers" if len(ends) < 2 else f"{len(ends) - 1} segments"
        message = f"{path}: has {reason}; save each segment in a file of its own"
        raise FileError(message)
    # Up to the end of the first heading every separator is possible.
    facts = dict(_pair(line) for line in lines[: ends[0]] if line.strip())
    separator = _SEPARATORS.get(facts.get("separator", "tab").lower(), "\t")
    decimal = facts.get("decimal_separator", ".")[:1] or "."
    rows = [line.split(separator) for line in lines[ends[0] + 1 : ends[1]]]
    own = {row[0].strip().lower(): row[1:] for row in rows if row[0].strip()}
    body = [line.split(separator) for line in lines[ends[1] + 1 :] if line.strip()]
    return facts, own, body, decimal


def _later(by_channel: dict[str, list[str]], count: int) -> NDArray[np.float64]:
    """Return how much later than the first each channel starts, by its own date and time [s]."""
    starts = list(map(" ".join, zip(*(by_channel.get(key, []) for key in _START), strict=False)))
    if count < 2 or len(starts) != count or not all(map(is_stamp, starts)):
        return np.zeros(count)
    begins = np.array([stamps_axis([start]).begin or 0.0 for start in starts])
    later = begins - begins.min()
    return later if later.max() > _SAME_START else np.zeros(count)


def _pair(line: str) -> tuple[str, str]:
    for separator in _SEPARATORS.values():
        key, found, value = line.partition(separator)
        if found:
            return key.strip().lower(), value.strip()
    return line.strip().lower(), ""


def _steps(by_channel: dict[str, list[str]], decimal: str, path: Path) -> list[float]:
    steps = numbers(by_channel.get("delta_x", []), decimal)[0]
    if not steps.size or not np.all(steps > 0):
        message = f"{path}: has neither times nor Delta_X; export it with X columns"
        raise FileError(message)
    return [float(step) for step in steps]
