"""Figures of a campaign: channels over time by object size at one place, and places against sizes.

Channels of a campaign over time, a line for each object size at one place, as a sheet. A campaign:
channels over time by object size at one place, and places against sizes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from turnout.core.errors import ResponseError
from turnout.figures.along_rail_sheet import shade_of
from turnout.figures.sheet import Line, Row, Sheet
from turnout.figures.style import GREY, new_figure, put_title, styled
from turnout.metric.campaign_statistics import end_values, object_places

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


KILO, MILLI = 1e-3, 1e3
NO_OBJECT = "#000000"


@dataclass(frozen=True, slots=True)
class ChannelRow:
    """One of the stacked axes: its label, its channel (movement, time) and its scale."""

    label: str
    channel: xr.DataArray
    factor: float


def plot_stacked(dataset: xr.Dataset, *, place: str, direction: str = "closing") -> "Figure":
    """Draw every channel over time, a line for each object size at one place.

    This is the form of figure 5 of the published measurements.

    Parameters
    ----------
    dataset : xarray.Dataset
        Dimensions movement and time, measured or simulated; channels that it lacks are left out.
    place : str
        Such as "sleeper 6". Throws without an object are drawn in black, whatever their place.
    direction : str
        "closing" or "opening".

    Returns
    -------
    matplotlib.figure.Figure
        Object force [kN], currents [A], drive forces [kN] over the time since the onset [s].

    Raises
    ------
    ResponseError
        When nothing was thrown at that place.
    """
    chosen = chosen_movements(dataset, place=place, direction=direction)
    rows = campaign_channels(chosen)
    if not rows:
        message = "nothing to draw: the dataset has no forces and no currents"
        raise ResponseError(message)
    sizes = chosen["size"].values
    span = shown_span(chosen, rows)
    figure, axes = new_figure(len(rows))
    for ax, row in zip(axes, rows, strict=True):
        for number, size in enumerate(sizes):
            values = row.channel.isel(movement=number).values * row.factor
            ax.plot(
                chosen["time"].values,
                values,
                color=size_colour(float(size), sizes),
                linewidth=1.5 if size == 0 else 1.1,
                linestyle="-" if not _slipped(chosen, number) else (0, (5, 1.2)),
                label=size_label(chosen, number),
                zorder=3 if size == 0 else 2,
            )
        styled(ax, row.label, span=span)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside right upper", frameon=False, title="Object size", fontsize=9
    )
    axes[-1].set_xlabel("Time since onset of motion [s]")
    figure.align_ylabels(axes)
    put_title(figure, campaign_title(dataset, f"{direction}, object at {place}"))
    return figure


def plot_overview(dataset: xr.Dataset, *, direction: str = "closing") -> "Figure":
    """Draw places against sizes: the force of each channel at the end of the throw.

    Parameters
    ----------
    dataset : xarray.Dataset
        Dimensions movement and time, measured or simulated.
    direction : str
        "closing" or "opening".

    Returns
    -------
    matplotlib.figure.Figure
        A table for each drive and for the object, coloured by force and written in kN. Where a
        drive slipped the figure is framed; repeats are averaged; an empty place was not thrown.
    """
    kept = dataset.isel(movement=np.flatnonzero(dataset["direction"].values == direction))
    tables = [
        (row.label.replace("\n", " "), row.channel * row.factor)
        for row in campaign_channels(kept)
        if row.factor == KILO
    ]
    if not kept.sizes["movement"] or not tables:
        message = f"nothing to draw: no {direction} movement with forces"
        raise ResponseError(message)
    without = ["none"] if (kept["size"].values == 0).any() else []
    places = [*without, *object_places(kept)]
    sizes = np.unique(kept["size"].values)
    figure, axes = _table_figure(len(tables), rows=len(places), columns=sizes.size)
    for number, (ax, (label, channel)) in enumerate(zip(axes, tables, strict=True)):
        _table(ax, kept, channel, places=places, sizes=sizes)
        ax.set_title(label, fontsize=10)
        ax.set_xlabel("Object size [mm]")
        ax.tick_params(labelleft=number == 0)
    text = f"{direction}: force at the end of the throw, framed where a drive slipped"
    put_title(figure, campaign_title(dataset, text))
    return figure


def chosen_movements(dataset: xr.Dataset, *, place: str, direction: str) -> xr.Dataset:
    """Return one movement a size at a place, the smallest object first."""
    going = dataset["direction"].values == direction
    here = going & (dataset["place"].values == place) & (dataset["size"].values > 0)
    if not here.any():
        places = ", ".join(object_places(dataset)) or "no place at all"
        message = f"no {direction} movement with an object at '{place}'; there are {places}"
        raise ResponseError(message)
    free = going & (dataset["size"].values == 0)
    at_place = free & (dataset["place"].values == place)
    wanted = np.flatnonzero(here | (at_place if at_place.any() else free))
    first: dict[float, int] = {}
    for number in wanted:
        first.setdefault(float(dataset["size"].values[number]), int(number))
    return dataset.isel(movement=[first[size] for size in sorted(first)])


def campaign_channels(dataset: xr.Dataset) -> list[ChannelRow]:
    """Return forces, currents and powers of a campaign, each with label and scale of its axes."""
    rows = []
    if "object_force" in dataset and np.isfinite(dataset["object_force"].values).any():
        rows.append(ChannelRow("Object\nforce [kN]", dataset["object_force"], KILO))
    for name, label, factor in (
        ("drive_current", "current [A]", 1.0),
        ("drive_power", "power [W]", 1.0),
        ("drive_force", "force [kN]", KILO),
    ):
        if name in dataset:
            rows += [
                ChannelRow(f"Drive {drive}\n{label}", dataset[name].sel(drive=drive), factor)
                for drive in dataset["drive"].values
                if np.isfinite(dataset[name].sel(drive=drive).values).any()
            ]
    return rows


def shown_span(dataset: xr.Dataset, rows: Sequence[ChannelRow]) -> tuple[float, float]:
    """Return the time to show: until half a second after the last rail without slip has stopped."""
    time = dataset["time"].values
    known = np.isfinite(rows[-1].channel.values)
    ends = [time[np.flatnonzero(row)[-1]] for row in known if row.any()]
    slipped = [_slipped(dataset, number) for number in range(dataset.sizes["movement"])]
    settled = [end for end, slips in zip(ends, slipped, strict=False) if not slips]
    last = float(max(settled or ends))
    return max(-0.5, float(time[0])), last


def _slipped(dataset: xr.Dataset, number: int) -> bool:
    return "slipped" in dataset.coords and bool(dataset["slipped"].values[number])


def size_label(dataset: xr.Dataset, number: int) -> str:
    """Return the size of a movement's object for a legend, marked if a drive slipped on it."""
    size = float(dataset["size"].values[number])
    text = "none" if size == 0 else f"{size * MILLI:g} mm"
    return f"{text} (slips)" if _slipped(dataset, number) else text


