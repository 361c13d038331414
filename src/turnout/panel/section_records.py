"""Cross-sections of a panel as records."""

from pydantic import Field

from turnout.files.quantity import (
    AreaList,
    LengthList,
    PositiveNumberList,
    SecondMomentList,
)
from turnout.panel.record import Record


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
