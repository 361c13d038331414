"""The tables of the benchmark as Markdown, written from the results."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.detection.method import FOLDS
from turnout.core.files import write_atomic
from turnout.detection.conditions import SIMULATED

TABLE = "table.md"
NOTHING = "-"
Results = Mapping[str, Mapping[str, Any]]


def write_table(folder: Path, order: str, results: Mapping[str, Results]) -> Path:
    """Write all tables: first who is first under which conditions."""
    path = folder / TABLE
    parts = [f"{SIMULATED.capitalize()}.", order]
    for name, own in results.items():
        parts += [f"## {name}", merit_table(own), place_table(own)]
        parts += [kind_table(own), said_table(own), budget_table(own)]
    write_atomic(path, "\n\n".join(part for part in parts if part) + "\n")
    return path


def kind_table(results: Results) -> str:
    """Return a table of a90 and a90/95 by the kind of the object, sleepers 4 to 8."""
    kinds = list(next(iter(results.values()))["score"]["kind"])
    rows = []
    for result in results.values():
        found = [result["score"]["kind"][name] for name in kinds]
        sizes = (f"{millimetres(of['a90'])} / {millimetres(of['a90_95'])}" for of in found)
        rows.append([result["title"], *sizes])
    return markdown_table(["a90 / a90/95, sleepers 4 to 8 [mm]", *kinds], rows)


def said_table(results: Results) -> str:
    """Return a table of gaps, places and sizes: median error and coverage of 95 % intervals."""
    heads, rows = ["error [mm], interval holds"], []
    for result in results.values():
        score = result["score"]
        found = {**score["gap"], "place": score["x"], "size": score["size"]}
        found = {name: item for name, item in found.items() if item and item["count"]}
        if found:
            heads = [heads[0], *found]
            rows.append([result["title"], *(
                f"{millimetres(item['median'])}, {item['coverage']:.0%}" for item in found.values()
            )])  # fmt: skip
    return markdown_table(heads, rows) if rows else ""


def budget_table(results: Results) -> str:
    """Return a table of the settings that each method tried, and of their cost."""
    heads = ("method", "settings", "fits", "tuned in [s]", "detected of held back", "taken")
    rows = []
    for result in results.values():
        shares = [item["detected"] for item in result["tried"]]
        rows.append([
            result["title"], str(len(shares)), str(FOLDS * len(shares) + 1),
            f"{result['tuning_time']:.0f}", f"{min(shares):.0%} to {max(shares):.0%}",
            ", ".join(f"{name} {value}" for name, value in result["setting"].items()),
        ])  # fmt: skip
    return markdown_table(heads, rows)


def merit_table(results: Results) -> str:
    """Return a table of the figures of merit, a row a method."""
    heads = (
        *("method", "false alarms in 1,000", "in 10,000", "a90 4-8 [mm]", "at equal rate [mm]"),
        *("unknown", "causes", "calibration", "ms", "kB"),
    )
    rows = []
    for result in results.values():
        score = result["score"]
        rows.append([
            result["title"],
            _rate(score["false_alarms"], 1e3),
            _rate(score["rare_alarms"], 1e4),
            millimetres(score["mid_span"]),
            millimetres(score["equal_mid_span"]),
            *(_plain(score[name]) for name in ("unknown_auroc", "macro_f1", "calibration")),
            f"{result['milliseconds']:.2f}",
            f"{result['bytes'] / 1e3:.0f}",
        ])  # fmt: skip
    return markdown_table(heads, rows)


def place_table(results: Results) -> str:
    """Return a table of a90 and a90/95 by place, two rows a method."""
    places = list(next(iter(results.values()))["score"]["place"])
    rows = []
    for result in results.values():
        found = [result["score"]["place"][name] for name in places]
        rows.append([result["title"], *(millimetres(item["a90"]) for item in found)])
        rows.append(["a90/95", *(millimetres(item["a90_95"]) for item in found)])
    return markdown_table(["a90 [mm]", *map(_short, places)], rows)


def markdown_table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table whose first column is text and whose others are numbers, as Markdown."""
    lines = ["| " + " | ".join(heads) + " |", "|---|" + "--:|" * (len(heads) - 1)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])


def _short(place: str) -> str:
    return place.replace("drive ", "D").replace("sleeper ", "")


def _rate(rate: Mapping[str, Any] | None, scale: float) -> str:
    if rate is None or rate["value"] is None:
        return NOTHING
    low, high = scale * rate["low"], scale * rate["high"]
    return f"{scale * rate['value']:.1f} ({low:.1f}-{high:.1f})"


def millimetres(value: float | None) -> str:
    """Return a size in mm; a dash for none.

    Examples
    --------
    >>> millimetres(0.0123), millimetres(None)
    ('12.3', '-')
    """
    return NOTHING if value is None or not np.isfinite(value) else f"{1e3 * value:.1f}"


def _plain(value: float | None) -> str:
    return NOTHING if value is None else f"{value:.2f}"
