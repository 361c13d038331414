"""A study as lines of text: inputs, sampling, stored channels, size."""

from collections.abc import Iterator

from turnout.core.units import TEMPERATURE
from turnout.figures.report.values import LONG_LIST, shown
from turnout.metric.summary import format_overrides
from turnout.study.design import Drawn
from turnout.study.distribution import Choice, Distribution
from turnout.study.random_inputs import format_celsius
from turnout.study.scenario import Value
from turnout.study.study import Study
from turnout.study.value_ranges import value_ranges
from turnout.study.variable import Variable

WIDTH = 12


def study_lines(study: Study) -> Iterator[str]:
    """Yield the content of a study: scenarios, ranges, chance, rule and output.

    Parameters
    ----------
    study : Study
        Loaded study; no throw of it is made.

    Examples
    --------
    >>> from turnout.calibration.load_study import load_study
    >>> next(study_lines(load_study("sleeper-6")))
    'study       sleeper-6 (seed 0)'
    """
    yield line("study", f"{study.name} (seed {study.seed})")
    yield line("panel", f"{study.panel.name}, {study.panel.hash[:12]}")
    for number, (key, value) in enumerate(study.panel.overrides.items()):
        yield line("set" if number == 0 else "", format_overrides({key: value}))
    yield line("scenarios", _count(study))
    drawn = {item.name: item for item in study.design.drawn}
    ranges = value_ranges(study.design.axes, study.design.drawn)
    names = [*study.variables, *(field.name for field in study.fields)]
    width = max(len(name) for name in names) + 2
    for number, (name, variable) in enumerate(study.variables.items()):
        text = _range_text(variable, ranges[name], drawn.get(name))
        yield line("varies" if number == 0 else "", f"{name:<{width}}{text}")
    for number, field in enumerate(study.fields):
        low, high, share = ends_of(field.distribution)
        text = (
            f"{low:.4g} ... {high:.4g} {field.distribution.kind}{share}, "
            f"{len(field.members)} places, {field.correlation} over {field.correlation_length:g} m"
        )
        yield line("field" if number == 0 else "", f"{field.name:<{width}}{text}")
    if study.law is not None:
        yield line("temperature", f"multiplies {study.law.key}")
    if study.rule is not None:
        yield line("rule", f"{study.rule.variable} grows until a drive slips")
    kept = ", ".join(study.output.channels) or "labels and features only"
    yield line("stores", f"{kept} at {study.output.rate:g} Hz")
    yield line("scheme", study.scheme.describe())


def line(head: str, text: str) -> str:
    """Return a line with its heading."""
    return f"{head:<{WIDTH}}{text}"


def ends_of(law: Distribution) -> tuple[float, float, str]:
    """Return the range of a distribution: its bounds, or its central 95 % if unbounded.

    Examples
    --------
    >>> ends_of(Distribution(kind="uniform", parameters={"minimum": 1.0, "maximum": 3.0}))
    (1.0, 3.0, '')
    """
    if {"minimum", "maximum"} <= set(law.parameters):
        return law.parameters["minimum"], law.parameters["maximum"], ""
    return law.value(0.025), law.value(0.975), " (95 %)"


def _count(study: Study) -> str:
    design = study.design
    text = str(study.count)
    if design.states > 1 and design.cells > 1:
        text += f": {design.states} states, {design.cells} throws in each"
    if design.states > 1:
        text += f"; states drawn by {design.method}"
    if study.rule is not None:
        length = len(design.axes[-1].rows)
        text += f" at most: {study.count // length} chains of {length}"
    return text


def _range_text(variable: Variable, values: tuple[Value, ...], drawn: Drawn | None) -> str:
    ends = [values[0], values[-1]]
    if drawn is not None and not isinstance(drawn.law, Choice):
        low, high, share = ends_of(drawn.law)
        return f"{_shown(variable, low)} ... {_shown(variable, high)} {drawn.law.kind}{share}"
    if len(values) <= LONG_LIST:
        text = ", ".join(_shown(variable, value) for value in values)
    else:
        text = f"{_shown(variable, ends[0])} ... {_shown(variable, ends[1])}"
        text += f" ({len(values)} values)"
    if drawn is not None and isinstance(drawn.law, Choice):
        weights = ", ".join(f"{weight:g}" for weight in drawn.law.weights[:LONG_LIST])
        text += f", one of them by the weights {weights}"
    return text


def _shown(variable: Variable, value: Value) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str):
        return value
    if variable.kind is TEMPERATURE and not variable.factor:
        return format_celsius(value)
    return shown(float(f"{value:.4g}"), variable.units, variable.key.split(".")[-1])
