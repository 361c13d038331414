"""Points of a plane in a file: one unit for all, a pair of numbers each."""

from turnout.core.units import LENGTH, SI, parse_numbers, unit_factor

MOST_POINTS = 2000
"""Points of one outline."""


def parse_points(value: object, *, si: bool = False) -> tuple[tuple[float, float], ...]:
    """Read points of a plane: `{unit, values = [[y, z], ...]}`; from Python also pairs in metres.

    Examples
    --------
    >>> parse_points({"unit": "mm", "values": [[0, 0], [75.0, 1.5]]})
    ((0.0, 0.0), (0.075, 0.0015))
    """
    unit: object = "m"
    if isinstance(value, dict) and set(value) == {"unit", "values"}:
        unit, value = value["unit"], value["values"]
    elif not (si or _all_si(value)):
        message = 'must be a table { unit = "mm", values = [[y, z], [y, z], ...] }'
        raise ValueError(message)
    if not isinstance(unit, str) or not unit.strip():
        message = "`unit` must be a text such as the unit of " + LENGTH.name
        raise ValueError(message)
    if not isinstance(value, list | tuple) or not value:
        message = "needs a list of points [y, z]"
        raise ValueError(message)
    if len(value) > MOST_POINTS:
        message = f"has {len(value)} points; at most {MOST_POINTS} are read, leave some out"
        raise ValueError(message)
    metre = unit_factor(unit, LENGTH)
    points = []
    for number, pair in enumerate(value, 1):
        if not isinstance(pair, list | tuple) or len(pair) != 2:
            message = f"point {number} of {len(value)} must be a pair [y, z]"
            raise ValueError(message)
        try:
            y, z = parse_numbers(pair)
        except ValueError as error:
            message = f"point {number} of {len(value)}: {error}"
            raise ValueError(message) from None
        points.append((y * metre, z * metre))
    return tuple(points)


def _all_si(value: object) -> bool:
    """Tell whether every number in nested lists is marked as SI."""
    if isinstance(value, list | tuple):
        return all(_all_si(item) for item in value)
    return isinstance(value, SI)
