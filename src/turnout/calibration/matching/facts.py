"""Facts and ranges of a panel, read from their file and held against the panel."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from turnout.calibration.matching.measures import MEASURES, SHARE
from turnout.core.errors import PanelError, StudyError
from turnout.core.json_files import to_plain
from turnout.core.library import open_toml
from turnout.core.problems import choices, nearest, show_value, validation_problems
from turnout.core.provenance import content_hash
from turnout.core.quantity import Record
from turnout.core.toml import TomlFile
from turnout.core.units import Dimension, parse_quantity
from turnout.panel.foreign_object import ForeignObject, parse_object, resolve_objects
from turnout.panel.load import LoadedPanel, load_named_panel
from turnout.study.variable import value_kind

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
    """A measure of a throw, or the sum of several terms; these take missing values from here."""

    name: str = Field(min_length=1, description="for tables and figures")
    terms: list[TermRecord] = Field([], description="default: this one term")


class FactRecord(SumRecord):
    """Fact that a panel must meet."""

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
    """Measurement on the track, by a throw or directly."""

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


Floats = NDArray[np.float64]
PACKAGE = "turnout.calibration.matching"
OF_MACHINES = "machine."
"""Beginning of keys of machines."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UnknownValue:
    """A number of the panel that is not known.

    Attributes
    ----------
    name : str
        For tables and figures.
    keys, complement : tuple of str
        Keys that take its value, and those that take 1 less it.
    minimum, maximum : float
        Range, in SI.
    apply, scale : str
        As in the file.
    unit : str
        SI unit; empty for plain numbers and factors.
    origin : str
        Of the range, as the file says.
    """

    name: str
    keys: tuple[str, ...]
    complement: tuple[str, ...]
    minimum: float
    maximum: float
    apply: str
    scale: str
    unit: str
    origin: str

    @property
    def of_machine(self) -> bool:
        """True if it is a value of a machine, which the panel alone does not have."""
        return self.keys[0].startswith(OF_MACHINES)

    def value(self, share: Floats) -> Floats:
        """Return values at shares of the range, 0 to 1, in SI."""
        if self.scale == "log":
            return np.asarray(self.minimum * (self.maximum / self.minimum) ** share)
        return np.asarray(self.minimum + share * (self.maximum - self.minimum))


@dataclass(frozen=True, slots=True)
class Term:
    """A measure of one throw, with its factor in a sum; the throw by object and changed values."""

    measure: str
    of: str
    object: str
    changes: tuple[tuple[str, Any], ...]
    factor: float

    @property
    def throw(self) -> tuple[str, tuple[tuple[str, Any], ...], bool]:
        """Object, changed values, and whether by machines: what sets its throw apart."""
        return self.object, self.changes, MEASURES[self.measure].by_machines


@dataclass(frozen=True, slots=True, kw_only=True)
class Sum:
    """A number made of measures of throws: a fact, an answer or a measurement.

    Attributes
    ----------
    name : str
        For tables and figures.
    terms : tuple of Term
        Their factors times their values are added up.
    unit : str
        SI unit; empty for plain numbers.
    least, most : float
        Of a fact; infinite where there is no bound.
    late : bool
        Of a fact: only where all others hold.
    precision : float
        Of a measurement: its standard deviation.
    parameter : str
        Of a measurement: the parameter that is measured, in place of terms; else empty.
    origin : str
        As the file says.
    """

    name: str
    terms: tuple[Term, ...]
    unit: str
    least: float = -np.inf
    most: float = np.inf
    late: bool = False
    precision: float = 0.0
    parameter: str = ""
    origin: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Facts:
    """Unknowns of a panel, and facts that its throws must meet.

    Attributes
    ----------
    name, description : str
        Of the file.
    panel : LoadedPanel
        With the values that are not parameters.
    seed : int
        Of all random numbers.
    parameters : tuple of UnknownValue
        What is not known.
    facts, measurements, answers : tuple of Sum
        What must hold, what could be measured, and what is reported.
    machines : tuple of (str, object)
        Values that make drives machines, in throws whose currents are measured.
    """

    name: str
    description: str
    panel: LoadedPanel
    seed: int
    parameters: tuple[UnknownValue, ...]
    facts: tuple[Sum, ...]
    measurements: tuple[Sum, ...]
    answers: tuple[Sum, ...]
    machines: tuple[tuple[str, Any], ...] = ()

    @property
    def digest(self) -> str:
        """Content hash of all that determines which panels are tried and accepted."""
        parameters = [replace(item, origin="") for item in self.parameters]
        facts = [replace(item, origin="") for item in self.facts]
        wanted = to_plain((parameters, facts, self.machines))
        return content_hash([self.seed, wanted, self.panel.hash])

    def overrides(self, shares: Floats, *, of_machines: bool = False) -> dict[str, object]:
        """Return the values of the panel, or of its machines, by key at a point, in SI."""
        found: dict[str, object] = {}
        for parameter, share in zip(self.parameters, shares, strict=True):
            if parameter.of_machine is not of_machines:
                continue
            value = float(parameter.value(share))
            for key in parameter.keys:
                if parameter.apply == "set":
                    found[key] = value
                    continue
                for full, own in self.panel.values_at(key).items():
                    found[full] = _applied(parameter.apply, own, value)
            found |= dict.fromkeys(parameter.complement, 1.0 - value)
        return found