def size_colour(size: float, sizes: np.ndarray) -> str | tuple[float, float, float, float]:
    """Return black without an object, else a colour that grows with the size."""
    if size == 0:
        return NO_OBJECT
    from matplotlib import colormaps

    objects = np.sort(sizes[sizes > 0])
    share = float(np.searchsorted(objects, size)) / max(1, objects.size - 1)
    red, green, blue, alpha = colormaps["plasma"](0.9 * (1.0 - share))
    return (red, green, blue, alpha)


def campaign_title(dataset: xr.Dataset, text: str) -> str:
    """Return the name of a campaign, marked if synthetic, above the text of a figure."""
    name = str(dataset.attrs.get("title", "campaign"))
    origin = " (synthetic)" if dataset.attrs.get("synthetic") else ""
    return f"{name}{origin}\n{text}"


def _table_figure(count: int, *, rows: int, columns: int) -> "tuple[Figure, list[Axes]]":
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    size = (1.6 + count * (0.6 + 0.36 * columns), 1.8 + 0.3 * rows)
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, count, squeeze=False, sharey=True)
    return figure, list(axes[0])


def _table(
    ax: "Axes",
    dataset: xr.Dataset,
    channel: xr.DataArray,
    *,
    places: Sequence[str],
    sizes: np.ndarray,
) -> None:
    from matplotlib.patches import Rectangle

    ends = end_values(channel)
    cells = np.full((len(places), sizes.size), np.nan)
    for line, place in enumerate(places):
        for column, size in enumerate(sizes):
            same = (dataset["place"].values == place) & (dataset["size"].values == size)
            known = ends[same][np.isfinite(ends[same])]
            if known.size:
                cells[line, column] = known.mean()
            if known.size and any(_slipped(dataset, int(at)) for at in np.flatnonzero(same)):
                frame = Rectangle(
                    (column - 0.5, line - 0.5),
                    1,
                    1,
                    fill=False,
                    edgecolor="black",
                    linewidth=1.8,
                    zorder=4,
                )
                ax.add_patch(frame)
    ax.imshow(
        cells,
        cmap="YlOrRd",
        vmin=0.0,
        vmax=max(1.0, float(np.nanmax(cells, initial=0.0))),
        aspect="auto",
    )
    top = max(1.0, float(np.nanmax(cells, initial=0.0)))
    for (line, column), value in np.ndenumerate(cells):
        if np.isfinite(value):
            colour = "white" if value > 0.65 * top else "black"
            ax.text(
                column, line, f"{value:.1f}", ha="center", va="center", fontsize=7, color=colour
            )
    ax.set_xticks(range(sizes.size), [f"{size * MILLI:g}" for size in sizes], fontsize=8)
    ax.set_yticks(range(len(places)), ["no object" if p == "none" else p for p in places])
    ax.tick_params(length=0)
    ax.set_facecolor("0.95")
    for spine in ax.spines.values():
        spine.set_color(GREY)


