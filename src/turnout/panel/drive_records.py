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
    gap_limit: Length | None = Field(
        None, gt=0, description="gap at which this drive refuses lock [m]; default lock.gap_limit"
    )
    extension: LengthList | None = Field(
        None, description="elastic law as a table: extension of the bushing, rising [m]"
    )
    force: ForceList | None = Field(None, description="elastic law as a table: its force [N]")


class Linkage(Placed):
    """A rod that transmits motion: stiff, with an adjustable length and play."""

    height: Length = Field(0.0, ge=-1, le=1, description="z of the connection [m]")
    stiffness: Stiffness = Field(gt=0, description="[N/m]")
    lost_motion: Length = Field(
        0.0, ge=0, le=0.5, description="play, half of it to either side of the free length [m]"
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
    """Linkage that moves a second place of a rail by a ratio of what the rail does at a drive."""

    drive: str = Field(description="the drive at whose place the linkage takes its motion")
    rails: list[str] | None = Field(None, description="names of the rails; default all")
    ratio: float = Field(
        gt=0, le=10, description="motion at `x` over motion at the drive's place [-]"
    )
    adjustment: Length = Field(
        0.0, ge=-0.1, le=0.1, description="moves its place further closed when closed [m]"
    )


class Sensor(Placed):
    """Switch rail control contact (TKK): measures the gap to the stock rail."""

    rail: str = Field(description="the switch rail whose gap it measures")
    height: Length = Field(ge=-1, le=1, description="z at which the gap is taken [m]")
    limit: Length = Field(gt=0, description="not in control at this gap or more [m]")


class Sleeper(Placed):
    """A named place along the panel, as counted in the field."""


class Lock(Record):
    """Rule by which the drives confirm locking at the end of a movement."""

    rule: Literal["slip or gap", "no slip", "raw gap"] = Field(
        "slip or gap",
        description="refused: 'slip or gap' where a drive is saturated or a gap at a drive is at "
        "its limit or above; 'no slip' where a drive is saturated; 'raw gap' where a gap is",
    )
    gap_limit: Length = Field(gt=0, description="gap at a drive from which lock is refused [m]")
