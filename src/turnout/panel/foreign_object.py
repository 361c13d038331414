"""Foreign objects: the description by a user, on a command line too, and the place from it."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Any

from pydantic import ValidationError

from turnout.core.errors import PanelError
from turnout.core.problems import choices, describe_error, nearest, show_value
from turnout.core.units import LENGTH, parse_quantity
from turnout.law.object_kind import (
    OBJECT_KINDS,
    PARAMETERS,
    Trapped,
    filled_parameters,
    kind_faults,
)
from turnout.law.obstruction import NEVER
from turnout.panel.layout import largest_opening
from turnout.panel.markers import ordered_movements
from turnout.panel.model import Panel
from turnout.panel.place import find_place
from turnout.panel.records import PanelObject

# The opening is an estimate; an object is refused only when it is larger by more than this [m].
OPENING_MARGIN = 0.003
# A longer object acts at several places along the rail, each with its share [m].
LONGEST_PART = 0.3
PANEL_DEFAULTS = ("rail", "height", "stiffness", "face_slope", "appears", "disappears")
"""Fields that an object takes from the panel if left out."""


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
    face_slope : float, optional
        Vertical over lateral force on the switch rail, which is lifted where it is positive: the
        slope of a planed face against the vertical, or of a wedge below the rail [-].
    appears, disappears : float or str, optional
        When it is placed and taken away [s].
    kind : str
        "spring" (elastic, as in the paper) or another of `turnout.law.object_kind.OBJECT_KINDS`,
        which say which of the following each has, and their defaults.
    length, depth : float or str, optional
        Extent along the rail and upright [m].
    strength : float or str, optional
        Stone: splitting force over the square of the size; ice: crushing pressure; wood and metal:
        stress at which they yield [Pa].
    density : float or str, optional
        Of snow [kg/m3].
    temperature : float or str, optional
        Of ice and snow [K].
    piece : float, optional
        Share of the size that stays when a stone splits, or of ice that is crushed [-].

    Raises
    ------
    PanelError
        With all problems at once.

    Examples
    --------
    >>> ForeignObject("13 mm", "sleeper 6").size
    0.013
    >>> ForeignObject("20 mm", "sleeper 6", kind="ice", temperature="-10 degC").temperature
    263.15
    """

    size: float | str
    at: str
    rail: str | None = None
    height: float | str | None = None
    stiffness: float | str | None = None
    face_slope: float | None = None
    appears: float | str | None = None
    disappears: float | str | None = None
    kind: str = "spring"
    length: float | str | None = None
    depth: float | str | None = None
    strength: float | str | None = None
    density: float | str | None = None
    temperature: float | str | None = None
    piece: float | None = None

    def __post_init__(self) -> None:
        """Turn texts into SI numbers."""
        given = {name: value for name in _FIELDS if (value := getattr(self, name)) is not None}
        given |= {name: value.item() for name, value in given.items() if hasattr(value, "item")}
        try:
            record = PanelObject.model_validate(given, context={"si": True})
        except ValidationError as error:
            faults = [(str(item["loc"][0]), describe_error(item)) for item in error.errors()]
        else:
            for name in given:
                object.__setattr__(self, name, getattr(record, name))
            faults = list(kind_faults(self.kind, self.parameters))
        if faults:
            raise PanelError([f"{key}{text}" for key, text in faults], source="foreign object")

    @property
    def parameters(self) -> dict[str, Any]:
        """Parameters of its kind, by name; None if left out."""
        return {name: getattr(self, name) for name in PARAMETERS}


_FIELDS = tuple(field.name for field in fields(ForeignObject))


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedObject(Trapped):
    """A foreign object whose place and times are known, in SI.

    Parameters
    ----------
    name : str
        Its name in the panel, or its number among those given.
    x, height : float
        Place of its contact with the switch rail [m].
    face_slope : float
        Vertical over lateral force on the switch rail [-].
    rail : str
        Switch rail that traps it.
    appears, disappears : float
        When it is placed and taken away [s]; infinite if it stays.
    whole : str
        Name of the object that this is a part of; empty for a whole one.
    """

    name: str
    x: float
    rail: str
    height: float
    appears: float
    disappears: float
    face_slope: float = 0.0
    whole: str = ""


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
        x, faults = _examined(panel, item, sized=True)
        problems += [f"object {name}: {key}{text}" for key, text in faults]
        if x is not None and not faults:
            placed.append(_place(panel, name, item, x))
    if problems:
        raise PanelError(problems, source="foreign object")
    return tuple(placed)


def from_record(record: PanelObject) -> ForeignObject:
    """Make a foreign object from one that belongs to the panel file."""
    return ForeignObject(**{name: getattr(record, name) for name in _FIELDS})


def _filled(panel: Panel, item: ForeignObject) -> ForeignObject:
    """Fill the gaps in an object's description with the panel's defaults."""
    defaults = panel.object_defaults
    missing = {
        name: value
        for name in PANEL_DEFAULTS
        if getattr(item, name) is None and (value := getattr(defaults, name)) is not None
    }
    if not missing:
        return item
    filled = object.__new__(ForeignObject)  # what it is made of has been checked
    for name in _FIELDS:
        object.__setattr__(filled, name, missing.get(name, getattr(item, name)))
    return filled


def _place(panel: Panel, name: str, item: ForeignObject, x: float) -> PlacedObject:
    """Place an object that leaves out no more than times at a place [m]."""
    rail, size = str(item.rail), float(item.size)
    return PlacedObject(
        name=name,
        size=size,
        x=x,
        rail=rail,
        height=float(item.height or 0.0),
        face_slope=float(item.face_slope or 0.0),
        stiffness=float(item.stiffness or 0.0),
        appears=_onset(panel, rail) if item.appears is None else float(item.appears),
        disappears=math.inf if item.disappears is None else float(item.disappears),
        kind=item.kind,
        **filled_parameters(item.kind, item.parameters, size=size),  # type: ignore[arg-type]
    )


