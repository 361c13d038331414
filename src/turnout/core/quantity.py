"""Types of dimensional fields, and the unit and dimension of a field of a record.

With these types pydantic reads "13 mm" as 0.013 and refuses a bare 13. Python code may pass SI
numbers, marked by `turnout.core.units.SI` or by the validation context `{"si": True}`; a file can
do neither. Unit and dimension are found from the description in the schema of a field.
"""

import re
import typing
from collections.abc import Callable, Iterator
from typing import Annotated, Any

from annotated_types import Le
from pydantic import BeforeValidator, ValidationInfo, WithJsonSchema

from turnout.core.units import (
    ACCELERATION,
    ANGLE,
    ANGULAR_STIFFNESS,
    AREA,
    CURRENT,
    CURRENT_SENSITIVITY,
    DAMPING,
    DENSITY,
    DIMENSIONS,
    FIELD_CONSTANT,
    FORCE,
    FREQUENCY,
    HEAT_CAPACITY,
    INDUCTANCE,
    INERTIA,
    LENGTH,
    MASS,
    MOTOR_CONSTANT,
    PER_ENERGY,
    PRESSURE,
    RESISTANCE,
    ROTATIONAL_DRAG,
    ROTATIONAL_SPEED,
    SECOND_MOMENT,
    SECTION_MODULUS,
    SHAFT_RATIO,
    SI,
    STIFFNESS,
    TEMPERATURE,
    TEMPERATURE_COEFFICIENT,
    TIME,
    TORQUE,
    VOLTAGE,
    VOLTAGE_RATIO,
    Dimension,
    parse_numbers,
    parse_quantities,
    parse_quantity,
    unit_factor,
)


def unit_of(field: Any) -> str | None:
    """Return the SI unit of a field of a record, or None if it has none.

    Examples
    --------
    >>> from turnout.panel.records import Chair
    >>> unit_of(Chair.model_fields["damping"]), unit_of(Chair.model_fields["friction_coefficient"])
    ('N s/m', None)
    """
    for marker in (*field.metadata, *_markers(field.annotation)):
        description = str((getattr(marker, "json_schema", None) or {}).get("description", ""))
        found = re.search(r"\[([^\]]+)\]$", description)
        if found and found.group(1) != "-":
            return found.group(1)
    return None


def dimension_of(field: Any) -> Dimension | None:
    """Return the dimension of a field of a record, or None for a plain number or a text.

    Examples
    --------
    >>> from turnout.panel.records import Chair
    >>> dimension_of(Chair.model_fields["damping"]).name
    'damping'
    """
    unit = unit_of(field)
    return next((item for item in DIMENSIONS if item.unit == unit), None)


def _markers(annotation: Any) -> Iterator[Any]:
    """Yield the metadata of an annotation, also within unions."""
    yield from getattr(annotation, "__metadata__", ())
    for part in typing.get_args(annotation):
        if not isinstance(part, str):
            yield from _markers(part)


# Two steel surfaces are below 1e10 N/m; far above, a contact is lost in rounding [N/m].
STIFFEST = 1e12


def _positive_numbers(value: object) -> tuple[float, ...]:
    numbers = parse_numbers(value)
    if min(numbers) <= 0:
        message = f"every number must be more than 0, the least is {min(numbers):g}"
        raise ValueError(message)
    return numbers


def _python(info: ValidationInfo) -> bool:
    return bool(info.context and info.context.get("si"))


def _scalar(dimension: Dimension) -> Callable[[object, ValidationInfo], float]:
    def read(value: object, info: ValidationInfo) -> float:
        return parse_quantity(value, dimension, si=_python(info))

    return read


def _list(dimension: Dimension) -> Callable[[object, ValidationInfo], tuple[float, ...]]:
    def read(value: object, info: ValidationInfo) -> tuple[float, ...]:
        return parse_quantities(value, dimension, si=_python(info))

    return read


def _points(value: object, info: ValidationInfo) -> tuple[tuple[float, float], ...]:
    return parse_points(value, si=_python(info))


def _scalar_schema(dimension: Dimension) -> dict[str, Any]:
    return {
        "type": "string",
        "description": f"{dimension.name} with its unit [{dimension.unit}]",
        "examples": [dimension.example],
    }


