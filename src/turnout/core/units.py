"""Units: "13 mm" in a file is 0.013 in memory.

A quantity is a text that carries a unit of the right dimension. A bare number is refused unless it
comes from Python, marked by `SI` or by `si=True`; neither can be written in a TOML file. The usual
units are resolved from a table, all others by pint, imported only when one of them turns up.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import cache, lru_cache
from typing import Any

from turnout.core.problems import show_value

LONGEST_UNIT = 60
"""Most characters of a unit."""

_FACTOR = re.compile(
    r"(?:[A-Za-zµμΩ][A-Za-z0-9_µμΩ]{0,23}|°[CF]?|%)"
    r"(?:\s?(?:\^|\*\*)\s?[+-]?[1-9]|⁻?[¹²³⁴⁵⁶⁷⁸⁹])?(?=[\s*·./]|\Z)"
)
_SIGN = re.compile(r"\s?[*·./]\s?|\s(?:per\s)?")
_ONE = re.compile(r"1(?:\s?/\s?|\sper\s)")


def is_unit_text(text: str) -> bool:
    """Return True if a text, with single spaces at most, follows the grammar of the module.

    Examples
    --------
    >>> [is_unit_text(text) for text in ("kN s/m^2", "1/K", "kg·m⁻³", "m per s")]
    [True, True, True, True]
    >>> [is_unit_text(text) for text in ("m^9^9", "2 m", "N/(m/s)", "m*", "m^10")]
    [False, False, False, False, False]
    """
    if len(text) > LONGEST_UNIT:
        return False
    one = _ONE.match(text)
    position = one.end() if one else 0
    while factor := _FACTOR.match(text, position):
        position = factor.end()
        if position == len(text):
            return True
        sign = _SIGN.match(text, position)
        if sign is None:
            return False
        position = sign.end()
    return False


class SI(float):
    """A number that Python code handed over as SI; a file cannot produce one."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Dimension:
    """A physical dimension: its name, its SI unit and an example of a value in a file."""

    name: str
    unit: str
    example: str


LENGTH = Dimension("length", "m", "13 mm")
TIME = Dimension("time", "s", "3.2 s")
FREQUENCY = Dimension("frequency", "Hz", "20 Hz")
FORCE = Dimension("force", "N", "6 kN")
STIFFNESS = Dimension("stiffness", "N/m", "750 kN/m")
ANGULAR_STIFFNESS = Dimension("angular stiffness", "N m/rad", "225 kN m/rad")
DAMPING = Dimension("damping", "N s/m", "25 kN s/m")
PRESSURE = Dimension("pressure", "N/m^2", "210 GPa")
DENSITY = Dimension("density", "kg/m^3", "7850 kg/m^3")
ACCELERATION = Dimension("acceleration", "m/s^2", "9.81 m/s^2")
AREA = Dimension("area", "m^2", "76.7 cm^2")
SECOND_MOMENT = Dimension("second moment of area", "m^4", "3038 cm^4")
VOLTAGE = Dimension("voltage", "V", "10 V")
CURRENT = Dimension("current", "A", "2 A")
CURRENT_PER_FORCE = Dimension("current per force", "A/N", "0.2 A/kN")
CURRENT_SENSITIVITY = Dimension("current sensitivity", "V/A", "100 mV/A")
VOLTAGE_RATIO = Dimension("voltage ratio", "V/V", "1 mV/V")
STRAIN = Dimension("strain", "m/m", "273 um/m")
SECTION_MODULUS = Dimension("section modulus", "m^3", "6.28 cm^3")
TEMPERATURE = Dimension("temperature", "K", "20 degC")
TEMPERATURE_DIFFERENCE = Dimension("temperature difference", "K", "5 K")
TEMPERATURE_COEFFICIENT = Dimension("temperature coefficient", "1/K", "-0.004 1/K")
RESISTANCE = Dimension("resistance", "ohm", "13 ohm")
INDUCTANCE = Dimension("inductance", "H", "150 mH")
TORQUE = Dimension("torque", "N m", "0.88 N m")
INERTIA = Dimension("moment of inertia", "kg m^2", "0.002 kg m^2")
MASS = Dimension("mass", "kg", "600 kg")
ROTATIONAL_SPEED = Dimension("rotational speed", "rad/s", "60 rad/s")
ANGLE = Dimension("angle", "rad", "650 rad")
SHAFT_RATIO = Dimension("shaft angle per length", "rad/m", "5600 rad/m")
ROTATIONAL_DRAG = Dimension("rotational drag", "N m s/rad", "5e-5 N m s/rad")
MOTOR_CONSTANT = Dimension("motor constant", "V s/rad", "0.99 V s/rad")
FIELD_CONSTANT = Dimension("motor constant per ampere of field", "V s/(rad A)", "1.155 V s/(rad A)")
HEAT_CAPACITY = Dimension("heat capacity", "J/K", "900 J/K")
PER_ENERGY = Dimension("share per energy", "1/J", "1e-9 1/J")
FORCE_RATE = Dimension("force rate", "N/s", "22 kN/s")

