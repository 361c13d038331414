"""Layout of a text file of numbers: encoding, separator, decimal mark, heading, first row.

Loggers and oscilloscopes write up to a page above the numbers. A line that begins with a label
(Sample rate, INTERVAL, VERT_UNITS, TraceName) states something for the whole table or for each
column; of the rows as wide as the table, one names the columns and one may hold their units.
"""

import codecs
import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import groupby, pairwise

from turnout.core.errors import refused_of
from turnout.core.sheet_rows import split_row
from turnout.measurement.formats.assemble import is_unit, split_unit, tidy_unit
from turnout.measurement.formats.clock import (
    StatedClock,
    is_rate_name,
    is_time_name,
    is_time_unit,
    squeezed,
)
from turnout.measurement.formats.numbers import (
    PLAIN,
    curve_parts,
    is_missing,
    is_number,
    numbers,
    plain_sign,
)
from turnout.measurement.formats.time_axis import is_date, is_stamp, rises_evenly

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
# More numbers with zeros in front than these are digits behind a decimal comma.
_MOST_STATES = 2


_NAMES = re.compile(
    r"signals?|names?|channels?|channelnames?|channeltitles?=?|tracename|labels?|title|titles|"
    r"kanal(?:e|namen?)?|bezeichnung|signalname|ynames?"
)
_UNITS = re.compile(
    r"units?|vertunits?|verticalunits?|vunits?|yunits?|yunitlabel|channelunits?|einheit(?:en)?|"
    r"enhet|unitname"
)
_PARTED = re.compile(r"\s*([^;,\t]{2,60}?)\s*[;,\t]\s*(.*\S)\s*")
SHORT, LONG = "\0", "\1"
"""In place of the name that a row lacks, wherever it belongs; and of a row with one too many."""
_SPOKEN = re.compile(r"\W*([^\W\d][^\d]*?)\s+([+\-]?[\d.,]+\s?[^\W\d]\S*)")
"""A statement without a separator: "Abtastrate 25 Hz"."""
_LABEL_ALONE = re.compile(r"[^:=]*[:=]\s*(?:[,;\t]|\Z)")
_NUMBERED = re.compile(r"(\d+) ?= ?([^\W\d].*)")
"""A statement, "1=Force"; one above each column, with its number, is its name."""
_NEXT_LABEL = re.compile(r"[;,]\s+(?=[^\W\d][^:=]*[:=])")
_LABELLED = re.compile(r'\s*["#%]*\s*([^:=\t;,"]{2,60}?)\s*["]?\s*[:=]\s*(.*\S)\s*')


_SPACED = re.compile(r"\"[^\"]*\"(?!\S)|[^\s\[(]\S*[ \t]+(?:\[[^\s\[\]]*\]|\([^\s()]*\))(?!\S)|\S+")
"""Cells between spaces; a unit in brackets belongs to the name before it."""
_WITH_UNIT = re.compile(r"[^\[\]()]+(?:\[[^\[\]()]*\]|\([^\[\]()]*\))")
_BRACKETS = re.compile(r"\[[^\]]*\]|\([^)]*\)")
_EMPTY_CELL = re.compile(r"\S *\t *\t *\S")
_UNIT = re.compile(r"(?<=[\d.,])\s?[^\W\d_]{1,4}\Z")


