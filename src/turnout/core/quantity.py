"""Records of files, and types of their dimensional fields.

With these types pydantic reads "13 mm" as 0.013 and refuses a bare 13. Python code may pass SI
numbers, marked by `turnout.core.units.SI` or by the validation context `{"si": True}`; a file can
do neither.
"""

from collections.abc import Callable, Collection, Iterator
from copy import deepcopy
from dataclasses import dataclass
from typing import Annotated, Any, Self

from annotated_types import Le
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    GetCoreSchemaHandler,
    PlainValidator,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)

from turnout.core.problems import nearest
from turnout.core.units import (
    ACCELERATION,
    ANGLE,
    ANGULAR_STIFFNESS,
    AREA,
    CURRENT,
    CURRENT_SENSITIVITY,
    DAMPING,
    DENSITY,
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
    PER_SPEED,
    PRESSURE,
    RESISTANCE,
    ROTATIONAL_DRAG,
    ROTATIONAL_SPEED,
    SECOND_MOMENT,
    SECTION_MODULUS,
    SHAFT_RATIO,
    SI,
    SPEED,
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


class Record(BaseModel):
    """Base of the records of files: no unknown keys, and no change after validation."""

    model_config = ConfigDict(
        extra="forbid",
        defer_build=True,  # most are read as parts of a whole and never alone
        frozen=True,
        strict=True,
        allow_inf_nan=False,
        str_strip_whitespace=True,
    )


class JudgedRecord(Record):
    """Base of records whose values must go together; all their faults are named at once."""

    @model_validator(mode="after")
    def _judged(self) -> Self:
        if found := "; ".join(self.faults()):
            raise ValueError(found)
        return self

    def faults(self) -> Iterator[str]:
        """Yield the faults between the values, with remedies."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class NameIn:
    """Mark of a text that must be a name in a table, which may get more of them.

    Examples
    --------
    >>> from pydantic import TypeAdapter
    >>> TypeAdapter(Annotated[str, NameIn({"stone": 1, "ice": 2})]).validate_python("ice")
    'ice'
    """

    names: Collection[str]

    def check(self, value: object) -> str:
        """Return the value if it is a name; otherwise say which there are."""
        if isinstance(value, str) and value in self.names:
            return value
        *most, last = map(repr, self.names)
        expected = f"{', '.join(most)} or {last}" if most else last
        near = nearest(value, self.names) if isinstance(value, str) else ""
        message = f"must be {expected}{near}"
        raise ValueError(message)

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> Any:
        """Return the schema of pydantic, by which it validates."""
        return PlainValidator(self.check).__get_pydantic_core_schema__(source, handler)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        """Return the JSON schema, which lists the names."""
        return {"enum": list(self.names), "type": "string"}


@dataclass(frozen=True, slots=True, eq=False)
class Quantity:
    """Mark of a field with a dimension: its reading and its JSON schema.

    Attributes
    ----------
    dimension : Dimension
        Of the value, or of each of several.
    read : callable
        From a value of a file, and whether bare numbers are SI, to SI.
    schema : mapping
        JSON schema of a value in a file.
    """

    dimension: Dimension
    read: Callable[..., Any]
    schema: dict[str, Any]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> Any:
        """Return the schema of the plain value, with the reading of a quantity before it."""

        def read(value: object, info: ValidationInfo) -> Any:
            si = bool(info.context and info.context.get("si"))
            return self.read(value, self.dimension, si=si)

        return BeforeValidator(read).__get_pydantic_core_schema__(source, handler)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        """Return the JSON schema of a value in a file."""
        return deepcopy(self.schema)  # pydantic adds what is said of the field


def _scalar(dimension: Dimension) -> Quantity:
    schema = {
        "type": "string",
        "description": f"{dimension.name} with its unit [{dimension.unit}]",
        "examples": [dimension.example],
    }
    return Quantity(dimension, parse_quantity, schema)


def _list(dimension: Dimension) -> Quantity:
    scalar = {"type": "string", "examples": [dimension.example]}
    numbers = {"type": "array", "items": {"type": "number"}, "minItems": 1}
    forms: list[dict[str, Any]] = [
        scalar,
        {"type": "array", "items": scalar, "minItems": 1},
        _table_schema({"unit": {"type": "string"}, "values": numbers}),
    ]
    if dimension in (LENGTH, TIME):
        forms.append(_table_schema({"start": scalar, "step": scalar, "count": {"type": "integer"}}))
    said = f"{dimension.name}, several values with their unit [{dimension.unit}]"
    return Quantity(dimension, parse_quantities, {"description": said, "anyOf": forms})


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

_POINTS_SCHEMA: dict[str, Any] = {
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


def _positive_numbers(value: object) -> tuple[float, ...]:
    numbers = parse_numbers(value)
    if min(numbers) <= 0:
        message = f"every number must be more than 0, the least is {min(numbers):g}"
        raise ValueError(message)
    return numbers


# Two steel surfaces are below 1e10 N/m; far above, a contact is lost in rounding [N/m].
STIFFEST = 1e12


Length = Annotated[float, _scalar(LENGTH)]
Time = Annotated[float, _scalar(TIME)]
Frequency = Annotated[float, _scalar(FREQUENCY)]
Force = Annotated[float, _scalar(FORCE)]
Stiffness = Annotated[float, _scalar(STIFFNESS), Le(STIFFEST)]
AngularStiffness = Annotated[float, _scalar(ANGULAR_STIFFNESS)]
Damping = Annotated[float, _scalar(DAMPING)]
Pressure = Annotated[float, _scalar(PRESSURE)]
Density = Annotated[float, _scalar(DENSITY)]
Acceleration = Annotated[float, _scalar(ACCELERATION)]
Area = Annotated[float, _scalar(AREA)]
SectionModulus = Annotated[float, _scalar(SECTION_MODULUS)]
Voltage = Annotated[float, _scalar(VOLTAGE)]
VoltageRatio = Annotated[float, _scalar(VOLTAGE_RATIO)]
CurrentSensitivity = Annotated[float, _scalar(CURRENT_SENSITIVITY)]
Resistance = Annotated[float, _scalar(RESISTANCE)]
Inductance = Annotated[float, _scalar(INDUCTANCE)]
Torque = Annotated[float, _scalar(TORQUE)]
Inertia = Annotated[float, _scalar(INERTIA)]
Mass = Annotated[float, _scalar(MASS)]
RotationalSpeed = Annotated[float, _scalar(ROTATIONAL_SPEED)]
Angle = Annotated[float, _scalar(ANGLE)]
ShaftRatio = Annotated[float, _scalar(SHAFT_RATIO)]
RotationalDrag = Annotated[float, _scalar(ROTATIONAL_DRAG)]
MotorConstant = Annotated[float, _scalar(MOTOR_CONSTANT)]
FieldConstant = Annotated[float, _scalar(FIELD_CONSTANT)]
HeatCapacity = Annotated[float, _scalar(HEAT_CAPACITY)]
PerEnergy = Annotated[float, _scalar(PER_ENERGY)]
Speed = Annotated[float, _scalar(SPEED)]
PerSpeed = Annotated[float, _scalar(PER_SPEED)]
Current = Annotated[float, _scalar(CURRENT)]
Temperature = Annotated[float, _scalar(TEMPERATURE)]
TemperatureCoefficient = Annotated[float, _scalar(TEMPERATURE_COEFFICIENT)]
LengthList = Annotated[tuple[float, ...], _list(LENGTH)]
TimeList = Annotated[tuple[float, ...], _list(TIME)]
ForceList = Annotated[tuple[float, ...], _list(FORCE)]
AreaList = Annotated[tuple[float, ...], _list(AREA)]
SecondMomentList = Annotated[tuple[float, ...], _list(SECOND_MOMENT)]


MOST_POINTS = 2000
"""Most points of one outline."""


def parse_points(
    value: object, dimension: Dimension = LENGTH, *, si: bool = False
) -> tuple[tuple[float, float], ...]:
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
        message = "`unit` must be a text such as the unit of " + dimension.name
        raise ValueError(message)
    if not isinstance(value, list | tuple) or not value:
        message = "needs a list of points [y, z]"
        raise ValueError(message)
    if len(value) > MOST_POINTS:
        message = f"has {len(value)} points; at most {MOST_POINTS} are read, leave some out"
        raise ValueError(message)
    metre = unit_factor(unit, dimension)
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


PointList = Annotated[
    tuple[tuple[float, float], ...], Quantity(LENGTH, parse_points, _POINTS_SCHEMA)
]
PositiveNumberList = Annotated[
    tuple[float, ...], BeforeValidator(_positive_numbers), WithJsonSchema(_NUMBERS_SCHEMA)
]
