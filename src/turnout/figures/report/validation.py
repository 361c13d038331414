"""The page about a validation: the verdict, errors beside repeats, measured against predicted."""

import math
from collections.abc import Sequence

import numpy as np
import xarray as xr

from turnout.calibration.validation.acceptance import (
    LEAST_COVER,
    MOST_SPREADS,
    Acceptance,
    judge,
    notes,
    scatter_text,
)
from turnout.core.value_text import count_text
from turnout.figures.report.inputs import origin_section
from turnout.figures.report.page import FEW_POINTS, Heat, Page, Picture, Section, Table
from turnout.figures.style import MILLI, rendered
from turnout.figures.validation import comparison_sheet, plot_comparison, plot_error_map
from turnout.metric.agreement import only_fitted
from turnout.metric.campaign_statistics import object_places
from turnout.metric.finding import Finding, Severity

PERCENT = 100.0


def validation_page(validation: xr.Dataset, *, suffixes: Sequence[str] = (".pdf",)) -> Page:
    """Return the page about a validation.

    Parameters
    ----------
    validation : xarray.Dataset
        From `turnout.calibration.validation.validate.validate`.
    suffixes : sequence of str
        File formats in which the page offers each figure.

    Returns
    -------
    Page
    """
    verdict = judge(validation)
    sections = [
        Section(
            heading="Errors and the spread of repeats",
            text=f"Of {count_text(verdict.judged, 'movement')} that were judged; the fit used "
            f"{verdict.used}{', each predicted without its place' if verdict.left_out else ''}. "
            f"From throw to throw: {scatter_text(validation)}.",
            tables=[_channels(verdict), _features(verdict)],
        ),
        Section(
            heading="Places against sizes",
            text="Root mean square difference of prediction and measurement as a multiple of the "
            f"repeat spread of the channel, closing; {MOST_SPREADS:g} is the limit."
            + (
                " Framed: used for the fit, so not judged." if only_fitted(validation).any() else ""
            ),
            heats=_heats(validation),
        ),
        Section(
            heading="Over time",
            pictures=[_picture(validation, place, suffixes) for place in _places(validation)],
            folded=True,
        ),
        Section(heading="Largest errors and exclusions", tables=_remarks(validation, verdict)),
        Section(heading="Movements", tables=[_movements(validation)]),
        origin_section(validation.attrs),
    ]
    return Page(
        title=f"Validation: {validation.attrs.get('title', 'campaign')}",
        subtitle=f"Panel {validation.attrs.get('panel', 'not stated')}, calibrated; "
        f"{count_text(validation.sizes['movement'], 'movement')} predicted",
        findings=validation_findings(validation, verdict),
        sections=[s for s in sections if s.tables or s.heats or s.pictures],
        synthetic=bool(validation.attrs.get("synthetic")),
    )


def validation_findings(validation: xr.Dataset, verdict: Acceptance) -> list[Finding]:
    """Return the verdict on a calibration, then the error of each channel."""
    level: Severity = "good" if verdict.accepted else "bad" if verdict.reasons else "look"
    answer = "Valid" if verdict.accepted else "Not valid" if verdict.reasons else "Not validated"
    found = [Finding(level, "Does the calibration hold?", answer, verdict.text.partition(": ")[2])]
    share = f"{PERCENT * verdict.cover:.0f} % of the measurement"
    limit = f"at least {PERCENT * LEAST_COVER:.0f} % should be"
    inside: Severity = "good" if verdict.cover >= LEAST_COVER else "bad"
    found.append(Finding(inside, "Inside the 95 % band", share, limit))
    for item in verdict.channels:
        error, detail = f"Error of {item.channel}", "no throw of it can be simulated"
        if math.isnan(item.rms):
            found.append(Finding("bad", error, "not known", detail))
        else:
            rms, nrmse, repeats, times, *_ = item.figures
            detail = (
                f"{rms}, {nrmse} of the largest force; repeats spread by {repeats}; "
                f"the limit is {MOST_SPREADS:g} spreads"
            )
            far: Severity = "bad" if item.spreads > MOST_SPREADS else "good"
            found.append(Finding(far, error, f"{times} repeat spreads", detail))
        found.append(
            Finding(
                "bad" if item.cover < item.least_cover else "good",
                f"Band of {item.channel}",
                f"{PERCENT * item.cover:.0f} % inside",
                f"a right model has less than {PERCENT * item.least_cover:.0f} % inside in one "
                "campaign of twenty",
            )
        )
    for text in (*verdict.remarks, *notes(validation)):
        found.append(Finding("look", "Check", "Note", text))
    return found


