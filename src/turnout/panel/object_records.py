"""The records of foreign objects in a panel file."""

from typing import Annotated

from pydantic import Field

from turnout.core.quantity import (
    Density,
    Length,
    NameIn,
    Pressure,
    Record,
    Stiffness,
    Temperature,
    Time,
)
from turnout.law.object_kind import OBJECT_KINDS


class ObjectDefaults(Record):
    """Defaults for foreign objects that leave these values out."""

    rail: str = Field(description="switch rail that traps it")
    height: Length = Field(ge=-1, le=1, description="z of its contact with the switch rail [m]")
    stiffness: Stiffness = Field(gt=0, description="in compression only [N/m]")
    appears: Time | None = Field(
        None, ge=0, description="when it is placed; default onset of the last closing [s]"
    )
    disappears: Time | None = Field(
        None, gt=0, description="when it is taken away; default it stays [s]"
    )


class PanelObject(Record):
    """A foreign object that belongs to the panel file."""

    size: Length = Field(gt=0, description="extent across the gap [m]")
    at: str = Field(description="'sleeper 6', 'drive 1', 'sensor TKK1', 'chair 5' or 'x = 3.6 m'")
    rail: str | None = Field(None, description="switch rail that traps it")
    height: Length | None = Field(None, ge=-1, le=1, description="z of its contact [m]")
    stiffness: Stiffness | None = Field(None, gt=0, description="in compression only [N/m]")
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
