"""The records of a panel: sections, rails, supports, drives, links, sensors, schedule, objects.

A rail names its section, of whatever kind: a table, one outline all along, or an outline planed to
lie against a stock rail. Outlines have y positive AWAY from the stock rail, as drawings of switch
rails have it; tables count y TOWARDS it.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag

from turnout.core.quantity import (
    AngularStiffness,
    AreaList,
    Damping,
    Density,
    Force,
    ForceList,
    Length,
    LengthList,
    NameIn,
    PerSpeed,
    PointList,
    PositiveNumberList,
    Pressure,
    Record,
    SecondMomentList,
    Speed,
    Stiffness,
    Temperature,
    Time,
    TimeList,
)
from turnout.law.friction_state import FRICTION_STATES, FrictionCurve, curves_along
from turnout.law.object_kind import OBJECT_KINDS
from turnout.panel.lock_rule import DEFAULT_RULE, LOCK_RULES, rules_text

if TYPE_CHECKING:
    RuleName = str
else:
    RuleName = Literal[tuple(LOCK_RULES)]


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
        (0.0,),
        description="top of the planed rail below the stock rail's there, from 0 to less than "
        "the height of the stock rail above seat_height [m]",
    )
    least_thickness: Length = Field(
        0.0, ge=0, description="steel thinner than this is taken as cut away [m]"
    )


class Placed(Record):
    """Something at a place along the switch rails."""

    x: Length = Field(description="position from the toe [m]")


class OnRails(Placed):
    """Something that stands under or beside one or more switch rails."""

    rails: list[str] | None = Field(None, description="names of the rails; default all")


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


class ScaledSection(Record):
    """Factors by which a rail's section differs from the one that it names, as sections vary.

    Rolling tolerances and wear change a section by a few per cent, an unknown planing by more. What
    differs by more than a factor of two is another section, to be drawn or tabulated as such.
    """

    section_scale: float = Field(
        1.0,
        ge=0.5,
        le=2.0,
        description="factor of area, second moments, product moment and torsion constant: mass "
        "and all stiffness alike [-]",
    )
    lateral_inertia_scale: float = Field(
        1.0,
        ge=0.5,
        le=2.0,
        description="further factor of the second moment for lateral bending, of the product "
        "moment by its square root; the area stays [-]",
    )


class RunningEdge(Record):
    """Running edge on a circle: w(x) = tangent_offset + (x + lead)^2 / (2 radius), in bounds."""

    radius: Length = Field(gt=0, description="radius of the outer running edge [m]")
    lead: Length = Field(
        description="distance of the toe behind the point where the circle runs parallel [m]"
    )
    tangent_offset: Length = Field(
        0.0,
        description="offset at that point; negative where the rails meet at an angle [m]",
    )
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
    """Distinguish a tabulated gap from a constant one, so that an error speaks of one form only."""
    tabulated = isinstance(value, Profile) or (isinstance(value, dict) and "unit" not in value)
    return "profile" if tabulated else "length"


Gap = Annotated[
    Annotated[Length, Tag("length")] | Annotated[Profile, Tag("profile")],
    Discriminator(_gap_form),
]


def _stress_free(value: object) -> object:
    """Read "closed", "open" or a fraction; refuse others and state the allowed values."""
    if value in ("closed", "open"):
        return value
    number = float(value) if isinstance(value, int | float) else -1.0
    if isinstance(value, bool) or not 0.0 <= number <= 1.0:
        message = 'must be "closed", "open" or a fraction from 0 to 1, such as 0.25'
        raise ValueError(message)
    return number


StressFree = Annotated[Literal["closed", "open"] | float, BeforeValidator(_stress_free)]


class Rail(ScaledSection):
    """A switch rail in its stress-free position, straight or curved in plan.

    With `fit_gap` its shapes are computed: closed, the rail is held by its drives and leaves that
    gap to the stock rail; open, the drives have moved it by their strokes; stress-free, it stands
    at the fraction `stress_free` between the two. With `stock_rail_gap` the stress-free shape is
    typed. The gap is data of its own: a curve changes what the rail does, not the gap.
    """

    closes: Literal["+y", "-y"] = Field(description="closing direction; instrumented rail: '+y'")
    stress_free: StressFree = Field(
        description="position without any force: 'closed', 'open', or the fraction of the way "
        "from closed to open [-]"
    )
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
    fit_gap: Gap | None = Field(
        None,
        description="open distance to the unloaded stock rail that is left when the drives hold "
        "the rail closed, at contact height, without any contact [m]; the stress-free shape "
        "follows from it, `stress_free` and the strokes",
    )
    stock_rail_gap: Gap | None = Field(
        None,
        description="typed or measured shape in place of fit_gap: open distance to the unloaded "
        "stock rail in the stress-free position, at contact height [m]",
    )
    independent_shape: bool = Field(
        False,
        description="whether a typed shape is taken as it is, though it contradicts the strokes",
    )
    head_width: Length | None = Field(
        None, gt=0, description="full head width: w beyond it adds to the flangeway [m]"
    )
    gauge_widening: Gap | None = Field(
        None, description="design gauge of its route less the nominal gauge, where it is closed [m]"
    )

    @property
    def has_stock_rail(self) -> bool:
        """True if the rail has a stock rail to close against."""
        return self.stock_rail_gap is not None or self.fit_gap is not None

    @property
    def fraction(self) -> float:
        """Place of the stress-free position on the way from closed (0) to open (1) [-]."""
        given = self.stress_free
        return given if isinstance(given, float) else {"closed": 0.0, "open": 1.0}[given]


class StockRail(ScaledSection):
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
    frozen_force: Force = Field(
        0.0, ge=0, description="a rail is frozen to it where it rests, until this lateral force [N]"
    )
    roller_lift: Length | None = Field(
        None,
        ge=-0.02,
        le=0.02,
        description="height above the plate at which a roller on springs begins to carry the "
        "unloaded foot; where it is below, once the plate yields so far [m]; default no roller",
    )
    roller_stiffness: Stiffness = Field(
        5e5, gt=0, description="of the roller's spring a foot point [N/m]"
    )
    roller_friction: float = Field(
        0.03,
        ge=0,
        le=2,
        description="of a rail that runs on the roller, 0.02 to 0.05 as a rule [-]",
    )
    friction_opening: LengthList | None = Field(
        None,
        description="friction along the stroke: openings from the closed position, rising from 0, "
        "from which on each factor holds [m]",
    )
    friction_factor: list[float] | None = Field(
        None, description="friction along the stroke: factors on friction_coefficient [-]"
    )
    friction_state: str | list[str] | None = Field(
        None,
        description=f"{', '.join(FRICTION_STATES)}, or one of them from each friction_opening on: "
        "multiplies friction_coefficient, that of a sound chair, and sets the three values below; "
        "default a constant coefficient",
    )
    static_ratio: float | None = Field(
        None,
        description="coefficient at rest over that in motion, 1 to 5 [-]; default of the state, or "
        "1",
    )
    stribeck_speed: Speed | None = Field(
        None,
        gt=0,
        description="at which half of what is more at rest is left [m/s]; default of the state, or "
        "0.005 m/s",
    )
    friction_rise: PerSpeed | None = Field(
        None,
        ge=0,
        description="share by which friction rises per speed, as grease does [s/m]; default of the "
        "state, or 0",
    )

    @property
    def friction_states(self) -> list[str]:
        """Names of its states, one or one from each opening on; none without."""
        given = self.friction_state
        return [given] if isinstance(given, str) else given or []

    @property
    def friction_curves(self) -> tuple[FrictionCurve, ...]:
        """Curves of `friction_coefficient` times their levels, from each opening on."""
        factors = self.friction_factor or [1.0] * len(self.friction_opening or (0.0,))
        own = (self.static_ratio, self.stribeck_speed, self.friction_rise)
        return curves_along(tuple(factors), tuple(self.friction_states), own)


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
    stiffness: Stiffness = Field(gt=0, description="of the contact, in compression only [N/m]")
    clearance: Length = Field(0.0, description="added to the stock rail gap at this place [m]")


class Drive(Placed):
    """Point machine as a moving marker that pushes one switch rail through a bilinear bushing."""

    rail: str = Field(description="the switch rail it is connected to")
    height: Length = Field(0.0, ge=-1, le=1, description="z of the rod connection [m]")
    rod_slope: float = Field(
        0.0,
        ge=-1,
        le=1,
        description="rise of the line from the rod's machine end to its rail end over its way in "
        "+y: vertical over lateral force on the rail, a push lifts where it is positive [-]",
    )
    roll_stiffness: AngularStiffness = Field(
        0.0, ge=0, description="of the rod's bracket against roll of the rail [N m/rad]"
    )
    stroke: Length = Field(gt=0, description="marker travel between closed and open [m]")
    lost_motion: Length = Field(
        0.0,
        ge=0,
        le=0.3,
        description="of a clamp lock: way of its slide before it takes a closed rail with it, and "
        "after a closing rail is home [m]",
    )
    over_travel_open: Length = Field(
        0.0, description="marker goes so far beyond the panel's open position [m]"
    )
    over_travel_closed: Length = Field(
        0.0, description="marker goes so far beyond the panel's closed position [m]"
    )
    stiffness: Stiffness = Field(gt=0, description="bushing below saturation [N/m]")
    saturation_force: Force = Field(gt=0, description="slip level of the clutch [N]")
    saturated_stiffness: Stiffness = Field(ge=0, description="bushing beyond saturation [N/m]")
    gap_limit: Length | None = Field(
        None, gt=0, description="gap at which this drive refuses lock [m]; default lock.gap_limit"
    )
    extension: LengthList | None = Field(
        None, description="elastic law as a table: extension of the bushing, rising [m]"
    )
    force: ForceList | None = Field(None, description="elastic law as a table: its force [N]")
    machine: str | None = Field(
        None,
        description="name of a machine, of this file or the library, that moves the rod instead of "
        "a marker; the rod is then linear, with `stiffness`, and the machine's clutch slips",
    )


class Linkage(Placed):
    """A rod that transmits motion: stiff, with an adjustable length and play."""

    height: Length = Field(0.0, ge=-1, le=1, description="z of the connection [m]")
    stiffness: Stiffness = Field(gt=0, description="along the rod [N/m]")
    lost_motion: Length = Field(
        0.0, ge=0, le=0.1, description="play, half of it to either side of the free length [m]"
    )


class Link(Linkage):
    """Linear lateral spring between two switch rails.

    It is free of force in the through route, where the instrumented rail is closed and the other
    open, each in its position by strokes; `adjustment` lengthens it from there.
    """

    rails: list[str] = Field(min_length=2, max_length=2, description="the two rails it joins")
    adjustment: Length = Field(
        0.0, ge=-0.1, le=0.1, description="added to its free length; spreads the rails [m]"
    )


class BackDrive(Linkage):
    """Linkage that moves a second place of a rail by a ratio of the rail's motion at a drive."""

    drive: str = Field(description="the drive at whose place the linkage takes its motion")
    rails: list[str] | None = Field(None, description="names of the rails; default all")
    ratio: float = Field(
        gt=0, le=10, description="motion at `x` over motion at the drive's place [-]"
    )
    adjustment: Length = Field(
        0.0, ge=-0.1, le=0.1, description="moves its place further closed when closed [m]"
    )