DIMENSIONS = (
    LENGTH,
    TIME,
    FREQUENCY,
    FORCE,
    STIFFNESS,
    ANGULAR_STIFFNESS,
    DAMPING,
    PRESSURE,
    DENSITY,
    ACCELERATION,
    AREA,
    SECOND_MOMENT,
    VOLTAGE,
    CURRENT,
    CURRENT_PER_FORCE,
    CURRENT_SENSITIVITY,
    VOLTAGE_RATIO,
    STRAIN,
    SECTION_MODULUS,
    TEMPERATURE,
    TEMPERATURE_DIFFERENCE,
    TEMPERATURE_COEFFICIENT,
    RESISTANCE,
    INDUCTANCE,
    TORQUE,
    INERTIA,
    MASS,
    ROTATIONAL_SPEED,
    ANGLE,
    SHAFT_RATIO,
    ROTATIONAL_DRAG,
    MOTOR_CONSTANT,
    FIELD_CONSTANT,
    HEAT_CAPACITY,
    PER_ENERGY,
    FORCE_RATE,
)

# Unit texts resolved without pint; tests/unit/test_core_units.py compares each with pint.
COMMON_UNITS: dict[str, dict[str, float]] = {
    "length": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "um": 1e-6, "km": 1e3},
    "time": {"s": 1.0, "ms": 1e-3, "min": 60.0},
    "frequency": {"Hz": 1.0, "kHz": 1e3},
    "force": {"N": 1.0, "kN": 1e3, "MN": 1e6},
    "stiffness": {
        "N/m": 1.0, "kN/m": 1e3, "MN/m": 1e6, "GN/m": 1e9, "N/mm": 1e3, "kN/mm": 1e6,
    },
    "angular stiffness": {"N m/rad": 1.0, "kN m/rad": 1e3, "MN m/rad": 1e6},
    "damping": {"N s/m": 1.0, "kN s/m": 1e3},
    "pressure": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "N/mm^2": 1e6, "N/m^2": 1.0},
    "density": {"kg/m^3": 1.0},
    "acceleration": {"m/s^2": 1.0},
    "area": {"m^2": 1.0, "cm^2": 1e-4, "mm^2": 1e-6},
    "second moment of area": {"m^4": 1.0, "cm^4": 1e-8, "mm^4": 1e-12},
    "voltage": {"V": 1.0, "mV": 1e-3},
    "current": {"A": 1.0, "mA": 1e-3},
    "current per force": {"A/N": 1.0, "A/kN": 1e-3},
    "current sensitivity": {"V/A": 1.0, "mV/A": 1e-3},
    "voltage ratio": {"V/V": 1.0, "mV/V": 1e-3},
    "strain": {"m/m": 1.0, "um/m": 1e-6},
    "section modulus": {"m^3": 1.0, "cm^3": 1e-6, "mm^3": 1e-9},
    "temperature": {"K": 1.0},
    "temperature difference": {"K": 1.0},
    "temperature coefficient": {"1/K": 1.0},
    "resistance": {"ohm": 1.0, "mohm": 0.001, "kohm": 1000.0},
    "inductance": {"H": 1.0, "mH": 0.001},
    "force rate": {"N/s": 1.0, "kN/s": 1e3},
    "torque": {"N m": 1.0, "N mm": 0.001, "kN m": 1000.0},
    "moment of inertia": {"kg m^2": 1.0, "kg cm^2": 0.0001},
    "mass": {"kg": 1.0, "t": 1000.0},
    "rotational speed": {"rad/s": 1.0},
    "angle": {"rad": 1.0},
    "shaft angle per length": {"rad/m": 1.0, "rad/mm": 1000.0},
    "rotational drag": {"N m s/rad": 1.0},
    "motor constant": {"V s/rad": 1.0},
    "motor constant per ampere of field": {"V s/(rad A)": 1.0},
    "heat capacity": {"J/K": 1.0, "kJ/K": 1000.0},
    "share per energy": {"1/J": 1.0, "1/MJ": 1e-06},
}  # fmt: skip

