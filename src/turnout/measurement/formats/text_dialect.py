"""Layout of a text file of numbers: encoding, separator, decimal mark, heading, first row."""

import codecs
import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

from turnout.core.errors import FileError
from turnout.measurement.formats.heading import Heading, read_heading
from turnout.measurement.formats.numbers import (
    PLAIN,
    curve_parts,
    is_missing,
    is_number,
    plain_sign,
)
from turnout.measurement.formats.time_axis import is_date, is_stamp

# So much of a file is read to recognise its layout [bytes].
SAMPLE_SIZE = 200_000
MOST_ROWS = 120
"""Lines that are looked at to find the layout, unless the table only begins behind them."""
DECIMAL_MARKS = {"\t": ".,", ";": ".,", ",": ".,", "|": ".,", " ": ".,"}
"""Decimal marks by separator, in the order of preference if several would do."""
_BOMS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
# A number only with marks between thousands is weaker evidence than one without.
_GROUPED_WEIGHT = 0.9
# So many rows of numbers above a table are facts of the heading.
_MOST_LOOSE_ROWS = 3


@dataclass(frozen=True, slots=True)
class TextLayout:
    """Everything needed to read the numbers of a text file.

    Attributes
    ----------
    encoding, separator, decimal : str
        As for a reader of separated values; the separator " " is any white space.
    first_row : int
        Number of lines before the first row of numbers.
    width : int
        Columns of the table.
    heading : Heading
        Names, units and clock above the numbers.
    loose_rows : int
        Number of rows of numbers above the table with another width.
    """

    encoding: str
    separator: str
    decimal: str
    first_row: int
    width: int
    heading: Heading
    loose_rows: int = 0

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each column; a number if the file has none."""
        given = [*self.heading.names, *[""] * self.width][: self.width]
        return tuple(name or f"column {place}" for place, name in enumerate(given, start=1))


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
        # Windows writes a minus, a dash or an apostrophe where Latin-1 has controls.
        return "cp1252" if any(0x80 <= byte < 0xA0 for byte in sample) else "latin-1"
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
    >>> layout.separator, layout.decimal, layout.first_row, layout.names, layout.heading.units
    (';', ',', 1, ('Time', 'Rod 1'), ['s', 'mV/V'])
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
        best = _best(lines[:MOST_ROWS])
        if best is None or best[2] > MOST_ROWS // 2:
            best = _best(lines) or _best(lines[:MOST_ROWS], units=True)
    except csv.Error as error:
        message = f"{source}: is no table of numbers ({error})"
        raise FileError(message) from None
    if best is None:
        first = next((line.strip() for line in lines if line.strip()), "")[:60]
        shown = "".join(char if char.isprintable() else " " for char in first)
        message = f"{source}: there are no rows of numbers in it (it begins with: {shown})"
        raise FileError(message)
    separator, decimal, first_row, width = best
    above = _heading_rows(lines[:first_row], separator, width)
    below = [split_line(line, separator) for line in lines[first_row : first_row + MOST_ROWS]]
    shows = any(decimal in cell and not is_stamp(cell) for cells in below for cell in cells)
    table = [cells for cells in below if len(cells) == width]
    loose = _loose_rows(above, width, decimal)
    if max(loose, default=0) > _MOST_LOOSE_ROWS:
        message = f"{source}: holds tables of different widths; save each in a file of its own"
        raise FileError(message)
    names = max((len(cells) for cells in above), default=0)
    if separator == "," and 2 * names == width and not any("." in c for r in table for c in r):
        message = (
            f"{source}: the comma parts its columns and its decimals; export it with semicolons"
        )
        raise FileError(message)
    filled = width < 2 or any(cells[-1] for cells in table)
    try:
        heading = read_heading(
            above,
            width if filled or (above and len(above[-1]) == width and above[-1][-1]) else width - 1,
            decimal=decimal if shows else None,
            first_empty=10 * sum(bool(cells[0]) for cells in table) < len(table),
            last_filled=filled,
            unnamed_first=_unnamed_first(table, decimal),
        )
    except ValueError as error:
        message = f"{source}: {error}"
        raise FileError(message) from None
    return TextLayout(encoding, separator, decimal, first_row, width, heading, sum(loose))


def _loose_rows(above: Sequence[Sequence[str]], width: int, decimal: str) -> list[int]:
    """Return how many rows of numbers of one other width lie together, for each such place."""
    widths = [
        len(cells) if all(_weight(cell, decimal) for cell in cells) else 0
        for cells in above
        if cells
    ]
    runs = [(size, len(list(rows))) for size, rows in groupby(widths)]
    return [count for size, count in runs if size > 1 and size != width]


def _unnamed_first(table: Sequence[Sequence[str]], decimal: str) -> bool:
    """Return True if the first column may lack a name: texts, an index, or a date before a time."""
    first = [cells[0] for cells in table]
    if len(table[0]) > 1 and is_date(first[0]) and is_stamp(table[0][1]):
        return True
    if not any(_weight(cell, decimal) for cell in first):
        return True
    plain = all(cell.isdigit() and len(cell) < 16 for cell in first)
    return plain and len({int(b) - int(a) for a, b in pairwise(first)}) == 1


def _heading_rows(lines: Sequence[str], separator: str, width: int) -> list[list[str]]:
    """Return the cells of the lines above the table; a quoted cell may go over several lines."""
    if separator != " " and any(line.count('"') % 2 for line in lines):
        rows = csv.reader(io.StringIO("\n".join(lines)), delimiter=separator)
        return [[" ".join(cell.split()) for cell in row] for row in rows]
    return [_heading_cells(line, separator, width) for line in lines]


def _heading_cells(line: str, separator: str, width: int) -> list[str]:
    """Return the cells of a line above the table; one statement, such as "Rate: 1,000 Hz", is one.

    A separator may stand within the statement.
    """
    cells = split_line(line, separator)
    if separator == " " and len(cells) != width and len(long := _WITH_UNIT.findall(line)) == width:
        return [cell.strip() for cell in long]
    if cells and separator == " " and (":" in line or "=" in line):
        return [line.strip()]
    first = _BRACKETS.sub("", cells[0]) if cells else ""
    return [line.strip()] if ":" in first[:-1] and not first.startswith('"') else cells


def _best(lines: Sequence[str], *, units: bool = False) -> tuple[str, str, int, int] | None:
    """Return separator, decimal mark, first row and width of the reading that explains most.

    With `units` a cell may hold a number with its unit.
    """
    best, best_score = None, (0.0, 0)
    for separator, marks in DECIMAL_MARKS.items():
        if best is not None and not any(separator in line for line in lines):
            continue
        rows = [split_line(line, separator) for line in lines]
        for decimal in marks:
            if decimal == "," and not any("," in cell for cells in rows for cell in cells):
                continue
            cut = [[_UNIT.sub("", c) for c in cells] for cells in rows] if units else rows
            shares = [_share(cells, decimal) for cells in cut]
            widths = Counter(len(c) for c, share in zip(rows, shares, strict=True) if share >= 0.5)
            if not widths:
                continue
            width = max(widths, key=lambda key: (widths[key], key))
            row = _first_row(cut, shares, width, decimal)
            heading = [cells for cells in rows[:row] if cells]
            last = heading[-1] if heading else []
            whole = len(last) == width
            while last and not last[-1]:
                last = last[:-1]
            near = width > 2 and abs(len(last) - width) == 1
            fits = 3 if not heading or whole or len(last) == width else 2 if near else 1
            fits = 1 if heading and shares[row - 1] >= 0.5 else fits
            table = zip(rows[row:], shares[row:], strict=True)
            total = sum(share * share for cells, share in table if len(cells) == width)
            score = (round(total * fits, 6), width)
            if score > best_score:
                best, best_score = (separator, decimal, row, width), score
    return best


_SPACED = re.compile(r"[^\s\[(]\S*[ \t]+(?:\[[^\s\[\]]*\]|\([^\s()]*\))(?!\S)|\S+")
"""Cells between spaces; a unit in brackets belongs to the name before it."""


_WITH_UNIT = re.compile(r"[^\[\]()]+(?:\[[^\[\]()]*\]|\([^\[\]()]*\))")
_BRACKETS = re.compile(r"\[[^\]]*\]|\([^)]*\)")
_UNIT = re.compile(r"(?<=[\d.,])\s?[^\W\d_]{1,4}\Z")


def split_line(line: str, separator: str) -> list[str]:
    """Return the cells of a line."""
    if separator == " ":
        return _SPACED.findall(line)
    if not line.strip():
        return []
    return [
        cell.strip()
        for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    ]


def _share(cells: Sequence[str], decimal: str) -> float:
    """Return the share of the filled cells that are numbers, times or known gaps."""
    filled = [cell for cell in cells if cell]
    found = [_weight(cell, decimal) or _is_curve(cell, cells, decimal) for cell in filled]
    if not filled or not any(found):
        return 0.0
    gaps = sum(
        1 for cell, weight in zip(filled, found, strict=True) if not weight and is_missing(cell)
    )
    return (sum(found) + gaps) / len(filled)


def _weight(cell: str, decimal: str) -> float:
    if PLAIN[decimal].fullmatch(plain_sign(cell)[:80]):
        return 1.0
    if is_stamp(cell) or is_date(cell):
        return 1.0
    return _GROUPED_WEIGHT if is_number(cell, decimal) else 0.0


def _is_curve(cell: str, cells: Sequence[str], decimal: str) -> bool:
    """Return True for a list of numbers in one of several cells; alone it may be a row."""
    return len(cells) > 1 and bool(curve_parts(cell, decimal))


def _first_row(
    rows: Sequence[Sequence[str]], shares: Sequence[float], width: int, decimal: str
) -> int:
    """Return the first row of the table: the first as wide whose first filled cell is a value."""
    fitting = [n for n, cells in enumerate(rows) if len(cells) == width and shares[n] >= 0.5]
    unlabelled = [number for number in fitting if not rows[number][0]]
    usual = unlabelled if 2 * len(unlabelled) > len(fitting) else fitting
    kinds = rows[usual[len(usual) // 2]]
    first = next((place for place, cell in enumerate(kinds) if _weight(cell, decimal)), 0)
    above, *below = rows[fitting[0] : fitting[0] + 4]
    numbered = [str(int(above[0]) + n) for n in range(width)] if above[0] in ("0", "1") else []
    if above == numbered and any(_are_words(cells, width) for cells in below):
        del fitting[0]  # the numbers of the columns
    for number in fitting:
        cells = rows[number]
        if first == 1 and cells[0] and not kinds[0] and number != fitting[-1]:
            continue  # a label above an empty first column
        if _weight(cells[first], decimal) or number == fitting[-1]:
            return _with_gaps_above(rows, number, width)
    return fitting[0]


def _are_words(cells: Sequence[str], width: int) -> bool:
    return len(cells) == width and all(c[:1].isalpha() and not is_missing(c) for c in cells)


def _with_gaps_above(rows: Sequence[Sequence[str]], number: int, width: int) -> int:
    """Return the first row of a table that begins with overloads in all columns."""
    while number and len(rows[number - 1]) == width:
        filled = [cell for cell in rows[number - 1] if cell]
        if not filled or not all(is_missing(cell) for cell in filled):
            break
        number -= 1
    return number
