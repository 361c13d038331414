"""What all records of a panel share, and what the placed ones share beyond that."""

from pydantic import BaseModel, ConfigDict, Field

from turnout.files.quantity import (
    Length,
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
