"""From the variables of a study file to axes and draws, with everything that is wrong in them."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from turnout.core.problems import choices, nearest, show_value
from turnout.core.units import (
    MOST_VALUES,
    TEMPERATURE,
    TEMPERATURE_DIFFERENCE,
    Dimension,
    is_finite,
)
from turnout.panel.load import LoadedPanel
from turnout.study.design import Axis, Drawn
from turnout.study.distribution import (
    DIFFERENCE_PARAMETERS,
    DIMENSIONLESS_PARAMETERS,
    PARAMETERS,
    Choice,
    Distribution,
    parameter_faults,
)
from turnout.study.scenario import Value
from turnout.study.study_file import FieldRecord, TogetherRecord, VariableRecord
from turnout.study.variable import OBJECT_KEYS, RECORDER_KEYS, Variable, value_kind

CHOICE = "choice"
MEMBER_GROUPS = {"every sleeper": "sleeper", "every drive": "drive"}
_ALL_PARAMETERS = tuple(dict.fromkeys(name for a, b in PARAMETERS.values() for name in (*a, *b)))


@dataclass(slots=True)
class ParsedStudy:
    """The parts of a study file that were read so far, and all problems found.

    Attributes
    ----------
    panel : LoadedPanel
        Whose keys and limits the variables must keep to.
    variables : dict
        Variables read so far, by name.
    axes, drawn : list
        Of the design.
    problems : list of str
        Each with its key, the value and what is allowed.
    """

    panel: LoadedPanel
    variables: dict[str, Variable] = field(default_factory=dict)
    axes: list[Axis] = field(default_factory=list)
    drawn: list[Drawn] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)

    def add_problem(self, where: str, text: str) -> None:
        """Append a problem: the key path `where`, then the value and the allowed ones."""
        self.problems.append(f"{where}{text}")


def read_variable(parsed: ParsedStudy, record: VariableRecord, *, where: str) -> None:
    """Read a variable of a study file: an axis if it has values, else a draw."""
    variable = _add_variable(parsed, record, where=where)
    if variable is None:
        return
    if record.distribution is not None:
        law = read_law(parsed, record, variable, where=where)
        if law is not None:
            parsed.drawn.append(Drawn(name=variable.name, law=law))
        return
    given = [name for name in (*_ALL_PARAMETERS, "weights") if getattr(record, name) is not None]
    if record.values is None:
        text = f"; with {', '.join(given)} it needs a distribution" if given else ""
        parsed.add_problem(where, f": needs `values` or a `distribution`{text}")
        return
    if given:
        parsed.add_problem(
            where, f".{given[0]}: goes with a `distribution`, not with `values` alone"
        )
    values = _read_axis(parsed, record.values, variable, where=f"{where}.values")
    if values:
        parsed.axes.append(Axis(names=(variable.name,), rows=tuple((item,) for item in values)))


def read_together(parsed: ParsedStudy, record: TogetherRecord, *, where: str) -> None:
    """Read variables that go side by side: a list of cases."""
    named = []
    for key in record.factors:
        if key not in record.keys:
            text = f' = "{key}": is none of its keys{nearest(key, record.keys)}'
            parsed.add_problem(f"{where}.factors", text)
    for key in record.keys:
        record_of_key = VariableRecord.model_validate({"key": key, "factor": key in record.factors})
        named.append(_add_variable(parsed, record_of_key, where=f"{where}.keys"))
    rows = []
    for number, row in enumerate(record.rows, 1):
        at = f"{where}.rows, row {number}"
        if len(row) != len(record.keys):
            parsed.add_problem(at, f": has {len(row)} values for {len(record.keys)} keys")
            continue
        values = []
        for variable, item in zip(named, row, strict=True):
            if variable is not None:
                values += _read_values(parsed, [item], variable, where=f"{at}, {variable.name}")
        rows.append(tuple(values))
    variables = [item for item in named if item is not None]
    if len(variables) == len(named) and rows:
        parsed.axes.append(Axis(names=tuple(item.name for item in variables), rows=tuple(rows)))


def _add_variable(parsed: ParsedStudy, record: VariableRecord, *, where: str) -> Variable | None:
    """Find the variable of a record, and note it under its name."""
    try:
        kind = value_kind(parsed.panel, record.key, factor=record.factor)
    except ValueError as error:
        parsed.add_problem(where, f'.key = "{record.key}": {error}')
        return None
    special = record.key in OBJECT_KEYS or record.key in RECORDER_KEYS
    if record.factor and (special or not (kind is float or isinstance(kind, Dimension))):
        parsed.add_problem(where, f'.factor: "{record.key}" has no number that can be multiplied')
        return None
    name = record.name or (f"{record.key}.factor" if record.factor else record.key)
    if name in parsed.variables:
        parsed.add_problem(
            where, f': the name "{name}" is already used; give one of them another `name`'
        )
        return None
    variable = Variable(name=name, key=record.key, kind=kind, factor=record.factor)
    parsed.variables[name] = variable
    return variable


def _read_axis(parsed: ParsedStudy, given: Any, variable: Variable, *, where: str) -> list[Value]:
    """Read the values of an axis; a table {first, last, count} gives even ones."""
    if isinstance(given, list):
        items = given
        if variable.key == "object.at":
            items = _expand_places(parsed.panel, given)
        values = _read_values(parsed, items, variable, where=where)
        if not given:
            parsed.add_problem(where, ": needs at least one value")
        if len(set(values)) < len(values):
            parsed.add_problem(where, f" = {show_value(given)}: a value is there twice")
        return values
    if set(given) != {"first", "last", "count"}:
        parsed.add_problem(
            where, f" = {show_value(given)}: must be a list or a table {{first, last, count}}"
        )
        return []
    ends = _read_values(parsed, [given["first"], given["last"]], variable, where=where)
    count = given["count"]
    if isinstance(count, bool) or not isinstance(count, int) or not 2 <= count <= MOST_VALUES:
        parsed.add_problem(
            where, f".count = {show_value(count)}: must be a whole number, 2 to {MOST_VALUES}"
        )
        return []
    if len(ends) < 2 or not all(isinstance(end, float) for end in ends) or ends[0] == ends[1]:
        if len(ends) == 2:
            parsed.add_problem(
                where, f" = {show_value(given)}: first and last must be different numbers"
            )
        return []
    return [round(float(item), 12) for item in np.linspace(float(ends[0]), float(ends[1]), count)]


def _expand_places(panel: LoadedPanel, given: list[Any]) -> list[Any]:
    """Spell "every sleeper" and "every drive" out; then places go from toe to heel."""
    if not any(item in MEMBER_GROUPS for item in given if isinstance(item, str)):
        return given
    known: list[tuple[float, str]] = []
    kept: list[Any] = []
    for item in given:
        family = MEMBER_GROUPS.get(item) if isinstance(item, str) else None
        if family is None:
            kept.append(item)
        else:
            members = getattr(panel, family)
            known += [(member.x, f"{family} {name}") for name, member in members.items()]
    return [place for _, place in sorted(known)] + kept


def _read_values(
    parsed: ParsedStudy, items: list[Any], variable: Variable, *, where: str
) -> list[Value]:
    values = []
    for item in items:
        try:
            values.append(variable.read(item))
        except ValueError as error:
            parsed.add_problem(where, f" = {show_value(item)}: {error}")
    return values


def read_law(
    parsed: ParsedStudy, record: VariableRecord, variable: Variable, *, where: str
) -> Distribution | Choice | None:
    """Read the distribution of a variable, or return None if it has no valid one."""
    kind = str(record.distribution)
    if kind == CHOICE:
        return _read_choice(parsed, record, variable, where=where)
    if kind not in PARAMETERS:
        known = [*PARAMETERS, CHOICE]
        parsed.add_problem(where, f'.distribution = "{kind}": there is none of this name'
                   f"{nearest(kind, known)}; there are {choices(known)}")  # fmt: skip
        return None
    if not (variable.factor or variable.kind is float or isinstance(variable.kind, Dimension)):
        parsed.add_problem(
            where, f'.distribution = "{kind}": is for numbers; use "{CHOICE}" with values'
        )
        return None
    before = len(parsed.problems)
    for name in ("values", "weights"):
        if getattr(record, name) is not None:
            parsed.add_problem(
                where, f'.{name}: goes with distribution "{CHOICE}", not with "{kind}"'
            )
    parameters = _read_parameters(parsed, record, variable, where=where)
    if len(parsed.problems) == before:
        for name, text in parameter_faults(kind, parameters):
            parsed.add_problem(where, f".{name}{text}")
    if len(parsed.problems) > before:
        return None
    return Distribution(kind=kind, parameters=parameters)


def _read_parameters(
    parsed: ParsedStudy, record: VariableRecord, variable: Variable, *, where: str
) -> dict[str, float]:
    needed, optional = PARAMETERS[str(record.distribution)]
    parameters = {}
    for name in _ALL_PARAMETERS:
        value = getattr(record, name)
        if value is None:
            if name in needed:
                parsed.add_problem(
                    where, f".{name}: is required for distribution {record.distribution!r}"
                )
            continue
        if name not in (*needed, *optional):
            text = f"; its parameters are {choices([*needed, *optional])}"
            parsed.add_problem(
                where, f".{name}: is none of distribution {record.distribution!r}{text}"
            )
            continue
        try:
            parameters[name] = _read_parameter(variable, name, value)
        except ValueError as error:
            parsed.add_problem(where, f".{name} = {show_value(value)}: {error}")
    return parameters


def _read_parameter(variable: Variable, name: str, value: Any) -> float:
    if name in DIMENSIONLESS_PARAMETERS:
        if isinstance(value, bool) or not isinstance(value, int | float) or not is_finite(value):
            message = "must be a finite plain number, without quotes or unit"
            raise ValueError(message)
        return float(value)
    if name in DIFFERENCE_PARAMETERS and variable.kind is TEMPERATURE:
        return float(Variable(name="", key="", kind=TEMPERATURE_DIFFERENCE).read(value))
    return float(variable.read(value))


def _read_choice(
    parsed: ParsedStudy, record: VariableRecord, variable: Variable, *, where: str
) -> Choice | None:
    before = len(parsed.problems)
    for name in _ALL_PARAMETERS:
        if getattr(record, name) is not None:
            parsed.add_problem(
                where, f'.{name}: is none of distribution "{CHOICE}", which takes `values`'
            )
    if record.values is None:
        parsed.add_problem(where, f'.values: are missing for distribution "{CHOICE}"')
        return None
    values = _read_axis(parsed, record.values, variable, where=f"{where}.values")
    weights = [1.0] * len(values) if record.weights is None else record.weights
    if not all(is_finite(item) and item > 0 for item in weights):
        parsed.add_problem(where, f".weights = {show_value(weights)}: each must be more than 0")
    if len(weights) != len(values) and len(parsed.problems) == before:
        parsed.add_problem(where, f".weights: {len(weights)} for {len(values)} values")
    if len(parsed.problems) > before:
        return None
    return Choice(values=tuple(values), weights=tuple(float(item) for item in weights))


def read_field_law(
    parsed: ParsedStudy, record: FieldRecord, *, where: str
) -> tuple[Variable, Distribution] | None:
    """Read key and distribution of a random field."""
    scratch = ParsedStudy(parsed.panel)
    variable = _add_variable(scratch, record, where=where)
    law = None
    if variable is not None:
        if record.distribution is None or record.distribution == CHOICE:
            scratch.add_problem(
                where, ".distribution: a field needs one of numbers, such as 'lognormal'"
            )
        else:
            law = read_law(scratch, record, variable, where=where)
    parsed.problems += scratch.problems
    return (variable, law) if variable is not None and isinstance(law, Distribution) else None