class Sensor(Placed):
    """Switch rail control contacts (TKK): a pair, one on each rail, or one on one rail.

    Of a pair the contact on the rail that should be closed counts, as at a drive.
    """

    rail: str | None = Field(
        None, description="the one switch rail whose gap it measures; default a pair, one on each"
    )
    height: Length = Field(ge=-1, le=1, description="z at which the gap is taken [m]")
    limit: Length = Field(gt=0, description="not in control at this gap or more [m]")


class Sleeper(Placed):
    """A named place along the panel, as counted in the field."""


class Lock(Record):
    """Rule by which the drives confirm locking at the end of a movement."""

    rule: RuleName = Field(DEFAULT_RULE, description=f"refused: {rules_text()}")
    gap_limit: Length = Field(gt=0, description="gap at a drive from which lock is refused [m]")


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
    """Schedule of the movements; before, between and after them the markers rest."""

    starts: Literal["open", "closed"] = Field(description="position of the instrumented rail")
    loaded: bool = Field(
        False,
        description="whether the start is what the schedule's last movement to it leaves: drives "
        "at their over-travel, the closed rail pressed home, friction in the chairs; default at "
        "the strokes, without friction",
    )
    loaded_by: Literal["return", "cycles"] = Field(
        "return",
        description="motion before a loaded start: 'return' is the last three fifths of that "
        "movement in long steps, 'cycles' the whole schedule in the steps of the run until the "
        "forces of drives repeat to 0.5 N, which takes two to four throws more",
    )
    end: Time = Field(
        gt=0, description="end of the simulation; later where machines arrive later [s]"
    )


