"""Some of the accepted panels as a study: a list of cases that every study command takes."""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.matching.facts import Facts

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
