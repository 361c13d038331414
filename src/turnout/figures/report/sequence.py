"""The page about a sequence of throws: trapped objects and their reports, from throw to throw."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from turnout.figures.along_rail_sheet import shade_of
from turnout.figures.report.inputs import origin_section
from turnout.figures.report.page import Page, Section, Table
from turnout.figures.report.run import picture_of
from turnout.figures.sheet import Line, Row, Sheet
from turnout.metric.finding import Finding, Severity
from turnout.throw.verdict import break_note, throw_table

MOST_ROWS = 400
"""Throws in the table; of more, some at even distances."""
LEVELS: Mapping[str, Severity] = {
    "undetected object": "bad",
    "not locked": "bad",
    "not sound": "bad",
    "depends on how it breaks": "look",
    "not judged": "look",
}
"""Of kinds of verdicts; all others are good."""


def sequence_page(dataset: xr.Dataset) -> Page:
    """Return the page about a sequence of throws.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `simulate_sequence`, with what it keeps by default.
    """
    rows = throw_table(dataset)
    sheet = sequence_sheet(dataset, rows)
    sections = [
        Section(heading="From throw to throw", pictures=[picture_of(sheet)] if sheet.rows else []),
        Section(heading="Throws", tables=[_table(rows, dataset)], folded=True),
        origin_section(dataset.attrs),
    ]
    return Page(
        title=str(dataset.attrs.get("title", "Throws of a switch")),
        subtitle=f"Simulation, {dataset.attrs.get('mode', '')}".strip(", "),
        findings=sequence_findings(dataset, rows),
        sections=[s for s in sections if s.pictures or s.tables or s.text],
        synthetic=False,
    )


def sequence_findings(dataset: xr.Dataset, rows: Sequence[Mapping[str, Any]]) -> list[Finding]:
    """Return the number of throws by verdict, and a finding if the sequence is incomplete.

    Takes what `sequence_sheet` takes.
    """
    found = []
    if not dataset.attrs.get("complete", True):
        message = str(dataset.attrs.get("outcome_message", "ended early"))
        found.append(Finding("bad", "Is the sequence whole?", "No", message))
    for kind, count in Counter(row["verdict"] for row in rows).most_common():
        throws = [row["throw"] for row in rows if row["verdict"] == kind]
        detail = f"{count} of {len(rows)} throws, first throw {throws[0]}, last throw {throws[-1]}"
        share = f"{100 * count / len(rows):.3g} %"
        found.append(Finding(LEVELS.get(kind, "good"), kind[:1].upper() + kind[1:], share, detail))
    if note := break_note(dataset):
        found.append(Finding("look", "Can the numbers be trusted?", "With care", note))
    return sorted(found, key=lambda item: item.level != "bad")


def sequence_sheet(dataset: xr.Dataset, rows: Sequence[Mapping[str, Any]]) -> Sheet:
    """Return sizes of objects and forces over the number of the throw, without rows for one.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `simulate_sequence`.
    rows : sequence of mapping
        Of its `throw_table`.
    """
    throws = np.array([row["throw"] for row in rows], dtype=float)

    def lines(key: str, names: Sequence[str], factor: float) -> tuple[Line, ...]:
        values = np.array([row[key] for row in rows], dtype=float).reshape(throws.size, -1)
        count = max(len(names) - 1, 1)
        return tuple(
            Line(label=name, x=throws, y=factor * values[:, at], colour=shade_of(at / count),
                 dash=at)
            for at, name in enumerate(names)
        )  # fmt: skip

    drives = [f"Drive {name}" for name in dataset["drive"].values]
    made = [Row("End force [kN]", lines("drive_force_end", drives, 1e-3))]
    if rows and rows[0]["size"]:
        objects = [f"object {name}" for name in dataset["object"].values]
        made = [
            Row("Size [mm]", lines("size", objects, 1e3)),
            Row("Object force [kN]", lines("object_force_peak", ["largest"], 1e-3)),
            *made,
        ]
    return Sheet(
        name="throws",
        title="From throw to throw",
        caption=f"Object force: {note}." if (note := dataset.attrs.get("object_peak_note")) else "",
        x_label="Throw",
        rows=tuple(made) if throws.size > 1 else (),
    )


def _table(rows: Sequence[Mapping[str, Any]], dataset: xr.Dataset) -> Table:
    every = max(1, -(-len(rows) // MOST_ROWS))
    drives = [f"Drive {name} [kN]" for name in dataset["drive"].values]
    heads = ("Throw", "Size [mm]", "Left [mm]", "Object [kN]", *drives, "Verdict", "At the end")
    lines = [
        (
            str(row["throw"]),
            " + ".join(f"{1e3 * size:.1f}" for size in row["size"]),
            " + ".join(f"{1e3 * size:.1f}" for size in row["left"]),
            f"{1e-3 * row['object_force_peak']:.2f}",
            *(f"{1e-3 * force:.2f}" for force in row["drive_force_end"]),
            row["verdict"],
            row["state"],
        )
        for row in rows[::every]
    ]
    return Table("", heads, lines)
