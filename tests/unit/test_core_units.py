"""Quantities: every unit against pint, exact decimals, what is refused."""

import math
from contextlib import suppress

import pint
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from turnout.core.quantity import Length, LengthList, PositiveNumberList
from turnout.core.units import (
    ACCELERATION,
    ANGULAR_STIFFNESS,
    DAMPING,
    DENSITY,
    DIMENSIONS,
    FREQUENCY,
    LENGTH,
    SECOND_MOMENT,
    SI,
    STIFFNESS,
    TIME,
    UNITS,
    Dimension,
    parse_numbers,
    parse_quantities,
    parse_quantity,
    unit_factor,
)

REGISTRY = pint.UnitRegistry()
COMPOSED = ("kN/mm", "N m/A", "lbf in", "kip/ft", "kN s/m", "MN m/rad", "N/mm^2", "g/cm**3", "cm^4")
COMPOSED += (
    "kg cm^2",
    "rad/mm",
    "mV/V",
    "mV/A",
    "um/m",
    "1/MJ",
    "V s/(rad A)",
    "kN·mm⁻¹",
    "km/h/s",
)
NOT_COMPARED = ("furlong", "rev", "L", "l", "liter", "litre")
WITHOUT_DIMENSION = {"C", "F"}


def accepted(unit: str) -> list[tuple[Dimension, float]]:
    """Return the dimensions that a unit belongs to, with its SI value in each."""
    found = []
    for dimension in DIMENSIONS:
        with suppress(ValueError):
            found.append((dimension, unit_factor(unit, dimension)))
    return found


@pytest.mark.parametrize(
    "unit",
    [
        *(name for name in UNITS if name not in NOT_COMPARED),
        *(dimension.unit for dimension in DIMENSIONS),
        *(dimension.example.split(maxsplit=1)[1] for dimension in DIMENSIONS[:-1]),
        *("kN", "mm", "dam", "µs", "nF", "hN", "kilonewton", "millimeters", "Mt", "minutes"),
        *COMPOSED,
    ],
)
def test_units_agree_with_pint(unit: str) -> None:
    """Pint takes the furlong for that of the US survey, and a revolution by no short name."""
    if unit == "degC":
        return
    found = accepted(unit)
    assert bool(found) == (unit not in {*WITHOUT_DIMENSION, "nF"})
    for dimension, factor in found:
        expected = REGISTRY.Quantity(1.0, unit).to(dimension.unit).magnitude
        assert factor == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "dimension", "expected"),
    [
        ("750 kN/m", STIFFNESS, 750e3),
        ("13 mm", LENGTH, 0.013),
        ("13mm", LENGTH, 0.013),
        ("  -7.5e-1   mm ", LENGTH, -0.00075),
        ("1 inch", LENGTH, 0.0254),
        ("9.81 m/s^2", ACCELERATION, 9.81),
        ("20 Hz", FREQUENCY, 20.0),
        ("0.02 1/s", FREQUENCY, 0.02),
        ("25 kN s/m", DAMPING, 25e3),
        ("25 kN*s/m", DAMPING, 25e3),
        ("225 kN m/rad", ANGULAR_STIFFNESS, 225e3),
        ("3038 cm^4", SECOND_MOMENT, 3038e-8),
        ("7850 kg/m^3", DENSITY, 7850.0),
        ("7.85 g/cm**3", DENSITY, 7850.0),
        ("2 minute", TIME, 120.0),
    ],
)
def test_quantities_are_read_in_si(text: str, dimension: Dimension, expected: float) -> None:
    assert parse_quantity(text, dimension) == pytest.approx(expected, rel=1e-14)


@given(st.integers(min_value=-100_000, max_value=100_000))
def test_millimetres_equal_the_decimal_a_user_writes_in_python(tenths: int) -> None:
    assert parse_quantity(f"{tenths / 10} mm", LENGTH) == float(f"{tenths}e-4")


