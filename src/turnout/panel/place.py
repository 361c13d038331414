"""Places along the rails by name: "sleeper 6", "drive 1", "sensor TKK1", "chair 5", "x = 3.6 m"."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from turnout.core.problems import choices, nearest, shortened
from turnout.core.units import LENGTH, parse_quantity

SAME_PLACE = 1e-6
"""Positions nearer to each other than this are one place [m]."""
PLACE_FAMILIES = ("sleeper", "drive", "sensor", "chair", "stud", "stop", "link", "fastening")
_FIELD_NAMES = ("sleeper", "drive", "sensor")
_NAMED = re.compile("|".join(PLACE_FAMILIES), re.IGNORECASE)
# May stand between family and name.
_BETWEEN = "-_:#. "
MOST_PANELS = 16
"""So many panels have their names in memory in lower case: throws of a study share them."""
_FORMS = "'sleeper 6', 'drive 1', 'sensor TKK1' or 'TKK1', 'chair 5' or 'x = 3.6 m'"


@dataclass(frozen=True, slots=True)
class Place:
    """A place along the rails: its position [m] and the family and name that it was given by."""

    x: float
    family: str = ""
    name: str = ""


def place_name(panel: Any, x: float) -> str:
    """Return the name of the part of a panel at a place, as it is called in the field.

    Parameters
    ----------
    panel : Panel
        With its sleepers, drives and sensors.
    x : float
        From the toe [m].
    """
    for family in _FIELD_NAMES:
        for name, member in getattr(panel, family).items():
            if abs(member.x - x) < SAME_PLACE:
                return f"{family} {name}"
    return f"x = {x:g} m"


def find_place(families: Mapping[str, Mapping[str, Any]], at: str) -> Place:
    """Find a place.

    Parameters
    ----------
    families : mapping
        Records with an `x` by family and name.
    at : str
        A family and a name, a name that occurs only once, or a position.

    Returns
    -------
    Place
        Where it is.

    Raises
    ------
    ValueError
        When there is no such place; the text lists the names there are.
    """
    text = at.strip()
    sign, _, position = text.partition("=")
    if sign.strip().lower() == "x" and position.strip():
        return Place(parse_quantity(position.strip(), LENGTH))
    alone = _places_called(families, text)
    if len({place.x for place in alone}) == 1:
        return alone[0]
    named = _NAMED.match(text)
    if alone and not named:
        whole = " or ".join(f"'{place.family} {place.name}'" for place in alone)
        message = f"is not the name of one place only; write {whole}"
        raise ValueError(message)
    name = text[named.end() :].strip() if named else ""
    if named and name not in families.get(named[0].lower(), {}):
        name = name.lstrip(_BETWEEN)
    if not named or not name:
        message = f"is not a place; write {_FORMS}{nearest(text, _place_names(families))}"
        raise ValueError(message)
    family = named[0].lower()
    members = families.get(family, {})
    if name in members:
        return Place(members[name].x, family, name)
    matches = [known for known in members if known.lower() == name.lower()]
    if len(matches) == 1:
        return Place(members[matches[0]].x, family, matches[0])
    message = (
        f"there is no {family} '{shortened(name)}'{nearest(name, members)}; "
        f"there are {choices(members)}"
    )
    raise ValueError(message)


def _places_called(families: Mapping[str, Mapping[str, Any]], text: str) -> list[Place]:
    """Return the places of any family whose whole name is a text, whatever its case."""
    names = tuple([tuple(families.get(family, ())) for family in PLACE_FAMILIES])
    called = _names_by_lower(names).get(text.lower(), ())
    return [Place(families[family][name].x, family, name) for family, name in called]


@lru_cache(maxsize=MOST_PANELS)
def _names_by_lower(names: tuple[tuple[str, ...], ...]) -> dict[str, list[tuple[str, str]]]:
    """Return family and name of the members of all families, by their names in lower case."""
    found: dict[str, list[tuple[str, str]]] = {}
    for family, members in zip(PLACE_FAMILIES, names, strict=True):
        for name in members:
            found.setdefault(name.lower(), []).append((family, name))
    return found


def _place_names(families: Mapping[str, Mapping[str, Any]]) -> list[str]:
    return [f"{family} {name}" for family in PLACE_FAMILIES for name in families.get(family, {})]
