"""Foreign objects, and the places that they and sensors are named by.

Places by name: "sleeper 6", "drive 1", "sensor TKK1", "chair 5", "x = 3.6 m". Foreign objects: what
a user says about one, and where that puts it.
"""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from turnout.core.problems import choices, nearest, shortened, show_value
from turnout.core.units import LENGTH, STIFFNESS, TIME, Dimension, parse_quantity
from turnout.errors import PanelError
from turnout.panel.layout import largest_opening
from turnout.panel.markers import ordered_movements
from turnout.panel.model import Panel
from turnout.panel.records import PanelObject

PLACE_FAMILIES = ("sleeper", "drive", "sensor", "chair", "stud", "stop", "link", "fastening")
_NAMED = re.compile("|".join(PLACE_FAMILIES), re.IGNORECASE)
_FORMS = "'sleeper 6', 'drive 1', 'sensor TKK1', 'chair 5' or 'x = 3.6 m'"


@dataclass(frozen=True, slots=True)
class Place:
    """A place along the rails: its position [m] and the family and name that it was given by."""

    x: float
    family: str = ""
    name: str = ""


def find_place(families: Mapping[str, Mapping[str, Any]], at: str) -> Place:
    """Find a place.

    Parameters
    ----------
    families : mapping
        Records with an `x` by family and name.
    at : str
        A family and a name, or a position.

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
    named = _NAMED.match(text)
    name = text[named.end() :].strip() if named else ""
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


def _place_names(families: Mapping[str, Mapping[str, Any]]) -> list[str]:
    return [f"{family} {name}" for family in PLACE_FAMILIES for name in families.get(family, {})]


# The opening is an estimate; an object is refused only when it is larger by more than this [m].
OPENING_MARGIN = 0.003
# From this size on a number was meant in millimetres [m].
LEAST_SUSPECT = 1.0
_DIMENSIONS = {
    "size": LENGTH,
    "height": LENGTH,
    "stiffness": STIFFNESS,
    "appears": TIME,
    "disappears": TIME,
}


@dataclass(frozen=True, slots=True)
class ForeignObject:
    """An object between switch rail and stock rail, as a user describes it.

    Numbers are SI; texts carry their unit. What is left out comes from the panel's
    `object_defaults`.

    Parameters
    ----------
    size : float or str
        Extent across the gap [m].
    at : str
        "sleeper 6", "drive 1", "sensor TKK1", "chair 5" or "x = 3.6 m".
    rail : str, optional
        Switch rail that traps it.
    height : float or str, optional
        z of its contact with the switch rail [m].
    stiffness : float or str, optional
        In compression only [N/m].
    appears, disappears : float or str, optional
        When it is placed and taken away [s].

    Raises
    ------
    PanelError
        With all problems at once.

    Examples
    --------
    >>> ForeignObject("13 mm", "sleeper 6").size
    0.013
    """

    size: float | str
    at: str
    rail: str | None = None
    height: float | str | None = None
    stiffness: float | str | None = None
    appears: float | str | None = None
    disappears: float | str | None = None

    def __post_init__(self) -> None:
        """Turn texts into SI numbers."""
        problems = []
        for name, dimension in _DIMENSIONS.items():
            value = getattr(self, name)
            if value is None and name != "size":
                continue
            try:
                object.__setattr__(self, name, _quantity(name, value, dimension))
            except ValueError as error:
                problems.append(f"{name} = {show_value(value)}: {error}")
        texts: dict[str, Any] = {"at": self.at, "rail": "" if self.rail is None else self.rail}
        problems += [
            f"{name} = {show_value(value)}: must be text"
            for name, value in texts.items()
            if not isinstance(value, str)
        ]
        if problems:
            raise PanelError(problems, source="foreign object")


@dataclass(frozen=True, slots=True)
class PlacedObject:
    """A foreign object whose place and times are known, in SI.

    Parameters
    ----------
    name : str
        Its name in the panel, or its number among those given.
    size : float
        Extent across the gap [m].
    x, height : float
        Place of its contact with the switch rail [m].
    rail : str
        Switch rail that traps it.
    stiffness : float
        In compression only [N/m].
    appears, disappears : float
        When it is placed and taken away [s]; infinite if it stays.
    """

    name: str
    size: float
    x: float
    rail: str
    height: float
    stiffness: float
    appears: float
    disappears: float


def _quantity(name: str, value: Any, dimension: Dimension) -> float:
    if hasattr(value, "item"):
        value = value.item()
    number = parse_quantity(value, dimension, si=True)
    if name == "size" and number >= LEAST_SUSPECT:
        message = (
            f"metres? Nothing of {number:g} m is trapped in a switch; "
            f'write {1e-3 * number:g} or "{number:g} mm"'
        )
        raise ValueError(message)
    if number <= 0 and name in ("size", "stiffness", "disappears"):
        message = "must be more than 0"
        raise ValueError(message)
    if number < 0 and name == "appears":
        message = "must be at least 0"
        raise ValueError(message)
    return number


def parse_object(text: str) -> ForeignObject:
    """Read an object from a command line.

    Parameters
    ----------
    text : str
        SIZE@PLACE, such as "13mm@sleeper6" or "13 mm @ x = 3.6 m".

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
    """
    size, sign, place = text.partition("@")
    if not sign or not size.strip() or not place.strip():
        problem = f'"{text}" is not SIZE@PLACE, such as 13mm@sleeper6 or "13 mm @ x = 3.6 m"'
        raise PanelError([problem], source="foreign object")
    try:
        length = parse_quantity(size, LENGTH)
    except ValueError as error:
        raise PanelError([f'size = "{size.strip()}": {error}'], source="foreign object") from None
    return ForeignObject(length, place.strip())


def parse_objects(texts: Iterable[str]) -> list[ForeignObject]:
    """Read objects from a command line, with the problems of all of them at once.

    Examples
    --------
    >>> [item.at for item in parse_objects(["13mm@sleeper6", "5mm@drive2"])]
    ['sleeper6', 'drive2']
    """
    found: list[ForeignObject] = []
    problems: list[str] = []
    for text in texts:
        try:
            found.append(parse_object(text))
        except PanelError as error:
            problems += error.problems
    if problems:
        raise PanelError(problems, source="foreign object")
    return found


def resolve_objects(
    panel: Panel, objects: Iterable[ForeignObject] = ()
) -> tuple[PlacedObject, ...]:
    """Place the panel's own objects and the given ones.

    Parameters
    ----------
    panel : Panel
        A valid panel.
    objects : iterable of ForeignObject
        Further objects; none is fine.

    Returns
    -------
    tuple of PlacedObject
        Those of the panel first.

    Raises
    ------
    PanelError
        With all problems at once: unknown places or rails, objects larger than the opening.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> resolve_objects(load_panel("sb2"), [ForeignObject("13 mm", "sleeper 6")])[0].appears
    4.4
    """
    given = [(name, from_record(record)) for name, record in panel.object.items()]
    given += [(str(number), item) for number, item in enumerate(objects, 1)]
    placed, problems = [], []
    for name, item in given:
        item = _filled(panel, item)
        faults = object_faults(panel, item)
        problems += [f"object {name}: {key}{text}" for key, text in faults]
        if not faults:
            placed.append(_place(panel, name, item))
    if problems:
        raise PanelError(problems, source="foreign object")
    return tuple(placed)


def from_record(record: PanelObject) -> ForeignObject:
    """Make a foreign object from one that belongs to the panel file."""
    return ForeignObject(
        record.size,
        record.at,
        rail=record.rail,
        height=record.height,
        stiffness=record.stiffness,
        appears=record.appears,
        disappears=record.disappears,
    )


def _families(panel: Panel) -> dict[str, Any]:
    return panel.__dict__


def _filled(panel: Panel, item: ForeignObject) -> ForeignObject:
    """Take what the object leaves out from the panel's defaults."""
    defaults = panel.object_defaults
    names = ("rail", "height", "stiffness", "appears", "disappears")
    missing = {name: getattr(defaults, name) for name in names if getattr(item, name) is None}
    return replace(item, **missing) if missing else item