@pytest.mark.parametrize(
    ("value", "dimension", "message"),
    [
        (13, LENGTH, r'13 would be 13 m; write the unit, such as "13 mm"'),
        ("13", LENGTH, r"13 would be 13 m"),
        (0, LENGTH, r"0 would be 0 m"),
        (750.0, STIFFNESS, r"750 would be 750 N/m"),
        ("13 kN", LENGTH, r'"kN" is a unit of force; needs one of length'),
        ("16 ft 6 in", LENGTH, r'more than one number and one unit; write it as "198 in"'),
        ("16'6\"", LENGTH, r'write it as "198 in"'),
        ("6-1/4 in", LENGTH, r'write it as "6.25 in"'),
        ("13 slug", LENGTH, r"a unit of mass; needs one of length"),
        ("13 mph", LENGTH, r"unit of speed.*length"),
        ("13 N m", ANGULAR_STIFFNESS, r'"N m" is a unit of torque'),
        ("13 blorb", LENGTH, r"not a known unit"),
        ("13 (", LENGTH, r"is not a unit"),
        ("13 m; import os", LENGTH, r"is not a unit"),
        ("13 " + "m*" * 40 + "m", LENGTH, r"is not a unit"),
        ("nan mm", LENGTH, r"finite"),
        ("-inf m", LENGTH, r"finite"),
        (math.nan, LENGTH, r"finite"),
        ("1e400 m", LENGTH, r"finite"),
        ("1e306 km", LENGTH, r"finite"),
        ("mm", LENGTH, r"a number and a unit of length"),
        ("", LENGTH, r"a number and a unit of length"),
        (True, LENGTH, r"text with a number and a unit"),
        (None, LENGTH, r"text with a number and a unit"),
        ("20 rad/s", FREQUENCY, r"cycles a second"),
        ("20 rpm", FREQUENCY, r"cycles a second"),
    ],
)
def test_anything_else_is_refused(value: object, dimension: Dimension, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parse_quantity(value, dimension)


def test_python_may_hand_over_si_numbers() -> None:
    assert parse_quantity(0.013, LENGTH, si=True) == 0.013
    assert parse_quantity(SI(0.013), LENGTH) == 0.013
    with pytest.raises(ValueError, match="finite"):
        parse_quantity(SI(math.inf), LENGTH)


def test_lists_take_four_forms() -> None:
    expected = (0.0, 0.6, 1.2)
    assert parse_quantities(["0 m", "600 mm", "1.2 m"], LENGTH) == expected
    assert parse_quantities({"unit": "mm", "values": [0, 600, 1200]}, LENGTH) == expected
    assert parse_quantities({"start": "0 m", "step": "0.6 m", "count": 3}, LENGTH) == expected
    assert parse_quantities("0.6 m", LENGTH) == (0.6,)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ([], "at least one"),
        (["1 m", 2, "3 kN"], r"item 2 of 3 has no unit.*item 3 of 3"),
        ({"unit": "mm"}, r"got a table with unit"),
        ({"unit": "mm", "values": ["1 mm"]}, r"plain number"),
        ({"unit": "kN", "values": [1]}, r"unit of force"),
        ({"unit": 3, "values": [1]}, r"`unit` must be"),
        ({"start": 0, "step": "1 m", "count": 2}, r"no unit"),
        ({"start": "0 m", "step": "1 m", "count": 2.5}, r"whole number"),
        ({"start": "0 m", "step": "1 m", "count": 0}, r"1 \.\.\. 10000"),
        ({"start": "0 m", "step": "1 m", "count": 10**9}, r"1 \.\.\. 10000"),
    ],
)
def test_lists_say_what_is_wrong(value: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parse_quantities(value, LENGTH)


def test_plain_numbers() -> None:
    assert parse_numbers(0.5) == (0.5,)
    for wrong in (["0.5"], [True], [math.nan], []):
        with pytest.raises(ValueError, match="number|at least"):
            parse_numbers(wrong)
    with pytest.raises(ValidationError, match="more than 0"):
        TypeAdapter(PositiveNumberList).validate_python([1.0, 0.0])


def test_context_lets_python_pass_numbers_through_pydantic() -> None:
    adapter = TypeAdapter(Length)
    assert adapter.validate_python(0.5, context={"si": True}) == 0.5
    with pytest.raises(ValidationError, match="no unit"):
        adapter.validate_python(0.5)
    assert TypeAdapter(LengthList).validate_python([0.5], context={"si": True}) == (0.5,)


def test_schema_of_a_quantity_names_dimension_and_example() -> None:
    schema = TypeAdapter(Length).json_schema()
    assert schema["type"] == "string"
    assert "length" in schema["description"]
    assert schema["examples"] == ["13 mm"]