class ObjectDefaults(Record):
    """Defaults for foreign objects that leave these values out."""

    rail: str = Field(description="switch rail that traps it")
    height: Length = Field(ge=-1, le=1, description="z of its contact with the switch rail [m]")
    stiffness: Stiffness = Field(gt=0, description="in compression only [N/m]")
    face_slope: float = Field(
        0.0,
        ge=-1,
        le=1,
        description="of the face that it presses on, against the vertical: vertical over lateral "
        "force on the switch rail, which is lifted where it is positive [-]",
    )
    appears: Time | None = Field(
        None, ge=0, description="when it is placed; default onset of the last closing [s]"
    )
    disappears: Time | None = Field(
        None, gt=0, description="when it is taken away; default it stays [s]"
    )


LEAST_SUSPECT = 1.0
"""From this size on the number of an object was meant in millimetres [m]."""


def _no_metres(size: float) -> float:
    if size >= LEAST_SUSPECT:
        message = (
            f"metres? Nothing of {size:g} m is trapped in a switch; "
            f'write {1e-3 * size:g} or "{size:g} mm"'
        )
        raise ValueError(message)
    return size


class PanelObject(Record):
    """A foreign object that belongs to the panel file."""

    size: Annotated[Length, AfterValidator(_no_metres)] = Field(
        gt=0, description="extent across the gap [m]"
    )
    at: str = Field(description="'sleeper 6', 'drive 1', 'sensor TKK1', 'chair 5' or 'x = 3.6 m'")
    rail: str | None = Field(None, description="switch rail that traps it")
    height: Length | None = Field(None, ge=-1, le=1, description="z of its contact [m]")
    stiffness: Stiffness | None = Field(None, gt=0, description="in compression only [N/m]")
    face_slope: float | None = Field(
        None, ge=-1, le=1, description="vertical over lateral force on the switch rail [-]"
    )
    appears: Time | None = Field(None, ge=0, description="when it is placed [s]")
    disappears: Time | None = Field(None, gt=0, description="when it is taken away [s]")
    kind: Annotated[str, NameIn(OBJECT_KINDS)] = Field(
        "spring", description="what it is; a spring is elastic and never breaks"
    )
    length: Length | None = Field(None, gt=0, description="extent along the rail [m]")
    depth: Length | None = Field(None, gt=0, description="upright extent [m]")
    strength: Pressure | None = Field(
        None,
        gt=0,
        description="stone: splitting force over size squared; ice: crushing pressure; wood, "
        "metal: yield [Pa]",
    )
    density: Density | None = Field(None, gt=0, description="of snow [kg/m3]")
    temperature: Temperature | None = Field(None, gt=0, description="of ice and snow [K]")
    piece: float | None = Field(
        None, ge=0, le=0.95, description="share of the size that stays when it breaks [-]"
    )