def _place(panel: Panel, name: str, item: ForeignObject) -> PlacedObject:
    """Place an object that leaves out no more than times."""
    rail = str(item.rail)
    return PlacedObject(
        name=name,
        size=float(item.size),
        x=find_place(_families(panel), item.at).x,
        rail=rail,
        height=float(item.height or 0.0),
        stiffness=float(item.stiffness or 0.0),
        appears=_onset(panel, rail) if item.appears is None else float(item.appears),
        disappears=math.inf if item.disappears is None else float(item.disappears),
    )


def _onset(panel: Panel, rail: str) -> float:
    """Give the start of the last movement that closes a rail, or 0 where none does."""
    to = "closed" if panel.rail[rail].closes == "+y" else "open"
    starts = [movement.start for _, movement in ordered_movements(panel) if movement.to == to]
    return starts[-1] if starts else 0.0


def object_faults(
    panel: Panel, item: ForeignObject, *, sized: bool = True
) -> list[tuple[str, str]]:
    """Find what is wrong with an object in a panel: the key and a text for each fault.

    Parameters
    ----------
    panel : Panel
        The panel.
    item : ForeignObject
        The object.
    sized : bool
        Whether the panel is sound enough to compare the size with the opening.
    """
    whole = _filled(panel, item)
    faults = []
    if whole.rail not in panel.rail:
        text = f"; there are {choices(panel.rail)}{nearest(str(whole.rail), panel.rail)}"
        faults.append(("rail", f" = {show_value(whole.rail)}: there is no such rail{text}"))
    x = None
    try:
        x = find_place(_families(panel), whole.at).x
    except ValueError as error:
        faults.append(("at", f" = {show_value(whole.at)}: {error}"))
    if sized and x is not None and whole.rail in panel.rail:
        faults += _opening_faults(panel, whole, str(whole.rail), x)
    return faults + (_time_faults(panel, whole) if sized else [])


