"""From a study file to the parts of a study, and where study files are found.

Studies that come with the program, and where the panel of a study is looked for. From a study file
to the parts of a study, with all that is wrong in it at once.
"""

import copy
import math
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from turnout.core.library import names_in_library, text_in_library
from turnout.core.problems import choices, describe_error, nearest, show_value
from turnout.core.regular import user_path
from turnout.core.toml import TomlFile, parse_toml, read_toml
from turnout.core.units import (
    FORCE,
    FREQUENCY,
    LENGTH,
    TIME,
    Dimension,
)
from turnout.errors import PanelError, SolverError, StudyError
from turnout.panel.load import LoadedPanel, load_panel
from turnout.panel.override import records_in
from turnout.schema.check import unknown_channels
from turnout.scheme import MODES, Scheme
from turnout.study.chance import (
    MOST_SCENARIOS,
    RandomField,
    TemperatureLaw,
    read_fields,
    read_law_of_temperature,
    read_pairs,
    read_quantity,
    sampling_faults,
)
from turnout.study.design import Axis, Design
from turnout.study.limits import limit_faults, reach_of
from turnout.study.records import StudyRecord
from turnout.study.sampling import copula_factor
from turnout.study.scenario import Output, Rule
from turnout.study.variable import Variable
from turnout.study.variables import Found, read_together, read_variable


def study_names() -> tuple[str, ...]:
    """List the studies that come with the program.

    Examples
    --------
    >>> "paper-campaign" in study_names()
    True
    """
    return names_in_library("turnout.study")


def study_text(name: str) -> str:
    """Give the TOML text of a library study, to start an own study file from.

    Raises
    ------
    FileError
        When there is no such study; the text lists those there are.
    """
    return text_in_library("turnout.study", name, kind="study")


def open_study(name_or_path: str | Path) -> TomlFile:
    """Read a study of the library by its name, or a study file by its path."""
    name = str(name_or_path).strip()
    if isinstance(name_or_path, Path) or name.endswith(".toml") or "/" in name or "\\" in name:
        return read_toml(user_path(name))
    return parse_toml(study_text(name), source=name)


def named_panel(name: str, file: TomlFile) -> LoadedPanel:
    """Load the panel that a study names; a path starts at the folder of the study."""
    return load_panel(path_from(name, file) if name.endswith(".toml") else name)


def path_from(name: str, file: TomlFile) -> Path:
    """Return a path that a study names; one that is not absolute starts at the study's folder."""
    path = user_path(name)
    return path if path.is_absolute() or file.folder is None else file.folder / path


SCHEME_UNITS: dict[str, Dimension] = {
    "step": TIME,
    "cutoff_frequency": FREQUENCY,
    "gap_tolerance": LENGTH,
    "force_tolerance": FORCE,
}
RATE_FROM_OUTPUT = "output_interval"

