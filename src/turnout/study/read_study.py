"""Read a study file against its panel: scheme, output, design and all problems at once."""

import copy
import math
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Any

from pydantic import BaseModel, ValidationError

from turnout.core.channels import unknown_channels
from turnout.core.errors import SolverError, StudyError
from turnout.core.keys import records_in
from turnout.core.problems import choices, describe_error, nearest, show_value
from turnout.core.scheme import MODES, Scheme
from turnout.core.toml import TomlFile
from turnout.core.units import (
    FORCE,
    FREQUENCY,
    LENGTH,
    TIME,
    Dimension,
)
from turnout.panel.load import LoadedPanel
from turnout.panel.schema import DRAFT, tidy
from turnout.study.design import Axis, Design
from turnout.study.distribution import PARAMETERS
from turnout.study.random_inputs import (
    MOST_SCENARIOS,
    RandomField,
    TemperatureLaw,
    read_fields,
    read_law_of_temperature,
    read_pairs,
    read_quantity,
    sampling_faults,
)
from turnout.study.sampling import copula_factor
from turnout.study.scenario import Output, Rule
from turnout.study.study_file import StudyRecord
from turnout.study.value_ranges import limit_faults
from turnout.study.variable import Variable
from turnout.study.variables import CHOICE, ParsedStudy, read_together, read_variable

SCHEME_UNITS: dict[str, Dimension] = {
    "step": TIME,
    "cutoff_frequency": FREQUENCY,
    "gap_tolerance": LENGTH,
    "force_tolerance": FORCE,
}
OUTPUT_INTERVAL_KEY = "output_interval"

