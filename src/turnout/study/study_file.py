"""A study file as records: its content before it is held against a panel."""

from typing import Any, Literal

from pydantic import Field

from turnout.core.quantity import Record

Number = float | int | str


class VariableRecord(Record):
    """A quantity that varies: over values, each in turn, or drawn from a distribution."""

    key: str = Field(
        min_length=1, description="a key of the panel, of the object (object.size), or temperature"
    )
    name: str | None = Field(None, min_length=1, description="in the results; default the key")
    factor: bool = Field(False, description="multiply the panel's values instead of setting them")
    values: list[Any] | dict[str, Any] | None = Field(
        None,
        description='values with their unit, or {first, last, count}; places also "every sleeper" '
        'and "every drive"',
    )
    weights: list[float | int] | None = Field(
        None, description='of the values when one is drawn: distribution = "choice"'
    )
    distribution: str | None = Field(None, description="name of a distribution")
    minimum: Number | None = Field(None, description="least value")
    maximum: Number | None = Field(None, description="largest value")
    mean: Number | None = Field(None, description="of normal distributions, before truncation")
    standard_deviation: Number | None = Field(None, description="before truncation")
    median: Number | None = Field(None, description="of a lognormal distribution")
    log_deviation: Number | None = Field(
        None, description="standard deviation of the logarithm [-]"
    )
    mode: Number | None = Field(None, description="the most likely value of a triangle")
    alpha: Number | None = Field(None, description="first shape of a beta distribution [-]")
    beta: Number | None = Field(None, description="second shape of a beta distribution [-]")


class FieldRecord(VariableRecord):
    """A value for each member of a family, alike for members that stand near each other."""

    correlation_length: str = Field(description="distance in which correlation falls to 1/e")
    correlation: Literal["exponential", "gaussian"] = Field(
        "exponential", description="'exponential' is rough, 'gaussian' smooth"
    )


class TogetherRecord(Record):
    """Several variables side by side: a list of cases."""

    keys: list[str] = Field(min_length=1, description="what varies")
    factors: list[str] = Field(
        [],
        description="those of the keys whose values multiply the panel's instead of setting them",
    )
    rows: list[list[Any]] = Field(min_length=1, description="a value for each key, row by row")


class SamplingRecord(Record):
    """Sampling of the variables that have a distribution."""

    method: Literal["random", "latin hypercube", "sobol", "saltelli"] = Field(
        "random", description="'saltelli' is the design that first and total Sobol indices need"
    )
    count: int = Field(description="states of the switch that are drawn")


class CorrelationRecord(Record):
    """Two drawn variables that go together, through a Gaussian copula."""

    between: list[str] = Field(min_length=2, max_length=2, description="names of two variables")
    rank_correlation: float = Field(gt=-1, lt=1, description="Spearman's [-]")


class TemperatureLawRecord(Record):
    """Effect of temperature on a value: linear, or a table."""

    key: str = Field("chair.friction_coefficient", description="what is multiplied")
    reference: str | None = Field(None, description="where the factor is 1")
    coefficient: str | None = Field(None, description="change of the factor a kelvin")
    temperature: list[str] | None = Field(None, min_length=2, description="table, rising")
    factor: list[float | int] | None = Field(None, min_length=2, description="table [-]")


class RuleRecord(Record):
    """Condition for leaving out the rest of a chain of throws."""

    increase: str = Field(description="the variable that grows along a chain")
    until: Literal["a drive slips"] = Field("a drive slips", description="what ends a chain")
    at_least: Number | None = Field(None, description="values up to here are simulated in any case")


class OutputRecord(Record):
    """Channels and rate that are kept of each throw besides its labels."""

    rate: str | None = Field(
        None, description="kept instants a second; default 100 Hz, or 125 Hz in mode quick"
    )
    channels: list[str] | None = Field(
        None, description="histories that are kept; [] for labels alone"
    )
    keep: Literal["histories", "features"] = Field(
        "histories",
        description="'features': no histories, labels and features in single precision, in large "
        "batches, at most 300 bytes a throw",
    )


class StudyRecord(Record):
    """A study of many throws."""

    schema_version: Literal[1] = Field(description="version of this file format")
    name: str = Field(min_length=1, description="name of the study")
    description: str = Field("", description="what the study is for, in a few sentences")
    panel: str = Field(description="library panel, or path of a panel file from this one")
    calibration: str | None = Field(
        None, description="path of a calibration from this file; its values are put in the panel"
    )
    seed: int = Field(0, ge=0, lt=2**63, description="seed of all random numbers")
    set: dict[str, Any] = Field({}, description="values of the panel that differ in every throw")
    variable: list[VariableRecord] = []
    together: list[TogetherRecord] = []
    field: list[FieldRecord] = []
    sampling: SamplingRecord | None = None
    correlation: list[CorrelationRecord] = []
    temperature_law: TemperatureLawRecord | None = None
    rule: RuleRecord | None = None
    split: list[str] | None = Field(
        None, description="variables whose equal values stay together when data are split"
    )
    output: OutputRecord = OutputRecord.model_validate({})
    scheme: dict[str, Any] = Field(
        {}, description="mode (waveform, quick, quasi-static), and choices of Scheme that differ"
    )
