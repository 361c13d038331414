"""The usual figure of each kind of dataset.

Stands alone: it loads Matplotlib, which registering the accessor must not.
"""

from typing import TYPE_CHECKING, Any

import xarray as xr

from turnout.api.sweep import cells_of
from turnout.core.errors import ResponseError
from turnout.figures.campaign import plot_overview, plot_stacked
from turnout.figures.draw import draw_sheet
from turnout.figures.gauge import plot_gauge
from turnout.figures.modes import plot_modes
from turnout.figures.recording import plot_measured
from turnout.figures.report.sequence import sequence_sheet
from turnout.figures.report.view import dataset_kind
from turnout.figures.sweep import plot_sweep_map
from turnout.figures.throw import plot_throw
from turnout.figures.validation import plot_comparison, plot_error_map
from turnout.throw.verdict import throw_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw(dataset: xr.Dataset, **options: Any) -> "Figure":
    """Draw a dataset as its kind is usually drawn.

    Parameters
    ----------
    dataset : xarray.Dataset
        Run, recording, campaign, sweep, calibration, validation, modes or gauge, by its `kind`.
    **options
        Of the function that draws it.
    """
    kind = dataset_kind(dataset)
    if kind == "sweep":
        return plot_sweep_map(cells_of(dataset, **options))
    if kind == "modes":
        return plot_modes(dataset, **options)
    if kind == "wheel":
        return plot_gauge(dataset, **options)
    if kind == "validation":
        return (plot_comparison if "place" in options else plot_error_map)(dataset, **options)
    if kind == "campaign":
        return (plot_stacked if "place" in options else plot_overview)(dataset, **options)
    if kind == "sequence":
        sheet = sequence_sheet(dataset, throw_table(dataset), **options)
        if not sheet.rows:
            message = "a sequence of one throw has no course; draw dataset.isel(throw=0)"
            raise ResponseError(message)
        return draw_sheet(sheet)
    return (plot_measured if kind == "recording" else plot_throw)(dataset, **options)