def _list_schema(dimension: Dimension) -> dict[str, Any]:
    scalar = {"type": "string", "examples": [dimension.example]}
    numbers = {"type": "array", "items": {"type": "number"}, "minItems": 1}
    forms: list[dict[str, Any]] = [
        scalar,
        {"type": "array", "items": scalar, "minItems": 1},
        _table_schema({"unit": {"type": "string"}, "values": numbers}),
    ]
    if dimension in (LENGTH, TIME):
        forms.append(_table_schema({"start": scalar, "step": scalar, "count": {"type": "integer"}}))
    return {
        "description": f"{dimension.name}, several values with their unit [{dimension.unit}]",
        "anyOf": forms,
    }


def _table_schema(properties: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }


_NUMBERS_SCHEMA = {
    "description": "plain numbers more than 0 [-]",
    "anyOf": [
        {"type": "number", "exclusiveMinimum": 0},
        {"type": "array", "items": {"type": "number", "exclusiveMinimum": 0}, "minItems": 1},
    ],
}

_POINTS_SCHEMA = {
    "description": "points [y, z] with their unit [m]",
    **_table_schema(
        {
            "unit": {"type": "string"},
            "values": {
                "type": "array",
                "items": {"type": "array", "items": {"type": "number"}},
            },
        }
    ),
}