USUAL_INTERVAL = 0.01
"""Between kept instants, where a study does not say and steps fall on it [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """What a study file says, held against the limits of its panel."""

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
    """Make the record of a study file, without the keys that are unknown, which it tells.

    Raises
    ------
    StudyError
        Where anything else is wrong with keys and types.
    """
    try:
        return StudyRecord.model_validate(file.data), []
    except ValidationError as error:
        errors = error.errors(include_url=False)
    problems = [_described(item, file.data) for item in errors]
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


def _described(error: Any, data: Any) -> str:
    """Return key path and fault of what pydantic found; parts of a list have their number."""
    path, inside = "", data
    record: type[BaseModel] = StudyRecord
    for part in error["loc"]:
        if isinstance(part, int):
            inside = inside[part]
            key = inside.get("key") if isinstance(inside, dict) else None
            path += f" {part + 1}" + (f" ({key})" if isinstance(key, str) else "")
            continue
        path += f".{part}" if path else str(part)
        field = record.model_fields.get(part)
        inner = next(records_in(field.annotation), None) if field is not None else None
        record = inner or record
        inside = inside.get(part, {}) if isinstance(inside, dict) else {}
    return path + describe_error(error, allowed=record.model_fields)


def read_parts(
    record: StudyRecord, panel: LoadedPanel, *, source: str, unknown: Iterable[str] = ()
) -> Parts:
    """Read everything of a study and hold it against its panel.

    Parameters
    ----------
    record : StudyRecord
        What the file says.
    panel : LoadedPanel
        What it is about.
    source : str
        What to call the file.
    unknown : iterable of str
        Problems that were found before.

    Raises
    ------
    StudyError
        With all problems at once.
    """
    found = Found(panel, problems=list(unknown))
    try:
        panel = panel.with_overrides(record.set, si=False) if record.set else panel
        found.panel = panel
    except PanelError as error:
        found.problems += [f"set.{text}" for text in error.problems]
    for number, variable in enumerate(record.variable, 1):
        read_variable(found, variable, where=f"variable {number} ({variable.key})")
    for number, together in enumerate(record.together, 1):
        read_together(found, together, where=f"together {number}")
    random_fields = read_fields(found, record)
    law = read_law_of_temperature(found, record)
    scheme = _scheme(found, record)
    output = _output(found, record, scheme)
    scheme = scheme_for(scheme, output)
    rule = _rule(found, record)
    design = _design(found, record, with_fields=bool(random_fields))
    split = _split(found, record, design)
    found.problems += limit_faults(
        panel,
        reach=reach_of(found.axes, found.drawn),
        variables=found.variables,
        fields=random_fields,
        law=law,
        whole=not found.problems,
    )
    if found.problems or design is None:
        raise StudyError(list(dict.fromkeys(found.problems)), source=source)
    return Parts(
        panel=panel,
        scheme=scheme,
        output=output,
        design=design,
        variables={name: found.variables[name] for name in design.names},
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
        Numerical choices.
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


def _scheme(found: Found, record: StudyRecord) -> Scheme:
    known = {item.name for item in fields(Scheme)} - {RATE_FROM_OUTPUT} | {"mode"}
    chosen: dict[str, Any] = {}
    for name, value in record.scheme.items():
        if name not in known:
            text = f": unknown key{nearest(name, known)}; allowed are {choices(sorted(known))}"
            found.note(f"scheme.{name}", text)
        elif name == "mode" and value not in MODES:
            allowed = f"{nearest(str(value), MODES)}; allowed are {choices(MODES)}"
            found.note("scheme.mode", f" = {show_value(value)}: is no mode{allowed}")
        elif name in SCHEME_UNITS:
            number = read_quantity(found, f"scheme.{name}", value, SCHEME_UNITS[name])
            chosen |= {} if number is None else {name: number}
        elif name != "mode":
            chosen[name] = value
    mode = record.scheme.get("mode")
    try:
        return Scheme.of(mode, **chosen) if mode in MODES else Scheme(**chosen)
    except (SolverError, TypeError) as error:
        found.note("", str(error))
        return Scheme()


def _output(found: Found, record: StudyRecord, scheme: Scheme) -> Output:
    usual = 1.0 / scheme.output_interval / max(1, int(USUAL_INTERVAL / scheme.output_interval))
    given, rate = record.output.rate, None
    if given is not None:
        rate = read_quantity(found, "output.rate", given, FREQUENCY)
    if rate is not None and not 0 < rate <= 1000:
        found.note("output.rate", f" = {rate:g} Hz: must be more than 0, at most 1000 Hz")
        rate = None
    channels = record.output.channels
    if channels is None:
        return Output(rate=rate or usual)
    found.problems += [f"output.channels: {text}" for text in unknown_channels(tuple(channels))]
    return Output(rate=rate or usual, channels=tuple(channels))


def _rule(found: Found, record: StudyRecord) -> Rule | None:
    """Read the rule, and make its axis the one that runs fastest."""
    given = record.rule
    if given is None:
        return None
    own = [axis for axis in found.axes if axis.names == (given.increase,)]
    if not own:
        names = [axis.names[0] for axis in found.axes if len(axis.names) == 1]
        text = f": is no variable with values{nearest(given.increase, names)}"
        found.note("rule.increase", f' = "{given.increase}"{text}; there are {choices(names)}')
        return None
    variable, axis = found.variables[given.increase], own[0]
    values = [row[0] for row in axis.rows]
    numbers = [item for item in values if isinstance(item, float)]
    if len(numbers) < len(values) or numbers != sorted(numbers):
        found.note("rule.increase", f' = "{given.increase}": its values must rise')
    found.axes.remove(axis)
    found.axes.append(Axis(names=axis.names, rows=axis.rows))
    if given.at_least is None:
        return Rule(variable=given.increase, at_least=-float("inf"))
    try:
        return Rule(variable=given.increase, at_least=float(variable.read(given.at_least)))
    except ValueError as error:
        found.note("rule.at_least", f" = {show_value(given.at_least)}: {error}")
        return None


def _design(found: Found, record: StudyRecord, *, with_fields: bool) -> Design | None:
    given, names = record.sampling, [item.name for item in found.drawn]
    if given is None:
        if found.drawn or with_fields:
            what = choices(names) if names else "the field"
            found.note("sampling", f": {what} is drawn, so say how often in a table [sampling]")
        if not found.axes and not found.problems:
            found.note("variable", ": nothing varies, so there is no scenario; give one variable")
    elif not found.drawn and not with_fields and not found.problems:
        found.note("sampling", ": nothing is drawn; give a variable with a `distribution`")
    if given is not None:
        found.problems += sampling_faults(given.method, given.count, len(names), with_fields)
    pairs = read_pairs(found, record, names)
    factor, fault = copula_factor(names, pairs)
    if fault:
        found.note("correlation", f": the rank correlations {fault}")
    if pairs and given is not None and given.method == "saltelli":
        found.note("correlation", ": Sobol indices need independent variables; leave it out")
    if found.problems:
        return None
    design = Design(
        axes=tuple(found.axes),
        drawn=tuple(found.drawn),
        method=given.method if given else "random",
        draws=given.count if given else 1,
        copula=factor if pairs else None,
        seed=record.seed,
    )
    if design.count > MOST_SCENARIOS:
        found.note("", f"{design.count} scenarios: at most {MOST_SCENARIOS}; take fewer values")
    return design


def _split(found: Found, record: StudyRecord, design: Design | None) -> tuple[str, ...]:
    if design is None:
        return ()
    if record.split is not None:
        for name in record.split:
            if name not in design.names:
                text = f"{nearest(name, design.names)}; there are {choices(design.names)}"
                found.note("split", f' = "{name}": is no variable{text}')
        return tuple(record.split)
    if design.states > 1:
        return ()
    keys = {name: found.variables[name].key for name in design.names}
    return tuple(
        name for name in design.names if keys[name] not in ("object.size", "object.present")
    )