def _applied(how: str, own: Any, value: float) -> Any:
    if isinstance(own, tuple):
        return [_applied(how, item, value) for item in own]
    return float(own) + value if how == "add" else float(own) * value


def load_facts(name_or_path: str | Path) -> Facts:
    """Load a facts file of the library by its name, or one by its path.

    Raises
    ------
    FileError
        When the file cannot be read or is not TOML.
    StudyError, PanelError
        With all problems at once.

    Examples
    --------
    >>> load_facts("paper-facts").panel.name
    'uic60-760-1-15'
    """
    return read_facts(open_toml(PACKAGE, name_or_path, kind="facts file"))


def read_facts(file: TomlFile) -> Facts:
    """Make facts of a TOML document that was already read."""
    try:
        record = FactsRecord.model_validate(file.data)
    except ValidationError as error:
        raise StudyError(validation_problems(error.errors()), source=file.source) from None
    panel = load_named_panel(record.panel, file)
    try:
        by_machines = panel.with_overrides(record.machines, si=False) if record.machines else None
    except PanelError as error:
        raise StudyError([f"machines: {p}" for p in error.problems], source=file.source) from None
    reader = _Reader(panel, by_machines, file, [], {})
    parameters = tuple(
        reader.parameter(item, number) for number, item in enumerate(record.parameter)
    )
    names = {item.name for item in parameters}
    facts = tuple(
        reader.sum("fact", each, number)
        for number, item in enumerate(record.fact)
        for each in item.each()
    )
    measurements = tuple(
        reader.measurement(item, number, parameters)
        for number, item in enumerate(record.measurement)
    )
    answers = tuple(reader.sum("answer", item, n) for n, item in enumerate(record.answer))
    if len(names) < len(parameters):
        reader.problems.append("parameter: two have the same name")
    if not any(not fact.late for fact in facts):
        reader.problems.append("fact: all are late; at least one must be tried on every panel")
    if reader.problems:
        raise StudyError(reader.problems, source=file.source)
    return Facts(
        name=record.name,
        description=record.description,
        panel=reader.panel,
        seed=record.seed,
        parameters=parameters,
        facts=facts,
        measurements=measurements,
        answers=answers,
        machines=tuple(sorted(record.machines.items())),
    )


