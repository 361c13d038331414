"""Values with their intervals, relative to where they started."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from turnout.errors import ResponseError
from turnout.plot.style import COLOURS, GREY, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PERCENT = 100.0


def plot_intervals(dataset: xr.Dataset, *, ax: "Axes | None" = None) -> "Axes":
    """Draw fitted parameters with their 95 % intervals, relative to their start values.

    Parameters
    ----------
    dataset : xarray.Dataset
        `value`, `low`, `high` and `start` by parameter, in SI.
    ax : matplotlib.axes.Axes, optional
        Where to draw; default a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        A line a parameter; the dotted line is the start.

    Raises
    ------
    ResponseError
        When there is no parameter.

    Examples
    --------
    >>> rows = {"value": 0.31, "low": 0.3, "high": 0.32, "start": 0.3}
    >>> known = xr.Dataset({name: ("parameter", [value]) for name, value in rows.items()})
    >>> plot_intervals(known.assign_coords(parameter=["friction"])).get_xlabel()
    'Change from the start value [%]'
    """
    count = dataset.sizes["parameter"]
    if not count:
        message = "nothing to draw: no parameter was fitted"
        raise ResponseError(message)
    if ax is None:
        figure, (ax,) = new_figure(1)
        figure.set_figheight(1.2 + 0.35 * count)
    start = dataset["start"].to_numpy()
    scale = np.where(start != 0, abs(start), abs(dataset["value"].to_numpy()))
    value, low, high = (
        PERCENT * (dataset[name].to_numpy() - start) / scale for name in ("value", "low", "high")
    )
    places = -np.arange(count, dtype=float)
    ax.errorbar(
        value, places, xerr=(value - low, high - value), fmt="o", color=COLOURS[0], capsize=4
    )
    ax.axvline(0.0, color=GREY, linewidth=0.8, linestyle=":")
    ax.set_yticks(places, [str(name) for name in dataset["parameter"].values])
    ax.set_ylim(places[-1] - 0.6, 0.6)
    ax.set_xlabel("Change from the start value [%]")
    ax.grid(visible=True, axis="x", color="0.85", linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
    ax.set_title(str(dataset.attrs.get("title", "")), loc="left", fontsize=11)
    return ax
