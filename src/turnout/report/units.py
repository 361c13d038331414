"""Numbers in engineers' units for the screen; SI stays inside."""

from typing import Any

# SI unit: name on the screen and its size in SI.
SHOWN: dict[str, tuple[str, float]] = {
    "N": ("kN", 1e3),
    "N/m": ("kN/m", 1e3),
    "N s/m": ("kN s/m", 1e3),
    "N m/rad": ("kN m/rad", 1e3),
    "N/m^2": ("GPa", 1e9),
    "m^2": ("cm^2", 1e-4),
    "m^4": ("cm^4", 1e-8),
}
# Lengths of the layout are read in metres, all others in millimetres.
IN_METRES = frozenset({"x", "start", "end", "radius", "curve_radius", "lead", "element_length"})


def shown(value: Any, unit: str | None, name: str) -> str:
    """Return a value as it is read on the screen.

    Parameters
    ----------
    value : object
        SI number, list of them, text, or mapping of names to numbers.
    unit : str or None
        Its SI unit.
    name : str
        Name of the field: positions are shown in metres, other lengths in millimetres.

    Examples
    --------
    >>> shown(0.115, "m", "stroke"), shown(7.5e5, "N/m", "stiffness"), shown([0.0, 0.6], "m", "x")
    ('115 mm', '750 kN/m', '0, 0.6 m')
    """
    if isinstance(value, dict):
        return ", ".join(f"{key}: {shown(item, unit, name)}" for key, item in value.items())
    if isinstance(value, list | tuple):
        if unit is None or not value:
            return ", ".join(_number(item) for item in value)
        text, factor = _screen_unit(unit, name)
        if isinstance(value[0], list | tuple):
            reach = [
                f"{min(c) / factor:.4g} ... {max(c) / factor:.4g}" for c in zip(*value, strict=True)
            ]
            return f"{len(value)} points, {' by '.join(reach)} {text}"
        return f"{', '.join(_number(item / factor) for item in value)} {text}"
    if unit is None or not isinstance(value, float | int):
        return _number(value)
    text, factor = _screen_unit(unit, name)
    if text == "kN/m" and abs(value) >= 1e6:
        text, factor = "kN/mm", 1e6
    return f"{_number(value / factor)} {text}"


def _screen_unit(unit: str, name: str) -> tuple[str, float]:
    if unit == "m":
        return ("m", 1.0) if name in IN_METRES else ("mm", 1e-3)
    return SHOWN.get(unit, (unit, 1.0))


def _number(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
