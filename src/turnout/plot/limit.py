"""The blind-zone map: probability of detection along the blade, size upwards."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from turnout.plot.style import GREY

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEVELS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)


def plot_limit(dataset: xr.Dataset, *, channel: str = "both drives") -> "Figure":
    """Draw the map of a dataset of `turnout limit`; below the touch floor nothing can be seen.

    Parameters
    ----------
    dataset : xarray.Dataset
        With pod, a90 and touch_floor.
    channel : str
        Which forces.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    at = dataset.sel(channel=channel)
    x, size = at["x"].to_numpy(), 1e3 * at["size"].to_numpy()
    floor, largest = 1e3 * at["touch_floor"].to_numpy(), 1e3 * at["largest_size"].to_numpy()
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    ax = figure.subplots()
    top = float(np.ceil(max(floor.max() * 2.0, np.nanmax(1e3 * at["a90"].fillna(0.0)) * 1.25)))
    drawn = ax.contourf(x, size, at["pod"].to_numpy().T, levels=LEVELS, cmap="RdYlGn")
    if np.any(largest < top):
        ax.fill_between(
            x, largest, max(top, float(largest.max())), facecolor="0.94", edgecolor="0.7",
            linewidth=0.8, label="not thrown",
        )  # fmt: skip
    ax.fill_between(
        x, 0.0, floor, facecolor="white", edgecolor=GREY, hatch="///", linewidth=0.8,
        label="not touched in 1 of 10 states or more",
    )  # fmt: skip
    low, high = (1e3 * at[name].to_numpy() for name in ("a90_low", "a90_high"))
    ax.plot(x, 1e3 * at["a90"], "o-", color="black", markersize=4, label="a90, 95 % over states")
    ax.vlines(x, low, high, color="black", linewidth=1.0)
    if "known_a90" in dataset and channel == "both drives":
        ax.plot(
            x, 1e3 * dataset["known_a90"], "s--", color="black", markersize=4, linewidth=1.0,
            markerfacecolor="white", label="a90 if only the place is known",
        )  # fmt: skip
    ax.set_xlim(float(x.min()), float(x.max()))
    ax.set_ylim(0.0, top)
    ax.set_xlabel("Position from the toe [m]")
    ax.set_ylabel("Object size [mm]")
    names = [
        str(place).replace("sleeper ", "").replace("drive ", "D") for place in at["place"].values
    ]
    above = ax.secondary_xaxis("top")
    above.set_xticks(x, names, fontsize=8)
    above.tick_params(length=2)
    above.set_xlabel("Sleeper, drive", fontsize=8)
    bar = figure.colorbar(drawn, ax=ax, ticks=LEVELS, label="Probability of detection (bound) [-]")
    bar.outline.set_visible(False)
    ax.legend(loc="upper right", fontsize=8, framealpha=0.9)
    said = dataset.attrs
    figure.suptitle(
        f"Best detection by {said.get('quantities', 'force')}, {channel}: discrepancy "
        f"{100 * said['discrepancy']:g} %, "
        f"{said['history']} throws known, false-alarm rate {said['false_alarm_rate']:g}"
        + (f", {kind}" if (kind := said.get("object_kind", "spring")) != "spring" else ""),
        fontsize=10,
    )
    return figure


def plot_bands(dataset: xr.Dataset) -> "Figure":
    """Draw the bands of a90 over panels along the blade.

    Parameters
    ----------
    dataset : xarray.Dataset
        With a90 over panel and place, and a90_band with its interval over share and place.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    ax = figure.subplots()
    x, band = dataset["x"].to_numpy(), 1e3 * dataset["a90_band"].to_numpy()
    each = 1e3 * dataset["a90"].to_numpy()
    names = [str(name) for name in dataset["panel"].to_numpy()]
    few = len(names) <= FEW
    for name, row in zip(names, each, strict=True):
        label = name if few else None
        ax.plot(x, row, color=None if few else "0.75", linewidth=0.8, label=label)
    ax.fill_between(x, band[0], band[-1], color="0.9", zorder=0, label="90 % of the panels")
    label = "middle, 95 % over drawn states"
    middle = len(band) // 2
    ends = [1e3 * dataset[f"a90_band_{end}"].to_numpy()[middle] for end in ("low", "high")]
    ax.plot(x, band[middle], "o-", color="black", markersize=4, label=label)
    ax.vlines(x, *ends, color="black", linewidth=1.0)
    ax.set_ylim(bottom=0.0)
    ax.set_xlabel("Position from the toe [m]")
    ax.set_ylabel("a90 of the bound [mm]")
    ax.grid(visible=True, color="0.88", linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(fontsize=8)
    figure.suptitle(f"Smallest object that can be seen, {len(names)} panels", fontsize=10)
    return figure


FEW = 8
"""Panels that are named in the figure of bands."""
