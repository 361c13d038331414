"""Rails of a panel as records: switch rails, stock rails, and what varies along them."""

from typing import Annotated, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag

from turnout.files.quantity import (
    Length,
    LengthList,
)
from turnout.panel.record import Record


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


def _stress_free(value: object) -> object:
    """Read "closed", "open" or a fraction; one sentence says what is allowed."""
    if value in ("closed", "open"):
        return value
    number = float(value) if isinstance(value, int | float) else -1.0
    if isinstance(value, bool) or not 0.0 <= number <= 1.0:
        message = 'must be "closed", "open" or a fraction from 0 to 1, such as 0.25'
        raise ValueError(message)
    return number


StressFree = Annotated[Literal["closed", "open"] | float, BeforeValidator(_stress_free)]


class Rail(Record):
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

    @property
    def has_stock_rail(self) -> bool:
        """Whether the rail has a stock rail to close against."""
        return self.stock_rail_gap is not None or self.fit_gap is not None

    @property
    def fraction(self) -> float:
        """Place of the stress-free position on the way from closed (0) to open (1) [-]."""
        given = self.stress_free
        return given if isinstance(given, float) else {"closed": 0.0, "open": 1.0}[given]


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
