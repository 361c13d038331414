"""The gauge along a closed rail at rest and under a wheel: sheet, figure and page."""

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from turnout.figures.draw import draw_sheet
from turnout.figures.report.page import Page, Picture, Section, Table
from turnout.figures.sheet import Level, Line, Moment, Row, Sheet
from turnout.figures.style import COLOURS, rendered
from turnout.metric.least_gauge import gauges_of_load, least_gauges, wheel_findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MILLI, KILO = 1e3, 1e-3
BLACK = len(COLOURS) - 1


def gauge_sheet(dataset: xr.Dataset) -> Sheet:
    """Return the least gauge along a closed rail, and the gauge at a wheel that rolls along it.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `turnout.gauge_under_wheel`.

    Returns
    -------
    Sheet
        Above at rest, and for each load the least while the wheel rolls; below at the wheel.
    """
    x, wheel = dataset["x"].values, dataset["wheel"].values
    nominal, limit = (float(dataset.attrs[f"gauge_{name}"]) for name in ("nominal", "limit"))
    rest = MILLI * (dataset["gauge_at_rest"].values - nominal)
    along, at_wheel = [Line(label="at rest", x=x, y=rest, colour=BLACK)], list[Line]()
    colours, dashes = (
        {force: number for number, force in enumerate(np.unique(dataset[name]).tolist())}
        for name in ("lateral_force", "vertical_force")
    )
    for number in range(dataset.sizes["load"]):
        one = dataset.isel(load=number)
        lateral, vertical = (float(one[name]) for name in ("lateral_force", "vertical_force"))
        name = f"Y {KILO * lateral:g} kN, Q {KILO * vertical:g} kN"
        gauge, own, _ = gauges_of_load(one)
        for lines, places, values in ((along, x, gauge.min(axis=0)), (at_wheel, wheel, own)):
            colour, dash = colours[lateral] % BLACK, dashes[vertical]
            y = MILLI * (values - nominal)
            lines.append(Line(label=name, x=places, y=y, colour=colour, dash=dash))
    objects: list[dict[str, Any]] = json.loads(dataset.attrs["foreign_objects"])
    levels = () if np.isnan(limit) else (Level(MILLI * (limit - nominal), "least gauge allowed"),)
    return Sheet(
        name="gauge-under-wheel",
        title=f"{dataset.attrs['title']}, rail {dataset.attrs['rail']} closed",
        caption="Above the least gauge at each place while the wheel rolls over the rail, below "
        "the gauge where the wheel is. An object keeps the rail away from its stock rail; a wheel "
        "levers it about the object, so that the least gauge can be elsewhere. Colours tell "
        "the lateral force Y, dashes the vertical force Q.",
        x_label="x from the toe [m]",
        rows=(
            Row("Least gauge less\nnominal [mm]", tuple(along), levels),
            Row("At the wheel, less\nnominal [mm]", tuple(at_wheel), levels),
        ),
        moments=tuple(Moment(float(item["x"]), f"{MILLI * item['size']:g} mm") for item in objects),
    )


def plot_gauge(dataset: xr.Dataset) -> "Figure":
    """Draw the gauge along a closed rail at rest and under a wheel.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `turnout.gauge_under_wheel`.

    Returns
    -------
    matplotlib.figure.Figure
    """
    return draw_sheet(gauge_sheet(dataset))


def gauge_page(dataset: xr.Dataset, *, suffixes: Sequence[str] = (".pdf",)) -> Page:
    """Return the page about the gauge beside a closed rail, at rest and under a wheel.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `turnout.gauge_under_wheel`.
    suffixes : sequence of str
        File formats in which the page offers the figure.
    """
    sheet = gauge_sheet(dataset)
    figure = draw_sheet(sheet)
    picture = Picture(sheet, {suffix: rendered(figure, suffix) for suffix in suffixes})
    columns = ("Y [kN]", "Q [kN]", "at the wheel [mm]", "under the wheel [mm]", "roll [mrad]")
    rows = [
        (
            f"{KILO * item.lateral:g}",
            f"{KILO * item.vertical:g}",
            f"{MILLI * item.at_wheel:.1f} at {item.wheel_place}",
            f"{MILLI * item.under_wheel:.1f} {item.where}",
            f"{MILLI * item.roll:.1f}",
        )
        for item in least_gauges(dataset)
    ]
    said = dataset.attrs
    conditions = [(name, str(said[name])) for name in ("panel", "panel_hash", "overrides", "rail")]
    conditions += [(name, str(said[name])) for name in ("course", "scheme", "version")]
    return Page(
        title="Track gauge under a wheel",
        subtitle=f"{sheet.title}: simulated, quasi-static, a wheel on one rail",
        findings=wheel_findings(dataset),
        sections=[
            Section(heading="Along the rail", pictures=[picture]),
            Section(heading="Load by load", tables=[Table("", columns, rows)]),
            Section(heading="Conditions", tables=[Table("", ("", ""), conditions)]),
        ],
    )
