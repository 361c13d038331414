"""A facts file: what is not known of a panel, with ranges, and facts that its throws must meet."""

from itertools import pairwise
from typing import Any, Literal

from pydantic import Field

from turnout.core.quantity import Record

Number = float | int | str


class ParameterRecord(Record):
    """A number of the panel that is not known, with its range."""

    name: str = Field(min_length=1, description="for tables and figures")
    keys: list[str] = Field(min_length=1, description="keys of the panel that take its value")
    complement: list[str] = Field([], description="keys that take 1 less its value")
    minimum: Number = Field(description="least value")
    maximum: Number = Field(description="largest value")
    apply: Literal["set", "add", "multiply"] = Field(
        "set", description="the value itself, or what is added to the panel's, or a factor of it"
    )
    scale: Literal["linear", "log"] = Field("linear", description="in which it is evenly likely")


class TermRecord(Record):
    """A measure of one throw, as a part of a sum."""

    measure: str | None = Field(None, description="name of a measure")
    of: str | None = Field(
        None, description="drive, sensor or, for a visible size, place that it is taken of"
    )
    object: str | None = Field(None, description='foreign object: "13 mm@sleeper 6"')
    set: dict[str, Any] = Field({}, description="values of the panel that differ in this throw")
    factor: float = Field(1.0, description="in the sum [-]")


def _term(item: str, factor: float) -> TermRecord:
    return TermRecord.model_validate({"object": item, "factor": factor})


class SumRecord(TermRecord):
    """A measure of a throw, or the sum of several terms, which take from here what they lack."""

    name: str = Field(min_length=1, description="for tables and figures")
    terms: list[TermRecord] = Field([], description="default: this one term")


class FactRecord(SumRecord):
    """What a panel must meet."""

    least: Number | None = Field(None, description="least allowed")
    most: Number | None = Field(None, description="largest allowed")
    late: bool = Field(
        False, description="only where all other facts hold, and not emulated: for costly ones"
    )
    grows: list[str] = Field(
        [], description="foreign objects; each is a fact about the change from the one before"
    )

    def each(self) -> "list[FactRecord]":
        """Return the facts that it stands for."""
        return [
            self.model_copy(
                update={
                    "name": f"{self.name}, {item.partition('@')[0]} after {old.partition('@')[0]}",
                    "terms": [_term(item, 1.0), _term(old, -1.0)],
                }
            )
            for old, item in pairwise(self.grows)
        ] or [self]


class MeasurementRecord(SumRecord):
    """What could be measured on the track, by a throw or directly."""

    parameter: str | None = Field(
        None, description="a parameter that is measured itself, in place of a measure"
    )
    precision: Number = Field(description="standard deviation of the measurement")


class FactsRecord(Record):
    """A facts file."""

    schema_version: Literal[1] = Field(description="version of this file format")
    name: str = Field(min_length=1, description="name of the file's subject")
    description: str = Field("", description="what it is, in a few sentences")
    panel: str = Field(description="library panel, or path of a panel file from this one")
    machines: dict[str, Any] = Field(
        {}, description="values that make drives machines, in throws whose currents are measured"
    )
    seed: int = Field(0, ge=0, lt=2**63, description="of all random numbers")
    parameter: list[ParameterRecord] = Field(min_length=1)
    fact: list[FactRecord] = Field(min_length=1)
    measurement: list[MeasurementRecord] = []
    answer: list[SumRecord] = []