# An offset scale: no factor converts it to kelvins.
CELSIUS, CELSIUS_ZERO = ("degC", "°C"), Decimal("273.15")

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_NOT_FINITE = re.compile(r"[+-]?(nan|inf|infinity)\b", re.IGNORECASE)
_LARGEST_COUNT = 10_000

LONGEST_QUANTITY = 100
"""Most characters of a quantity."""

MOST_VALUES = 100_000
"""Most values of one list."""

MOST_KEPT = 4096
"""Quantities in the cache of texts, the latest used."""


def parse_quantity(value: object, dimension: Dimension, *, si: bool = False) -> float:
    """Read one value of a dimension and give it in SI.

    Parameters
    ----------
    value : object
        A text with a number and a unit, or, from Python, an SI number.
    dimension : Dimension
        Dimension that the value must have.
    si : bool
        Accept a bare number as SI.

    Returns
    -------
    float
        The value in the SI unit of the dimension.

    Raises
    ------
    ValueError
        When the value is not a finite quantity of that dimension; the text says the remedy.

    Examples
    --------
    >>> parse_quantity("13 mm", LENGTH)
    0.013
    >>> parse_quantity("40 kN/mm", STIFFNESS)
    40000000.0
    """
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        message = f"must be text with a number and a unit of {_of(dimension)}"
        raise ValueError(message)
    if isinstance(value, int | float):
        if not is_finite(value):
            message = "must be a finite number"
            raise ValueError(message)
        if si or isinstance(value, SI):
            return float(value)
        raise ValueError(_bare(f"{value:g}", dimension))
    return _read(value, dimension)


@lru_cache(maxsize=MOST_KEPT)
def _read(value: str, dimension: Dimension) -> float:
    """Read a text; cached, since the texts of a panel are read again after each change."""
    if len(value) > LONGEST_QUANTITY:
        message = f"has {len(value)} characters; a quantity has at most {LONGEST_QUANTITY}"
        raise ValueError(message)
    text = value.strip()
    if _NOT_FINITE.match(text):
        message = "must be a finite number"
        raise ValueError(message)
    match = _NUMBER.match(text)
    if match is None:
        message = f"must be a number and a unit of {_of(dimension)}"
        raise ValueError(message)
    number, unit = match[0], text[match.end() :].strip()
    if not unit:
        raise ValueError(_bare(number, dimension))
    if dimension is LENGTH:
        _refuse_feet_and_inches(text)
    return _scaled(float(number), unit, dimension)


_FEET = re.compile(
    r"""(?:(?P<feet>\d+(?:\.\d+)?)\s*(?:ft|feet|foot|'|′)\s*-?\s*)?
    (?:(?P<inches>\d+(?:\.\d+)?)??(?:[\s-]*(?P<over>\d+)/(?P<under>\d+))?\s*
    (?:in|inch|inches|"|″|'')?)?\.?""",
    re.VERBOSE | re.ASCII,
)