@dataclass(slots=True)
class Heading:
    """Names, units and clock above the numbers.

    Attributes
    ----------
    names, units : list of str
        One a column; empty if there are none.
    stated : StatedClock
        Rate, interval and start.
    empty : set of int
        Columns that name facts of the heading and hold no samples.
    """

    names: list[str] = field(default_factory=list)
    units: list[str] = field(default_factory=list)
    stated: StatedClock = field(default_factory=StatedClock)
    empty: set[int] = field(default_factory=set)


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
    for place, name in ((1, "utf-16-le"), (0, "utf-16-be")):
        zeros = half[place::2].count(0)
        if half and b"\0" not in half[1 - place :: 2] and zeros > 0.8 * len(half) / 2:
            return name
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
    >>> layout.separator, layout.decimal, layout.first_row
    (';', ',', 1)
    >>> layout.heading.names, layout.heading.units
    (['Time', 'Rod 1'], ['s', 'mV/V'])
    """
    with refused_of(source):
        return _layout(sample)


def _layout(sample: bytes) -> TextLayout:
    encoding = encoding_of(sample)
    text = codecs.getincrementaldecoder(encoding)("replace").decode(sample)
    if "\0" in text:
        message = "is no text file and of no format that is known"
        raise ValueError(message)
    # Only line ends count: a form feed or a Unicode separator is no new line to a reader of rows.
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if len(sample) >= SAMPLE_SIZE and len(lines) > 1:
        lines = lines[:-1]
    best = _best(lines[:MOST_ROWS])
    if best is None or best[2] > MOST_ROWS // 2:
        best = _best(lines) or _best(lines[:MOST_ROWS], units=True)
    if best is None:
        first = next((line.strip() for line in lines if line.strip()), "")[:60]
        shown = "".join(char if char.isprintable() else " " for char in first)
        message = f"there are no rows of numbers in it (it begins with: {shown})"
        raise ValueError(message)
    separator, decimal, first_row, width = best
    above = _heading_rows(lines[:first_row], separator, width)
    below = [split_line(line, separator) for line in lines[first_row : first_row + MOST_ROWS]]
    shows = any(decimal in cell and not is_stamp(cell) for cells in below for cell in cells)
    table = [cells for cells in below if len(cells) == width]
    loose = _loose_rows(above, width, decimal)
    if max(loose, default=0) > _MOST_LOOSE_ROWS:
        message = "holds tables of different widths; save each in a file of its own"
        raise ValueError(message)
    names = [len(cells) for cells in above if not any(is_number(cell, ".") for cell in cells)]
    if separator == "," and _parts_decimals(table, max(names, default=0)):
        message = "the comma may part its columns and its decimals; export it with semicolons"
        raise ValueError(message)
    heading = _heading(above, table, decimal, shows=shows)
    alone = (width, decimal) == (1, ",") and not any(heading.names)
    if alone and _parts_columns([cells[0] for cells in table]):
        message = "the comma may part its columns or its decimals; name each column above them"
        raise ValueError(message)
    if len(table) > 3 and not _goes_on(table, decimal):
        _refuse_numbers(first_row + 1, table[0], decimal, below=True)
    return TextLayout(encoding, separator, decimal, first_row, width, heading, sum(loose))


def _heading(
    rows: Sequence[Sequence[str]], table: Sequence[Sequence[str]], mark: str, *, shows: bool
) -> Heading:
    """Read the rows above the numbers.

    Parameters
    ----------
    rows, table : sequence of sequence of str
        Cells of each row above the numbers, and of those below.
    mark : str
        Decimal mark of the table.
    shows : bool
        Whether its numbers show that mark.

    Raises
    ------
    ValueError
        When a rate or an interval is stated that is none, or a row has names for some columns.
    """
    width, decimal = len(table[0]), mark if shows else None
    # A column that holds samples must have a name if another has.
    filled = [any(cells[place] for cells in table) for place in range(width)]
    last_filled, found = width < 2 or filled[-1], Heading()
    rows = _without_facts(rows, found, decimal)
    while not (width < 2 or filled[width - 1] or (rows and rows[-1][width - 1 : width] > [""])):
        width -= 1
    # The first column may only hold the labels of the heading.
    first_empty = 10 * sum(bool(cells[0]) for cells in table) < len(table)
    unnamed_first = _unnamed_first(table, mark)
    wide: list[tuple[int, list[str]]] = []
    logger = bool(rows) and [cell.strip('"').upper() for cell in rows[0][:1]] == ["TOA5"]
    for number, row in enumerate(rows):
        cells = [cell.strip().strip('"').strip() for cell in row]
        whole = len(cells) == width
        if whole and not cells[0] and _labelled(cells[1:] or [""], width, found, decimal):
            continue
        factors = cells[:1] == [""] and (whole or _are_numbers([cell for cell in cells if cell]))
        if len(cells) > 1 and not cells[0].strip("#%!/ ") and not factors:
            cells = cells[1:]  # the mark of a comment
            whole = len(cells) == width
        while cells and not cells[-1]:
            cells.pop()
        if not cells or cells[0].lower().startswith("sep=") or (logger and number == 0):
            continue
        left_out = found.stated.leaves_out(" ".join(cells))
        # Below a time a word before as many numbers is no statement, unless one of a rate.
        named = any(is_time_name(split_unit(cell)[0]) for _, above in wide for cell in above)
        timed = named and whole and width > 1 and _are_numbers(cells[1:])
        first = split_unit(cells[0])[0]
        digits = whole and width > 1 and is_time_name(first) and all(map(str.isdigit, cells[1:]))
        words = is_rate_name(first) or not (timed or digits)  # digits may be names
        if words and _labelled(cells, width, found, decimal, beside=not first_empty) or left_out:
            continue
        numbered = [_NUMBERED.fullmatch(cell) for cell in cells] if whole and width > 1 else []
        if [match and int(match[1]) for match in numbered] == list(range(1, len(numbered) + 1)):
            cells = [match[2] if match else "" for match in numbered] or cells
        if _NUMBERED.match(cells[0]) or (len(cells) < 3 and _LABEL_ALONE.match(cells[0])):
            continue
        if first_empty and cells[0] and not (whole and number == len(rows) - 1):
            continue
        unit_alone = whole and len(cells) == 1 and is_time_unit(tidy_unit(cells[0]))
        if unit_alone or max(width - 1, 2 if width > 1 else 1) <= len(cells) <= width + 1:
            cells[0] = re.sub(r"\A(?:[#%!]|//)+ *", "", cells[0])
            if len(cells) == width - 1 and last_filled and not whole:
                cells = ["" if unnamed_first else SHORT, *cells]
            cells[0] = f"{LONG * (len(cells) > width)}{cells[0]}"
            wide.append((number + 1, [*cells, *[""] * width][:width]))
    if logger and len(wide) > 2:
        found.names = wide[0][1]
        found.units = [tidy_unit(text) if is_unit(text) else "" for text in wide[1][1]]
        return found
    _choose(wide, found, decimal)
    return found


def _labelled(
    cells: list[str], width: int, found: Heading, decimal: str | None, *, beside: bool = False
) -> bool:
    """Take a row that begins with a label; return False if it does not.

    The label stands beside the columns, or above the first if that is empty.
    """
    label, values = cells[0], cells[1:]
    if len(cells) == width > 2 and len(set(cells[::2])) == 1:  # a label beside each value
        kind = squeezed(label)
        if _NAMES.fullmatch(kind) or _UNITS.fullmatch(kind):
            texts = ["" if place % 2 == 0 else text for place, text in enumerate(cells)]
            if _NAMES.fullmatch(kind):
                found.names = texts
            else:
                found.units = [tidy_unit(text) for text in texts]
            return True
        if found.names or all(is_number(text, decimal or ".") for text in cells[1::2]):
            name, unit = split_unit(label)
            found.stated.read(name, cells[1::2], unit=unit, decimal=decimal)
            return True
    if match := _LABELLED.fullmatch(cells[0]):
        first = _NEXT_LABEL.split(match[2].lstrip(",;\t "))[0]
        label, values = match[1], [first, *values]
    elif (len(cells) == 1 or not any(" " in c for c in cells)) and (
        match := _SPOKEN.fullmatch(" ".join(cells))
    ):
        if found.stated.read(match[1], [match[2]], decimal=decimal):
            return True
    elif len(cells) > 1 and label.endswith((":", "=")):
        label = label[:-1].strip()
    elif len(cells) == 1 and (match := _PARTED.fullmatch(label)):
        label, values = match[1], [match[2]]
    if not values or is_number(label, decimal or "."):
        return False
    key = squeezed(label)
    if len(cells) >= width + beside and _NAMES.fullmatch(key):
        found.names = _padded([split_unit(text)[0] for text in values], width)
        return True
    if len(cells) >= width - 1 + beside and _UNITS.fullmatch(key):
        found.units = _padded([tidy_unit(text) for text in values], width)
        return True
    if found.stated.read_unit(label, values):
        return True
    name, unit = split_unit(label)
    values = [value for value in values if value]
    if values and not any(character.isdigit() for character in values[0]):
        return False
    stated = found.stated
    return (
        stated.read(label, values, decimal=decimal)
        or stated.read(name, values, unit=unit, decimal=decimal)
        or stated.doubt(label, " ".join(values))
    )


def _padded(texts: list[str], width: int) -> list[str]:
    """Return a text a column, of which a label may stand above the first."""
    return [*[""] * (width - len(texts)), *texts]


def _choose(wide: list[tuple[int, list[str]]], found: Heading, decimal: str | None) -> None:
    """Choose the row of names and the row of units; numbers below the names cannot be read."""
    rows = [cells for _, cells in wide]
    unit_rows = [n for n, cells in enumerate(rows) if _are_units(cells, others=len(rows) > 1)]
    timed = [n for n, row in enumerate(rows) if any(is_time_name(split_unit(c)[0]) for c in row)]
    names: int | None = None
    if timed:
        names = min(timed, key=lambda n: (sum(is_unit(cell) for cell in rows[n] if cell), -n))
    elif unit_rows and not found.names and len(rows) > 1:
        names = unit_rows[-1] - 1 if unit_rows[-1] else 1
        if any(is_number(c, decimal or ".") and not c.isdigit() for c in rows[names]):
            names = unit_rows[-1]
    elif rows and not (found.names and unit_rows):
        names = len(rows) - 1
    near = [n for n in unit_rows if n != names and (names is None or n >= names - 1)]
    if near:
        found.units = [tidy_unit(text.lstrip(SHORT)) for text in rows[near[-1]]]
    for place, (number, cells) in enumerate(wide):
        if names is None or (place >= names and place not in near[-1:]):
            _refuse_numbers(number, cells, decimal, below=names is not None and place > names)
    if names is None or all(found.names[1:]) and found.names:
        return
    if rows[names][0].startswith((SHORT, LONG)):
        count = len(rows[names])
        held = count - 1 if rows[names][0] == SHORT else count + 1
        message = f"line {wide[names][0]} has {held} names for {count} columns; name each"
        raise ValueError(message)
    pairs = [split_unit(text) for text in rows[names]]
    given = found.names or [""] * len(pairs)
    found.names = [own or name for own, (name, _) in zip(given, pairs, strict=True)]
    own = [unit for _, unit in pairs]
    found.units = [a or b for a, b in zip(own, found.units or own, strict=True)]


def _refuse_numbers(line: int, cells: list[str], decimal: str | None, *, below: bool) -> None:
    """Refuse a row that seems to be one of numbers with something unreadable before them."""
    filled = [cell for cell in cells if cell]
    # Which may be digits, also alike behind the name of a time.
    timed = any(is_time_name(split_unit(cell)[0]) for cell in filled[:1])
    no_names = below or (len({*filled}) < len(filled) and not timed)
    values = [c for c in filled if is_number(c, decimal or ".") and (no_names or not c.isdigit())]
    if 2 * len(values) >= len(filled) > 0:
        wrong = next((cell for cell in filled if cell not in values), "")
        message = (
            f"line {line}: '{wrong[:40]}' is not a number, in a row of numbers above the table"
        )
        if not wrong:
            message = (
                f"line {line}: '{filled[0][:40]}' is in a row of numbers above the table with an "
                "empty cell; leave it out, or fill the cell if it is the first sample"
            )
        if wrong.startswith((SHORT, LONG)):
            message = f"line {line} has fewer or more cells than the table; give all rows the same"
        raise ValueError(message)


def _are_units(cells: list[str], *, others: bool) -> bool:
    """Return True if half of the cells at least are units, and none can be a name alone."""
    filled = [cell for cell in cells if cell]
    if not filled:
        return False
    bracketed = sum(cell[0] + cell[-1] in ("()", "[]") for cell in filled)
    known = sum(is_unit(cell) for cell in filled if not cell.isdigit())
    return bracketed == len(filled) or known == len(filled) or (others and 2 * known >= len(filled))


def _without_facts(
    rows: Sequence[Sequence[str]], found: Heading, decimal: str | None
) -> list[list[str]]:
    """Read facts among the names of an oscilloscope, "t0 = -0.1", or below: Start, Increment."""
    kept = [list(cells) for cells in rows]
    for cells in kept:
        for place, cell in enumerate(cells) if len(cells) > 2 and "=" not in cells[0] else ():
            match = _LABELLED.fullmatch(cell) if "=" in cell else None
            if match and found.stated.read(match[1], [match[2]], decimal=decimal):
                cells[place] = ""
    names, below = kept[-2:] if len(kept) > 1 else ([], [])
    for place, (name, text) in enumerate(zip(names, below, strict=False)):
        if name and not is_time_name(name) and is_number(text, decimal or "."):
            with suppress(ValueError):
                if found.stated.read(name, [f"{text} s"], decimal=decimal):
                    found.empty.add(place)
                    names[place] = below[place] = ""
    return kept


def _loose_rows(above: Sequence[Sequence[str]], width: int, decimal: str) -> list[int]:
    """Return how many rows of numbers of one other width lie together, for each such place."""
    widths = [
        len(cells) if all(value_weight(cell, decimal) for cell in cells) else 0
        for cells in above
        if cells
    ]
    runs = [(size, len(list(rows))) for size, rows in groupby(widths)]
    return [count for size, count in runs if size > 1 and size != width]


def _parts_decimals(table: Sequence[Sequence[str]], names: int) -> bool:
    """Return True if the comma between the columns of a table may be its decimal mark as well.

    There are fewer names than columns; or digits behind whole numbers have one length, some begin
    with a zero, and they differ more than those of a state.
    """
    if any("." in cell and not is_stamp(cell) for cells in table for cell in cells):
        return False
    width = len(table[0])
    zeros = any(
        all(map(str.isdigit, column))
        and len({*map(len, column)}) == 1 < len(column[0]) < 6
        and any(cell[0] == "0" for cell in column)
        and len({*column}) > _MOST_STATES
        and all(cell.lstrip("+-").isdigit() for cell in map(plain_sign, before))
        for before, column in pairwise(zip(*table, strict=True))
    )
    return names + 1 < width <= 2 * names or (zeros and names < width)


def _parts_columns(cells: Sequence[str]) -> bool:
    """Return True if a decimal comma may part two columns of whole numbers as well.

    None writes -0, or zeros in front.
    """
    parts = [plain_sign(cell).partition(",") for cell in cells]
    return all(
        comma and whole != "-0" and more.isdigit() and (more == "0" or more[0] != "0")
        for whole, comma, more in parts
    )


def _goes_on(table: Sequence[Sequence[str]], decimal: str) -> bool:
    """Return False if a first row of numbers with an empty cell may be none of the samples.

    A time goes on in it, or other rows have empty cells as well.
    """
    first, *others = table[:4]
    if all(first) or not all(map(all, others)) or not _are_numbers([c for c in first if c]):
        return True
    for column in zip(*table[:4], strict=True):
        values, wrong, _ = numbers(column, decimal)
        if not wrong and rises_evenly(values):
            return True
    return False


def _unnamed_first(table: Sequence[Sequence[str]], decimal: str) -> bool:
    """Return True if the first column may lack a name: texts, an index, or a date before a time."""
    first = [cells[0] for cells in table]
    if len(table[0]) > 1 and is_date(first[0]) and is_stamp(table[0][1]):
        return True
    if not any(value_weight(cell, decimal) for cell in first):
        return True
    plain = all(cell.isdigit() and len(cell) < 16 for cell in first)
    steps = {int(b) - int(a) for a, b in pairwise(first)} if plain else set()
    return len(steps) == 1 and steps != {0}


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
    if cells and separator == " " and any(mark in line for mark in ":=;"):
        return [line.strip()]
    first = _BRACKETS.sub("", cells[0]) if cells else ""
    return [line.strip()] if ":" in first[:-1] and not first.startswith('"') else cells


def _best(lines: Sequence[str], *, units: bool = False) -> tuple[str, str, int, int] | None:
    """Return separator, decimal mark, first row and width of the reading that explains most.

    With `units` a cell may hold a number with its unit.
    """
    best, best_score, whole_share = None, (0.0, 0), 0.0
    for separator, marks in DECIMAL_MARKS.items():
        if best is not None and not any(separator in line for line in lines):
            continue
        behind_tab = {line[0] == "\t" for line in lines if line.rstrip()[-1:].isdigit()}
        parted = best is not None and best[0] in "|\t" and best[3] > 1 and whole_share > 0.9
        gaps = parted or len(behind_tab) > 1 or any(map(_EMPTY_CELL.search, lines))
        if separator == " " and gaps:
            continue
        rows = [split_line(line, separator) for line in lines]
        for decimal in marks:
            if decimal == "," and not any("," in cell for cells in rows for cell in cells):
                continue
            cut = [[_UNIT.sub("", c) for c in cells] for cells in rows] if units else rows
            shares = [_share(cells, decimal) for cells in cut]
            bare = [_share(cells, decimal) for cells in _without_texts(cut)]
            shares = [b if b >= _GROUPED_WEIGHT else a for a, b in zip(shares, bare, strict=True)]
            widths = Counter(len(c) for c, share in zip(rows, shares, strict=True) if share >= 0.5)
            if not widths:
                continue
            width = max(widths, key=lambda key: (widths[key], key))
            row = _first_row(cut, [share >= 0.5 for share in shares], width, decimal)
            heading = [cells for cells in rows[:row] if cells]
            last = heading[-1] if heading else []
            whole = len(last) == width
            while last and not last[-1]:
                last = last[:-1]
            titled = separator == " " and best is not None and best[0] == "\t"
            near = width > 2 and abs(len(last) - width) == 1 and not titled
            fits = 3 if not heading or whole or len(last) == width else 2 if near else 1
            # Numbers with an empty cell before them are factors or names.
            missed = all(last) and (shares[row - 1] >= 0.5 or _are_numbers(last))
            fits = 1 if heading and missed else fits
            table = zip(rows[row:], shares[row:], strict=True)
            squares = [share * share for cells, share in table if len(cells) == width]
            score = (round(sum(squares) * fits, 6), width)
            if score > best_score:
                best, best_score = (separator, decimal, row, width), score
                whole_share = sum(squares) / len(squares)
    return best


def _without_texts(rows: Sequence[Sequence[str]]) -> list[Sequence[str]]:
    """Return rows with empty cells in the columns that hold texts in all but a tenth of them."""
    usual = Counter(len(cells) for cells in rows if len(cells) > 2).most_common(1)
    width = usual[0][0] if usual else 0
    table = [cells for cells in rows if len(cells) == width]
    held = [sum(map(_is_no_text, column)) for column in zip(*table, strict=True)]
    kept = [10 * count > len(table) for count in held]
    return [
        [cell * keep for cell, keep in zip(cells, kept, strict=True)] if len(cells) == width
        else cells for cells in rows
    ]  # fmt: skip


def _is_no_text(cell: str) -> bool:
    """Return True for numbers, times and curves, and for what seems to be several cells."""
    several = any(map(str.isdigit, cell)) and any(mark in cell for mark in ";,|\t")
    return several or any(value_weight(cell, mark) for mark in ".,")


def _are_numbers(cells: Sequence[str]) -> bool:
    """Return True if all cells are numbers, whatever the decimal mark of each."""
    plain = [plain_sign(cell) for cell in cells]
    return bool(plain) and all(any(p.fullmatch(c) for p in PLAIN.values()) for c in plain)


def split_line(line: str, separator: str) -> list[str]:
    """Return the cells of a line."""
    if separator == " ":
        return [
            cell[1:-1] if cell[0] + cell[-1] == '""' else cell for cell in _SPACED.findall(line)
        ]
    return split_row(line, separator) if line.strip() else []


def _share(cells: Sequence[str], decimal: str) -> float:
    """Return the share of the filled cells that are numbers, times or known gaps."""
    filled = [cell for cell in cells if cell]
    weights = [value_weight(cell, decimal) for cell in filled]
    # A list of numbers alone in its line may be a row; beside others it counts as so many.
    texts = [cell for cell, weight in zip(filled, weights, strict=True) if not weight]
    lists = [len(curve_parts(cell, decimal)) for cell in texts if len(cells) > 1]
    found = sum(weights) + sum(lists)
    gaps = sum(map(is_missing, texts))
    more = sum(count - 1 for count in lists if count)
    return (found + gaps) / (len(filled) + more) if found else 0.0


def value_weight(cell: str, decimal: str) -> float:
    """Return how surely a cell holds a number or a time; 0 for anything else."""
    if PLAIN[decimal].fullmatch(plain_sign(cell)[:80]):
        return 1.0
    if is_stamp(cell) or is_date(cell):
        return 1.0
    return _GROUPED_WEIGHT if is_number(cell, decimal) else 0.0


def _first_row(
    rows: Sequence[Sequence[str]], held: Sequence[bool], width: int, decimal: str
) -> int:
    """Return the first row of the table: the first as wide whose first filled cell is a value."""
    fitting = [n for n, cells in enumerate(rows) if len(cells) == width and held[n]]
    unlabelled = [number for number in fitting if not rows[number][0]]
    labelled = [number for number in fitting if rows[number][0]]
    usual = unlabelled if len(unlabelled) > len(labelled) else labelled
    kinds = rows[usual[len(usual) // 2]]
    values = [bool(value_weight(c, decimal) or curve_parts(c, decimal)) for c in kinds]
    first = values.index(True) if any(values) else 0
    above, *below = rows[fitting[0] : fitting[0] + 4]
    numbered = [str(int(above[0]) + n) for n in range(width)] if above[0] in ("0", "1") else []
    tenths = width > 1 and len(below) > 2 and all(decimal in c for cells in below for c in cells)
    words = fitting[1:] and any(_are_words(cells, width) for cells in below)
    if above == numbered and (tenths or words):
        return fitting[1]  # below the numbers of the columns
    for number in fitting:
        cells = rows[number]
        labels = first == 1 and not kinds[0] and max(labelled, default=-1) < unlabelled[0]
        if labels and cells[0] and number != fitting[-1]:
            continue  # a label above an empty first column
        value = value_weight(cells[first], decimal) or curve_parts(cells[first], decimal)
        if value or number == fitting[-1]:
            return _with_gaps_above(rows, number, width, decimal)
    return fitting[0]


def _are_words(cells: Sequence[str], width: int) -> bool:
    return len(cells) == width and all(c[:1].isalpha() and not is_missing(c) for c in cells)


def _with_gaps_above(rows: Sequence[Sequence[str]], number: int, width: int, decimal: str) -> int:
    """Return the first row of a table that begins with overloads."""
    while number and len(rows[number - 1]) == width:
        above = rows[number - 1]
        # Beside an empty cell a number may be a factor, or the name of a column.
        mixed = all(cell and (is_missing(cell) or value_weight(cell, decimal)) for cell in above)
        if not mixed and not (any(above) and all(map(is_missing, above))):
            break
        number -= 1
    return number
