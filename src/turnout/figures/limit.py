"""The blind-zone map: probability of detection along the blade, size upwards."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from turnout.figures.style import GREY

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

LEVELS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
SHARED_LABEL_LENGTH = 0.015
"""Places closer than this share of the drawn length have one label [-]."""


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
    x, floor = at["x"].to_numpy(), 1e3 * at["touch_floor"].to_numpy()
    a90, largest = 1e3 * at["a90"].to_numpy(), 1e3 * at["largest_size"].to_numpy()
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    ax = figure.subplots()
    seen = np.where(np.isfinite(a90), 1.25 * a90, 1.05 * largest)
    top = float(np.ceil(max(floor.max() * 2.0, seen.max())))
    drawn = _probability(ax, at, top=max(top, float(largest.max())))
    if np.any(largest < top):
        ax.fill_between(
            x, largest, max(top, float(largest.max())), facecolor="0.94", edgecolor="0.7",
            linewidth=0.8, label="not thrown",
        )  # fmt: skip
    ax.fill_between(
        x, 0.0, floor, facecolor="white", edgecolor=GREY, hatch="///", linewidth=0.8,
        label="not touched in 1 of 10 states or more",
    )  # fmt: skip
    _lines(ax, at, known=channel == "both drives")
    if x[0] < x[-1]:
        ax.set_xlim(float(x.min()), float(x.max()))
    ax.set_ylim(0.0, top)
    ax.set_xlabel("Position from the toe [m]")
    ax.set_ylabel("Object size [mm]")
    above = ax.secondary_xaxis("top")
    above.set_xticks(*labels_of(x, [str(place) for place in at["place"].values]), fontsize=8)
    above.tick_params(length=2)
    above.set_xlabel("Sleeper, drive", fontsize=8)
    bar = figure.colorbar(drawn, ax=ax, ticks=LEVELS, label="Probability of detection (bound) [-]")
    bar.outline.set_visible(False)
    ax.legend(loc="upper right", fontsize=8, framealpha=0.9)
    figure.suptitle(_title(dataset, channel), fontsize=10)
    return figure


def level_sizes(at: xr.Dataset) -> "NDArray[np.float64]":
    """Return the size from which on each of `LEVELS` but the last is reached at each place.

    That of 0.9 is a90. A level that is not reached up to the largest size that was thrown has that
    size.

    Parameters
    ----------
    at : xarray.Dataset
        With pod over place and size, and largest_size.

    Returns
    -------
    ndarray, shape (n_levels - 1, n_places)
        [m]
    """
    pod, size = at["pod"].transpose("place", "size").to_numpy(), at["size"].to_numpy()
    from_here_on = np.minimum.accumulate(pod[:, ::-1], axis=1)[:, ::-1]
    sizes = np.append(size, np.inf)
    found = np.array([sizes[np.sum(from_here_on < level, axis=1)] for level in LEVELS[:-1]])
    return np.asarray(np.minimum(found, at["largest_size"].to_numpy()), dtype=np.float64)


def labels_of(x: "NDArray[np.float64]", places: list[str]) -> tuple[list[float], list[str]]:
    """Return positions and short names of places; those that lie together have one label.

    Parameters
    ----------
    x : ndarray, shape (n_places,)
        Rising [m].
    places : list of str
        Such as "drive 1" or "sleeper 3".

    Examples
    --------
    >>> labels_of(np.array([0.3, 0.3, 3.0]), ["drive 1", "drive 2", "sleeper 5"])
    ([0.3, 3.0], ['D1, D2', '5'])
    """
    at: list[float] = []
    names: list[str] = []
    for position, place in zip(x.tolist(), places, strict=True):
        name = place.replace("sleeper ", "").replace("drive ", "D")
        if at and position - at[-1] <= SHARED_LABEL_LENGTH * float(np.ptp(x)):
            names[-1] += f", {name}"
        else:
            at.append(position)
            names.append(name)
    return at, names


def _probability(ax: "Axes", at: xr.Dataset, *, top: float) -> "ScalarMappable":
    """Fill from the size of each level upwards; between places the sizes are interpolated.

    Interpolating the probability itself would bend the edges, since it rises within a fraction of
    what the sizes differ by from place to place.
    """
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import BoundaryNorm, ListedColormap

    ends = np.array(LEVELS)
    colours = colormaps["RdYlGn"]((ends[1:] + ends[:-1]) / 2.0)
    x = at["x"].to_numpy()
    for level, colour, size in zip(LEVELS, colours, 1e3 * level_sizes(at), strict=False):
        ax.fill_between(x, size, top, color=colour, linewidth=0.0, label=f"_{level:g}")
    return ScalarMappable(BoundaryNorm(LEVELS, len(colours)), ListedColormap(colours))


def _lines(ax: "Axes", at: xr.Dataset, *, known: bool) -> None:
    """Draw a90 with its interval, and that of a known place if it is there."""
    x, a90 = at["x"].to_numpy(), 1e3 * at["a90"].to_numpy()
    low, high = (1e3 * at[name].to_numpy() for name in ("a90_low", "a90_high"))
    ax.plot(x, a90, "o-", color="black", markersize=4, label="a90, 95 % over states")
    ax.vlines(x, low, high, color="black", linewidth=1.0)
    if (beyond := np.isnan(a90)).any():
        ax.plot(
            x[beyond], 1e3 * at["largest_size"].to_numpy()[beyond], "^", color="black",
            markersize=6, label="a90 beyond what was thrown",
        )  # fmt: skip
    if "known_a90" in at and known:
        ax.plot(
            x, 1e3 * at["known_a90"], "s--", color="black", markersize=4, linewidth=1.0,
            markerfacecolor="white", label="a90 if only the place is known",
        )  # fmt: skip


def _title(dataset: xr.Dataset, channel: str) -> str:
    said = dataset.attrs
    drives = [name for name in dataset["channel"].values.tolist() if name.startswith("drive ")]
    if len(drives) == 1 and channel == "both drives":
        channel = "its one drive"
    return (
        f"Best detection by {said.get('quantities', 'force')}, {channel}: discrepancy "
        f"{100 * said['discrepancy']:g} %, "
        f"{said['history']} throws known, false-alarm rate {said['false_alarm_rate']:g}"
        + (f", {kind}" if (kind := said.get("object_kind", "spring")) != "spring" else "")
    )


def plot_bands(dataset: xr.Dataset) -> "Figure":
    """Draw the bands of a90 over panels along the blade.

    Parameters
    ----------
    dataset : xarray.Dataset
        With a90 and panel_x over panel and place, and a90_band with its interval over share and
        place. The line of a panel has its places where they are in that panel.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    ax = figure.subplots()
    x, band = dataset["x"].to_numpy(), 1e3 * dataset["a90_band"].to_numpy()
    each = 1e3 * dataset["a90"].to_numpy()
    names = [str(name) for name in dataset["panel"].to_numpy()]
    few = len(names) <= MOST_NAMED_PANELS
    for name, own, values in zip(names, dataset["panel_x"].to_numpy(), each, strict=True):
        label = name if few else None
        along = np.argsort(own, kind="stable")
        at, row = own[along], values[along]
        (line,) = ax.plot(at, row, color=None if few else "0.75", linewidth=0.8, label=label)
        ends = ends_before_gaps(row)
        ax.plot(at[ends], row[ends], "^", color=line.get_color() if few else "0.45", markersize=5)
    beyond = np.isnan(band[-1]) & np.isfinite(band[0])
    top = np.where(beyond, np.nanmax(each, initial=0.0), band[-1])
    label = f"90 % of the panels{', at least, where lines end' if beyond.any() else ''}"
    ax.fill_between(x, band[0], top, color="0.9", zorder=0, label=label)
    label = "middle, 95 % over drawn states"
    middle = len(band) // 2
    interval = [1e3 * dataset[f"a90_band_{end}"].to_numpy()[middle] for end in ("low", "high")]
    ax.plot(x, band[middle], "o-", color="black", markersize=4, label=label)
    ax.vlines(x, *interval, color="black", linewidth=1.0)
    if np.isnan(each).any():
        ax.plot([], [], "^", color="0.45", markersize=5, label="line ends: beyond what was thrown")
    ax.set_ylim(bottom=0.0)
    ax.set_xlabel("Position from the toe [m]")
    ax.set_ylabel("a90 of the bound [mm]")
    ax.grid(visible=True, color="0.88", linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(fontsize=8)
    figure.suptitle(f"Smallest object that can be seen, {len(names)} panels", fontsize=10)
    return figure


def ends_before_gaps(row: "NDArray[np.float64]") -> "NDArray[np.bool_]":
    """Return a mask of the values that have a neighbour that is NaN.

    Parameters
    ----------
    row : ndarray, shape (n,)
        Values in the order in which a line joins them.

    Examples
    --------
    >>> ends_before_gaps(np.array([1.0, 2.0, np.nan, 3.0])).tolist()
    [False, True, False, True]
    """
    gap = np.pad(np.isnan(row), 1)
    return np.asarray(~gap[1:-1] & (gap[:-2] | gap[2:]), dtype=np.bool_)


MOST_NAMED_PANELS = 8
"""Panels that are named in the figure of bands."""
