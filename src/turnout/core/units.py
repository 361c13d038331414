"""Units: "13 mm" in a file is 0.013 in memory.

A quantity is a text that carries a unit of the right dimension. A bare number is refused unless it
comes from Python, marked by `SI` or by `si=True`; neither can be written in a TOML file. Units are
products of powers of the names in `UNITS`, with prefixes.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import lru_cache
from typing import Any, NamedTuple

from turnout.core.problems import show_value

LONGEST_UNIT = 60
"""Most characters of a unit."""

_FACTOR = re.compile(
    r"([A-Za-zµμΩ][A-Za-z0-9_µμΩ]{0,23}|°[CF]?|%)"
    r"(?:\s?(?:\^|\*\*)\s?([+-]?[1-9])|(⁻?[¹²³⁴⁵⁶⁷⁸⁹]))?(?=[\s*·./]|\Z)"
)
_SIGN = re.compile(r"\s?[*·./]\s?|\s(?:per\s)?")
_ONE = re.compile(r"1(?:\s?/\s?|\sper\s)")
_BELOW = re.compile(r"/\s?\(([^()/*·.]+)\)\Z")
_SUPERSCRIPTS = str.maketrans("⁻¹²³⁴⁵⁶⁷⁸⁹", "-123456789")


def unit_factors(text: str) -> list[tuple[str, int]] | None:
    """Split a unit, with single spaces at most, into names and powers; None if it is not one.

    Examples
    --------
    >>> unit_factors("kN s/m^2"), unit_factors("1/K"), unit_factors("V s/(rad A)")[2:]
    ([('kN', 1), ('s', 1), ('m', -2)], [('K', -1)], [('rad', -1), ('A', -1)])
    >>> [unit_factors(text) for text in ("m^9^9", "2 m", "N/(m/s)", "m*", "m^10")]
    [None, None, None, None, None]
    """
    if len(text) > LONGEST_UNIT:
        return None
    text = _BELOW.sub(lambda group: "/" + "/".join(group[1].split()), text)
    one = _ONE.match(text)
    position, turned = (one.end(), -1) if one else (0, 1)
    found = []
    while factor := _FACTOR.match(text, position):
        power = int(factor[2] or (factor[3] or "1").translate(_SUPERSCRIPTS))
        found.append((factor[1], turned * power))
        position = factor.end()
        if position == len(text):
            return found
        sign = _SIGN.match(text, position)
        if sign is None:
            return None
        position, turned = sign.end(), -1 if sign[0].strip() in ("/", "per") else 1
    return None


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
POWER = Dimension("power", "W", "350 W")
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
SPEED = Dimension("speed", "m/s", "5 mm/s")
PER_SPEED = Dimension("share per speed", "s/m", "1 s/m")
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
    POWER,
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
    SPEED,
    PER_SPEED,
    PER_ENERGY,
    FORCE_RATE,
    SPEED,
)

# Names with prefixes: what each is in those before. Powers of ten stay exact.
_WITH_PREFIX = {
    **dict.fromkeys(("m", "s", "A", "K", "rad"), ""),
    "N": "kg m/s^2", "Pa": "N/m^2", "J": "N m", "W": "J/s", "V": "W/A", "ohm": "V/A",
    "H": "V s/A", "Wh": "3600 J", "C": "A s", "F": "C/V", "Wb": "V s", "Hz": "1/s",
    "L": "1e-3 m^3", "g": "1e-3 kg", "t": "1e3 kg", "bar": "1e5 Pa", "lbf": "4.4482216152605 N",
    "Ω": "ohm", "l": "L",
    "meter": "m", "metre": "m", "second": "s", "gram": "g", "ampere": "A", "kelvin": "K",
    "newton": "N", "pascal": "Pa", "joule": "J", "watt": "W", "volt": "V", "henry": "H",
    "hertz": "Hz", "radian": "rad", "liter": "L", "litre": "L", "tonne": "t",
}  # fmt: skip
_WITHOUT_PREFIX = {
    "kg": "", "min": "60 s", "minute": "min", "h": "60 min", "hr": "h", "hour": "h",
    "d": "24 h", "day": "d", "deg": "0.017453292519943295 rad", "degree": "deg", "°": "deg",
    "rev": "6.283185307179586 rad", "turn": "rev", "revolution": "rev", "rpm": "rev/min",
    "in": "25.4 mm", "inch": "in", "ft": "12 in", "foot": "ft", "feet": "ft", "yd": "3 ft",
    "yard": "yd", "mi": "1760 yd", "mile": "mi", "furlong": "220 yd",
    "thou": "25.4 um", "micron": "um", "lb": "0.45359237 kg", "pound": "lb", "oz": "0.0625 lb",
    "slug": "lbf s^2/ft", "kip": "1000 lbf", "pound_force": "lbf", "kgf": "9.80665 N",
    "tf": "1000 kgf", "psi": "lbf/in^2", "ksi": "kip/in^2", "atm": "101325 Pa",
    "hp": "550 ft lbf/s", "mph": "mi/h", "kph": "km/h", "%": "1e-2 m/m", "percent": "%",
    "ppm": "1e-6 m/m",
}  # fmt: skip
UNITS = _WITH_PREFIX | _WITHOUT_PREFIX
"""Definition of each unit: a number where it is not one, and units."""
_PREFIXES = {
    **{"f": -15, "p": -12, "n": -9, "u": -6, "µ": -6, "μ": -6, "m": -3, "c": -2, "d": -1},
    **{"da": 1, "h": 2, "k": 3, "M": 6, "G": 9, "T": 12},
    **{"nano": -9, "micro": -6, "milli": -3, "centi": -2, "deci": -1},
    **{"kilo": 3, "mega": 6, "giga": 9},
}
_BASE = ("m", "kg", "s", "A", "K")


class Unit(NamedTuple):
    """A unit in SI: a ratio times a power of ten, powers of the base units, and its plain names."""

    ratio: float
    ten: int
    powers: tuple[int, ...]
    names: frozenset[str] = frozenset()

    @property
    def factor(self) -> float:
        """SI value of one."""
        return self.ratio * float(f"1e{self.ten}")


@lru_cache(maxsize=1024)
def _resolved(text: str) -> Unit | None:
    """Return a unit by its text; None for an unknown name, ValueError for no unit at all."""
    factors = unit_factors(text)
    if factors is None:
        raise ValueError(text)
    ratio, ten, powers, names = 1.0, 0, (0,) * len(_BASE), set()
    for symbol, power in factors:
        found = _named(symbol)
        if found is None:
            return None
        name, unit = found
        names.add(name)
        ratio, ten = ratio * unit.ratio**power, ten + power * unit.ten
        powers = tuple(a + power * b for a, b in zip(powers, unit.powers, strict=True))
    return Unit(ratio, ten, powers, frozenset(names))


@lru_cache(maxsize=1024)
def _named(symbol: str) -> tuple[str, Unit] | None:
    """Return the name of a unit without its prefix, and the unit with it."""
    if symbol in UNITS:
        return symbol, _defined(symbol)
    for length in (1, 2, 4, 5):
        prefix, name = symbol[:length], symbol[length:]
        if prefix in _PREFIXES and name in _WITH_PREFIX:
            unit = _defined(name)
            return name, unit._replace(ten=unit.ten + _PREFIXES[prefix])
    plural = symbol[:-1] if symbol[-1:] == "s" and len(symbol) > 4 else ""
    plural = f"{symbol[:-2]}" if symbol == "inches" else plural
    return _named(plural) if plural else None


def _defined(name: str) -> Unit:
    definition = UNITS[name]
    if not definition:
        return Unit(1.0, 0, tuple(int(name == base) for base in _BASE))
    number, _, rest = definition.partition(" ")
    exact = re.fullmatch(r"1e(-?\d+)", number)
    known = _NUMBER.fullmatch(number)
    unit = _resolved(rest if known else definition)
    assert unit is not None
    if exact:
        return unit._replace(ten=unit.ten + int(exact[1]))
    return unit._replace(ratio=unit.ratio * float(number)) if known else unit


# Offset scales: no factor converts it to kelvins.
CELSIUS, CELSIUS_ZERO = ("degC", "°C"), Decimal("273.15")
MELTING = 273.15
"""Of ice [K]."""
_OFFSET = (*CELSIUS, "degF", "°F")

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


def _scaled(number: float, text: str, dimension: Dimension) -> float:
    if dimension is TEMPERATURE and text in CELSIUS and math.isfinite(number):
        return float(Decimal(repr(number)) + CELSIUS_ZERO)
    unit = _unit(text, dimension)
    # Shifting the decimal point rounds once: "4.9 mm" is exactly the 0.0049 that Python writes.
    if unit.ratio == 1.0 and math.isfinite(number):
        result = float(Decimal(repr(number)).scaleb(unit.ten))
    else:
        result = number * unit.factor
    if not math.isfinite(result):
        message = "must be a finite number"
        raise ValueError(message)
    return result


def unit_factor(unit: str, dimension: Dimension) -> float:
    """Return the SI value of one `unit`; ValueError when it is not a unit of the dimension.

    Examples
    --------
    >>> unit_factor("kN/m", STIFFNESS)
    1000.0
    """
    return _unit(unit, dimension).factor


@lru_cache(maxsize=MOST_KEPT)
def _unit(given: str, dimension: Dimension) -> Unit:
    """Return a unit of a dimension, or raise ValueError."""
    text = " ".join(given[: LONGEST_QUANTITY + 1].split())
    try:
        if len(given) > LONGEST_QUANTITY:
            raise ValueError(text)
        unit = _resolved(text)
    except ValueError:
        message = (
            f"{show_value(text)} is not a unit; needs one of {_of(dimension)}: names with whole "
            "powers up to 9, multiplied or divided"
        )
        raise ValueError(message) from None
    if unit is None:
        fault = "counts from another zero" if text in _OFFSET else "is not a known unit"
    else:
        fault = _unit_fault(unit, dimension)
    if fault:
        message = f'"{text}" {fault}; needs one of {_of(dimension)}'
        raise ValueError(message)
    return unit  # type: ignore[return-value]  # an unknown one has a fault


def _unit_fault(unit: Unit, dimension: Dimension) -> str:
    """Return the reason why a unit is none of a dimension; empty if it is.

    Of dimensions with the same powers, such as torque and angular stiffness, a unit belongs to the
    one that is written with its names, if there is one.
    """
    own = _resolved(dimension.unit)
    is_own = own is not None and own.powers == unit.powers
    if is_own and own is not None and own.names == unit.names:
        return ""
    if is_own and dimension is FREQUENCY:
        whole = unit.names <= {"Hz", "hertz", "s"}
        return "" if whole else "does not count cycles a second"
    others = [(item, _resolved(item.unit)) for item in DIMENSIONS]
    same = [(item, other.names) for item, other in others if other and other.powers == unit.powers]
    named = [item for item, names in same if names == unit.names]
    if is_own and not named:
        return ""
    known = next(iter(named or [item for item, _ in same]), None)
    return f"is a unit of {known.name}" if known else "is of another dimension"


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
