"""Accepted panels: ranges, combinations, measurements and answers, and some of them as a study."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from turnout.calibration.matching.facts import Facts, Sum, UnknownValue
from turnout.calibration.matching.match import (
    panel_facts,
    panel_workers,
    thrower_at,
)
from turnout.core.json_files import to_plain
from turnout.core.kept_results import append_line, read_lines
from turnout.core.progress import Pace, Report
from turnout.core.provenance import content_hash
from turnout.core.workers import Workers
from turnout.study.variable import LABEL

Floats = NDArray[np.float64]

FEWEST = 10
"""Accepted panels below which nothing is said about them."""
STRONG = 0.5
"""Rank correlation from which two parameters are named."""
NODES = np.array([-np.sqrt(3.0), 0.0, np.sqrt(3.0)])
"""Of the three-point Gauss-Hermite rule, for errors of a measurement in standard deviations."""
NODE_WEIGHTS = np.array([1.0, 4.0, 1.0]) / 6.0
"""Of the same rule; their sum is one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
    """A parameter before and after: bounds as stated, and those of the accepted panels, in SI.

    Attributes
    ----------
    name, unit, origin : str
        Of the parameter.
    minimum, maximum : float
        As stated.
    least, low, median, high, most : float
        Of the accepted panels: extremes, and 5, 50 and 95 % of them.
    left : float
        Spread of the accepted panels as a share of that of the stated range [-].
    """

    name: str
    unit: str
    origin: str
    minimum: float
    maximum: float
    least: float
    low: float
    median: float
    high: float
    most: float
    left: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Combination:
    """Two parameters that the facts bind together, by their rank correlation (Spearman) [-]."""

    first: str
    second: str
    correlation: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Gain:
    """Expected effect of a further measurement on the accepted panels.

    Attributes
    ----------
    name, unit, origin : str
        Of the measurement.
    precision, spread : float
        Its standard deviation, and that of its value over the accepted panels.
    left : float
        Share of the panels that would remain, counted by the entropy of their weights [-].
    parameters, answers : float
        Mean share of the variance of the parameters, and of the answers, that would remain [-].
    """

    name: str
    unit: str
    origin: str
    precision: float
    spread: float
    left: float
    parameters: float
    answers: float


def ranges(facts: Facts, points: Floats) -> list[Range]:
    """Return each parameter before and after.

    Parameters
    ----------
    facts : Facts
        With the stated ranges.
    points : ndarray, shape (n_accepted, n_parameters)
        Accepted panels as shares of the ranges.
    """
    found = []
    for parameter, shares in zip(facts.parameters, points.T, strict=True):
        marks = parameter.value(np.quantile(shares, [0.0, 0.05, 0.5, 0.95, 1.0]))
        found.append(
            Range(
                name=parameter.name,
                unit=parameter.unit,
                origin=parameter.origin,
                minimum=parameter.minimum,
                maximum=parameter.maximum,
                least=float(marks[0]),
                low=float(marks[1]),
                median=float(marks[2]),
                high=float(marks[3]),
                most=float(marks[4]),
                left=float(shares.std() * np.sqrt(12.0)),
            )
        )
    return found


def combinations(facts: Facts, points: Floats, *, strong: float = STRONG) -> list[Combination]:
    """Return the pairs of parameters with a strong rank correlation, the strongest first."""
    ranked = np.apply_along_axis(rankdata, 0, points)
    matrix = np.corrcoef(ranked.T)
    names = [item.name for item in facts.parameters]
    found = [
        Combination(first=names[i], second=names[j], correlation=float(matrix[i, j]))
        for i in range(len(names))
        for j in range(i + 1, len(names))
        if abs(matrix[i, j]) >= strong
    ]
    return sorted(found, key=lambda item: -abs(item.correlation))


def fixed_direction(facts: Facts, points: Floats, *, most: int = 4) -> list[tuple[float, str]]:
    """Return the combination of parameters that the facts fix most, its largest parts first.

    It is the eigenvector of the least variance of the scaled parameters; each part is a share of
    the stated range.
    """
    values, vectors = np.linalg.eigh(np.cov(points.T))
    weights = vectors[:, int(np.argmin(values))]
    weights = weights / weights[np.argmax(np.abs(weights))]
    order = np.argsort(-np.abs(weights))[:most]
    return [(float(weights[number]), facts.parameters[number].name) for number in order]


