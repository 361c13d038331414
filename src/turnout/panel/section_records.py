"""Cross-sections of a panel as records: tables of numbers, and sections drawn as outlines.

A rail names its section, of whatever kind: a table, one outline all along, or an outline planed to
lie against a stock rail. Outlines have y positive AWAY from the stock rail, as drawings of switch
rails have it; tables count y TOWARDS it.
"""

from pydantic import Field

from turnout.core.quantity import (
    AreaList,
    Length,
    LengthList,
    PointList,
    PositiveNumberList,
    Record,
    SecondMomentList,
)


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
