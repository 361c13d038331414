"""The gap along the rails of a panel when they lie closed, with the limits that it must keep."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from turnout.metric.movement import settled
from turnout.panel.layout import resting_gap
from turnout.panel.model import Panel
from turnout.plot.style import COLOURS, DASHES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

POINTS = 200
MILLI = 1e3


def plot_closed_gap(panel: Panel, *, dataset: xr.Dataset | None = None, ax: "Axes") -> "Axes":
    """Draw the gap along each rail when it lies closed, and the limits of sensors and lock.

    Parameters
    ----------
    panel : Panel
        The panel.
    dataset : xarray.Dataset, optional
        A throw of it; without one, or one without an instant, gaps are estimated from the strokes.
    ax : matplotlib.axes.Axes
        Where to draw.

    Returns
    -------
    matplotlib.axes.Axes
        The same.
    """
    simulated = dataset is not None and dataset.sizes["time"] > 0
    for number, (name, rail) in enumerate(panel.rail.items()):
        if not rail.has_stock_rail:
            continue
        if dataset is None or not simulated:
            x = np.linspace(rail.start, rail.end, POINTS)
            gap = resting_gap(panel, name, x, closed=True)
        else:
            closed = settled(dataset, to="closed" if rail.closes == "+y" else "open")
            x, gap = dataset["x"].values, closed["gap"].sel(rail=name).values
        if gap is None:
            continue
        ax.plot(
            x, MILLI * gap, color=COLOURS[number], linestyle=DASHES[number], label=f"rail {name}"
        )
    for number, (name, sensor) in enumerate(panel.sensor.items()):
        ax.plot(
            [sensor.x],
            [MILLI * sensor.limit],
            marker="v",
            color=COLOURS[2],
            linestyle="none",
            label="limit of TKK" if number == 0 else "_",
        )
        ax.annotate(
            name, (sensor.x, MILLI * sensor.limit), xytext=(6, 0), textcoords="offset points",
            va="center", fontsize=8,
        )  # fmt: skip
    limits = panel.gap_limits()
    for number, (name, drive) in enumerate(panel.drive.items()):
        ax.plot(
            [drive.x],
            [MILLI * limits[name]],
            marker="s",
            color=COLOURS[5],
            markeredgecolor="black",
            linestyle="none",
            label="gap limit of lock" if number == 0 else "_",
        )
    how = (
        "simulated"
        if dataset is not None and dataset.sizes["time"]
        else "estimated from the strokes"
    )
    ax.set_ylabel(f"Gap when closed [mm]\n({how})")
    ax.set_xlabel("x from the toe [m]")
    ax.set_ylim(bottom=min(0.0, ax.get_ylim()[0]))
    ax.grid(visible=True, color="0.85", linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(loc="best", ncols=2, frameon=False, fontsize=8)
    return ax