def _opening_faults(
    panel: Panel, item: ForeignObject, rail: str, x: float
) -> list[tuple[str, str]]:
    record = panel.rail[rail]
    if not record.start <= x <= record.end:
        text = f"x = {x:g} m is not on rail '{rail}', {record.start:g} ... {record.end:g} m"
        return [("at", f" = {show_value(item.at)}: {text}")]
    opening = largest_opening(panel, rail, x)
    if opening is None:
        text = f" = {show_value(rail)}: has no stock_rail_gap, so nothing can be trapped by it"
        return [("rail", text)]
    if float(item.size) > opening + OPENING_MARGIN:
        text = (
            f" = {float(item.size) * 1e3:g} mm: larger than the opening, rail '{rail}' stands "
            f"at most about {opening * 1e3:.0f} mm open at x = {x:g} m"
        )
        return [("size", text)]
    return []


def _time_faults(panel: Panel, item: ForeignObject) -> list[tuple[str, str]]:
    faults, end = [], panel.schedule.end
    appears = None if item.appears is None else float(item.appears)
    if appears is not None and appears > end:
        faults.append(("appears", f" = {appears:g} s: is after the end of the schedule, {end:g} s"))
    if item.disappears is not None:
        gone = float(item.disappears)
        known = item.rail in panel.rail
        start = appears if appears is not None else _onset(panel, str(item.rail)) if known else 0.0
        if gone <= start:
            text = f" = {gone:g} s: must be after the object appears, {start:g} s"
            faults.append(("disappears", text))
    return faults