DEFAULT_INTERVAL = 0.01
"""Between kept instants, if a study gives none and steps fall on it [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyParts:
    """Content of a study file, held against the limits of its panel."""

    panel: LoadedPanel
    scheme: Scheme
    output: Output
    design: Design
    variables: dict[str, Variable]
    fields: tuple[RandomField, ...]
    law: TemperatureLaw | None
    rule: Rule | None
    split: tuple[str, ...]


def read_record(file: TomlFile) -> tuple[StudyRecord, list[str]]:
    """Make the record of a study file, without the keys that are unknown, which it lists.

    Raises
    ------
    StudyError
        Where anything else is wrong with keys and types.
    """
    try:
        return StudyRecord.model_validate(file.data), []
    except ValidationError as error:
        errors = error.errors(include_url=False)
    found = dict[str, str]()
    for item in errors:  # of a value that may be of several types, the fault as the first of them
        path, text = _describe_error(item, file.data)
        found.setdefault(path, text)
    problems = list(found.values())
    known = copy.deepcopy(file.data)
    for item in errors:
        if item["type"] == "extra_forbidden":
            table: Any = known
            for part in item["loc"][:-1]:
                table = table[part]
            del table[item["loc"][-1]]
    try:
        return StudyRecord.model_validate(known), problems
    except ValidationError:
        raise StudyError(list(dict.fromkeys(problems)), source=file.source) from None


def _describe_error(error: Any, data: Any) -> tuple[str, str]:
    """Return the key path of an error from pydantic, and this with its fault.

    Parts of a list have their number.
    """
    path, inside = "", data
    record: type[BaseModel] = StudyRecord
    for part in error["loc"]:
        if isinstance(part, int):
            inside = inside[part]
            key = inside.get("key") if isinstance(inside, dict) else None
            path += f" {part + 1}" + (f" ({key})" if isinstance(key, str) else "")
            continue
        if not isinstance(inside, dict):  # a type that the value may have
            break
        path += f".{part}" if path else str(part)
        field = record.model_fields.get(part)
        inner = next(records_in(field.annotation), None) if field is not None else None
        record = inner or record
        inside = inside.get(part, {})
    return path, path + describe_error(error, allowed=record.model_fields)


def read_parts(
    record: StudyRecord, panel: LoadedPanel, *, source: str, problems: Iterable[str] = ()
) -> StudyParts:
    """Read everything of a study and hold it against its panel.

    Parameters
    ----------
    record : StudyRecord
        Content of the file.
    panel : LoadedPanel
        With the calibration and the values that the study sets.
    source : str
        Name of the file in messages.
    problems : iterable of str
        Found before: unknown keys, values that cannot be set.

    Raises
    ------
    StudyError
        With all problems at once.
    """
    parsed = ParsedStudy(panel, problems=list(problems))
    for number, variable in enumerate(record.variable, 1):
        read_variable(parsed, variable, where=f"variable {number} ({variable.key})")
    for number, together in enumerate(record.together, 1):
        read_together(parsed, together, where=f"together {number}")
    random_fields = read_fields(parsed, record)
    law = read_law_of_temperature(parsed, record)
    scheme = _read_scheme(parsed, record)
    output = _read_output(parsed, record, scheme)
    scheme = scheme_for(scheme, output)
    rule = _read_rule(parsed, record)
    design = _read_design(parsed, record, with_fields=bool(random_fields))
    split = _read_split(parsed, record, design)
    parsed.problems += limit_faults(
        panel,
        axes=parsed.axes,
        drawn=parsed.drawn,
        variables=parsed.variables,
        fields=random_fields,
        law=law,
        whole=not parsed.problems,
    )
    if parsed.problems or design is None:
        raise StudyError(list(dict.fromkeys(parsed.problems)), source=source)
    return StudyParts(
        panel=panel,
        scheme=scheme,
        output=output,
        design=design,
        variables={name: parsed.variables[name] for name in design.names},
        fields=tuple(random_fields),
        law=law,
        rule=rule,
        split=split,
    )


def scheme_for(scheme: Scheme, output: Output) -> Scheme:
    """Return a scheme that keeps instants which the rate of a study takes every so many of.

    Those are its steps where the rate falls on them; otherwise they are filled in between.

    Parameters
    ----------
    scheme : Scheme
        Scheme of the study, with or without an output interval.
    output : Output
        With the rate that is wanted.

    Examples
    --------
    >>> scheme_for(Scheme.of("quick"), Output(rate=125.0)).output_interval
    0.004
    >>> round(scheme_for(Scheme.of("quick"), Output(rate=200.0)).output_interval, 12)
    0.0025
    """
    share = output.interval / scheme.output_interval
    count = max(1, math.ceil(share - 1e-6))
    if abs(share - count) < 1e-6:
        return scheme
    return replace(scheme, output_interval=output.interval / count)


def _read_scheme(parsed: ParsedStudy, record: StudyRecord) -> Scheme:
    known = {item.name for item in fields(Scheme)} - {OUTPUT_INTERVAL_KEY} | {"mode"}
    chosen: dict[str, Any] = {}
    for name, value in record.scheme.items():
        if name not in known:
            text = f": unknown key{nearest(name, known)}; allowed are {choices(sorted(known))}"
            parsed.add_problem(f"scheme.{name}", text)
        elif name == "mode" and value not in MODES:
            allowed = f"{nearest(str(value), MODES)}; allowed are {choices(MODES)}"
            parsed.add_problem("scheme.mode", f" = {show_value(value)}: is no mode{allowed}")
        elif name in SCHEME_UNITS:
            number = read_quantity(parsed, f"scheme.{name}", value, SCHEME_UNITS[name])
            chosen |= {} if number is None else {name: number}
        elif name != "mode":
            chosen[name] = value
    mode = record.scheme.get("mode")
    try:
        return Scheme.of(mode, **chosen) if mode in MODES else Scheme(**chosen)
    except (SolverError, TypeError) as error:
        parsed.add_problem("", str(error))
        return Scheme()


def _read_output(parsed: ParsedStudy, record: StudyRecord, scheme: Scheme) -> Output:
    usual = 1.0 / scheme.output_interval / max(1, int(DEFAULT_INTERVAL / scheme.output_interval))
    given, rate = record.output.rate, None
    if given is not None:
        rate = read_quantity(parsed, "output.rate", given, FREQUENCY)
    if rate is not None and not 0 < rate <= 1000:
        parsed.add_problem("output.rate", f" = {rate:g} Hz: must be more than 0, at most 1000 Hz")
        rate = None
    channels = record.output.channels
    if record.output.keep == "features":
        if channels:
            parsed.add_problem("output.channels", ': keep = "features" keeps none; leave one out')
        return Output(rate=rate or usual, channels=())
    if channels is None:
        return Output(rate=rate or usual)
    parsed.problems += [f"output.channels: {text}" for text in unknown_channels(tuple(channels))]
    return Output(rate=rate or usual, channels=tuple(channels))


def _read_rule(parsed: ParsedStudy, record: StudyRecord) -> Rule | None:
    """Read the rule, and make its axis the one that runs fastest."""
    given = record.rule
    if given is None:
        return None
    own = [axis for axis in parsed.axes if axis.names == (given.increase,)]
    if not own:
        names = [axis.names[0] for axis in parsed.axes if len(axis.names) == 1]
        text = f": is not a variable with values{nearest(given.increase, names)}"
        parsed.add_problem(
            "rule.increase", f' = "{given.increase}"{text}; there are {choices(names)}'
        )
        return None
    variable, axis = parsed.variables[given.increase], own[0]
    values = [row[0] for row in axis.rows]
    numbers = [item for item in values if isinstance(item, float)]
    if len(numbers) < len(values) or numbers != sorted(numbers):
        parsed.add_problem("rule.increase", f' = "{given.increase}": its values must rise')
    parsed.axes.remove(axis)
    parsed.axes.append(Axis(names=axis.names, rows=axis.rows))
    if given.at_least is None:
        return Rule(variable=given.increase, at_least=-float("inf"))
    try:
        return Rule(variable=given.increase, at_least=float(variable.read(given.at_least)))
    except ValueError as error:
        parsed.add_problem("rule.at_least", f" = {show_value(given.at_least)}: {error}")
        return None


def _read_design(parsed: ParsedStudy, record: StudyRecord, *, with_fields: bool) -> Design | None:
    given, names = record.sampling, [item.name for item in parsed.drawn]
    if given is None:
        if parsed.drawn or with_fields:
            what = choices(names) if names else "the field"
            parsed.add_problem(
                "sampling", f": {what} is drawn, so say how often in a table [sampling]"
            )
        if not parsed.axes and not parsed.problems:
            parsed.add_problem(
                "variable", ": nothing varies, so there is no scenario; give one variable"
            )
    elif not parsed.drawn and not with_fields and not parsed.problems:
        parsed.add_problem("sampling", ": nothing is drawn; give a variable with a `distribution`")
    if given is not None:
        parsed.problems += sampling_faults(given.method, given.count, len(names), with_fields)
    pairs = read_pairs(parsed, record, names)
    factor, fault = copula_factor(names, pairs)
    if fault:
        parsed.add_problem("correlation", f": the rank correlations {fault}")
    if pairs and given is not None and given.method == "saltelli":
        parsed.add_problem(
            "correlation", ": Sobol indices need independent variables; leave it out"
        )
    if parsed.problems:
        return None
    design = Design(
        axes=tuple(parsed.axes),
        drawn=tuple(parsed.drawn),
        method=given.method if given else "random",
        draws=given.count if given else 1,
        copula=factor if pairs else None,
        seed=record.seed,
    )
    if design.count > MOST_SCENARIOS:
        parsed.add_problem(
            "", f"{design.count} scenarios: at most {MOST_SCENARIOS}; take fewer values"
        )
    return design


def _read_split(parsed: ParsedStudy, record: StudyRecord, design: Design | None) -> tuple[str, ...]:
    if design is None:
        return ()
    if record.split is not None:
        for name in record.split:
            if name not in design.names:
                text = f"{nearest(name, design.names)}; there are {choices(design.names)}"
                parsed.add_problem("split", f' = "{name}": is no variable{text}')
        return tuple(record.split)
    if design.states > 1:
        return ()
    keys = {name: parsed.variables[name].key for name in design.names}
    return tuple(
        name for name in design.names if keys[name] not in ("object.size", "object.present")
    )


def study_schema() -> dict[str, Any]:
    """Give the JSON schema of a study file.

    Whether a key exists and a value has the right unit depends on the panel, so that is checked
    when the file is loaded, not here.

    Returns
    -------
    dict
        A JSON schema, draft 2020-12.

    Examples
    --------
    >>> record = study_schema()["$defs"]["VariableRecord"]
    >>> "lognormal" in record["properties"]["distribution"]["enum"]
    True
    """
    schema = StudyRecord.model_json_schema(mode="validation")
    tidy(schema)
    for name, more in (("VariableRecord", [CHOICE]), ("FieldRecord", [])):
        schema["$defs"][name]["properties"]["distribution"]["enum"] = [*PARAMETERS, *more]
    return {"$schema": DRAFT, **schema, "title": "turnout study"}
