"""The records of a panel: sections, rails, supports, drives, links, sensors, schedule.

What all records of a panel share, and what the placed ones share beyond that. Cross-sections of a
panel as records: tables of numbers, and sections drawn as outlines.

A rail names its section, of whatever kind: a table, one outline all along, or an outline planed to
lie against a stock rail. Outlines have y positive AWAY from the stock rail, as drawings of switch
rails have it; tables count y TOWARDS it.

Matrices of one rail that another program has made, in place of sections and beams. Rails of a panel
as records: switch rails, stock rails, and what varies along them. What rails rest on, are held by
and strike, as records. What moves the switch rails, joins them and watches them, as records. What
happens when, as records: movements of the drives, foreign objects that come and go.
"""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag

from turnout.core.quantity import (
    AngularStiffness,
    AreaList,
    Damping,
    Force,
    ForceList,
    Length,
    LengthList,
    PointList,
    PositiveNumberList,
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


class Placed(Record):
    """Something at a place along the switch rails."""

    x: Length = Field(description="position from the toe [m]")


class OnRails(Placed):
    """Something that stands under or beside one or more switch rails."""

    rails: list[str] | None = Field(None, description="names of the rails; default all")


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


class DrawnOutline(Record):
    """The outline of a rail before planing: a polygon, its underside at z = 0."""

    points: PointList = Field(
        description="vertices (y, z) in order; y positive away from the stock rail [m]"
    )
    symmetric: bool = Field(
        False, description="only the half with y >= 0 is given; the other is its mirror image"
    )
    running_edge: Length | None = Field(
        None, description="y of the running edge; needed where the outline is planed or planes [m]"
    )


class OutlineSection(Record):
    """A prismatic section: one outline all along the rail, y = 0 of it on the reference line."""

    outline: str = Field(description="name of an outline, of this file or the library")


class PlanedSection(Record):
    """A switch rail's outline planed to lie against its stock rail; a cut for each station.

    The reference line is the switch rail's running edge, at the height of its underside. The
    stations are offsets w of the running edges, which the rail's `running_edge` turns into
    positions; properties are linear in w between them.
    """

    outline: str = Field(description="name of the switch rail's full outline")
    stock_outline: str = Field(description="name of the stock rail's outline")
    running_edge_offset: LengthList = Field(description="stations as offset w [m]")
    seat_height: Length = Field(
        description="underside of the switch rail above the stock rail's [m]"
    )
    clearance: Length = Field(0.0, ge=0, description="kept from the stock rail's outline [m]")
    lowering_offset: LengthList = Field((0.0,), description="offsets w of the lowering table [m]")
    lowering: LengthList = Field(
        (0.0,), description="top of the planed rail below the stock rail's there [m]"
    )
    least_thickness: Length = Field(
        0.0, ge=0, description="steel thinner than this is taken as cut away [m]"
    )


Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class RailMatrices:
    """A rail as matrices and a table that says which displacements its coordinates make.

    Attributes
    ----------
    stiffness, mass : csr_array, shape (n, n)
        Symmetric.
    damping : csr_array, shape (n, n), or None
        None: the panel's Rayleigh damping of these matrices.
    unit_weight : ndarray, shape (n,), or None
        Load for a gravity of 1 m/s2 in -z; None: from the mass.
    x, z : ndarray, shape (n_table,)
        Place of each displacement of the table, from the toe and above the foot [m].
    direction : tuple of str
        "ux", "uy", "uz", "rx", "ry" or "rz" of each.
    rows : csr_array, shape (n_table, n), or None
        Each displacement of the table for unit coordinates; None: the coordinates are the table.
    with_supports : bool
        The fastenings of the rail and its clamped heel are in the matrices already.
    digest : str
        Content hash of the file.
    """

    stiffness: sp.csr_array
    mass: sp.csr_array
    damping: sp.csr_array | None
    unit_weight: Floats | None
    x: Floats
    z: Floats
    direction: tuple[str, ...]
    rows: sp.csr_array | None
    with_supports: bool
    digest: str


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
    """A switch rail in its stress-free position, straight or curved in plan.

    The gap to the stock rail is data of its own: a curve changes what the rail does, not the gap.
    """

    closes: Literal["+y", "-y"] = Field(description="closing direction; instrumented rail: '+y'")
    stress_free: Literal["closed", "open"] = Field(description="position without any force")
    start: Length = Field(0.0, description="x of the toe end [m]")
    end: Length = Field(description="x of the heel end [m]")
    heel: Literal["clamped", "free"] = Field("free", description="condition at the heel end")
    section: str = Field(description="name of its section, of any kind")
    matrices: str | None = Field(
        None,
        description="file of matrices from another program (.mat), in place of section and beams",
    )
    axis: Literal["foot", "centroid"] = Field(
        "foot",
        description="line of the beam nodes: the straight foot line with eccentric sections, or "
        "the centroids laid straight (leaves out the torque of lateral shear on a rising axis)",
    )
    running_edge: RunningEdge | None = Field(
        None, description="needed where the section's stations are running-edge offsets"
    )
    curve_radius: Length | None = Field(
        None,
        ge=20,
        description="radius of the reference line in plan, away from the stock rail [m]; default "
        "straight",
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
    section: str = Field(description="name of its section: one row, or one outline")
    curve_radius: Length | None = Field(
        None,
        ge=20,
        description="radius of the rail in plan, away from the switch rail [m]; default straight",
    )
    foot_height: Length = Field(
        0.0, ge=-1, le=1, description="z of its foot, from the switch rail's [m]"
    )


class Chair(OnRails):
    """Slide chair: unilateral vertical contact and Coulomb friction at each foot point."""

    foot_offsets: LengthList | None = Field(
        None,
        description="y of the foot points, towards the rail's stock rail [m]; default the edges of "
        "the underside where the section is an outline, else the reference line",
    )
    foot_height: Length = Field(0.0, ge=-1, le=1, description="z of the foot points [m]")
    normal_stiffness: Stiffness = Field(gt=0, description="contact stiffness a foot point [N/m]")
    friction_coefficient: float = Field(ge=0, le=2, description="Coulomb friction [-]")
    stick_stiffness: Stiffness = Field(gt=0, description="tangential stiffness a foot point [N/m]")
    damping: Damping = Field(0.0, ge=0, description="vertical dashpot a foot point [N s/m]")
    clearance: Length = Field(0.0, description="free distance under the unloaded foot [m]")


class Fastening(OnRails):
    """Linear spring and damper in six directions between rail and sleeper."""

    height: Length = Field(0.0, ge=-1, le=1, description="z at which it acts [m]")
    offset: Length | None = Field(
        None,
        ge=-1,
        le=1,
        description="y at which it acts, towards the rail's stock rail [m]; default the middle of "
        "the underside where the section is an outline, else the reference line",
    )
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

    height: Length = Field(ge=-1, le=1, description="z of the contact [m]")
    stiffness: Stiffness = Field(gt=0, description="[N/m]")
    clearance: Length = Field(0.0, description="added to the stock rail gap at this place [m]")


class Drive(Placed):
    """Point machine as a moving marker that pushes one switch rail through a bilinear bushing."""

    rail: str = Field(description="the switch rail it is connected to")
    height: Length = Field(0.0, ge=-1, le=1, description="z of the rod connection [m]")
    roll_stiffness: AngularStiffness = Field(
        0.0, ge=0, description="of the rod's bracket against roll of the rail [N m/rad]"
    )
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
    machine: str | None = Field(
        None,
        description="name of a machine, of this file or the library, that moves the rod instead of "
        "a marker; the rod is then linear, with `stiffness`, and the machine's clutch slips",
    )


class Link(Placed):
    """Linear lateral spring between two switch rails."""

    rails: list[str] = Field(min_length=2, max_length=2, description="the two rails it joins")
    height: Length = Field(0.0, ge=-1, le=1, description="z of the connection [m]")
    stiffness: Stiffness = Field(gt=0, description="[N/m]")


class Sensor(Placed):
    """Switch rail control contact (TKK): measures the gap to the stock rail."""

    rail: str = Field(description="the switch rail whose gap it measures")
    height: Length = Field(ge=-1, le=1, description="z at which the gap is taken [m]")
    limit: Length = Field(gt=0, description="not in control at this gap or more [m]")


class Sleeper(Placed):
    """A named place along the panel, as counted in the field."""


class Lock(Record):
    """Rule by which the drives confirm locking at the end of a movement."""

    rule: Literal["no slip", "raw gap"] = Field(
        "no slip", description="'no slip': no drive saturated; 'raw gap': every gap below the limit"
    )
    gap_limit: Length = Field(gt=0, description="largest raw gap at a drive [m]")


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
    height: Length = Field(ge=-1, le=1, description="z of its contact with the switch rail [m]")
    stiffness: Stiffness = Field(gt=0, description="in compression only [N/m]")
    appears: Time | None = Field(None, ge=0, description="default: onset of the last closing [s]")
    disappears: Time | None = Field(None, gt=0, description="default: it stays [s]")


class PanelObject(Record):
    """A foreign object that belongs to the panel file."""

    size: Length = Field(gt=0, description="extent across the gap [m]")
    at: str = Field(description="'sleeper 6', 'drive 1', 'sensor TKK1', 'chair 5' or 'x = 3.6 m'")
    rail: str | None = Field(None, description="switch rail that traps it")
    height: Length | None = Field(None, ge=-1, le=1, description="z of its contact [m]")
    stiffness: Stiffness | None = Field(None, gt=0, description="in compression only [N/m]")
    appears: Time | None = Field(None, ge=0, description="when it is placed [s]")
    disappears: Time | None = Field(None, gt=0, description="when it is taken away [s]")