def _refuse_feet_and_inches(text: str) -> None:
    """Refuse "16 ft 6 in", 16'6" and "6 1/4 in", and say which decimal number they are."""
    found = _FEET.fullmatch(text)
    if found is None or not (found["inches"] or found["over"]):
        return
    if not (found["feet"] or found["over"]):
        return  # plain inches
    inches = 12.0 * float(found["feet"] or 0.0) + float(found["inches"] or 0.0)
    if found["over"] and int(found["under"]):
        inches += int(found["over"]) / int(found["under"])
    message = f'is more than one number and one unit; write it as "{inches:.10g} in"'
    raise ValueError(message)


def is_finite(value: float) -> bool:
    """Return True if a number is finite as a float; a whole number may be too large for one."""
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def _of(dimension: Dimension) -> str:
    return f'{dimension.name}, such as "{dimension.example}"'


def _bare(number: str, dimension: Dimension) -> str:
    return (
        f"has no unit, {number} would be {number} {dimension.unit}; "
        f'write the unit, such as "{dimension.example}"'
    )


def _scaled(number: float, unit: str, dimension: Dimension) -> float:
    if dimension is TEMPERATURE and unit in CELSIUS and math.isfinite(number):
        return float(Decimal(repr(number)) + CELSIUS_ZERO)
    factor = unit_factor(unit, dimension)
    exponent = round(math.log10(factor))
    # Shifting the decimal point rounds once: "4.9 mm" is exactly the 0.0049 that Python writes.
    if abs(factor / 10.0**exponent - 1.0) < 1e-12 and math.isfinite(number):
        result = float(Decimal(repr(number)).scaleb(exponent))
    else:
        result = number * factor
    if not math.isfinite(result):
        message = "must be a finite number"
        raise ValueError(message)
    return result


@lru_cache(maxsize=MOST_KEPT)
def unit_factor(unit: str, dimension: Dimension) -> float:
    """Return the SI value of one `unit`; ValueError when it is not a unit of the dimension.

    Examples
    --------
    >>> unit_factor("kN/m", STIFFNESS)
    1000.0
    """
    text = " ".join(unit[: LONGEST_QUANTITY + 1].split())
    known = COMMON_UNITS[dimension.name].get(text) if len(unit) <= LONGEST_QUANTITY else None
    if known is not None:
        return known
    if len(unit) > LONGEST_QUANTITY or not is_unit_text(text):
        message = (
            f"{show_value(text)} is not a unit; needs one of {_of(dimension)}: names with whole "
            "powers up to 9, multiplied or divided, without brackets"
        )
        raise ValueError(message)
    for name, units in COMMON_UNITS.items():
        cycles = dimension is FREQUENCY and name == ROTATIONAL_SPEED.name
        if text in units and not cycles:
            message = f'"{text}" is a unit of {name}; needs one of {_of(dimension)}'
            raise ValueError(message)
    return _pint_factor(text, dimension)


def _pint_factor(text: str, dimension: Dimension) -> float:
    """Resolve an uncommon unit by pint; whatever pint raises becomes a ValueError."""
    if dimension is FREQUENCY and not re.fullmatch(r"[kM]?[hH](z|ertz)|1/s|s\^-1|s\*\*-1", text):
        message = f'"{text}" is not a unit of {_of(dimension)} (cycles a second)'
        raise ValueError(message)
    registry = _registry()
    try:
        zero, factor = (
            float(registry.Quantity(number, text).to(dimension.unit).magnitude)
            for number in (0.0, 1.0)
        )
    except Exception as error:
        reason = "is of another dimension" if "convert" in str(error) else "is not a known unit"
        message = f'"{text}" {reason}; needs one of {_of(dimension)}'
        raise ValueError(message) from None
    if zero != 0.0:
        message = f'"{text}" counts from another zero; needs one of {_of(dimension)}'
        raise ValueError(message)
    if not (math.isfinite(factor) and factor > 0):
        message = f'"{text}" is not a usable unit; needs one of {_of(dimension)}'
        raise ValueError(message)
    return factor


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()


