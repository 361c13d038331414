"""What happens when, as records: movements of the drives, foreign objects that come and go."""

from typing import Literal

from pydantic import Field

from turnout.files.quantity import (
    Length,
    Stiffness,
    Time,
    TimeList,
)
from turnout.panel.record import Record


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
    loaded: bool = Field(
        False,
        description="whether the drives start at their over-travel, where the movement before the "
        "first left them: the closed rail is then pressed against its stock rail",
    )
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
