"""The measuring chain as data: column, quantity and sensor of each channel of a recording.

Values are SI once a record exists. A raw value (offset, calibration reading) keeps its dimension,
as it may be a voltage, a voltage ratio, a strain, or already a force or a current.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self, get_args

import numpy as np
from pydantic import BeforeValidator, Field, ValidationError, model_validator

from turnout.core.errors import FileError, TurnoutError
from turnout.core.problems import choices, describe_error, nearest
from turnout.core.quantity import (
    CurrentSensitivity,
    Force,
    Frequency,
    Length,
    Pressure,
    Record,
    SectionModulus,
    Time,
    Voltage,
    VoltageRatio,
)
from turnout.core.toml import parse_toml
from turnout.core.units import (
    CURRENT,
    FORCE,
    POWER,
    STRAIN,
    VOLTAGE,
    VOLTAGE_RATIO,
    Dimension,
    parse_quantities,
    parse_quantity,
    unit_factor,
)
from turnout.measurement.chain.recorder import HIGHEST_ORDER, LEAST_INTERVAL, RC, LowPass, Recorder
from turnout.measurement.formats.assemble import tidy_unit


@dataclass(frozen=True, slots=True)
class LoadCalibration:
    """A straight line through known loads: load = scale (raw - offset).

    Attributes
    ----------
    scale : float
        Load for each unit of raw.
    offset : float
        Raw at no load.
    scale_error, offset_error : float
        Standard errors; NaN with two points, which leave nothing over to judge by.
    nonlinearity : float
        Largest distance of a point from the line, over the range of the loads.
    count : int
        Number of points.
    """

    scale: float
    offset: float
    scale_error: float
    offset_error: float
    nonlinearity: float
    count: int


def fit_load_calibration(raw: Sequence[float], load: Sequence[float]) -> LoadCalibration:
    r"""Fit a straight line to known loads by least squares.

    .. math:: F = a + s\,r, \quad u(s)^2 = \frac{\sum e_i^2}{(n - 2) \sum (r_i - \bar r)^2}

    The error of the offset :math:`-a / s` follows from both by first-order propagation, centred
    where the two are not correlated.

    Parameters
    ----------
    raw : sequence of float, length n
        Readings of the sensor, n >= 2.
    load : sequence of float, length n
        Loads at these readings.

    Returns
    -------
    LoadCalibration
        In the units of the two.

    Raises
    ------
    ValueError
        When the points do not determine a line.

    Examples
    --------
    >>> line = fit_load_calibration([1.0, 3.0, 5.0], [0.0, 10.0, 20.0])
    >>> line.scale, line.offset, round(line.nonlinearity, 12)
    (5.0, 1.0, 0.0)
    """
    if len(raw) != len(load):
        message = f"{len(raw)} readings and {len(load)} loads; there must be as many"
        raise ValueError(message)
    if len(raw) < 2:
        message = "needs at least 2 points"
        raise ValueError(message)
    r, f = np.asarray(raw, dtype=float), np.asarray(load, dtype=float)
    spread = float(np.sum((r - r.mean()) ** 2))
    if np.ptp(r) == 0 or np.ptp(f) == 0:
        message = "all readings are the same" if np.ptp(r) == 0 else "all loads are the same"
        raise ValueError(message)
    scale = float(np.sum((r - r.mean()) * (f - f.mean()))) / spread
    if scale == 0:
        message = "the readings do not depend on the load"
        raise ValueError(message)
    offset = float(r.mean() - f.mean() / scale)
    residual = f - scale * (r - offset)
    free = len(r) - 2
    variance = float(np.sum(residual**2)) / free if free else np.nan
    scale_error = float(np.sqrt(variance / spread))
    # The mean load and the slope are not correlated; the offset is r_mean - f_mean / scale.
    lever = float(f.mean()) / scale
    offset_error = float(np.sqrt(variance / len(r) + (lever * scale_error) ** 2)) / abs(scale)
    return LoadCalibration(
        scale=scale,
        offset=offset,
        scale_error=scale_error,
        offset_error=offset_error,
        nonlinearity=float(np.max(np.abs(residual)) / np.ptp(f)),
        count=len(r),
    )


RAW = (VOLTAGE, VOLTAGE_RATIO, STRAIN, CURRENT, FORCE, POWER)
EXAMPLES = ("V", "mV", "mV/V", "um/m", "A", "mA", "N", "kN", "W", "kW")
OF_DRIVES: dict[str, Dimension] = {
    "drive_force": FORCE,
    "drive_current": CURRENT,
    "drive_voltage": VOLTAGE,
    "drive_power": POWER,
}
"""Quantities that each drive may have, and their dimensions."""


def drives_together(name: str) -> tuple[str, ...]:
    """Return the drives that a name joins, as of one current for two machines; else none.

    Examples
    --------
    >>> drives_together("1+2"), drives_together("1")
    (('1', '2'), ())
    """
    names = tuple(part.strip() for part in name.split("+"))
    return names if len(names) > 1 and all(names) and len({*names}) == len(names) else ()


@dataclass(frozen=True, slots=True)
class RawUnit:
    """A unit of a column: its text, its dimension and its size in SI."""

    text: str
    dimension: Dimension
    factor: float


def raw_unit(text: str) -> RawUnit:
    """Understand the unit of a column; ValueError when it is none that a sensor gives.

    Examples
    --------
    >>> unit = raw_unit("mV/V")
    >>> unit.dimension.name, unit.factor
    ('voltage ratio', 0.001)
    """
    tidy = tidy_unit(text)
    for dimension in RAW:
        try:
            return RawUnit(tidy, dimension, unit_factor(tidy, dimension))
        except ValueError:
            continue
    message = f'"{text}" is no unit of a sensor, which is such as {choices(EXAMPLES)}'
    raise ValueError(message)


@dataclass(frozen=True, slots=True)
class RawValues:
    """Values in a unit of a column, in SI."""

    values: tuple[float, ...]
    dimension: Dimension


def _raw_value(value: object) -> RawValues:
    if isinstance(value, RawValues):
        return value
    unit = _unit_of(value)
    return RawValues((parse_quantity(value, unit.dimension),), unit.dimension)


def _raw_values(value: object) -> RawValues:
    if isinstance(value, RawValues):
        return value
    if not isinstance(value, dict) or not isinstance(value.get("unit"), str):
        message = 'must be a table such as { unit = "mV/V", values = [0.0, 0.2] }'
        raise ValueError(message)
    unit = raw_unit(value["unit"])
    given = {**value, "unit": unit.text}
    return RawValues(parse_quantities(given, unit.dimension), unit.dimension)


def _unit_of(value: object) -> RawUnit:
    parts = value.split(maxsplit=1) if isinstance(value, str) else []
    if len(parts) != 2:
        message = 'must be text with a number and a unit, such as "0.02 mV/V"'
        raise ValueError(message)
    return raw_unit(parts[1])


def _known_unit(value: object) -> str:
    if not isinstance(value, str):
        message = 'must be text, such as "mV/V"'
        raise ValueError(message)
    return raw_unit(value).text


RawValue = Annotated[Any, BeforeValidator(_raw_value)]
RawList = Annotated[Any, BeforeValidator(_raw_values)]
UnitText = Annotated[str, BeforeValidator(_known_unit)]


class Rest(Record):
    """A time at which nothing acts: the mean there is the zero of a channel."""

    start: Time = Field(ge=0, description="from the start of the recording [s]")
    end: Time = Field(gt=0, description="from the start of the recording [s]")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.end <= self.start:
            message = f"ends at {self.end:g} s, must be later than its start at {self.start:g} s"
            raise ValueError(message)
        return self


class SensorRecord(Record):
    """Keys of every sensor: a column, its unit, its zero and its direction."""

    column: str = Field(min_length=1, description="name of the column in the recording")
    unit: UnitText | None = Field(
        None, description="unit of the column; needed where the file does not state it"
    )
    sign: Literal[1, -1] = Field(1, description="-1 turns the direction round")
    offset: RawValue | None = Field(None, description="reading at no load, in a unit of the column")
    tare: Rest | None = Field(None, description="rest whose mean is taken off as zero")
    phases: list[str] = Field(
        [], description="columns of the other phases: their mean with this one, of powers their sum"
    )
    optional: bool = Field(False, description="whether recordings may lack the column: NaN then")
    gain_uncertainty: float | None = Field(
        None,
        ge=0,
        lt=0.5,
        description="standard uncertainty of the sensitivity, default 0.01; known loads or a shunt "
        "narrow it [-]",
    )


class Amplified(SensorRecord):
    """A bridge; its column is a voltage ratio, or a voltage behind excitation and amplifier."""

    excitation: Voltage | None = Field(None, gt=0, description="bridge excitation [V]")
    gain: float = Field(1.0, gt=0, description="of the amplifier, where the column is a voltage")


class StrainBridge(Amplified):
    """Strain gauges on a drive rod that is bent by an eccentric attachment."""

    kind: Literal["strain bridge"]
    bridge: Literal["full T", "full bending", "half bending", "quarter"] = "full T"
    gauge_factor: float = Field(gt=0, description="relative resistance over strain [-]")
    poisson_ratio: float = Field(0.3, ge=0, lt=0.5, description="of the rod [-]")
    youngs_modulus: Pressure = Field(gt=0, description="of the rod [Pa]")
    section_modulus: SectionModulus | None = Field(None, gt=0, description="of the rod [m3]")
    diameter: Length | None = Field(None, gt=0, description="of a solid round rod [m]")
    eccentricity: Length = Field(gt=0, description="from the gauges to the force [m]")

    @model_validator(mode="after")
    def _one_section(self) -> Self:
        if (self.section_modulus is None) == (self.diameter is None):
            message = "needs either section_modulus or diameter"
            raise ValueError(message)
        return self


class Clamp(SensorRecord):
    """A current clamp."""

    kind: Literal["clamp"]
    sensitivity: CurrentSensitivity = Field(gt=0, description="voltage for each ampere [V/A]")


class LoadCell(Amplified):
    """A load cell of strain gauges."""

    kind: Literal["load cell"]
    sensitivity: VoltageRatio = Field(gt=0, description="output at the capacity [V/V]")
    capacity: Force = Field(gt=0, description="load at which it has that output [N]")


class Scaled(SensorRecord):
    """A column that the data acquisition system scaled already."""

    kind: Literal["scaled"]


class KnownLoadSensor(SensorRecord):
    """A column calibrated by known loads, whatever the sensor."""

    kind: Literal["calibrated"]
    readings: RawList = Field(description="readings at the loads, with their unit")
    loads: RawList = Field(description="the loads, with their unit")

    @model_validator(mode="after")
    def _straight(self) -> Self:
        self.calibration()
        return self

    def calibration(self) -> LoadCalibration:
        """Fit the line: SI load for each SI unit of the readings."""
        return fit_load_calibration(self.readings.values, self.loads.values)


AnySensor = Annotated[
    StrainBridge | Clamp | LoadCell | Scaled | KnownLoadSensor, Field(discriminator="kind")
]
KINDS: dict[str, type[SensorRecord]] = {
    get_args(item.model_fields["kind"].annotation)[0]: item
    for item in (StrainBridge, Clamp, LoadCell, Scaled, KnownLoadSensor)
}


class RecordedFilter(Record):
    """The low-pass of a recorder or of its amplifiers: causal, all force channels alike."""

    kind: Literal["butterworth", "bessel", "rc"] = "butterworth"
    order: int | None = Field(
        None, ge=1, le=HIGHEST_ORDER, description="number of poles, default 2; 1 of an rc"
    )
    corner: Frequency = Field(
        ge=0.1, le=1e5, description="where the amplitude has fallen by 3 dB [Hz]"
    )

    @model_validator(mode="after")
    def _one_pole(self) -> Self:
        if self.kind == RC and self.order not in (None, 1):
            message = f"order = {self.order}: an rc has one pole; leave order out"
            raise ValueError(message)
        return self

    def low_pass(self) -> LowPass:
        """Return the low-pass in the form that is applied to simulated forces."""
        order = self.order or (1 if self.kind == RC else 2)
        return LowPass(kind=self.kind, order=order, corner=self.corner)


class ChannelMap(Record):
    """Column of each quantity in a recording; drives are named as in the panel."""

    schema_version: Literal[1] = 1
    title: str = Field("", description="what was measured with it")
    rate: Frequency | None = Field(
        None, gt=0, description="sample rate of the dataset [Hz]; default the highest of a column"
    )
    clock_uncertainty: float | None = Field(
        None,
        ge=0,
        lt=0.05,
        description="standard uncertainty of the recorder's sampling rate, default 0.001 [-]",
    )
    recorded_average: Time | None = Field(
        None,
        ge=1e-3,
        le=2,
        description="it averages over this time before each sample [s]",
    )
    recorded_filter: RecordedFilter | None = Field(
        None, description="low-pass of the recorder, such as { order = 2, corner = '6 Hz' }"
    )
    recorded_rate: Frequency | None = Field(
        None,
        ge=1,
        description="samples that the recorder takes, where the file holds more, interpolated [Hz]",
    )
    drive_force: dict[str, AnySensor] = Field({}, description="by the name of the drive")
    drive_current: dict[str, AnySensor] = Field({}, description="by the name of the drive")
    drive_voltage: dict[str, AnySensor] = Field({}, description="by the name of the drive")
    drive_power: dict[str, AnySensor] = Field({}, description="by the name of the drive")
    object_force: AnySensor | None = None

    def recorder(self) -> Recorder:
        """Return the response of the recorder in every force channel."""
        stated = self.recorded_filter
        return Recorder(
            low_pass=stated.low_pass() if stated is not None else None,
            average=self.recorded_average or 0.0,
            # Samples that are closer change nothing that is compared.
            rate=rate if (rate := self.recorded_rate or 0.0) * LEAST_INTERVAL < 1.0 else 0.0,
        )


def map_problem(error: Any) -> str:
    """Return key path and fault, without the kind that pydantic puts into the path."""
    path = [str(part) for part in error["loc"]]
    kind = next((part for part in path if part in KINDS), None)
    keys = [part for part in path if part != kind]
    fields = KINDS[kind].model_fields if kind else ChannelMap.model_fields
    if error["type"] == "union_tag_not_found":
        return f"{'.'.join(keys)}: kind is missing; must be {choices(KINDS)}"
    if error["type"] == "union_tag_invalid":
        tag = error["ctx"]["tag"]
        return f'{".".join(keys)}.kind = "{tag}": must be {choices(KINDS)}{nearest(tag, KINDS)}'
    return ".".join(keys) + describe_error(error, allowed=fields) + _hint(error, keys)


def _hint(error: Any, keys: list[str]) -> str:
    """Return a hint on the table of a misplaced key or the form of a share, else an empty text."""
    key = keys[-1]
    if error["type"] == "extra_forbidden":
        if len(keys) > 1 and key in ChannelMap.model_fields:
            return "; it belongs above the first table of the map"
        if len(keys) == 1 and key in SensorRecord.model_fields:
            return "; it belongs into the table of a channel"
    if key.endswith("_uncertainty"):
        return "; it is a share: 0.02 for 2 %, 1e-5 for 10 ppm"
    return ""


def typed_recorder(
    *, average: str | None = None, low_pass: str | None = None, rate: str | None = None
) -> Recorder:
    """Return a recorder's response from the texts that a channel map takes.

    Parameters
    ----------
    average, rate : str, optional
        Such as "0.1 s" and "20 Hz".
    low_pass : str, optional
        A corner frequency, "6 Hz", or as in a channel map, '{ kind = "rc", corner = "6 Hz" }'.

    Raises
    ------
    FileError
        With all problems.

    Examples
    --------
    >>> typed_recorder(low_pass="6 Hz", average="0.1 s").text
    'a Butterworth low-pass of order 2 at 6 Hz, a mean over the last 0.1 s'
    """
    given: dict[str, Any] = {"recorded_average": average, "recorded_rate": rate}
    problems = []
    if low_pass is not None:
        try:
            given["recorded_filter"] = _filter_table(low_pass)
        except TurnoutError:
            problems.append(
                f"--recorded-filter {low_pass}: must be a corner frequency such as '6 Hz', or a "
                'table as in a channel map: \'{ kind = "bessel", order = 4, corner = "6 Hz" }\''
            )
    stated: dict[str, Any] = {}
    for key, value in given.items():
        try:
            stated[key] = getattr(ChannelMap.model_validate({key: value}), key)
        except ValidationError as error:
            found = [map_problem(item) for item in error.errors(include_url=False)]
            problems += [f"--{text.replace('_', '-', 1)}" for text in dict.fromkeys(found)]
    if (stated.get("recorded_rate") or 0.0) * LEAST_INTERVAL >= 1.0:
        problems.append(
            f"--recorded-rate {rate}: must be below {1.0 / LEAST_INTERVAL:g} Hz; "
            "closer samples change nothing that is compared"
        )
    if problems:
        raise FileError("\n".join(problems))
    return ChannelMap.model_validate(given).recorder()


def _filter_table(text: str) -> object:
    if not text.strip().startswith("{"):
        return {"corner": text}
    return parse_toml(f"recorded_filter = {text}", source="--recorded-filter").data[
        "recorded_filter"
    ]