def validation_figures(validation: xr.Dataset, *, suffixes: Sequence[str]) -> dict[str, bytes]:
    """Return the map of errors as files by name."""
    figure = plot_error_map(validation)
    return {f"errors{suffix}": rendered(figure, suffix) for suffix in suffixes}


def _channels(verdict: Acceptance) -> Table:
    rows = [(item.channel, str(item.movements), *item.figures) for item in verdict.channels]
    columns = (
        "Channel",
        "Movements",
        "RMS",
        "NRMSE",
        "Repeats",
        "RMS over repeats",
        "In the band",
        "At least",
    )
    marked = frozenset(n for n, item in enumerate(verdict.channels) if item.reasons)
    return Table("NRMSE is over the largest force of the channel", columns, rows, marked)


def _features(verdict: Acceptance) -> Table:
    rows = [(item.channel, *item.cells) for item in verdict.channels]
    columns = ("Channel", "Contact", "Build-up", "Peak", "Plateau")
    return Table("Predicted less measured, mean and standard deviation", columns, rows)


def _places(validation: xr.Dataset) -> list[str]:
    closing = validation["direction"].values == "closing"
    return object_places(validation.isel(movement=np.flatnonzero(closing)))


def _heats(validation: xr.Dataset) -> list[Heat]:
    closing = validation.isel(movement=np.flatnonzero(validation["direction"].values == "closing"))
    none = ["none"] if (closing["size"].values == 0).any() else []
    places, sizes = [*none, *object_places(closing)], np.unique(closing["size"].values)
    heats = []
    for name in closing["channel"].values:
        one = closing.sel(channel=name)
        times = (one["rms"] / one["repeat_spread"]).values
        if not np.isfinite(times).any():
            continue
        values = np.full((len(places), sizes.size), np.nan)
        framed = np.zeros(values.shape, dtype=bool)
        for line, column in np.ndindex(*values.shape):
            same = (one["place"].values == places[line]) & (one["size"].values == sizes[column])
            same &= np.isfinite(times)
            if same.any():
                values[line, column] = np.sqrt(np.mean(times[same] ** 2))
                framed[line, column] = bool(only_fitted(one)[same].any())
        heading = f"{str(name).capitalize()}, over {float(one['repeat_spread']):.0f} N of repeats"
        rows = ["no object" if place == "none" else place for place in places]
        columns = [f"{MILLI * size:g} mm" for size in sizes]
        heats.append(Heat(heading, rows, columns, values.tolist(), framed.tolist()))
    return heats


def _picture(validation: xr.Dataset, place: str, suffixes: Sequence[str]) -> Picture:
    figure = plot_comparison(validation, place=place)
    files = {suffix: rendered(figure, suffix) for suffix in suffixes}
    return Picture(comparison_sheet(validation, place=place), files, FEW_POINTS)


def _remarks(validation: xr.Dataset, verdict: Acceptance) -> list[Table]:
    remarks = (("Largest errors", verdict.worst), ("Check", tuple(notes(validation))))
    noticed = ("What this validation would notice", verdict.power)
    return [
        Table(heading, ("Remark",), [(text,) for text in rows])
        for heading, rows in (*remarks, noticed)
        if rows
    ]


def _movements(validation: xr.Dataset) -> Table:
    """Return a row for each movement: its object, its errors, a mark if it was not judged."""
    channels = [str(name) for name in validation["channel"].values]
    rows, marked = [], []
    for number in range(validation.sizes["movement"]):
        one = validation.isel(movement=number)
        size = float(one["size"])
        what = f"{MILLI * size:g} mm at {one['place'].item()}" if size > 0 else "no object"
        times = (one["rms"] / one["repeat_spread"]).values
        if not bool(only_fitted(one)) and np.nanmax(times, initial=0.0) > MOST_SPREADS:
            marked.append(number)
        errors = ("-" if math.isnan(value) else f"{value:.0f} N" for value in one["rms"].values)
        judged = "fit" if bool(only_fitted(one)) else "judged"
        rows.append(
            (str(one["movement"].item()), str(one["direction"].item()), what, judged, *errors)
        )
    columns = ("Movement", "Direction", "Object", "Used for", *(f"RMS {name}" for name in channels))
    return Table("Marked: beyond the limit in some channel", columns, rows, frozenset(marked))