Length = Annotated[float, BeforeValidator(_scalar(LENGTH)), WithJsonSchema(_scalar_schema(LENGTH))]
Time = Annotated[float, BeforeValidator(_scalar(TIME)), WithJsonSchema(_scalar_schema(TIME))]
Frequency = Annotated[
    float, BeforeValidator(_scalar(FREQUENCY)), WithJsonSchema(_scalar_schema(FREQUENCY))
]
Force = Annotated[float, BeforeValidator(_scalar(FORCE)), WithJsonSchema(_scalar_schema(FORCE))]
Stiffness = Annotated[
    float,
    BeforeValidator(_scalar(STIFFNESS)),
    WithJsonSchema(_scalar_schema(STIFFNESS)),
    Le(STIFFEST),
]
AngularStiffness = Annotated[
    float,
    BeforeValidator(_scalar(ANGULAR_STIFFNESS)),
    WithJsonSchema(_scalar_schema(ANGULAR_STIFFNESS)),
]
Damping = Annotated[
    float, BeforeValidator(_scalar(DAMPING)), WithJsonSchema(_scalar_schema(DAMPING))
]
Pressure = Annotated[
    float, BeforeValidator(_scalar(PRESSURE)), WithJsonSchema(_scalar_schema(PRESSURE))
]
Density = Annotated[
    float, BeforeValidator(_scalar(DENSITY)), WithJsonSchema(_scalar_schema(DENSITY))
]
Acceleration = Annotated[
    float, BeforeValidator(_scalar(ACCELERATION)), WithJsonSchema(_scalar_schema(ACCELERATION))
]
Area = Annotated[float, BeforeValidator(_scalar(AREA)), WithJsonSchema(_scalar_schema(AREA))]
SecondMoment = Annotated[
    float, BeforeValidator(_scalar(SECOND_MOMENT)), WithJsonSchema(_scalar_schema(SECOND_MOMENT))
]
SectionModulus = Annotated[
    float,
    BeforeValidator(_scalar(SECTION_MODULUS)),
    WithJsonSchema(_scalar_schema(SECTION_MODULUS)),
]
Voltage = Annotated[
    float, BeforeValidator(_scalar(VOLTAGE)), WithJsonSchema(_scalar_schema(VOLTAGE))
]
VoltageRatio = Annotated[
    float, BeforeValidator(_scalar(VOLTAGE_RATIO)), WithJsonSchema(_scalar_schema(VOLTAGE_RATIO))
]
CurrentSensitivity = Annotated[
    float,
    BeforeValidator(_scalar(CURRENT_SENSITIVITY)),
    WithJsonSchema(_scalar_schema(CURRENT_SENSITIVITY)),
]
Resistance = Annotated[
    float, BeforeValidator(_scalar(RESISTANCE)), WithJsonSchema(_scalar_schema(RESISTANCE))
]
Inductance = Annotated[
    float, BeforeValidator(_scalar(INDUCTANCE)), WithJsonSchema(_scalar_schema(INDUCTANCE))
]
Torque = Annotated[float, BeforeValidator(_scalar(TORQUE)), WithJsonSchema(_scalar_schema(TORQUE))]
Inertia = Annotated[
    float, BeforeValidator(_scalar(INERTIA)), WithJsonSchema(_scalar_schema(INERTIA))
]
Mass = Annotated[float, BeforeValidator(_scalar(MASS)), WithJsonSchema(_scalar_schema(MASS))]
RotationalSpeed = Annotated[
    float,
    BeforeValidator(_scalar(ROTATIONAL_SPEED)),
    WithJsonSchema(_scalar_schema(ROTATIONAL_SPEED)),
]
Angle = Annotated[float, BeforeValidator(_scalar(ANGLE)), WithJsonSchema(_scalar_schema(ANGLE))]
ShaftRatio = Annotated[
    float, BeforeValidator(_scalar(SHAFT_RATIO)), WithJsonSchema(_scalar_schema(SHAFT_RATIO))
]
RotationalDrag = Annotated[
    float,
    BeforeValidator(_scalar(ROTATIONAL_DRAG)),
    WithJsonSchema(_scalar_schema(ROTATIONAL_DRAG)),
]
MotorConstant = Annotated[
    float, BeforeValidator(_scalar(MOTOR_CONSTANT)), WithJsonSchema(_scalar_schema(MOTOR_CONSTANT))
]
FieldConstant = Annotated[
    float, BeforeValidator(_scalar(FIELD_CONSTANT)), WithJsonSchema(_scalar_schema(FIELD_CONSTANT))
]
HeatCapacity = Annotated[
    float, BeforeValidator(_scalar(HEAT_CAPACITY)), WithJsonSchema(_scalar_schema(HEAT_CAPACITY))
]
PerEnergy = Annotated[
    float, BeforeValidator(_scalar(PER_ENERGY)), WithJsonSchema(_scalar_schema(PER_ENERGY))
]
Current = Annotated[
    float, BeforeValidator(_scalar(CURRENT)), WithJsonSchema(_scalar_schema(CURRENT))
]
Temperature = Annotated[
    float, BeforeValidator(_scalar(TEMPERATURE)), WithJsonSchema(_scalar_schema(TEMPERATURE))
]
TemperatureCoefficient = Annotated[
    float,
    BeforeValidator(_scalar(TEMPERATURE_COEFFICIENT)),
    WithJsonSchema(_scalar_schema(TEMPERATURE_COEFFICIENT)),
]
LengthList = Annotated[
    tuple[float, ...], BeforeValidator(_list(LENGTH)), WithJsonSchema(_list_schema(LENGTH))
]
TimeList = Annotated[
    tuple[float, ...], BeforeValidator(_list(TIME)), WithJsonSchema(_list_schema(TIME))
]
ForceList = Annotated[
    tuple[float, ...], BeforeValidator(_list(FORCE)), WithJsonSchema(_list_schema(FORCE))
]
AreaList = Annotated[
    tuple[float, ...], BeforeValidator(_list(AREA)), WithJsonSchema(_list_schema(AREA))
]
SecondMomentList = Annotated[
    tuple[float, ...],
    BeforeValidator(_list(SECOND_MOMENT)),
    WithJsonSchema(_list_schema(SECOND_MOMENT)),
]
PointList = Annotated[
    tuple[tuple[float, float], ...], BeforeValidator(_points), WithJsonSchema(_POINTS_SCHEMA)
]
PositiveNumberList = Annotated[
    tuple[float, ...], BeforeValidator(_positive_numbers), WithJsonSchema(_NUMBERS_SCHEMA)
]


MOST_POINTS = 2000
"""Most points of one outline."""


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
    """Return True if every number in nested lists is marked as SI."""
    if isinstance(value, list | tuple):
        return all(_all_si(item) for item in value)
    return isinstance(value, SI)
