"""Tables with a row a throw, as monitoring systems write them."""

import csv
import io
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.errors import FileError, TurnoutError
from turnout.detection.conditions import CURRENT, FORCE, POWER, UNITS
from turnout.detection.detector.recorded import Recorded
from turnout.detection.detector.throw_layout import CLOSING, LEAST_SAMPLES, OPENING
from turnout.detection.detector.throws_of_dataset import faulty, throws_of_dataset
from turnout.detection.drive_quantities import CHANNELS
from turnout.measurement.formats.text_dialect import encoding_of

Floats = NDArray[np.float64]

RATE, START, DIRECTION, NAME = "rate [Hz]", "start [s]", "direction", "throw"
WINDOW = "window [s]"
MULTIPLES = {
    FORCE: {"N": 1.0, "daN": 10.0, "kN": 1e3},
    CURRENT: {"A": 1.0, "mA": 1e-3},
    POWER: {"W": 1.0, "kW": 1e3},
}
"""Units of a column, in those that are judged."""
SEPARATORS = ",;\t"
JOINED = "+"
"""Stands between the names of drives whose motors share one current."""
SHARED = "one channel stands for the motors of drives"
LONGEST_WINDOW = 0.1
"""A mean over longer smears what a contact changes [s]."""
LARGEST_RATE = 1e6
"""Samples a second beyond which a rate is mistyped [Hz]."""
LONGEST_CELL = 2**31 - 1
"""A cell holds all samples of a drive; csv allows 131,072 characters, 17 s at 1 kHz."""
MOST_SHOWN = 12
"""Columns that a message lists."""


@dataclass(frozen=True, slots=True)
class _Column:
    """Columns of a drive in a table.

    Attributes
    ----------
    drive, heading : str
        Its name, and that of the column.
    factor : float
        One of its unit in SI.
    """

    drive: str
    heading: str
    factor: float


def read_table(path: Path, *, quantity: str = FORCE) -> list[Recorded]:
    """Read a table with a row a throw.

    Columns: `throw`, `rate [Hz]`, optionally `start [s]` (of the first sample, the movement begins
    at 0), `window [s]` (samples are means or root mean squares over so long before their instants)
    and `direction`, and for each drive `force NAME [N]`, `current NAME [A]` or `power NAME [W]`, or
    a multiple of these: samples separated by spaces. Columns are separated by commas, semicolons or
    tabs; where no commas do that, they may be decimal marks.

    Parameters
    ----------
    path : Path
        Of the table (.csv).
    quantity : str
        Which of these is judged.

    Raises
    ------
    FileError
        When it is no such table, or has no rows.
    """
    names, rows, comma = _cells(path)
    columns = _columns(path, names, quantity)
    found = []
    for number, cells in enumerate(rows, 1):
        row = dict.fromkeys(names, "") | dict(zip(names, cells, strict=False))
        name = row.get(NAME, "").strip() or f"{path.name}, row {number}"
        if len(cells) > len(names):
            fault = f"has {len(cells)} cells below a heading of {len(names)}"
            if not comma:
                fault += "; decimal commas need semicolons between columns"
            found.append(faulty(name, fault))
        else:
            found.append(_of_row(row, name, columns, quantity, comma=comma))
    if not found:
        message = f"{path}: has a heading, but no row; each throw is a row"
        raise FileError(message)
    return found


def _cells(path: Path) -> tuple[list[str], Iterator[list[str]], bool]:
    """Return heading and rows of a table, and whether a comma is a decimal mark in it."""
    try:
        content = path.read_bytes()
        text = content.decode(encoding_of(content)).removeprefix("\ufeff")
        if "\0" in text:
            message = "it is no text"
            raise ValueError(message)  # noqa: TRY301 - one message for all that is no table
        lines = [line for line in io.StringIO(text, newline="") if line.strip()]
        first = lines[0] if lines else ""
        separator = max(SEPARATORS, key=first.count)
        before = csv.field_size_limit(LONGEST_CELL)
        try:
            rows = list(csv.reader(lines, delimiter=separator))
        finally:
            csv.field_size_limit(before)
    except (OSError, ValueError, csv.Error) as error:
        message = f"{path}: cannot be read as a table ({error})"
        raise FileError(message) from None
    names = [" ".join(name.split()) for name in rows[0]] if rows else []
    return names, iter(rows[1:]), separator != ","


