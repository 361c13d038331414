"""Foreign objects as they are written on a command line."""

from collections.abc import Iterable
from typing import Any

from turnout.core.errors import PanelError
from turnout.core.problems import choices, nearest
from turnout.core.units import LENGTH, parse_quantity
from turnout.law.object_kind import PARAMETERS
from turnout.panel.foreign_object import PANEL_DEFAULTS, ForeignObject


def parse_object(text: str) -> ForeignObject:
    """Read an object from a command line.

    Parameters
    ----------
    text : str
        SIZE@PLACE, such as "13mm@sleeper6" or "13 mm @ x = 3.6 m"; SIZE KIND@PLACE, KEY=VALUE, ...
        for other kinds, such as "20mm ice@sleeper6, length=2m, temperature=-10 degC".

    Returns
    -------
    ForeignObject
        The object; its place is looked up later, in a panel.

    Raises
    ------
    PanelError
        When the text is not of that form.

    Examples
    --------
    >>> parse_object("13mm@sleeper6")
    ForeignObject(size=0.013, at='sleeper6', rail=None, ...)
    >>> parse_object("20 mm snow @ drive 1, density = 400 kg/m^3").density
    400.0
    """
    size, sign, rest = text.partition("@")
    place, *pairs = rest.split(",")
    if not sign or not size.strip() or not place.strip():
        problem = (
            f'"{text}" is not SIZE@PLACE, such as 13mm@sleeper6 or "13 mm @ x = 3.6 m", nor '
            'SIZE KIND@PLACE, KEY=VALUE, such as "20mm ice@sleeper6, length=2m"'
        )
        raise PanelError([problem], source="foreign object")
    size, kind = _size_and_kind(size.strip())
    try:
        length = parse_quantity(size, LENGTH)
    except ValueError as error:
        problem = f'size = "{size}": {error}'
        raise PanelError([problem], source="foreign object") from None
    return ForeignObject(length, place.strip(), kind=kind, **_read_pairs(text, pairs))


def _size_and_kind(text: str) -> tuple[str, str]:
    """Separate the kind at the end of a size, if the text is no length alone."""
    size, _, last = text.rpartition(" ")
    if not size or not last.isalpha():
        return text, "spring"
    try:
        parse_quantity(text, LENGTH)
    except ValueError:
        return size.strip(), last.lower()
    return text, "spring"


def _read_pairs(text: str, pairs: Iterable[str]) -> dict[str, Any]:
    """Read KEY=VALUE of an object on a command line; values are read with the object."""
    found: dict[str, Any] = {}
    problems = []
    allowed = (*PANEL_DEFAULTS, *PARAMETERS)
    for pair in pairs:
        key, sign, value = (part.strip() for part in pair.partition("="))
        if not sign or not value:
            problems.append(f'"{text}": "{pair.strip()}" is not KEY=VALUE')
        elif key not in allowed:
            what = f'"{text}": an object has no "{key}"'
            problems.append(f"{what}{nearest(key, allowed)}; there are {choices(allowed)}")
        elif key == "piece":
            try:
                found[key] = float(value)
            except ValueError:
                problems.append(f'piece = "{value}": must be a plain number')
        else:
            found[key] = value
    if problems:
        raise PanelError(problems, source="foreign object")
    return found


def parse_objects(texts: Iterable[str]) -> list[ForeignObject]:
    """Read objects from a command line, with the problems of all of them at once.

    Examples
    --------
    >>> [item.at for item in parse_objects(["13mm@sleeper6", "5mm@drive2"])]
    ['sleeper6', 'drive2']
    """
    found: list[ForeignObject] = []
    problems: list[str] = []
    given = list(texts)
    for text in given:
        try:
            found.append(parse_object(text))
        except PanelError as error:
            named = [item if text in item else f'"{text}": {item}' for item in error.problems]
            problems += named if len(given) > 1 else error.problems
    if problems:
        raise PanelError(problems, source="foreign object")
    return found
