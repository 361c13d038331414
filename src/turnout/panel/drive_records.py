"""What moves the switch rails, joins them and watches them, as records."""

from typing import Literal

from pydantic import Field

from turnout.files.quantity import (
    AngularStiffness,
    Force,
    ForceList,
    Length,
    LengthList,
    Stiffness,
)
from turnout.panel.record import Placed, Record


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
