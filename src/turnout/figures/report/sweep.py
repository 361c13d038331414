"""The page about a sweep: outcomes of its throws, the map of places and sizes, sensitivities."""

import math
from collections.abc import Sequence

import numpy as np
import xarray as xr

from turnout.core.errors import ResponseError
from turnout.core.value_text import shown_unit
from turnout.figures.draw import draw_sheet
from turnout.figures.report.inputs import origin_section
from turnout.figures.report.page import Heat, Page, Picture, Section, Table
from turnout.figures.sheet import Line, Row, Sheet
from turnout.figures.style import rendered
from turnout.figures.sweep import TITLES, effect_axis, plot_sweep_map, strongest
from turnout.metric.finding import Finding, Severity
from turnout.metric.sensitivity import Effect, OutputEffects
from turnout.metric.sweep_map import (
    FAILED,
    NOT_JUDGED,
    NOT_THROWN,
    SLIPS,
    STATES,
    UNDETECTED,
    end_state,
    sweep_map,
    trapped_objects,
)
from turnout.throw.verdict import break_note

MAP_INPUTS = ("object.size", "object.at")
NEEDED = ("outcome", "verdict")
# Of each output the effects of so many inputs are drawn.
MOST_EFFECT_PLOTS = 2


def sweep_page(
    labels: xr.Dataset,
    *,
    decided: Sequence[OutputEffects] = (),
    suffixes: Sequence[str] = (".pdf",),
) -> Page:
    """Return the page about a sweep.

    Parameters
    ----------
    labels : xarray.Dataset
        Dimension scenario: inputs, outcomes, labels and features.
    decided : sequence of OutputEffects
        Sensitivity of each output.
    suffixes : sequence of str
        File formats in which the page offers each figure.

    Returns
    -------
    Page

    Raises
    ------
    ResponseError
        When the sweep lacks the labels that say how its throws ended.
    """
    lost = [name for name in NEEDED if name not in labels]
    if lost:
        message = (
            f"sweep {labels.attrs.get('name', '')}: has no {', '.join(lost)}, so the report"
            " cannot say how its throws ended; run the study again with this version"
        )
        raise ResponseError(message)
    sections = [
        Section(heading="How the throws ended", tables=_endings(labels)),
        *([_map_section(labels)] if has_map(labels) else []),
        Section(
            heading="Sensitivity",
            text="First-order Sobol index: share of the variance of an output due to one input. "
            "Total: with all interactions, where the sampling of the sweep allows it."
            if decided
            else "",
            tables=[_indices(item) for item in decided],
            pictures=[
                _picture(_effect_sheet(item, effect), suffixes)
                for item in decided
                for effect in strongest(item, MOST_EFFECT_PLOTS)
                if all(isinstance(level, float) for level in effect.levels)
            ],
            folded=True,
        ),
        Section(heading="What was varied", tables=[_inputs(labels)]),
        origin_section(labels.attrs),
    ]
    return Page(
        title=f"Sweep {labels.attrs.get('name', '')}".strip(),
        subtitle=str(labels.attrs.get("description", "")),
        findings=sweep_findings(labels),
        sections=[s for s in sections if s.tables or s.heats or s.pictures],
        synthetic=True,
    )


def sweep_findings(labels: xr.Dataset) -> list[Finding]:
    """Return the outcomes of the throws of a sweep, undetected objects first.

    Parameters
    ----------
    labels : xarray.Dataset
        Dimension scenario.

    Returns
    -------
    list of Finding
        Shares are of the throws that came to their end; none in a sweep without verdicts.
    """
    found = _ended(labels) if "verdict" in labels else []
    if note := break_note(labels):
        found.append(Finding("look", "Can the numbers be trusted?", "With care", note))
    missing = int(labels.attrs.get("missing", 0))
    if missing:
        found.append(Finding("look", "Not thrown yet", str(missing), "the sweep is not finished"))
    return found


def _ended(labels: xr.Dataset) -> list[Finding]:
    """Return the share of each outcome."""
    state = end_state(labels).to_numpy()
    ended = state < FAILED
    found = []
    if "object_touched" in labels:
        touched = ended & (labels["object_touched"].to_numpy() > 0)
        silent = state == UNDETECTED
        count, of = int(silent.sum()), int(touched.sum())
        trapped = trapped_objects(labels)
        gone = 0 if trapped is None else int((touched & ~trapped).sum())
        detail = (
            f"{count} of {of} throws that touch an object pass all checks with it in the switch"
            + (f"; in {gone} of them the object is gone at the end" if gone else "")
        )
        answer = f"{100 * count / of:.3g} % of touched objects" if of else "No object touched"
        found.append(Finding("bad" if count else "good", "Undetected objects", answer, detail))
    for number, name in enumerate(STATES):
        count = int((state == number).sum())
        if not count or number == UNDETECTED:
            continue
        whole = int(ended.sum()) if number < FAILED else state.size
        level: Severity = "look" if number in (NOT_JUDGED, FAILED, NOT_THROWN) else "fact"
        detail = f"{count} of {whole} throws"
        share = f"{100 * count / whole:.3g} %"
        found.append(Finding(level, name.capitalize(), share, detail))
    return found


