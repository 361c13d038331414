"""What a switch panel IS, as records: rails, supports, drives, sensors, schedule, foreign objects.

All values are SI once a record exists; lists of quantities are tuples. Lateral quantities are
positive in the closing direction of the instrumented switch rail, x runs from toe to heel, z is up
from the rail foot. Families such as `chair` map a name to a record; names are strings.
"""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag

from turnout.files.quantity import (
    Acceleration,
    AngularStiffness,
    AreaList,
    Damping,
    Density,
    Force,
    ForceList,
    Frequency,
    Length,
    LengthList,
    PositiveNumberList,
    Pressure,
    SecondMomentList,
    Stiffness,
    Time,
    TimeList,
)


class Record(BaseModel):
    """Base of all records: unknown keys are refused, nothing changes after validation."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        strict=True,
        allow_inf_nan=False,
        str_strip_whitespace=True,
    )


class Material(Record):
    """Linear elastic rail steel."""

    youngs_modulus: Pressure = Field(gt=0, description="Young's modulus [Pa]")
    poisson_ratio: float = Field(ge=0, lt=0.5, description="Poisson's ratio [-]")
    density: Density = Field(gt=0, description="mass density [kg/m3]")


class SectionTable(Record):
    """Cross-section properties along a rail, a row a station, linear in between.

    The stations are positions `x` along the rail, or offsets of the running edge from the stock
    rail's (`running_edge_offset`), which the rail's `running_edge` turns into positions. A single
    row is a prismatic rail. Second moments are about the centroid; y positions are measured from
    the rail's reference line, positive TOWARDS the stock rail that the rail closes against.
    """

    x: LengthList | None = Field(None, description="stations from the toe [m]")
    running_edge_offset: LengthList | None = Field(None, description="stations as offset w [m]")
    area: AreaList = Field(description="cross-section area A [m2]")
    second_moment_vertical: SecondMomentList = Field(description="vertical bending, I_y [m4]")
    second_moment_lateral: SecondMomentList = Field(description="lateral bending, I_z [m4]")
    product_moment: SecondMomentList | None = Field(None, description="I_yz [m4], default 0")
    torsion_constant: SecondMomentList = Field(description="St Venant J [m4]")
    shear_factor_vertical: PositiveNumberList = Field(description="shear area / area, vertical")
    shear_factor_lateral: PositiveNumberList = Field(description="shear area / area, lateral")
    centroid_height: LengthList = Field(description="z of the centroid above the foot [m]")
    centroid_offset: LengthList | None = Field(None, description="y of the centroid [m], default 0")
    shear_centre_height: LengthList | None = Field(
        None, description="z of the shear centre [m], default that of the centroid"
    )
    shear_centre_offset: LengthList | None = Field(
        None, description="y of the shear centre [m], default that of the centroid"
    )


class RunningEdge(Record):
    """Running edge on a tangent circle: w(x) = (x + lead)^2 / (2 radius), held within bounds."""

    radius: Length = Field(gt=0, description="radius of the outer running edge [m]")
    lead: Length = Field(description="distance of the toe behind the tangent point [m]")
    minimum: Length = Field(0.0, ge=0, description="least offset, the blade at the toe [m]")
    maximum: Length = Field(gt=0, description="offset from which the section is full [m]")


class Profile(Record):
    """A length that varies along x, held constant beyond its ends."""

    x: LengthList = Field(description="positions, rising [m]")
    value: LengthList = Field(description="the length at each position [m]")
    interpolation: Literal["linear", "cubic"] = Field(
        "linear", description="'cubic' is the not-a-knot spline, exact for a cubic parabola"
    )


def _gap_form(value: object) -> str:
    """Tell a tabulated gap from a constant one, so that an error speaks of one form only."""
    tabulated = isinstance(value, Profile) or (isinstance(value, dict) and "unit" not in value)
    return "profile" if tabulated else "length"


Gap = Annotated[
    Annotated[Length, Tag("length")] | Annotated[Profile, Tag("profile")],
    Discriminator(_gap_form),
]


class Rail(Record):
    """A switch rail, straight in its stress-free position."""

    closes: Literal["+y", "-y"] = Field(description="closing direction; instrumented rail: '+y'")
    stress_free: Literal["closed", "open"] = Field(description="position without any force")
    start: Length = Field(0.0, description="x of the toe end [m]")
    end: Length = Field(description="x of the heel end [m]")
    heel: Literal["clamped", "free"] = Field("free", description="condition at the heel end")
    section: str = Field(description="name of the section table")
    axis: Literal["foot", "centroid"] = Field(
        "foot",
        description="line of the beam nodes: the straight foot line with eccentric sections, or "
        "the centroids laid straight (leaves out the torque of lateral shear on a rising axis)",
    )
    running_edge: RunningEdge | None = Field(
        None, description="needed where the section's stations are running-edge offsets"
    )
    stock_rail_gap: Gap | None = Field(
        None,
        description="open distance to the unloaded stock rail in the stress-free position, at "
        "contact height [m]; leave out where there is none",
    )
    head_width: Length | None = Field(
        None, gt=0, description="full head width: w beyond it adds to the flangeway [m]"
    )


class StockRail(Record):
    """A flexible, prismatic stock rail that a switch rail closes against."""

    faces: str = Field(description="the switch rail that closes against it")
    start: Length = Field(description="x of its first end [m]")
    end: Length = Field(description="x of its last end [m]")
    ends: Literal["clamped", "free"] = Field("clamped", description="condition at both ends")
    section: str = Field(description="name of its section")
    foot_height: Length = Field(0.0, description="z of its foot, from the switch rail's [m]")


class Placed(Record):
    """Something at a place along the switch rails."""

    x: Length = Field(description="position from the toe [m]")


class OnRails(Placed):
    """Something that stands under or beside one or more switch rails."""

    rails: list[str] | None = Field(None, description="names of the rails; default all")


class Chair(OnRails):
    """Slide chair: unilateral vertical contact and Coulomb friction at each foot point."""

    foot_offsets: LengthList = Field((0.0,), description="y of the foot points [m]")
    foot_height: Length = Field(0.0, description="z of the foot points [m]")
    normal_stiffness: Stiffness = Field(gt=0, description="contact stiffness a foot point [N/m]")
    friction_coefficient: float = Field(ge=0, le=2, description="Coulomb friction [-]")
    stick_stiffness: Stiffness = Field(gt=0, description="tangential stiffness a foot point [N/m]")
    damping: Damping = Field(0.0, ge=0, description="vertical dashpot a foot point [N s/m]")
    clearance: Length = Field(0.0, description="free distance under the unloaded foot [m]")


class Fastening(OnRails):
    """Linear spring and damper in six directions between rail and sleeper."""

    height: Length = Field(0.0, description="z at which it acts [m]")
    stiffness_x: Stiffness = Field(0.0, ge=0, description="along x [N/m]")
    stiffness_y: Stiffness = Field(0.0, ge=0, description="along y [N/m]")
    stiffness_z: Stiffness = Field(0.0, ge=0, description="along z [N/m]")
    stiffness_roll: AngularStiffness = Field(0.0, ge=0, description="about x [N m/rad]")
    stiffness_pitch: AngularStiffness = Field(0.0, ge=0, description="about y [N m/rad]")
    stiffness_yaw: AngularStiffness = Field(0.0, ge=0, description="about z [N m/rad]")
    damping_x: Damping = Field(0.0, ge=0, description="along x [N s/m]")
    damping_y: Damping = Field(0.0, ge=0, description="along y [N s/m]")
    damping_z: Damping = Field(0.0, ge=0, description="along z [N s/m]")


class Stop(OnRails):
    """Unilateral lateral contact of the switch rail with the stock rail or a stud."""

    height: Length = Field(description="z of the contact [m]")
    stiffness: Stiffness = Field(gt=0, description="[N/m]")
    clearance: Length = Field(0.0, description="added to the stock rail gap at this place [m]")


class Drive(Placed):
    """Point machine as a moving marker that pushes one switch rail through a bilinear bushing."""

    rail: str = Field(description="the switch rail it is connected to")
    height: Length = Field(0.0, description="z of the rod connection [m]")
    stroke: Length = Field(gt=0, description="marker travel between closed and open [m]")
    over_travel_open: Length = Field(
        0.0, description="marker goes so far beyond the panel's open position [m]"
    )
    over_travel_closed: Length = Field(
        0.0, description="marker goes so far beyond the panel's closed position [m]"
    )
    stiffness: Stiffness = Field(gt=0, description="bushing below saturation [N/m]")
    saturation_force: Force = Field(gt=0, description="slip level of the clutch [N]")
    saturated_stiffness: Stiffness = Field(ge=0, description="bushing beyond saturation [N/m]")
    extension: LengthList | None = Field(
        None, description="elastic law as a table: extension of the bushing, rising [m]"
    )
    force: ForceList | None = Field(None, description="elastic law as a table: its force [N]")


class Link(Placed):
    """Linear lateral spring between two switch rails."""

    rails: list[str] = Field(min_length=2, max_length=2, description="the two rails it joins")
    height: Length = Field(0.0, description="z of the connection [m]")
    stiffness: Stiffness = Field(gt=0, description="[N/m]")


class Sensor(Placed):
    """Switch rail control contact (TKK): measures the gap to the stock rail."""

    rail: str = Field(description="the switch rail whose gap it measures")
    height: Length = Field(description="z at which the gap is taken [m]")
    limit: Length = Field(gt=0, description="not in control at this gap or more [m]")


class Sleeper(Placed):
    """A named place along the panel, as counted in the field."""


class Movement(Record):
    """One throw of all drives to the open or the closed position of the instrumented rail.

    "Open" and "closed" are always those of the instrumented rail; a drive on the other rail
    moves the same way in panel axes.
    """

    start: Time = Field(ge=0, description="onset [s]")
    duration: Time = Field(gt=0, description="time that a marker takes [s]")
    extra_time: dict[str, Time] = Field({}, description="added to `duration`, drive by drive [s]")
    to: Literal["open", "closed"] = Field(description="position of the instrumented rail after it")
    shape: Literal["raised cosine", "smoothstep", "linear", "table"] = Field(
        description="how a marker moves: 'raised cosine' is constant speed with smooth ends"
    )
    ramp: Time = Field(0.0, ge=0, description="length of each raised-cosine end [s]")
    table_time: TimeList | None = Field(None, description="table: time since the onset [s]")
    table_fraction: list[float] | None = Field(None, description="table: share of the travel [-]")
    table_file: str | None = Field(None, description="CSV file with columns time, fraction")


class Schedule(Record):
    """When the drives move; before, between and after the movements the markers rest."""

    starts: Literal["open", "closed"] = Field(description="position of the instrumented rail")
    end: Time = Field(gt=0, description="end of the simulation [s]")


class ObjectDefaults(Record):
    """What holds for a foreign object unless it says otherwise."""

    rail: str = Field(description="switch rail that traps it")
    height: Length = Field(description="z of its contact with the switch rail [m]")
    stiffness: Stiffness = Field(gt=0, description="in compression only [N/m]")
    appears: Time | None = Field(None, ge=0, description="default: onset of the last closing [s]")
    disappears: Time | None = Field(None, gt=0, description="default: it stays [s]")


class PanelObject(Record):
    """A foreign object that belongs to the panel file."""

    size: Length = Field(gt=0, description="extent across the gap [m]")
    at: str = Field(description="'sleeper 6', 'drive 1', 'sensor TKK1', 'chair 5' or 'x = 3.6 m'")
    rail: str | None = Field(None, description="switch rail that traps it")
    height: Length | None = Field(None, description="z of its contact [m]")
    stiffness: Stiffness | None = Field(None, gt=0, description="in compression only [N/m]")
    appears: Time | None = Field(None, ge=0, description="when it is placed [s]")
    disappears: Time | None = Field(None, gt=0, description="when it is taken away [s]")


class BeamDamping(Record):
    """Rayleigh damping of the beams (two frequencies), or stiffness-proportional (one)."""

    ratio: float = Field(ge=0, lt=1, description="share of critical [-]")
    frequencies: list[Frequency] = Field(
        min_length=1, max_length=2, description="where the ratio holds [Hz]"
    )


class Lock(Record):
    """Rule by which the drives confirm locking at the end of a movement."""

    rule: Literal["no slip", "raw gap"] = Field(
        "no slip", description="'no slip': no drive saturated; 'raw gap': every gap below the limit"
    )
    gap_limit: Length = Field(gt=0, description="largest raw gap at a drive [m]")


class Flangeway(Record):
    """Least open distance between switch rail and stock rail for the passing wheel."""

    limit: Length = Field(gt=0, description="least allowed distance [m]")


class Discretisation(Record):
    """How finely the rails are modelled."""

    element_length: Length = Field(gt=0, description="longest beam element [m]")
    superelement_cutoff: Frequency = Field(
        gt=0, description="fixed-interface modes up to here are kept in the superelements [Hz]"
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
    section: dict[str, SectionTable] = Field(min_length=1)
    rail: dict[str, Rail] = Field(min_length=1, max_length=2)
    stock_rail: dict[str, StockRail] = {}
    stock_fastening: dict[str, Fastening] = {}
    chair: dict[str, Chair] = {}
    fastening: dict[str, Fastening] = {}
    stop: dict[str, Stop] = {}
    stud: dict[str, Stop] = {}
    drive: dict[str, Drive] = Field(min_length=1, max_length=6)
    link: dict[str, Link] = {}
    sensor: dict[str, Sensor] = {}
    sleeper: dict[str, Sleeper] = {}
    schedule: Schedule
    movement: dict[str, Movement] = {}
    object_defaults: ObjectDefaults
    object: dict[str, PanelObject] = {}
    lock: Lock
    flangeway: Flangeway | None = None