INK = 6


def stacked_sheet(dataset: xr.Dataset, *, place: str, direction: str) -> Sheet:
    """Return the figure of `plot_stacked` as plain data.

    Parameters
    ----------
    dataset : xarray.Dataset
        Dimensions movement and time, measured or simulated.
    place : str
        Such as "sleeper 6".
    direction : str
        "closing" or "opening".

    Raises
    ------
    ResponseError
        When nothing was thrown at that place, or nothing was measured.
    """
    chosen = chosen_movements(dataset, place=place, direction=direction)
    rows = campaign_channels(chosen)
    if not rows:
        message = "nothing to draw: the dataset has no forces and no currents"
        raise ResponseError(message)
    first, last = shown_span(chosen, rows)
    time = chosen["time"].values
    within = (time >= first) & (time <= last)
    sizes = chosen["size"].values
    objects = np.sort(sizes[sizes > 0])

    def line(number: int, values: np.ndarray) -> Line:
        size = float(sizes[number])
        share = float(np.searchsorted(objects, size)) / max(1, objects.size - 1)
        return Line(
            label=size_label(chosen, number),
            x=time[within],
            y=values[within],
            colour=INK if size == 0 else shade_of(share),
            width=1.5 if size == 0 else 1.1,
        )

    return Sheet(
        name=f"{place.replace(' ', '-')}-{direction}",
        title=f"Object at {place}, {direction}",
        caption="A line for each object size; black without an object. Time from the onset "
        "of motion.",
        x_label="Time since onset of motion [s]",
        one_legend=True,
        rows=tuple(
            Row(
                row.label,
                tuple(
                    line(number, row.channel.isel(movement=number).values * row.factor)
                    for number in range(sizes.size)
                    if np.isfinite(row.channel.isel(movement=number).values).any()
                ),
            )
            for row in rows
        ),
    )
