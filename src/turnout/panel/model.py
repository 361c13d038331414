"""A switch panel as records: rails, supports, drives, sensors, schedule, foreign objects.

All values are SI once a record exists; lists of quantities are tuples. Lateral quantities are
positive in the closing direction of the instrumented switch rail, x runs from toe to heel, z is up
from the rail foot. Families such as `chair` map a name to a record; names are strings.
"""

from collections.abc import Hashable
from typing import Any, Literal

from pydantic import BaseModel, Field

from turnout.core.keys import Keys
from turnout.core.provenance import content_hash
from turnout.core.quantity import (
    Acceleration,
    Density,
    Frequency,
    Length,
    Pressure,
    Record,
    Speed,
)
from turnout.machine.components import Machine
from turnout.panel.records import (
    BackDrive,
    Chair,
    DrawnOutline,
    Drive,
    Fastening,
    Link,
    Lock,
    Movement,
    ObjectDefaults,
    OutlineSection,
    PanelObject,
    PlanedSection,
    Rail,
    Schedule,
    SectionTable,
    Sensor,
    Sleeper,
    StockRail,
    Stop,
)


class Material(Record):
    """Linear elastic rail steel."""

    youngs_modulus: Pressure = Field(
        ge=1e9, le=1e12, description="Young's modulus, of a solid that rails are made of [Pa]"
    )
    poisson_ratio: float = Field(ge=0, lt=0.5, description="Poisson's ratio [-]")
    density: Density = Field(gt=0, description="mass density [kg/m3]")


class BeamDamping(Record):
    """Rayleigh damping of the beams (two frequencies), or stiffness-proportional (one)."""

    ratio: float = Field(ge=0, lt=1, description="share of critical [-]")
    frequencies: list[Frequency] = Field(
        min_length=1, max_length=2, description="where the ratio holds [Hz]"
    )


class Flangeway(Record):
    """Least open distance between switch rail and stock rail for the passing wheel."""

    limit: Length = Field(gt=0, description="least allowed distance [m]")


class GaugeClass(Record):
    """Greatest narrowing of the gauge up to a line speed."""

    up_to: Speed = Field(gt=0, description="line speed up to which it holds [m/s]")
    narrowing: Length = Field(
        gt=0, description="greatest allowed narrowing below the nominal gauge [m]"
    )


class TrackGauge(Record):
    """Track gauge beside a closed switch rail: design, and the narrowing that is allowed."""

    nominal: Length = Field(gt=0, description="nominal gauge [m]")
    height: Length = Field(
        ge=-1,
        le=1,
        description="z at which it is taken on the switch rail: 14 mm below the running surface, "
        "from the foot [m]",
    )
    fit_gap_is_design: bool = Field(
        False,
        description="whether the fit gap is meant, so that a rail which leaves it has the design "
        "gauge; an assumed one narrows the gauge",
    )
    limit: Length | None = Field(
        None,
        gt=0,
        description="greatest allowed narrowing below the nominal gauge, where no line_speed is "
        "given [m]",
    )
    line_speed: Speed | None = Field(
        None, gt=0, description="whose class of limits the gauge is judged by [m/s]"
    )
    limits: str | list[GaugeClass] | None = Field(
        None,
        description="limits by line speed: of the library, a file (.toml), or classes up_to and "
        'narrowing whose speeds rise; default "immediate-action"',
    )

    @property
    def allowed_narrowing(self) -> float | None:
        """Greatest narrowing at its line speed, or its own limit [m]; None without either."""
        if self.line_speed is None:
            return self.limit
        classes = self.limits if isinstance(self.limits, list) else []
        return next((c.narrowing for c in classes if self.line_speed <= c.up_to), None)


class Discretisation(Record):
    """Resolution of the rail model."""

    element_length: Length = Field(gt=0, description="longest beam element [m]")
    superelement_cutoff: Frequency = Field(
        gt=0,
        le=1e5,
        description="fixed-interface modes up to here are kept in the superelements [Hz]",
    )


class Panel(Record):
    """A complete switch panel."""

    schema_version: Literal[1] = Field(description="version of this file format")
    name: str = Field(min_length=1, description="name of the panel")
    description: str = Field("", description="what the panel is, in a few sentences")
    gravity: Acceleration = Field(ge=0, description="gravity, acts in -z [m/s2]")
    instrumented_rail: str = Field(
        description="the switch rail that drives, gaps and signs refer to; it closes '+y'"
    )
    material: Material
    damping: BeamDamping
    discretisation: Discretisation
    outline: dict[str, DrawnOutline] = {}
    section: dict[str, SectionTable] = {}
    outline_section: dict[str, OutlineSection] = {}
    planed_section: dict[str, PlanedSection] = {}
    rail: dict[str, Rail] = Field(min_length=1, max_length=2)
    stock_rail: dict[str, StockRail] = {}
    stock_fastening: dict[str, Fastening] = {}
    chair: dict[str, Chair] = {}
    fastening: dict[str, Fastening] = {}
    stop: dict[str, Stop] = {}
    stud: dict[str, Stop] = {}
    drive: dict[str, Drive] = Field(min_length=1, max_length=6)
    machine: dict[str, Machine] = {}
    link: dict[str, Link] = {}
    back_drive: dict[str, BackDrive] = {}
    sensor: dict[str, Sensor] = {}
    sleeper: dict[str, Sleeper] = {}
    schedule: Schedule
    movement: dict[str, Movement] = {}
    object_defaults: ObjectDefaults
    object: dict[str, PanelObject] = {}
    lock: Lock
    flangeway: Flangeway | None = None
    gauge: TrackGauge | None = None

    @property
    def gauge_limit(self) -> float | None:
        """Least gauge that is allowed [m]; None without a limit."""
        narrowing = None if self.gauge is None else self.gauge.allowed_narrowing
        if self.gauge is None or narrowing is None:
            return None
        return round(self.gauge.nominal - narrowing, 9)

    def gap_limits(self) -> dict[str, float]:
        """Return the gap from which each drive refuses lock [m]."""
        common = self.lock.gap_limit
        return {
            name: common if drive.gap_limit is None else drive.gap_limit
            for name, drive in self.drive.items()
        }

    def key_of(self, *parts: str) -> tuple[Hashable, ...]:
        """Return a key of some fields, by their values and by the order of the members of families.

        Results that name no member may be kept by it, such as rows in the order of "sensor".
        """
        families = [getattr(self, name) for name in parts]
        order = [tuple(family) for family in families if isinstance(family, dict)]
        return self.digest_of(*parts), *order

    def digest_of(self, *parts: str) -> str:
        """Return a content hash of some fields, such as "movement" and "schedule"."""
        return content_hash({name: plain_value(name, getattr(self, name)) for name in parts})


PANEL_KEYS = Keys(
    Panel, what="panel", example='drive.1.stiffness="750 kN/m"', growing=("object", "machine")
)
FAMILIES = PANEL_KEYS.families
"""Record of the members of each family: fields of a panel that map names to records."""


NOT_HASHED: dict[str, set[str]] = {"movement": {"table_file"}, "rail": {"matrices"}}
"""Fields of records that name files whose content counts instead."""


def plain_value(name: str, value: Any, left_out: frozenset[tuple[str, str]] = frozenset()) -> Any:
    """Return the value of a field of a panel as plain data, without some fields of families."""
    if isinstance(value, dict):
        return {key: plain_value(name, member, left_out) for key, member in value.items()}
    if isinstance(value, BaseModel):
        without = {field for family, field in left_out if family == name}
        return value.model_dump(mode="json", exclude=NOT_HASHED.get(name, set()) | without)
    return value
