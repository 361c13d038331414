"""Values of a run sheet: size, place, direction, numbers, yes and no."""

import re
from typing import Any

from turnout.files.problems import choices, nearest
from turnout.files.units import LENGTH, parse_quantity
from turnout.measurement.motion import CLOSING, OPENING

# A larger object does not fit into any flangeway: its unit is wrong [m].
LARGEST = 0.2
FAMILIES = ("sleeper", "drive", "sensor", "chair", "stud", "stop", "link", "fastening")
_NAMED = re.compile(rf"({'|'.join(FAMILIES)})\s*[-_ ]?\s*(\S.*)\Z", re.IGNORECASE)
_TRUTH = {"yes": True, "no": False, "true": True, "false": False, "1": True, "0": False}
_DIRECTIONS = {CLOSING: CLOSING, OPENING: OPENING, "close": CLOSING, "open": OPENING}


def normal_place(text: str) -> str:
    """Return a place as all datasets write it.

    One word alone is taken as it is, since objects may lie at something that has a name on site.

    Raises
    ------
    ValueError
        When it is of no family of places, or a position has no unit.

    Examples
    --------
    >>> normal_place("Sleeper6"), normal_place("x=3600 mm"), normal_place("-")
    ('sleeper 6', 'x = 3.6 m', 'none')
    """
    words = " ".join(text.split())
    if words.lower() in ("", "-", "none", "no object"):
        return "none"
    if re.match(r"x\s*=", words, re.IGNORECASE):
        return f"x = {parse_quantity(words.split('=', 1)[1], LENGTH):.9g} m"
    named = _NAMED.match(words)
    if named is None and " " in words:
        hint = nearest(words.split()[0], FAMILIES)
        message = f"must be {choices(FAMILIES)} and a name, or such as 'x = 3.6 m'{hint}"
        raise ValueError(message)
    return f"{named[1].lower()} {named[2]}" if named else words


def object_size(value: Any) -> float:
    """Return the size of an object in a unit [m]; ValueError when it is none, or too large.

    Examples
    --------
    >>> object_size("1.3 cm")
    0.013
    """
    size = parse_quantity(value, LENGTH)
    if size < 0:
        message = "must be at least 0"
        raise ValueError(message)
    if size > LARGEST:
        message = f"{size:g} m is no object in a switch, at most {LARGEST:g} m; check the unit"
        raise ValueError(message)
    return size


def whole_number(value: Any) -> int:
    """Return a number of a movement or a repeat; ValueError when it is no whole number from 1.

    Examples
    --------
    >>> whole_number("2")
    2
    """
    if isinstance(value, bool) or not re.fullmatch(r"[1-9]\d{0,5}", str(value)):
        message = "must be a whole number from 1"
        raise ValueError(message)
    return int(value)


def direction_name(value: Any) -> str:
    """Return "closing" or "opening", also for "close" and "open"; ValueError for anything else.

    Examples
    --------
    >>> direction_name("Open")
    'opening'
    """
    known = _DIRECTIONS.get(str(value).strip().lower())
    if known is None:
        message = f'must be "{CLOSING}" or "{OPENING}"'
        raise ValueError(message)
    return known


def truth(value: Any) -> bool:
    """Return what yes or no says; ValueError for anything else.

    Examples
    --------
    >>> truth("Yes")
    True
    """
    known = _TRUTH.get(str(value).strip().lower())
    if known is None:
        message = "must be yes or no"
        raise ValueError(message)
    return known