def _columns(path: Path, names: list[str], quantity: str) -> list[_Column]:
    """Return the columns of the drives; FileError where the heading is none of a table."""
    units, lead = MULTIPLES[quantity], f"{quantity} "
    found = []
    for name in names:
        for unit, factor in units.items():
            if name.startswith(lead) and name.endswith(f" [{unit}]"):
                drive = name.removeprefix(lead).removesuffix(f"[{unit}]").strip()
                found.append(_Column(drive, name, factor))
    if RATE not in names or not found:
        shown = ", ".join(f"'{name[:40]}'" for name in names[:MOST_SHOWN]) or "nothing"
        also = " or ".join(unit for unit in units if unit != UNITS[quantity])
        message = (
            f"{path}: no table of throws: needs the columns '{RATE}' and "
            f"'{lead}NAME [{UNITS[quantity]}]' (or {also}), its heading has {shown}; "
            "a recording with a column a channel needs --channels MAP.toml"
        )
        raise FileError(message)
    drives = [item.drive for item in found]
    known = (NAME, RATE, START, DIRECTION, WINDOW)
    twice = [name for name in known if names.count(name) > 1]
    twice += [f"{lead}{name}" for name in drives if drives.count(name) > 1]
    if twice:
        message = f"{path}: has the column '{twice[0]}' more than once; keep one"
        raise FileError(message)
    return found


def _of_row(
    row: Mapping[str, str], name: str, columns: list[_Column], quantity: str, *, comma: bool
) -> Recorded:
    def numbers(text: str) -> Floats:
        return np.array((text.replace(",", ".") if comma else text).split(), dtype=np.float64)

    def number(heading: str, default: float) -> float:
        found = numbers(row.get(heading, ""))
        if found.size > 1:
            message = f"'{heading}' is {row[heading].strip()[:40]}"
            raise ValueError(message)
        return float(found[0]) if found.size else default

    direction = row.get(DIRECTION, "").strip().lower()
    if direction and direction != CLOSING:
        what = f"is {direction}" if direction == OPENING else f"'{DIRECTION}' is '{direction[:40]}'"
        return faulty(name, f"{what}, and {CLOSING} movements are judged")
    try:
        rate, start = number(RATE, math.nan), number(START, math.nan)
        window = number(WINDOW, 0.0)
        lines = [item.factor * numbers(row[item.heading]) for item in columns]
    except ValueError as error:
        said = str(error)
        return faulty(name, f"holds what is no number ({said[:80]})")
    drives = tuple(item.drive for item in columns)
    if not 0.0 < rate <= LARGEST_RATE:
        return faulty(name, f"'{RATE}' is {row[RATE].strip()[:40] or 'empty'}")
    if len({line.size for line in lines}) != 1 or lines[0].size < LEAST_SAMPLES:
        each = ", ".join(
            f"{line.size} of drive {drive}" for drive, line in zip(drives, lines, strict=True)
        )
        return faulty(name, f"has {each} samples; {LEAST_SAMPLES} or more are needed, as many each")
    joined = [drive for drive in drives if JOINED in drive]
    if joined:
        return faulty(name, f"{SHARED} {', '.join(joined)}; {quantity}s of each are needed")
    if not 0.0 <= window <= LONGEST_WINDOW:
        return faulty(name, f"'{WINDOW}' is {window:g}; up to {LONGEST_WINDOW:g} can be judged")
    return _thrown(name, np.array(lines), drives, quantity, times=(rate, start, window))


def _thrown(
    name: str,
    force: Floats,
    drives: tuple[str, ...],
    quantity: str,
    *,
    times: tuple[float, float, float],
) -> Recorded:
    """Return the throw of a row, with rate, start and window."""
    rate, start, window = times
    time = np.arange(force.shape[1]) / rate
    if np.isfinite(start):
        # a mean belongs to the middle of its window
        time += start - 0.5 * window
        return Recorded(
            name=name, time=time, force=force, drives=drives, onsets={CLOSING: 0.0}, single=True
        )
    dataset = xr.Dataset(
        {CHANNELS[quantity]: (("drive", "time"), force)}, {"time": time, "drive": list(drives)}
    )
    try:
        # where forces alone show movements, those that a discrepancy at rest shows are none of them
        (found,) = throws_of_dataset(dataset, name=name, quantity=quantity)
    except (TurnoutError, ValueError):
        return faulty(name, "holds several closings; one row is one throw")
    return found