def measurement_gains(
    facts: Facts,
    points: Floats,
    measured: Floats,
    answers: Floats,
) -> list[Gain]:
    r"""Return the spread that each further measurement should leave, the most useful first.

    Each accepted panel is taken as the true one in turn. A measurement of it gives every panel the
    weight

    .. math:: w_i \propto \exp(-(y_i - y_j - e)^2 / 2 s^2)

    with error e, averaged over its normal distribution.

    Parameters
    ----------
    facts : Facts
        With the measurements.
    points : ndarray, shape (n, n_parameters)
        Accepted panels as shares of the ranges.
    measured : ndarray, shape (n, n_measurements)
        What each would show, in SI.
    answers : ndarray, shape (n, n_answers)
        What is to be predicted, in SI.
    """
    found = []
    for item, column in zip(facts.measurements, measured.T, strict=True):
        weights = _weights(column, item.precision)
        found.append(_gain(item, column, weights, points, answers))
    return sorted(found, key=lambda gain: gain.left)


def _weights(values: Floats, precision: float) -> Floats:
    """Return the weights of all panels by true panel and error, shape (n, 3, n)."""
    shown = values[:, np.newaxis] + precision * NODES
    logs = -0.5 * ((shown[:, :, np.newaxis] - values) / precision) ** 2
    weights = np.exp(logs - logs.max(axis=2, keepdims=True))
    return np.asarray(weights / weights.sum(axis=2, keepdims=True))


def _gain(item: Sum, column: Floats, weights: Floats, points: Floats, answers: Floats) -> Gain:
    entropy = -(weights * np.log(np.maximum(weights, 1e-300))).sum(axis=2)
    left = float((np.exp(entropy) @ NODE_WEIGHTS).mean()) / len(column)
    return Gain(
        name=item.name,
        unit=item.unit,
        origin=item.origin,
        precision=item.precision,
        spread=float(column.std()),
        left=left,
        parameters=_variance_left(points, weights),
        answers=_variance_left(answers, weights),
    )


def _variance_left(values: Floats, weights: Floats) -> float:
    """Return the mean share of the variance of columns that weights are expected to leave."""
    moving = values[:, values.std(axis=0) > 0.0]
    if not moving.size:
        return 1.0
    mean = weights @ moving
    spread = weights @ moving**2 - mean**2
    expected = np.einsum("jek,e->k", spread, NODE_WEIGHTS) / len(values)
    return float((expected / moving.var(axis=0)).mean())


def answer_rows(answers: Sequence[Sum], values: Floats) -> list[dict[str, float | str]]:
    """Return how each answer spreads over panels: least, 5, 50, 95 % and most, in SI."""
    rows: list[dict[str, float | str]] = []
    for item, column in zip(answers, values.T, strict=True):
        marks = np.quantile(column, [0.0, 0.05, 0.5, 0.95, 1.0])
        names = ("least", "low", "median", "high", "most")
        row: dict[str, float | str] = {"name": item.name, "unit": item.unit}
        rows.append(row | dict(zip(names, map(float, marks), strict=True)))
    return rows


def accepted_study(facts: Facts, points: Floats, *, name: str) -> str:
    """Return a study file that throws each of some panels once, without an object.

    Parameters
    ----------
    facts : Facts
        What was matched.
    points : ndarray, shape (n, n_parameters)
        Panels as shares of the ranges.
    name : str
        Of the study.
    """
    units = {key: unit for parameter in facts.parameters for key, unit in _keys(facts, parameter)}
    keys = list(units)
    rows = []
    for point in points:
        values: dict[str, Any] = dict(facts.overrides(point))
        of_machines = facts.overrides(point, of_machines=True)
        values |= {f"{LABEL}{key}": value for key, value in of_machines.items()}
        for parameter, share in zip(facts.parameters, point, strict=True):
            if parameter.apply == "multiply" and not parameter.of_machine:
                values |= dict.fromkeys(parameter.keys, float(parameter.value(np.asarray(share))))
        rows.append(f"    [{', '.join(_written(key, values[key], units[key]) for key in keys)}],")
    factors = [
        key
        for item in facts.parameters
        if item.apply == "multiply" and not item.of_machine
        for key in item.keys
    ]
    lines = _range_lines(facts)
    if any(item.of_machine for item in facts.parameters):
        lines.append("Labels are values of machines, for throws by these; the panel has none.")
    ranges = "\n".join(f"# {line}" for line in lines)
    return f"""\
# {len(points)} panels that meet the facts of {facts.name}, found by `turnout panel match`.
# Their spread is conditional on the structure of {facts.panel.name} and on these ranges:
{ranges}

schema_version = 1
name = {json.dumps(name)}
description = \"\"\"
{len(points)} panels that meet all facts of {facts.name}, far from each other within its \\
ranges. One throw each without an object; add an object or another variable in a copy.\"\"\"
panel = {json.dumps(facts.panel.source)}
seed = {facts.seed}

[scheme]
mode = "quick"

[[together]]
keys = {_list(keys)}
factors = {_list(factors)}
rows = [
{chr(10).join(rows)}
]
"""