def parse_quantities(value: object, dimension: Dimension, *, si: bool = False) -> tuple[float, ...]:
    """Read several values: a list, `{unit, values}`, `{start, step, count}` or one scalar.

    Examples
    --------
    >>> parse_quantities({"unit": "cm^2", "values": [1.0, 2.0]}, AREA)
    (0.0001, 0.0002)
    >>> parse_quantities({"start": "0 m", "step": "0.6 m", "count": 3}, LENGTH)
    (0.0, 0.6, 1.2)
    """
    if isinstance(value, dict):
        return _from_table(value, dimension, si=si)
    items = value if isinstance(value, list | tuple) else [value]
    _check_length(items)
    result, problems = [], []
    for number, item in enumerate(items, 1):
        try:
            result.append(parse_quantity(item, dimension, si=si))
        except ValueError as error:
            problems.append(
                f"item {number} of {len(items)} {error}" if len(items) > 1 else f"{error}"
            )
    if problems:
        more = f"; and {len(problems) - 3} more" if len(problems) > 3 else ""
        raise ValueError("; ".join(problems[:3]) + more)
    return tuple(result)


def _check_length(items: Sequence[Any]) -> None:
    if not 1 <= len(items) <= MOST_VALUES:
        message = "needs at least one value"
        if items:
            message = f"has {len(items)} values; at most {MOST_VALUES} are read, leave some out"
        raise ValueError(message)


def _from_table(value: dict[str, object], dimension: Dimension, *, si: bool) -> tuple[float, ...]:
    keys = set(value)
    if keys == {"unit", "values"}:
        unit, values = value["unit"], value["values"]
        if not isinstance(unit, str) or not unit.strip():
            message = f"`unit` must be a text such as the unit of {_of(dimension)}"
            raise ValueError(message)
        numbers = parse_numbers(values)
        return tuple(_scaled(number, unit, dimension) for number in numbers)
    if keys == {"start", "step", "count"} and dimension in (LENGTH, TIME):
        start = parse_quantity(value["start"], dimension, si=si)
        step = parse_quantity(value["step"], dimension, si=si)
        count = value["count"]
        if isinstance(count, SI) and float(count).is_integer():
            count = int(count)
        if isinstance(count, bool) or not isinstance(count, int):
            message = "`count` must be a whole number"
            raise ValueError(message)
        if not 1 <= count <= _LARGEST_COUNT:
            message = f"`count` must be 1 ... {_LARGEST_COUNT}"
            raise ValueError(message)
        if not is_finite(start + step * count):
            message = "`start`, `step` and `count` must lead to finite numbers"
            raise ValueError(message)
        # Rounded to 1 nm, so that 0.6 m x 3 is the 1.8 m that a user writes.
        return tuple(round(start + step * number, 9) for number in range(count))
    forms = "a list, or a table {unit, values}"
    if dimension in (LENGTH, TIME):
        forms = "a list, or a table {unit, values} or {start, step, count}"
    message = f"must be {forms}; got a table with {', '.join(sorted(keys)) or 'nothing'}"
    raise ValueError(message)


def parse_numbers(value: object) -> tuple[float, ...]:
    """Read finite plain numbers: a list or one number.

    Examples
    --------
    >>> parse_numbers([0.5, 1])
    (0.5, 1.0)
    """
    items: Sequence[Any] = value if isinstance(value, list | tuple) else [value]
    _check_length(items)
    for number, item in enumerate(items, 1):
        if isinstance(item, bool) or not isinstance(item, int | float):
            message = (
                f"item {number} of {len(items)} must be a plain number, without quotes or unit"
            )
            raise ValueError(message)
        if not is_finite(item):
            message = f"item {number} of {len(items)} must be a finite number"
            raise ValueError(message)
    return tuple(float(item) for item in items)