def _onset(panel: Panel, rail: str) -> float:
    """Return the start of the last movement that closes a rail, or 0 if none does."""
    to = "closed" if panel.rail[rail].closes == "+y" else "open"
    starts = [movement.start for _, movement in ordered_movements(panel) if movement.to == to]
    return starts[-1] if starts else 0.0


def object_faults(
    panel: Panel, item: ForeignObject, *, sized: bool = True
) -> list[tuple[str, str]]:
    """Find the faults of an object in a panel: the key and a text for each.

    Parameters
    ----------
    panel : Panel
        The panel.
    item : ForeignObject
        The object.
    sized : bool
        Whether the panel is sound enough to compare the size with the opening.
    """
    return _examined(panel, _filled(panel, item), sized=sized)[1]


def _examined(
    panel: Panel, whole: ForeignObject, *, sized: bool
) -> tuple[float | None, list[tuple[str, str]]]:
    """Return the place of an object that leaves out no more than times, and its faults."""
    faults = [] if whole.stiffness is None else break_faults(whole)
    if whole.rail not in panel.rail:
        text = f"; there are {choices(panel.rail)}{nearest(str(whole.rail), panel.rail)}"
        faults.append(("rail", f" = {show_value(whole.rail)}: there is no such rail{text}"))
    x = None
    try:
        x = find_place(panel.__dict__, whole.at).x
    except ValueError as error:
        faults.append(("at", f" = {show_value(whole.at)}: {error}"))
    if sized and x is not None and whole.rail in panel.rail:
        faults += _opening_faults(panel, whole, str(whole.rail), x)
    return x, faults + (_time_faults(panel, whole) if sized else [])


def break_faults(item: ForeignObject) -> list[tuple[str, str]]:
    """Find out whether an object that breaks is squeezed flat before it can, or to its piece.

    Its compression where its force reaches the strength must be less than its size; of a long one
    that of its parts. Ice with a given piece must have a first layer beside it.
    """
    of_kind = OBJECT_KINDS[item.kind]
    if not of_kind.breaks:
        return []
    size, stiffness = float(item.size), float(item.stiffness or 0.0)
    given = filled_parameters(item.kind, item.parameters, size=size)
    given["length"] /= max(1, math.ceil(given["length"] / LONGEST_PART - 1e-9))
    whole = Trapped(kind=item.kind, size=size, stiffness=stiffness, **given)  # type: ignore[arg-type]
    curve, strength = of_kind.curve(whole), of_kind.strength(whole)
    if item.piece is not None and curve.breaks == NEVER:
        crushed = 1e3 * (1.0 - whole.piece) * size
        text = (
            f" = {whole.piece:g}: it cannot break, no more than {crushed:.2g} mm of its "
            f"{1e3 * size:g} mm may be crushed, which is less than its first layer; give a smaller "
            "piece or more size"
        )
        return [("piece", text)]
    reach = float(curve.breakpoints[1])
    if reach < size:
        return []
    key, text, less = "strength", f" = {1e-6 * strength:g} MPa", "less strength"
    if not whole.strength:
        key, text = "temperature", f" = {whole.temperature:g} K: its strength is {text[3:]}"
        less = "less frost, a strength of its own,"
    text += (
        f": it cannot break, {1e-3 * reach * curve.unloading:.3g} kN would press its "
        f"{1e3 * size:g} mm together by {1e3 * reach:.3g} mm (stiffness = "
        f"{1e-3 * stiffness:g} kN/m); give {less} or more stiffness"
    )
    return [(key, text)]


def _opening_faults(
    panel: Panel, item: ForeignObject, rail: str, x: float
) -> list[tuple[str, str]]:
    record = panel.rail[rail]
    if not record.start <= x <= record.end:
        text = f"x = {x:g} m is not on rail '{rail}', {record.start:g} ... {record.end:g} m"
        return [("at", f" = {show_value(item.at)}: {text}")]
    half = 0.5 * _length(item)
    if half > 0.0 and not record.start <= x - half <= x + half <= record.end:
        text = (
            f" = {2.0 * half:g} m: it reaches from x = {x - half:g} to {x + half:g} m, rail "
            f"'{rail}' from {record.start:g} to {record.end:g} m"
        )
        return [("length", text)]
    opening = largest_opening(panel, rail, x)
    if opening is None:
        text = (
            f" = {show_value(rail)}: has no stock rail (fit_gap), so nothing can be trapped by it"
        )
        return [("rail", text)]
    if float(item.size) > opening + OPENING_MARGIN:
        text = (
            f" = {float(item.size) * 1e3:g} mm: larger than the opening, rail '{rail}' stands "
            f"at most about {opening * 1e3:.0f} mm open at x = {x:g} m"
        )
        return [("size", text)]
    return []


def _length(item: ForeignObject) -> float:
    """Return the length along the rail of an object that has one, else 0 [m]."""
    if "length" not in OBJECT_KINDS[item.kind].parameters:
        return 0.0
    parameters = filled_parameters(item.kind, item.parameters, size=float(item.size))
    return parameters["length"] if parameters["length"] > LONGEST_PART else 0.0


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
        elif key in ("piece", "face_slope"):
            try:
                found[key] = float(value)
            except ValueError:
                problems.append(f'{key} = "{value}": must be a plain number')
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