@dataclass(frozen=True, slots=True)
class _Reader:
    """Reads the parts of a facts file against its panel and collects all problems.

    `by_machines` is the panel whose drives are machines, if the file says which; `dimensions` are
    those of the parameters that were read, by name.
    """

    panel: LoadedPanel
    by_machines: LoadedPanel | None
    file: TomlFile
    problems: list[str]
    dimensions: dict[str, Dimension]

    def origin(self, family: str, number: int, keys: tuple[str, ...]) -> str:
        """Return the first origin comment at keys of an entry of an array of tables."""
        for key in keys:
            found = self.file.origins.get((family, str(number), key))
            if found is not None:
                return f"{found.kind}: {found.text}"
        return ""

    def number(self, where: str, value: object, dimension: Dimension) -> float:
        """Read a value with its unit; 0 and a problem where it is none."""
        if dimension == SHARE:
            if isinstance(value, int | float) and not isinstance(value, bool):
                return float(value)
            self.problems.append(f"{where} = {show_value(value)}: must be a plain number")
            return 0.0
        try:
            return parse_quantity(value, dimension)
        except ValueError as error:
            self.problems.append(f"{where} = {show_value(value)}: {error}")
            return 0.0

    def parameter(self, record: ParameterRecord, number: int) -> UnknownValue:
        """Read a parameter and hold its keys against the panel."""
        where = f"parameter {number + 1} ({record.name})"
        dimension = SHARE
        of_machine = record.keys[0].startswith(OF_MACHINES)
        panel = (self.by_machines if of_machine else None) or self.panel
        for key in (*record.keys, *record.complement):
            try:
                kind = value_kind(panel, key, factor=record.apply == "multiply")
                panel.values_at(key)
            except (ValueError, PanelError) as error:
                self.problems.append(f'{where}.keys: "{key}": {error}')
                continue
            if isinstance(kind, Dimension) and record.apply != "multiply":
                dimension = kind
        self.dimensions[record.name] = dimension
        bounds = [
            self.number(f"{where}.{name}", getattr(record, name), dimension)
            for name in ("minimum", "maximum")
        ]
        if not bounds[0] < bounds[1] and not self.problems:
            self.problems.append(f"{where}: minimum must be less than maximum")
        if record.scale == "log" and not bounds[0] > 0 and not self.problems:
            self.problems.append(f"{where}: a log scale needs a minimum of more than 0")
        return UnknownValue(
            name=record.name,
            keys=tuple(record.keys),
            complement=tuple(record.complement),
            minimum=bounds[0],
            maximum=bounds[1],
            apply=record.apply,
            scale=record.scale,
            unit=dimension.unit,
            origin=self.origin("parameter", number, ("minimum", "maximum")),
        )

    def measurement(self, record: Any, number: int, parameters: tuple[UnknownValue, ...]) -> Sum:
        """Read a measurement: of a parameter itself, or of a sum of measures."""
        if record.parameter is None:
            return self.sum("measurement", record, number)
        where = f"measurement {number + 1} ({record.name})"
        known = {item.name: item for item in parameters}
        if record.parameter not in known:
            near = f"{nearest(record.parameter, known)}; there are {choices(known)}"
            self.problems.append(f'{where}.parameter = "{record.parameter}": is none{near}')
            return Sum(name=record.name, terms=(), unit="")
        dimension = self.dimensions[record.parameter]
        return Sum(
            name=record.name,
            terms=(),
            unit=dimension.unit,
            precision=self.number(f"{where}.precision", record.precision, dimension),
            parameter=record.parameter,
            origin=self.origin("measurement", number, ("precision",)),
        )

    def sum(self, family: str, record: SumRecord, number: int) -> Sum:
        """Read a fact, a measurement or an answer."""
        where = f"{family} {number + 1} ({record.name})"
        terms = tuple(self._term(where, part, record) for part in record.terms or [record])
        dimensions = {MEASURES[term.measure].dimension for term in terms if term.measure}
        if len(dimensions) > 1:
            self.problems.append(f"{where}: its terms are of different kinds, which do not add up")
        dimension = next(iter(dimensions), SHARE)
        bounds = {}
        for name in ("least", "most", "precision"):
            if (value := getattr(record, name, None)) is not None:
                bounds[name] = self.number(f"{where}.{name}", value, dimension)
        if family == "fact" and not bounds:
            self.problems.append(f"{where}: needs `least` or `most`")
        if bounds.get("least", -np.inf) > bounds.get("most", np.inf):
            self.problems.append(f"{where}: least is more than most")
        return Sum(
            name=record.name,
            terms=terms,
            unit=dimension.unit,
            least=bounds.get("least", -np.inf),
            most=bounds.get("most", np.inf),
            late=getattr(record, "late", False),
            precision=bounds.get("precision", 0.0),
            origin=self.origin(family, number, ("least", "most", "precision", "name")),
        )

    def _term(self, where: str, part: TermRecord, whole: SumRecord) -> Term:
        measure = part.measure or whole.measure or ""
        of = part.of if part.of is not None else whole.of or ""
        given = part.object if part.object is not None else whole.object or ""
        changes = {**whole.set, **part.set}
        known = MEASURES.get(measure)
        if known is None:
            near = f"{nearest(measure, MEASURES)}; there are {choices(MEASURES, most=40)}"
            self.problems.append(f'{where}.measure = "{measure}": is none{near}')
            measure = ""
        else:
            self._check_of(where, known.of, of)
        base: LoadedPanel | None = self.panel
        if known is not None and known.by_machines:
            base = self.by_machines
            if base is None:
                self.problems.append(
                    f'{where}: "{measure}" needs drives that are machines; give [machines], such '
                    'as "drive.1.machine" = "jea73"'
                )
        base = base or self.panel
        try:
            panel = base.with_overrides(changes, si=False) if changes else base
            if given:
                resolve_objects(panel, (parse_object(given),))
            if known is not None and known.of == "place" and of:
                resolve_objects(panel, (ForeignObject(0.01, of),))
        except PanelError as error:
            self.problems.extend(f"{where}: {text}" for text in error.problems)
        return Term(measure, of, given, tuple(sorted(changes.items())), part.factor)

    def _check_of(self, where: str, kind: str, of: str) -> None:
        families: dict[str, Mapping[str, Any]] = {
            "drive": self.panel.drive,
            "drive?": self.panel.drive,
            "sensor": self.panel.sensor,
        }
        names = families.get(kind, {})
        if kind in ("drive", "sensor", "place") and not of:
            self.problems.append(f"{where}.of: is missing, it names the {kind}")
        elif names and of and of not in names:
            text = f"{nearest(of, names)}; there are {choices(names)}"
            self.problems.append(f'{where}.of = "{of}": is no {kind.rstrip("?")}{text}')
