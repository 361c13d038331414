"""Trapped objects as unknowns: how thick they truly are, and where, against the run sheet.

All objects of a campaign are thicker by something in common, in every fit. Where this is not
enough, each size and each place has a difference of its own, as a cause. A common shift of places
in every fit led campaigns of few movements to values that were wrong by many deviations.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from turnout.calibration.measured_movements import MeasuredMovement
from turnout.calibration.parameter import Fitted, Parameter
from turnout.calibration.stages import known_to

# How well the thickness of an object and its place are known from a run sheet [m].
THICKNESS, PLACE = 0.2e-3, 50e-3
# What all objects are tried to be thicker by after a rough fit: whether a drive slips, or an object
# is touched, may change on the way, which no slope shows [m].
THICKER = (-1e-3, -0.5e-3, 0.5e-3, 1e-3)
_KIND = "object."
_THICKNESS, _PLACE = "thickness", "place"


def thickness_name(size: float = 0.0) -> str:
    """Return the name of what objects of a stated size, or all, are thicker than stated.

    Examples
    --------
    >>> thickness_name(0.013), thickness_name()
    ('object.13mm.thickness', 'object.thickness')
    """
    return f"{_KIND}{1e3 * size:g}mm.{_THICKNESS}" if size > 0 else _KIND + _THICKNESS


def shift_name(place: str = "") -> str:
    """Return the name of how much further from the toe objects at a stated place, or all, are.

    Examples
    --------
    >>> shift_name("sleeper 7"), shift_name()
    ('object.sleeper 7.place', 'object.place')
    """
    return f"{_KIND}{place}.{_PLACE}" if place else _KIND + _PLACE


def common_unknowns(movements: Sequence[MeasuredMovement]) -> list[Parameter]:
    """Return what all objects of a campaign may be thicker by than its run sheet says [m]."""
    if not any(item.size > 0 for item in movements):
        return []
    return [known_to(thickness_name(), 0.0, THICKNESS, keys=())]


def own_thicknesses(movements: Sequence[MeasuredMovement]) -> list[Parameter]:
    """Return what each size of object differs by from what all do [m]."""
    sizes = sorted({item.size for item in movements if item.size > 0})
    return [known_to(thickness_name(size), 0.0, THICKNESS, keys=()) for size in sizes]


def own_places(movements: Sequence[MeasuredMovement]) -> list[Parameter]:
    """Return what each place of objects differs by from what all do [m]."""
    places = dict.fromkeys(item.place for item in movements if item.size > 0)
    return [known_to(shift_name(place), 0.0, PLACE, keys=()) for place in places]


def is_of_object(parameter: Parameter | Fitted) -> bool:
    """Return whether a parameter is of trapped objects."""
    return parameter.name.startswith(_KIND)


def is_thickness(name: str) -> bool:
    """Return whether the name of an unknown of objects is that of a thickness, not of a place."""
    return name.endswith(_THICKNESS)


def acts_on(parameter: Parameter, movement: MeasuredMovement) -> bool:
    """Return whether a parameter of objects is of the one that a movement trapped."""
    own = (thickness_name(movement.size), shift_name(movement.place))
    return movement.size > 0 and parameter.name in (thickness_name(), shift_name(), *own)


def object_change(movement: MeasuredMovement, values: Mapping[str, float]) -> tuple[float, float]:
    """Return how much thicker, and further from the toe, the object of a movement is [m].

    Parameters
    ----------
    movement : MeasuredMovement
        With an object.
    values : mapping of str to float
        Of a fit, by name.
    """
    thicker = values.get(thickness_name(), 0.0) + values.get(thickness_name(movement.size), 0.0)
    return thicker, values.get(shift_name(), 0.0) + values.get(shift_name(movement.place), 0.0)


def thrown_object(movement: MeasuredMovement, values: Mapping[str, float]) -> tuple[str, float]:
    """Return place and size of the object of a movement at values; "none" and 0 without one [m]."""
    if not movement.size > 0:
        return movement.place, movement.size
    thicker, further = object_change(movement, values)
    place = f"x = {movement.x + further!r} m" if further else movement.place
    return place, movement.size + thicker


def as_found(
    movements: Sequence[MeasuredMovement], objects: Sequence[Fitted]
) -> tuple[MeasuredMovement, ...]:
    """Return movements with the objects that they truly had, as a calibration found them."""
    values = {item.name: item.value for item in objects}
    pairs = [(item, *thrown_object(item, values)) for item in movements]
    return tuple(replace(item, place=place, size=size) for item, place, size in pairs)


def object_lines(objects: Sequence[Fitted], *, leaves: float) -> list[str]:
    """Say which objects are not as the run sheet states them.

    Parameters
    ----------
    objects : sequence of Fitted
        What objects are thicker, and further from the toe, than stated [m].
    leaves : float
        How many stated deviations off is said [-].
    """
    lines = []
    for item in objects:
        thick = is_thickness(item.name)
        if abs(item.value) <= leaves * (THICKNESS if thick else PLACE):
            continue
        which = _which(item.name, thick=thick)
        digits, more = (2, ("thicker", "thinner")) if thick else (0, ("further", "less far"))
        size = f"{1e3 * abs(item.value):.{digits}f} ± {1e3 * item.deviation:.{digits}f} mm"
        way = more[item.value < 0.0] + ("" if thick else " from the toe")
        lines.append(f"objects: {which} are {size} {way} than the run sheet says; correct it")
    return lines


def _which(name: str, *, thick: bool) -> str:
    """Return which objects an unknown is of, in words."""
    what = name.removeprefix(_KIND).rpartition(".")[0]
    if not what:
        return "all"
    return f"those of {what.removesuffix('mm')} mm" if thick else f"those at {what}"
