"""Layout of a text file of numbers: encoding, separator, decimal mark, heading, first row."""

import codecs
import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass

from turnout.core.errors import FileError
from turnout.measurement.formats.assemble import RATE_NAME, UNIT_TEXTS, split_unit, tidy_unit

# So much of a file is read to recognise its layout [bytes].
SAMPLE_SIZE = 200_000
DECIMAL_MARKS = {"\t": ".,", ";": ".,", ",": ".", "|": ".,", " ": ".,"}
"""Decimal marks by separator, in the order of preference if several would do."""
EMPTY = frozenset(("", "nan", "na", "n/a", "null", "-nan", "inf", "-inf"))
_BOMS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_NUMBER = {
    ".": re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?"),
    ",": re.compile(r"[+-]?(\d+,?\d*|,\d+)([eE][+-]?\d+)?"),
}
CLOCK = re.compile(r"(\d{4}-\d\d-\d\d[T ])?\d\d:\d\d:\d\d([.,]\d+)?(Z|[+-]\d\d(:?\d\d)?)?")
_LEADING_NUMBER = re.compile(r"\s*(\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)\s*([a-zA-Z/]*)")


@dataclass(frozen=True, slots=True)
class TextLayout:
    """Everything needed to read the numbers of a text file.

    Attributes
    ----------
    encoding, separator, decimal : str
        As for a reader of separated values; the separator " " is any white space.
    first_row : int
        Number of lines before the first row of numbers.
    names, units : tuple of str
        One text a column; empty where the file has none.
    named : bool
        Whether the file names its columns.
    clock : bool
        Whether the first column holds times of day.
    rate : float or None
        Sample rate given in the heading [1/s].
    start_time : str or None
        Start given in the heading.
    """

    encoding: str
    separator: str
    decimal: str
    first_row: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    named: bool
    clock: bool
    rate: float | None
    start_time: str | None


def encoding_of(sample: bytes) -> str:
    """Return the encoding of a text from its first bytes: a mark, UTF-16, UTF-8, or else Latin-1.

    Examples
    --------
    >>> encoding_of("µm/m".encode("utf-16")), encoding_of("µm/m".encode("latin-1"))
    ('utf-16', 'latin-1')
    """
    for mark, name in _BOMS:
        if sample.startswith(mark):
            return name
    half = sample[: len(sample) // 2 * 2]
    if half and b"\0" not in half[0::2] and half[1::2].count(0) > 0.8 * len(half) / 2:
        return "utf-16-le"
    if half and b"\0" not in half[1::2] and half[0::2].count(0) > 0.8 * len(half) / 2:
        return "utf-16-be"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(sample)
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8"


def text_layout(sample: bytes, *, source: str) -> TextLayout:
    r"""Understand a text file from its first bytes.

    Parameters
    ----------
    sample : bytes
        The beginning of the file, or all of it.
    source : str
        The file, for messages.

    Raises
    ------
    FileError
        When there are no rows of numbers in it.

    Examples
    --------
    >>> layout = text_layout(b"Time (s);Rod 1 (mV/V)\n0,000;0,1\n0,001;0,2\n", source="a.csv")
    >>> layout.separator, layout.decimal, layout.first_row, layout.names, layout.units
    (';', ',', 1, ('Time', 'Rod 1'), ('s', 'mV/V'))
    """
    encoding = encoding_of(sample)
    text = codecs.getincrementaldecoder(encoding)("replace").decode(sample)
    if "\0" in text:
        message = f"{source}: is no text file and of no format that is known"
        raise FileError(message)
    # Only line ends count: a form feed or a Unicode separator is no new line to a reader of rows.
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if len(sample) >= SAMPLE_SIZE and len(lines) > 1:
        lines = lines[:-1]
    try:
        best, first_row = _best(lines)
    except csv.Error as error:
        message = f"{source}: is no table of numbers ({error})"
        raise FileError(message) from None
    if best is None:
        first = next((line.strip() for line in lines if line.strip()), "")[:60]
        shown = "".join(char if char.isprintable() else " " for char in first)
        message = f"{source}: there are no rows of numbers in it (it begins with: {shown})"
        raise FileError(message)
    separator, decimal = best
    row = _cells(lines[first_row], separator)
    heading = [_cells(line, separator) for line in lines[:first_row]]
    names, units = _heading(heading, len(row))
    rate, start_time = _preamble(lines[:first_row])
    return TextLayout(
        encoding=encoding,
        separator=separator,
        decimal=decimal,
        first_row=first_row,
        names=names or tuple(f"column {number}" for number in range(1, len(row) + 1)),
        units=units or ("",) * len(row),
        named=bool(names),
        clock=CLOCK.fullmatch(row[0]) is not None,
        rate=rate,
        start_time=start_time,
    )


def _best(lines: Sequence[str]) -> tuple[tuple[str, str] | None, int]:
    """Return the separator and decimal mark that read most rows as numbers, and the first row."""
    best, best_score, best_row = None, (0, 0), 0
    for separator, marks in DECIMAL_MARKS.items():
        rows = [_cells(line, separator) for line in lines]
        for decimal in marks:
            widths = [_width(cells, decimal) for cells in rows]
            counted = [width for width in widths if width]
            if not counted:
                continue
            width = max(set(counted), key=counted.count)
            row = widths.index(width)
            heading = [cells for cells in rows[:row] if cells]
            fits = not heading or len(heading[-1]) == width
            score = (counted.count(width) * (2 if fits else 1), width)
            if score > best_score:
                best, best_score, best_row = (separator, decimal), score, row
    return best, best_row


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    if not line.strip():
        return []
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]