def _keys(facts: Facts, parameter: UnknownValue) -> list[tuple[str, str]]:
    """Return the keys that a parameter has in a study, with their units; labels of machines."""
    if parameter.of_machine:
        keys = (*parameter.keys, *parameter.complement)
        return [(f"{LABEL}{key}", parameter.unit) for key in keys]
    if parameter.apply == "add":
        point = np.full(len(facts.parameters), 0.5)
        found = [
            key
            for key in facts.overrides(point)
            if any(_family(key) == _family(own) for own in parameter.keys)
        ]
        return [(key, parameter.unit) for key in found]
    return [(key, parameter.unit) for key in (*parameter.keys, *parameter.complement)]


def _family(key: str) -> tuple[str, str]:
    parts = key.split(".")
    return parts[0], parts[-1]


def _list(items: Sequence[str]) -> str:
    return "[\n" + "".join(f"    {json.dumps(item)},\n" for item in items) + "]"


def _written(key: str, value: Any, unit: str) -> str:
    """Return a value with all of its digits: where feet vibrate a fact may hang on the last one."""
    text = repr(float(value))
    if unit or key.startswith(LABEL):
        return f'"{text} {unit}"' if unit else f'"{text}"'
    return text


def _range_lines(facts: Facts) -> list[str]:
    return [
        f"{item.name}: {item.minimum:g} to {item.maximum:g} {item.unit or '[-]'}"
        f"{' added' if item.apply == 'add' else ' times' if item.apply == 'multiply' else ''}"
        f" ({item.origin or 'no origin given'})"
        for item in facts.parameters
    ]


SURVEYED = "surveyed.jsonl"
STAGE = "measurements and answers"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Survey:
    """Behaviour of each accepted panel.

    Attributes
    ----------
    points : ndarray, shape (n, n_parameters)
        Accepted panels as shares of the ranges.
    measured : ndarray, shape (n, n_measurements)
        In SI.
    answers : ndarray, shape (n, n_answers)
        In SI.
    throws : int
        That were made for it, now and before.
    """

    points: Floats
    measured: Floats
    answers: Floats
    throws: int


def survey(
    facts: Facts,
    points: Floats,
    folder: Path,
    *,
    workers: int | Workers = 1,
    report: Report | None = None,
) -> Survey:
    """Throw the accepted panels for measurements and answers; what a folder holds is not repeated.

    Parameters
    ----------
    facts : Facts
        With measurements and answers.
    points : ndarray, shape (n, n_parameters)
        Accepted panels.
    folder : Path
        Of the matching.
    workers : int or Workers
        Processes, as of `match_panel`.
    report : callable, optional
        Called after every panel.
    """
    wanted = (*facts.measurements, *facts.answers)
    key = content_hash(to_plain([[item.terms, item.parameter] for item in wanted]))
    known = {
        line["place"]: (line["values"], int(line["throws"]))
        for line in read_lines(folder / SURVEYED)
        if line.get("key") == key
    }
    places = [content_hash([facts.digest, list(map(float, point))]) for point in points]
    missing = {place: at for at, place in enumerate(places) if place not in known}
    pace = Pace(report)
    pace.begin(STAGE, len(places), there=len(places) - len(missing))
    with panel_workers(facts, workers) as processes:
        jobs = [partial(_surveyed, points[at]) for at in missing.values()]
        for number, (values, throws) in processes.run(jobs):
            place = list(missing)[number]
            known[place] = values, throws
            line = {"key": key, "place": place, "values": values, "throws": throws}
            append_line(folder / SURVEYED, line)
            pace.count(STAGE)
    found = [known[place] for place in places]
    table = np.array([values for values, _ in found], dtype=np.float64)
    table, count = table.reshape(len(points), len(wanted)), len(facts.measurements)
    throws = sum(made for _, made in found)
    return Survey(points=points, measured=table[:, :count], answers=table[:, count:], throws=throws)


def _surveyed(point: Floats) -> tuple[list[float], int]:
    """Return measurements and answers of a panel, and the throws that were made for them."""
    facts = panel_facts()
    thrower, wanted = thrower_at(facts, point), (*facts.measurements, *facts.answers)
    values = [
        _parameter(facts, point, item.parameter) if item.parameter else thrower.sum(item)
        for item in wanted
    ]
    return values, thrower.made


def _parameter(facts: Facts, point: Floats, name: str) -> float:
    number = [item.name for item in facts.parameters].index(name)
    return float(facts.parameters[number].value(point[number]))
