"""Accepted panels: their measurements and answers of the facts, and some of them as a study."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.matching.facts import Facts
from turnout.calibration.matching.match import panel_facts, panel_workers, thrower_at
from turnout.core.json_files import to_plain
from turnout.core.kept_lines import append_line, read_lines
from turnout.core.progress import Pace, Report
from turnout.core.provenance import content_hash
from turnout.core.workers import Workers

Floats = NDArray[np.float64]

DIGITS = 6


def study_text(facts: Facts, points: Floats, *, name: str) -> str:
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
    of_panel = [item for item in facts.parameters if not item.of_machine]
    units = {key: unit for parameter in of_panel for key, unit in _keys(facts, parameter)}
    keys = list(units)
    rows = []
    for point in points:
        values: dict[str, Any] = {}
        for parameter, share in zip(facts.parameters, point, strict=True):
            if parameter.of_machine:
                continue
            value = float(parameter.value(np.asarray(share)))
            if parameter.apply == "multiply":
                values |= dict.fromkeys(parameter.keys, value)
            values |= dict.fromkeys(parameter.complement, 1.0 - value)
        given = {key: item for key, item in facts.overrides(point).items() if key in units}
        values = given | values
        rows.append(f"    [{', '.join(_written(values[key], units[key]) for key in keys)}],")
    factors = [key for item in of_panel if item.apply == "multiply" for key in item.keys]
    ranges = "\n".join(f"# {line}" for line in _range_lines(facts))
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


def _keys(facts: Facts, parameter: Any) -> list[tuple[str, str]]:
    """Return the keys that a parameter sets in a study, with their units."""
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


def _written(value: Any, unit: str) -> str:
    text = f"{float(value):.{DIGITS}g}"
    return f'"{text} {unit}"' if unit else (text if "." in text or "e" in text else f"{text}.0")


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
        _parameter(facts, point, item.parameter)
        if item.parameter
        else thrower.sum(item, among=wanted)
        for item in wanted
    ]
    return values, thrower.made


def _parameter(facts: Facts, point: Floats, name: str) -> float:
    number = [item.name for item in facts.parameters].index(name)
    return float(facts.parameters[number].value(point[number]))
