"""Lines above the numbers of a table: names, units, and rates, starts and dates in words.

Loggers and oscilloscopes write up to a page there. A line that begins with a label (Sample rate,
INTERVAL, VERT_UNITS, TraceName) states something for the whole table or for each column; of the
rows as wide as the table, one names the columns and one may hold their units.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from turnout.measurement.formats.assemble import is_unit, split_unit, tidy_unit
from turnout.measurement.formats.clock import StatedClock, is_time_name, squeezed
from turnout.measurement.formats.numbers import is_number

_NAMES = re.compile(
    r"signals?|names?|channels?|channelnames?|channeltitles?=?|tracename|labels?|title|titles|"
    r"kanal(?:e|namen?)?|bezeichnung|signalname|ynames?"
)
_UNITS = re.compile(
    r"units?|vertunits?|verticalunits?|vunits?|yunits?|yunitlabel|channelunits?|einheit(?:en)?|"
    r"enhet|unitname"
)
_TIME_UNITS = re.compile(r"(?:horizontal|horz|h|x|time)units?")
_PARTED = re.compile(r"\s*([^;,\t]{2,60}?)\s*[;,\t]\s*(.*\S)\s*")
SHORT, LONG = "\0", "\1"
"""In place of the name that a row lacks, wherever it belongs; and of a row with one too many."""
_SPOKEN = re.compile(r"\W*([^\W\d][^\d]*?)\s+([+\-]?[\d.,]+\s?[^\W\d]\S*)")
"""A statement without a separator: "Abtastrate 25 Hz"."""
_NEXT_LABEL = re.compile(r"[;,]\s+(?=[^\W\d][^:=]*[:=])")
_LABELLED = re.compile(r'\s*["#%]*\s*([^:=\t;,"]{2,60}?)\s*["]?\s*[:=]\s*(.*\S)\s*')


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


def read_heading(
    rows: Sequence[Sequence[str]],
    width: int,
    *,
    decimal: str | None,
    first_empty: bool = False,
    last_filled: bool = False,
    unnamed_first: bool = False,
) -> Heading:
    """Read the rows above the numbers.

    Parameters
    ----------
    rows : sequence of sequence of str
        Cells of each row.
    width : int
        Columns of the table.
    decimal : str or None
        Decimal mark of the table; None if its numbers show none.
    first_empty : bool
        Whether the first column only holds the labels of the heading.
    last_filled : bool
        Whether the last column holds samples, so that it must have a name if another has.
    unnamed_first : bool
        Whether one name too few may be that of the first column.

    Raises
    ------
    ValueError
        When a rate or an interval is stated that is none, or a row has names for some columns.

    Examples
    --------
    >>> heading = read_heading([["Abtastrate: 1.000 Hz"], ["Zeit", "Kraft 1 [kN]"]], 2, decimal=",")
    >>> heading.names, heading.units, heading.stated.rate()
    (['Zeit', 'Kraft 1'], ['', 'kN'], (1000.0,))
    """
    found = Heading()
    wide: list[tuple[int, list[str]]] = []
    logger = bool(rows) and [cell.strip('"').upper() for cell in rows[0][:1]] == ["TOA5"]
    for number, row in enumerate(rows):
        cells = [cell.strip().strip('"').strip() for cell in row]
        if len(cells) > 1 and not cells[0].strip("#%/ "):
            cells = cells[1:]  # the mark of a comment
        whole = len(cells) == width
        while cells and not cells[-1]:
            cells.pop()
        if not cells or cells[0].lower().startswith("sep=") or (logger and number == 0):
            continue
        if _labelled(cells, width, found, decimal, beside=not first_empty):
            continue
        if first_empty and cells[0]:
            continue
        if max(width - 1, 2 if width > 1 else 1) <= len(cells) <= width + 1:
            cells[0] = cells[0].lstrip("#% ")
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
    cells: list[str], width: int, found: Heading, decimal: str | None, *, beside: bool
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
    if match := _LABELLED.fullmatch(cells[0]):
        label, values = match[1], [_NEXT_LABEL.split(match[2])[0], *values]
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
    if _TIME_UNITS.fullmatch(key):
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
    if len(rows) > 1:
        _facts_below_names(rows[-2], rows[-1], found, decimal)
    unit_rows = [n for n, cells in enumerate(rows) if _are_units(cells, others=len(rows) > 1)]
    timed = [n for n, row in enumerate(rows) if any(is_time_name(split_unit(c)[0]) for c in row)]
    names: int | None = None
    if timed:
        names = min(timed, key=lambda n: (sum(is_unit(cell) for cell in rows[n] if cell), -n))
    elif unit_rows and not found.names and len(rows) > 1:
        names = unit_rows[-1] - 1 if unit_rows[-1] else 1
    elif rows and not (found.names and unit_rows):
        names = len(rows) - 1
    near = [n for n in unit_rows if n != names and (names is None or n >= names - 1)]
    if near:
        found.units = [tidy_unit(text) for text in rows[near[-1]]]
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
    values = [c for c in filled if is_number(c, decimal or ".") and (below or not c.isdigit())]
    if 2 * len(values) >= len(filled) > 0:
        wrong = next((cell for cell in filled if cell not in values), filled[0])
        message = (
            f"line {line}: '{wrong[:40]}' is not a number, in a row of numbers above the table"
        )
        raise ValueError(message)


def _are_units(cells: list[str], *, others: bool) -> bool:
    """Return True if half of the cells at least are units, and none can be a name alone."""
    filled = [cell for cell in cells if cell]
    if not filled:
        return False
    bracketed = sum(cell[0] + cell[-1] in ("()", "[]") for cell in filled)
    known = sum(is_unit(cell) for cell in filled if not cell.isdigit())
    return bracketed == len(filled) or known == len(filled) or (others and 2 * known >= len(filled))


def _facts_below_names(
    names: list[str], below: list[str], found: Heading, decimal: str | None
) -> None:
    """Read facts with a column of their own: "Start" and "Increment" of an oscilloscope."""
    for place, name in enumerate(names):
        if name and not is_time_name(name) and is_number(below[place], decimal or "."):
            try:
                if found.stated.read(name, [f"{below[place]} s"], decimal=decimal):
                    found.empty.add(place)
                    names[place] = below[place] = ""
            except ValueError:
                continue
