"""Hold the values of a study against the limits of its panel, before anything is thrown."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TypeVar

from turnout.core.errors import PanelError
from turnout.core.problems import show_value
from turnout.measurement.chain.recorder import recorder_faults
from turnout.panel.foreign_object import object_faults
from turnout.panel.load import LoadedPanel
from turnout.study.design import Axis, Drawn
from turnout.study.distribution import Choice
from turnout.study.random_inputs import RandomField, TemperatureLaw
from turnout.study.scenario import Value
from turnout.study.variable import (
    LABEL,
    OBJECT_KEYS,
    RECORDER_KEYS,
    TEMPERATURE_KEY,
    Variable,
    apply_factors,
    foreign_objects,
    set_items,
)

T = TypeVar("T")

# An axis with more values than this is checked at its ends and some between.
MOST_CHECKED = 200


def value_ranges(axes: Iterable[Axis], drawn: Iterable[Drawn]) -> dict[str, tuple[Value, ...]]:
    """Return the range of each variable: all values, or the ends of a distribution.

    Parameters
    ----------
    axes : iterable of Axis
        Of a design.
    drawn : iterable of Drawn
        Of a design.

    Returns
    -------
    dict
        Values in SI by variable, without repeats, in their order.
    """
    found: dict[str, list[Value]] = {}
    for axis in axes:
        for column, name in enumerate(axis.names):
            found[name] = [row[column] for row in axis.rows]
    for item in drawn:
        law = item.law
        found[item.name] = list(law.values if isinstance(law, Choice) else law.bounds)
    return {name: tuple(dict.fromkeys(values)) for name, values in found.items()}


def limit_faults(
    panel: LoadedPanel,
    *,
    axes: Sequence[Axis],
    drawn: Sequence[Drawn],
    variables: Mapping[str, Variable],
    fields: Iterable[RandomField],
    law: TemperatureLaw | None,
    whole: bool = True,
) -> list[str]:
    """Find every value that the panel or the place of an object does not allow.

    Each value is tried alone, all other variables as the panel has them; values that change
    together are tried together, row by row.

    Parameters
    ----------
    panel : LoadedPanel
        Panel with the limits.
    axes, drawn : sequence of Axis, sequence of Drawn
        Of a design.
    variables : mapping of str to Variable
        Variables by their names in the study.
    fields : iterable of RandomField
        Tried at both ends of their distribution.
    law : TemperatureLaw or None
        Tried at the least and the largest temperature.
    whole : bool
        Whether nothing is missing, so that what an object lacks may be named.
    """
    problems = []
    lists = [axis for axis in axes if len(axis.names) > 1]
    in_lists = {name for axis in lists for name in axis.names}
    ranges = value_ranges(axes, drawn)
    for name, values in ranges.items():
        variable = variables[name]
        if variable.key == TEMPERATURE_KEY:
            numbers = [float(item) for item in values]
            faults = law.faults(min(numbers), max(numbers)) if law else []
            problems += [f"temperature_law: {text}" for text in faults]
        elif variable.key in RECORDER_KEYS:
            what = variable.key.partition(".")[2]
            problems += [
                f"variable {name} = {show_value(value)}: {text}"
                for value in _checked_values(values)
                for text in recorder_faults(what, float(value))
            ]
        elif _is_of_panel(variable) and name not in in_lists:
            for value in _checked_values(values):
                problems += _faults_of(panel, {name: value}, variables, f"variable {name}")
    for axis in lists:
        for number, row in _checked_values(tuple(enumerate(axis.rows, 1))):
            where = f"together, row {number} ({axis.names[0]}, ...)"
            problems += _faults_of(panel, dict(zip(axis.names, row, strict=True)), variables, where)
    for field in fields:
        for end in field.distribution.bounds:
            changes = (
                apply_factors(panel, {}, [(field.key, end)]) if field.factor else {field.key: end}
            )
            problems += _panel_faults(panel, changes, f"field {field.name}")
    by_key = {variables[name].key: values for name, values in ranges.items()}
    for part in _object_cases(by_key, lists, variables):
        problems += _object_faults(panel, part, whole=whole)
    return problems


def _is_of_panel(variable: Variable) -> bool:
    """Return True if a variable changes a value of the panel."""
    special = variable.key in OBJECT_KEYS or variable.key in RECORDER_KEYS
    return not special and variable.key != TEMPERATURE_KEY and not variable.key.startswith(LABEL)


def _object_cases(
    by_key: Mapping[str, tuple[Value, ...]],
    lists: Iterable[Axis],
    variables: Mapping[str, Variable],
) -> list[dict[str, tuple[Value, ...]]]:
    """Return values by key, once for each row of a list of cases that describes objects."""
    for axis in lists:
        keys = [variables[name].key for name in axis.names]
        if any(key in OBJECT_KEYS for key in keys):
            rows = _checked_values(axis.rows)
            return [
                {**by_key, **{key: (item,) for key, item in zip(keys, row, strict=True)}}
                for row in rows
            ]
    return [dict(by_key)]


def _checked_values(values: tuple[T, ...]) -> tuple[T, ...]:
    """Take all values, or of very many some with both ends."""
    stride = -(-len(values) // MOST_CHECKED)
    return (*values[::stride], values[-1]) if stride > 1 else values


def _faults_of(
    panel: LoadedPanel, chosen: Mapping[str, Value], variables: Mapping[str, Variable], where: str
) -> list[str]:
    """Return the faults of values by variable, all others as the panel has them."""
    own = [(variables[name], value) for name, value in chosen.items()]
    own = [(variable, value) for variable, value in own if _is_of_panel(variable)]
    values = {variable.key: value for variable, value in own if not variable.factor}
    factors = [(variable.key, float(value)) for variable, value in own if variable.factor]
    try:
        changes = apply_factors(panel, set_items(panel, values), factors)
    except PanelError as error:
        return [f"{where}: {error.problems[0]}"]
    return _panel_faults(panel, changes, where)


def _panel_faults(panel: LoadedPanel, changes: Mapping[str, Value], where: str) -> list[str]:
    try:
        panel.with_overrides(changes)
    except PanelError as error:
        return [f"{where}: {error.problems[0]}"]
    return []


def _object_faults(
    panel: LoadedPanel, by_key: Mapping[str, tuple[Value, ...]], *, whole: bool
) -> list[str]:
    """Check the object: complete, positive, and with room at each place for its largest size."""
    given = [key for key in by_key if key in OBJECT_KEYS]
    if not given:
        return []
    problems = []
    if whole and "object.size" not in by_key:
        problems.append(f'{given[0]}: an object needs a size; give a variable "object.size"')
    if whole and ("object.at" in by_key) == ("object.x" in by_key):
        problems.append('object: give its place as one of the variables "object.at", "object.x"')
    sizes = [float(size) for size in by_key.get("object.size", ())]
    if any(size < 0 for size in sizes):
        problems.append("object.size: must be at least 0 (0 mm is no object)")
    for key in ("object.stiffness", "object.disappears"):
        wrong = [value for value in by_key.get(key, ()) if not float(value) > 0]
        problems += [f"{key} = {show_value(value)}: must be more than 0" for value in wrong]
    wrong = [value for value in by_key.get("object.appears", ()) if float(value) < 0]
    problems += [f"object.appears = {show_value(value)}: must be at least 0" for value in wrong]
    placed = ("object.at" in by_key) != ("object.x" in by_key)
    if problems or not placed or not max(sizes, default=0.0) > 0:
        return problems
    # Faults that do not depend on each other: each key is tried with the first of the others.
    usual = {key: by_key[key][0] for key in given} | {"object.size": max(sizes)}
    usual["object.present"] = True
    for key in given:
        for value in () if key == "object.size" else _checked_values(by_key[key]):
            where = f"object of {1e3 * max(sizes):g} mm, {key} = {show_value(value)}: "
            problems += [
                where + text for text in _faults_of_kinds(panel, by_key, usual, key, value)
            ]
    return list(dict.fromkeys(problems))


def _faults_of_kinds(
    panel: LoadedPanel,
    by_key: Mapping[str, tuple[Value, ...]],
    usual: Mapping[str, Value],
    key: str,
    value: Value,
) -> list[str]:
    """Return the faults of a value, in an object of each kind that may be drawn."""
    kinds = by_key.get("object.kind", ("spring",)) if key != "object.kind" else (value,)
    found: list[str] = []
    for kind in kinds:
        chosen = {**usual, "object.kind": kind, key: value, "object.present": True}
        try:
            item = foreign_objects(chosen)[0]
        except PanelError as error:
            found += error.problems
            continue
        found += [f"{fault}{text}" for fault, text in object_faults(panel, item)]
    return found