def _width(cells: Sequence[str], decimal: str) -> int:
    """Return the number of cells when all are numbers or empty, else 0."""
    if not cells or not any(cells):
        return 0
    number = _NUMBER[decimal]
    for place, cell in enumerate(cells):
        if number.fullmatch(cell) or (place and cell.lower() in EMPTY):
            continue
        if place == 0 and CLOCK.fullmatch(cell) and len(cells) > 1:
            continue
        return 0
    return len(cells)


def _heading(rows: Sequence[list[str]], width: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Find names and units above the numbers: names with units, or a row of each."""
    wide = [row for row in rows if len(row) == width and any(row) and not row[0].startswith("sep=")]
    if not wide:
        return (), ()
    wide = [[row[0].lstrip("#% "), *row[1:]] for row in wide]
    last = wide[-1]
    if len(wide) > 1 and _are_units(last):
        names = [split_unit(text)[0] for text in wide[-2]]
        return tuple(names), tuple(tidy_unit(text) for text in last)
    pairs = [split_unit(text) for text in last]
    return tuple(name for name, _ in pairs), tuple(unit for _, unit in pairs)


def _are_units(cells: Sequence[str]) -> bool:
    bare = [cell for cell in cells if cell]
    return bool(bare) and all(
        cell in UNIT_TEXTS or (cell[0] + cell[-1] in ("()", "[]")) for cell in bare
    )


def _preamble(lines: Sequence[str]) -> tuple[float | None, str | None]:
    """Find "Sample rate: 1000 Hz" and "Start time: ..." among the lines above the numbers."""
    rate = start_time = None
    for line in lines:
        parts = re.split(r"[:=\t;,]", line, maxsplit=1)
        if len(parts) < 2:
            continue
        value = parts[1].strip(' \t:;,"')
        key, unit = split_unit(parts[0].strip(' \t"#%'))
        if RATE_NAME.fullmatch(key):
            match = _LEADING_NUMBER.match(value)
            factor = (
                {"": 1.0, "hz": 1.0, "s/s": 1.0, "khz": 1e3}.get(unit.lower() or match[2].lower())
                if match
                else None
            )
            if match and factor:
                rate = float(match[1].replace(",", ".")) * factor
        elif key.lower() in ("start time", "start", "startzeit", "recording start", "date"):
            start_time = value or None
    return rate, start_time
