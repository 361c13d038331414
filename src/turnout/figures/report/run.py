"""The page about one run, simulated or measured."""

from collections.abc import Iterable

import xarray as xr

from turnout.figures.along_rail_sheet import chair_sheet, gap_sheet, shape_sheet
from turnout.figures.draw import draw_sheet
from turnout.figures.over_time_sheet import energy_sheet, throw_sheet
from turnout.figures.report.inputs import inputs_section, origin_section
from turnout.figures.report.page import Page, Picture, Section, Table
from turnout.figures.sheet import Sheet
from turnout.figures.style import rendered, title_of
from turnout.metric.finding import findings
from turnout.metric.panel_check import concerns
from turnout.metric.summary import summary
from turnout.panel.load import LoadedPanel

FIGURE_SUFFIXES = (".pdf", ".png", ".svg")


def run_page(
    dataset: xr.Dataset,
    *,
    panel: LoadedPanel | None = None,
    pictures: Iterable[Picture] | None = None,
) -> Page:
    """Return the page about a run.

    Parameters
    ----------
    dataset : xarray.Dataset
        A run; findings that need a missing channel are left out.
    panel : LoadedPanel, optional
        Panel that it was computed with, from `turnout.figures.report.inputs.panel_of_result`.
    pictures : iterable of Picture, optional
        Its figures; default those of `run_sheets`, drawn.

    Returns
    -------
    Page
    """
    drawn = [picture_of(s) for s in run_sheets(dataset)] if pictures is None else list(pictures)
    sections = [
        Section(heading="What happened", pictures=drawn[:1]),
        Section(heading="Along the rails, and the energy", pictures=drawn[1:]),
        Section(heading="In numbers", tables=_tables(dataset)),
        inputs_section(dataset.attrs, panel),
        origin_section(dataset.attrs),
    ]
    kind = str(dataset.attrs.get("kind", "run"))
    return Page(
        title=f"Throw of {dataset.attrs.get('panel', dataset.attrs.get('title', 'a switch'))}",
        subtitle=f"{kind.capitalize()}: {title_of(dataset)}",
        findings=findings(dataset),
        sections=[s for s in sections if s.pictures or s.tables or s.text],
        synthetic=bool(dataset.attrs.get("synthetic")),
    )


def run_sheets(dataset: xr.Dataset) -> list[Sheet]:
    """Return the figures of a run, those that its channels allow."""
    if dataset.sizes.get("time", 0) < 2:
        return []
    sheets = [throw_sheet(dataset)]
    if "gap" in dataset:
        sheets += [shape_sheet(dataset), gap_sheet(dataset)]
    if "chair_normal_force" in dataset and "chair_friction_force" in dataset:
        sheets.append(chair_sheet(dataset))
    if "work_markers" in dataset:
        sheets.append(energy_sheet(dataset))
    return [sheet for sheet in sheets if any(row.lines for row in sheet.rows)]


def picture_of(sheet: Sheet) -> Picture:
    """Return a sheet with its drawing as PDF, PNG and SVG."""
    figure = draw_sheet(sheet)
    return Picture(sheet, {suffix: rendered(figure, suffix) for suffix in FIGURE_SUFFIXES})


def _tables(dataset: xr.Dataset) -> list[Table]:
    lines = summary(dataset) if dataset.attrs.get("kind") == "simulation" else []
    tables = [Table("", ("", ""), lines)] if lines else []
    if lines and dataset.attrs.get("foreign_objects", "[]") == "[]":
        rows = [(c.what, c.where, c.number, c.remedy) for c in concerns(dataset)]
        columns = ("What", "Where", "How much", "Remedy")
        tables += [Table("Check", columns, rows)] if rows else []
    return tables
