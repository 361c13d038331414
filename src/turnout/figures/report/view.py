"""A result as a notebook shows it: its findings in words, and one picture."""

from dataclasses import dataclass
from html import escape

import xarray as xr

from turnout.calibration.validation.acceptance import judge
from turnout.core.value_text import count_text
from turnout.figures.draw import draw_sheet
from turnout.figures.gauge import gauge_sheet
from turnout.figures.over_time_sheet import throw_sheet
from turnout.figures.report.campaign import campaign_findings
from turnout.figures.report.page import data_address
from turnout.figures.report.sequence import sequence_findings, sequence_sheet
from turnout.figures.report.sweep import sweep_findings
from turnout.figures.report.validation import validation_findings
from turnout.figures.sheet import Sheet
from turnout.figures.style import rendered, title_of
from turnout.metric.finding import Finding, findings
from turnout.metric.least_gauge import wheel_findings
from turnout.throw.verdict import throw_table

# Colour and sign both carry the level, so that no reader depends on colour.
SIGNS = {"good": ("✓", "#00875f"), "look": ("!", "#b36b00"), "bad": ("✗", "#c8322b")}
PLAIN = ("·", "inherit")


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A dataset that shows itself in a notebook as findings and a picture; see `view`."""

    dataset: xr.Dataset

    def __repr__(self) -> str:
        """Return the findings as lines of text."""
        lines = [self._title()]
        lines += [
            f"  {_sign(item)[0]} {item.question} {item.answer}: {_detail(item)}"
            for item in self._findings()
        ]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """Return the findings as a table above a picture."""
        cell = "text-align:left;padding:2px 12px 2px 0;vertical-align:top"
        rows = "".join(
            f"<tr style='background:none'><td style='{cell};color:{_sign(item)[1]}'>"
            f"<b>{_sign(item)[0]}</b></td><td style='{cell}'>{escape(item.question)}</td>"
            f"<td style='{cell};color:{_sign(item)[1]}'><b>{escape(item.answer)}</b></td>"
            f"<td style='{cell}'>{escape(_detail(item))}</td></tr>"
            for item in self._findings()
        )
        return (
            f"<div class='turnout-view'><div><b>{escape(self._title())}</b></div>"
            f"<table style='border:none;font-size:90%'>{rows}</table>{self._picture()}</div>"
        )

    def _title(self) -> str:
        attributes, kind = self.dataset.attrs, dataset_kind(self.dataset)
        if kind == "sweep":
            return f"{attributes.get('name', 'sweep')}: {self.dataset.sizes['scenario']} scenarios"
        if kind in ("campaign", "validation"):
            count = self.dataset.sizes["movement"]
            return f"{attributes.get('title', kind)}: {count_text(count, 'movement')}"
        if kind in ("sequence", "wheel"):
            return str(attributes.get("title", kind))
        return title_of(self.dataset)

    def _findings(self) -> list[Finding]:
        kind = dataset_kind(self.dataset)
        if kind == "sweep":
            return sweep_findings(self.dataset)
        if kind == "validation":
            return validation_findings(self.dataset, judge(self.dataset))
        if kind == "campaign":
            return campaign_findings(self.dataset)
        if kind == "sequence":
            return sequence_findings(self.dataset, throw_table(self.dataset))
        if kind == "wheel":
            return wheel_findings(self.dataset)
        return [] if kind == "modes" else findings(self.dataset)

    def _picture(self) -> str:
        sheet = self._sheet()
        if sheet is None:
            return ""
        content = rendered(draw_sheet(sheet), ".png")
        style = "max-width:100%;width:900px;background:white"
        return (
            f"<img style='{style}' alt='{escape(sheet.title)}' "
            f"src='{data_address(content, '.png')}'>"
        )

    def _sheet(self) -> Sheet | None:
        """Return a run over time, a sequence over its throws, a gauge; others have many lines."""
        if dataset_kind(self.dataset) == "sequence":
            course = sequence_sheet(self.dataset, throw_table(self.dataset))
            return course if course.rows else None
        if dataset_kind(self.dataset) == "wheel":
            return gauge_sheet(self.dataset)
        one = dataset_kind(self.dataset) in ("run", "recording")
        if not one or self.dataset.sizes.get("time", 0) < 2:
            return None
        sheet = throw_sheet(self.dataset)
        return sheet if any(row.lines for row in sheet.rows) else None


def view(dataset: xr.Dataset) -> View:
    """Show a result compactly: as the last line of a notebook's cell, or printed.

    Parameters
    ----------
    dataset : xarray.Dataset
        One run, simulated or measured, a sequence of throws, a campaign, a sweep or a validation.

    Returns
    -------
    View
        Findings in words, and for one run its forces, markers and gaps over time.

    Examples
    --------
    >>> run = xr.Dataset({"locked": ("time", [True])}, {"time": [0.0]}, {"panel": "sb1"})
    >>> print(view(run))
    sb1, locked
    ! Outcome Not judged: the dataset has no slip; keep the channels they need
      ✓ Locked? Yes: at the end
    """
    return View(dataset)


def dataset_kind(dataset: xr.Dataset) -> str:
    """Return the kind of a dataset: "run", "recording", "campaign", "sweep" and so on.

    Examples
    --------
    >>> dataset_kind(xr.Dataset({"drive_force": (("movement", "time"), [[0.0]])}))
    'campaign'
    """
    if "scenario" in dataset.dims:
        return "sweep"
    if dataset.attrs.get("kind") in ("modes", "validation", "wheel"):
        return str(dataset.attrs["kind"])
    if "movement" in dataset.dims:
        return "campaign"
    if "throw" in dataset.dims and "time" in dataset.dims:
        return "sequence"
    return "recording" if "channel_map_hash" in dataset.attrs else "run"


def _detail(item: Finding) -> str:
    return f"{item.detail}. {item.meaning}" if item.meaning else item.detail


def _sign(item: Finding) -> tuple[str, str]:
    return SIGNS.get(item.level, PLAIN)
