"""Figures of one run on one pair of axes, to be set beside each other or into a page."""

from typing import TYPE_CHECKING

import xarray as xr

from turnout.core.errors import ResponseError
from turnout.figures.along_rail_sheet import chair_sheet, gap_sheet, shape_sheet
from turnout.figures.draw import draw_row
from turnout.figures.over_time_sheet import energy_sheet, throw_sheet
from turnout.figures.sheet import Sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot_drive_force(dataset: xr.Dataset, *, ax: "Axes | None" = None) -> "Axes":
    """Draw the force of each drive over time.

    Parameters
    ----------
    dataset : xarray.Dataset
        One run, simulated or measured.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; default a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        Forces on the rail [kN], positive closing, over time [s].
    """
    return _row_of(throw_sheet(dataset), "Drive force", ax)


def plot_drive_gap(dataset: xr.Dataset, *, ax: "Axes | None" = None) -> "Axes":
    """Draw the gap at each drive and control contact over time.

    Parameters
    ----------
    dataset : xarray.Dataset
        One run with gaps.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; default a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        Gaps [mm] over time [s].
    """
    return _row_of(throw_sheet(dataset), "Gap", ax)


def plot_rail_shape(
    dataset: xr.Dataset, *, compare: xr.Dataset | None = None, ax: "Axes | None" = None
) -> "Axes":
    """Draw the gap along the closed rail at the end of a run.

    Parameters
    ----------
    dataset : xarray.Dataset
        A run with gaps along the rails.
    compare : xarray.Dataset, optional
        A second run of the same panel, dashed, such as the one without an object.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; default a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        Gap [mm] over x [m].
    """
    sheet = shape_sheet(dataset, compare=compare)
    return draw_row(sheet, sheet.rows[0], ax=ax)


def plot_gap(dataset: xr.Dataset, *, ax: "Axes | None" = None) -> "Axes":
    """Draw the gap along the closing rail at several instants.

    Parameters
    ----------
    dataset : xarray.Dataset
        A run with gaps along the rails.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; default a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        Gap [mm] over x [m]; later instants are darker.
    """
    sheet = gap_sheet(dataset)
    return draw_row(sheet, sheet.rows[0], ax=ax)


def plot_chair_load(dataset: xr.Dataset, *, ax: "Axes | None" = None) -> "Axes":
    """Draw the largest load of each slide chair in the last movement.

    Parameters
    ----------
    dataset : xarray.Dataset
        A run with chair forces.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; default a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        Normal force [kN] over x [m].
    """
    sheet = chair_sheet(dataset)
    return draw_row(sheet, sheet.rows[0], ax=ax)


def plot_energy(dataset: xr.Dataset, *, ax: "Axes | None" = None) -> "Axes":
    """Draw the work of the drives and the energies that it goes into.

    Parameters
    ----------
    dataset : xarray.Dataset
        A simulated run with energies.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; default a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        Work and energies [J] over time [s].
    """
    return _row_of(energy_sheet(dataset), "Energy [J]", ax)


def _row_of(sheet: Sheet, label: str, ax: "Axes | None") -> "Axes":
    """Draw the row whose label begins so."""
    for row in sheet.rows:
        if row.label.startswith(label):
            return draw_row(sheet, row, ax=ax)
    message = f"nothing to draw: the dataset has no {label.lower().partition(' [')[0]}"
    raise ResponseError(message)