def has_map(labels: xr.Dataset) -> bool:
    """Return True if a sweep varies size and place of the object."""
    return all(name in labels.coords for name in MAP_INPUTS)


def sweep_figures(labels: xr.Dataset, *, suffixes: Sequence[str]) -> dict[str, bytes]:
    """Return the map of a sweep as files by name, empty if it has none."""
    if not has_map(labels):
        return {}
    figure = plot_sweep_map(sweep_map(labels))
    return {f"map{suffix}": rendered(figure, suffix) for suffix in suffixes}


def _endings(labels: xr.Dataset) -> list[Table]:
    outcome, counts = np.unique(labels["outcome"].to_numpy().astype(str), return_counts=True)
    rows = [(str(name), str(count)) for name, count in zip(outcome, counts, strict=True)]
    return [Table("", ("Outcome of the simulation", "Throws"), rows)]


def _map_section(labels: xr.Dataset) -> Section:
    """Return the map of places against sizes: numbers in colour, and how the worst throw ended."""
    cells = sweep_map(labels)
    columns = [_level(cells["x"], at) for at in range(cells.sizes["x"])]
    rows = [_level(cells["y"], at) for at in range(cells.sizes["y"])]
    state = cells["state"].to_numpy()
    framed = np.isin(state, SLIPS)
    heats = [
        Heat(title, rows, columns, (factor * cells[name].to_numpy()).tolist(), framed.tolist())
        for name, (title, factor) in TITLES.items()
        if name in cells
    ]
    words = [(name, *(STATES[at] for at in line)) for name, line in zip(rows, state, strict=True)]
    text = "Medians of a cell, by size of the object in mm; framed where a drive slips."
    worst = Table("How the worst throw of a cell ended", ("Place", *columns), words)
    return Section(heading="Places against sizes", text=text, heats=heats, tables=[worst])


def _level(axis: xr.DataArray, at: int) -> str:
    value = axis.values[at]
    if axis.dtype.kind not in "fiu":
        return str(value)
    return f"{1e3 * float(value):.4g}"


def _indices(item: OutputEffects) -> Table:
    def share(value: float, half_width: float) -> str:
        return "" if math.isnan(value) else f"{100 * value:.1f} ± {100 * half_width:.1f} %"

    rows = [
        (index.name, share(index.first, index.first_confidence),
         share(index.total, index.total_confidence))
        for index in sorted(item.indices, key=lambda index: -index.first)
    ]  # fmt: skip
    return Table(item.output.name.replace("_", " "), ("Input", "First", "Total"), rows)


def _effect_sheet(item: OutputEffects, effect: Effect) -> Sheet:
    """Return the mean of an output over an input, with its 95 % interval."""
    label, factor, offset = effect_axis(effect)
    x = factor * np.array(effect.levels, dtype=float) + offset
    unit, size = shown_unit(item.output.units)
    name = item.output.name.replace("_", " ")
    lines = (
        Line(label="mean", x=x, y=effect.mean / size, style="line and marks"),
        *(
            Line(
                label="95 % interval" if sign > 0 else "95 % interval, below",
                x=x,
                y=(effect.mean + sign * effect.confidence) / size,
                colour=4,
                dash=3,
                width=0.9,
            )
            for sign in (1, -1)
        ),
    )
    return Sheet(
        name=f"{item.output.name}-{effect.name}".replace(", ", "-").replace(" ", "-"),
        title=f"{name} by {effect.name}",
        caption="Mean over all that was varied besides.",
        x_label=label or effect.name,
        rows=(Row(f"{name}\n[{unit}]" if unit else name, lines),),
    )


def _picture(sheet: Sheet, suffixes: Sequence[str]) -> Picture:
    figure = draw_sheet(sheet)
    return Picture(sheet, {suffix: rendered(figure, suffix) for suffix in suffixes})


def _inputs(labels: xr.Dataset) -> Table:
    """Return every input with its unit and range, or with its values if they are names."""
    rows = []
    for name, values in labels.coords.items():
        if "input" not in values.attrs:
            continue
        items = values.to_numpy()
        units = str(values.attrs.get("units", ""))
        if items.dtype.kind in "fiu":
            reach = f"{float(np.min(items)):.6g} to {float(np.max(items)):.6g}"
        else:
            reach = ", ".join(sorted({str(item) for item in items}))
        count = len({str(item) for item in items})
        rows.append((str(name), reach, units, str(count)))
    return Table("", ("Input", "Range", "Unit", "Different values"), rows)
