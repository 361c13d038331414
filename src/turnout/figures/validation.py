"""Figures of a validation: measured and predicted forces with 95 % bands, errors by place."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from turnout.core.errors import ResponseError
from turnout.figures.sheet import Line, Row, Sheet
from turnout.figures.style import COLOURS, FIGURE_SIZE, GREY, put_title, styled
from turnout.metric.agreement import only_fitted
from turnout.metric.campaign_statistics import object_places

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


KILO, MILLI = 1e-3, 1e3
MEASURED = "0.25"
# Errors are multiples of the repeat spread; the colour scale ends at the failure limit.
LARGEST_SHOWN_ERROR = 3.0


def plot_comparison(validation: xr.Dataset, *, place: str, sizes: Sequence[float] = ()) -> "Figure":
    """Draw measured and predicted forces over time, and their difference with the 95 % band.

    The forces are in the form of figure 11 of the published calibration. Below each row is what is
    measured less what is predicted, on a scale of its own.

    Parameters
    ----------
    validation : xarray.Dataset
        `measured`, `predicted`, `low`, `high` (channel, movement, time) [N].
    place : str
        Such as "sleeper 6".
    sizes : sequence of float, optional
        Of the objects [m]; default 13 and 29 mm where they were thrown, else the smallest and the
        largest.

    Returns
    -------
    matplotlib.figure.Figure
        Two rows for each channel over the time since the onset [s]: force and difference [kN].

    Raises
    ------
    ResponseError
        When nothing was thrown at that place.
    """
    chosen = compared_movements(validation, place=place, sizes=sizes)
    rows = [
        name
        for name in validation["channel"].values
        if np.isfinite(chosen["measured"].sel(channel=name).values).any()
    ]
    figure, axes = _paired_figure(len(rows))
    shown = chosen["predicted"].notnull().any(("channel", "movement")).values
    chosen = chosen.isel(time=np.flatnonzero(shown))
    time = chosen["time"].values
    span = (float(time[0]), float(time[-1]))
    for ax, below, name in zip(axes[::2], axes[1::2], rows, strict=True):
        for number in range(chosen.sizes["movement"]):
            one = chosen.sel(channel=name).isel(movement=number)
            _force_lines(ax, one, number)
            _difference_lines(below, one, number)
        styled(ax, f"{str(name).capitalize()}\nforce [kN]", span=span)
        styled(below, "difference\n[kN]", span=span)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right upper", frameon=False, fontsize=9)
    axes[-1].set_xlabel("Time since onset of motion [s]")
    figure.align_ylabels(axes)
    text = f"object at {place}; shaded: band of 95 %\ndifference: measured less predicted"
    put_title(figure, _title(validation, text))
    return figure


def _paired_figure(rows: int) -> "tuple[Figure, list[Axes]]":
    """Return a figure of axes that share time: a high one and a low one for each row."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    wide, high = FIGURE_SIZE
    figure = Figure(figsize=(wide, 1.5 * high * rows + 0.8), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2 * rows, 1, sharex=True, squeeze=False, height_ratios=[2, 1] * rows)
    return figure, list(axes[:, 0])


def _force_lines(ax: "Axes", one: xr.Dataset, number: int) -> None:
    size, time = float(one["size"]), one["time"].values
    colour = COLOURS[number % len(COLOURS)]
    text = f"{size * MILLI:g} mm" if size > 0 else "no object"
    band = (one["low"].values * KILO, one["high"].values * KILO)
    ax.fill_between(time, *band, color=colour, alpha=0.2, linewidth=0)
    ax.plot(time, one["predicted"].values * KILO, color=colour, label=f"predicted, {text}")
    ax.plot(
        time,
        one["measured"].values * KILO,
        color=MEASURED,
        linestyle="-" if number == 0 else (0, (4, 1.5)),
        linewidth=1.0,
        label=f"measured, {text}",
    )


def _difference_lines(ax: "Axes", one: xr.Dataset, number: int) -> None:
    """Draw the difference of measurement less prediction, and the band around zero [kN]."""
    colour, predicted = COLOURS[number % len(COLOURS)], one["predicted"].values
    band = ((one[end].values - predicted) * KILO for end in ("low", "high"))
    ax.fill_between(one["time"].values, *band, color=colour, alpha=0.2, linewidth=0)
    difference = (one["measured"].values - predicted) * KILO
    ax.plot(one["time"].values, difference, color=colour, linewidth=1.0)


def plot_error_map(validation: xr.Dataset) -> "Figure":
    """Draw places against sizes: the error of each channel beside the spread of repeats.

    Parameters
    ----------
    validation : xarray.Dataset
        `rms` (channel, movement) and `repeat_spread` (channel) [N]; `used` (movement).

    Returns
    -------
    matplotlib.figure.Figure
        A table for each channel: RMS difference [N], coloured by its multiple of the repeat spread
        (of the largest error where nothing was repeated). What the fit has used is in brackets,
        unless it is predicted from other places.
    """
    channels = [str(name) for name in validation["channel"].values]
    closing = validation.isel(movement=np.flatnonzero(validation["direction"].values == "closing"))
    sizes = np.unique(closing["size"].values)
    places = (["none"] if (sizes == 0).any() else []) + object_places(closing)
    if not places:
        message = "nothing to draw: no closing movement"
        raise ResponseError(message)
    figure, axes = _tables(len(channels), rows=len(places), columns=sizes.size)
    for number, (ax, name) in enumerate(zip(axes, channels, strict=True)):
        one = closing.sel(channel=name)
        _table(ax, one, places=places, sizes=sizes)
        spread = float(one["repeat_spread"])
        known = f"repeat spread {spread:.0f} N" if np.isfinite(spread) else "nothing repeated"
        ax.set_title(f"{name.capitalize()}, {known}", fontsize=10)
        ax.set_xlabel("Object size [mm]")
        ax.tick_params(labelleft=number == 0)
    brackets = "in brackets: used for the fit; " if only_fitted(closing).any() else ""
    text = (
        "RMS difference of prediction and measurement [N]; red: three repeat spreads or more;"
        f"\n{brackets}framed: a drive slipped"
    )
    put_title(figure, _title(validation, text))
    return figure


def compared_movements(
    validation: xr.Dataset, *, place: str, sizes: Sequence[float] = ()
) -> xr.Dataset:
    """Return the closing movements at a place that are drawn, one for each size.

    Without sizes 13 mm and 29 mm, as in the published figure; where one of them was not thrown,
    the largest or the smallest instead.
    """
    closing = validation["direction"].values == "closing"
    here = np.flatnonzero(closing & (validation["place"].values == place))
    if not here.size:
        known = ", ".join(object_places(validation)) or "no place at all"
        message = f"no closing movement with an object at '{place}'; there are {known}"
        raise ResponseError(message)
    thrown = validation["size"].values[here]
    wanted = list(sizes)
    if not wanted:
        published = [s for s in (0.013, 0.029) if np.isclose(thrown, s).any()]
        first = published[0] if published else float(thrown.min())
        pair = {first, float(thrown.max())}
        wanted = published if len(published) == 2 else sorted(pair | {float(thrown.min())})[-2:]
    found = [int(here[np.argmin(abs(thrown - size))]) for size in wanted]
    return validation.isel(movement=list(dict.fromkeys(found)))


def _table(ax: "Axes", one: xr.Dataset, *, places: Sequence[str], sizes: np.ndarray) -> None:
    from matplotlib.patches import Rectangle

    cells = np.full((len(places), sizes.size), np.nan)
    used = np.zeros(cells.shape, dtype=bool)
    for (line, column), _ in np.ndenumerate(cells):
        same = (one["place"].values == places[line]) & (one["size"].values == sizes[column])
        errors = one["rms"].values[same]
        if np.isfinite(errors).any():
            cells[line, column] = np.sqrt(np.nanmean(errors**2))
            used[line, column] = bool(only_fitted(one)[same].any())
        slipped = "slipped" in one.coords and bool(one["slipped"].values[same].any())
        if slipped and np.isfinite(cells[line, column]):
            frame = Rectangle(
                (column - 0.5, line - 0.5), 1, 1, fill=False, edgecolor="black", linewidth=1.6
            )
            ax.add_patch(frame)
    spread = float(one["repeat_spread"])
    largest = float(np.nanmax(cells, initial=0.0))
    top = LARGEST_SHOWN_ERROR * spread if np.isfinite(spread) and spread > 0 else max(largest, 1e-9)
    ax.imshow(cells, cmap="YlOrRd", vmin=0.0, vmax=top, aspect="auto")
    for (line, column), value in np.ndenumerate(cells):
        if np.isfinite(value):
            text = f"({value:.0f})" if used[line, column] else f"{value:.0f}"
            colour = "white" if value > 0.65 * top else "black"
            ax.text(column, line, text, ha="center", va="center", fontsize=7, color=colour)
    ax.set_xticks(range(sizes.size), [f"{size * MILLI:g}" for size in sizes], fontsize=8)
    ax.set_yticks(range(len(places)), ["no object" if p == "none" else p for p in places])
    ax.tick_params(length=0)
    ax.set_facecolor("0.95")
    for spine in ax.spines.values():
        spine.set_color(GREY)


def _tables(count: int, *, rows: int, columns: int) -> "tuple[Figure, list[Axes]]":
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    size = (max(8.5, 1.8 + count * (0.6 + 0.4 * columns)), 2.2 + 0.3 * rows)
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, list(figure.subplots(1, count, squeeze=False, sharey=True)[0])


def _title(validation: xr.Dataset, text: str) -> str:
    name = str(validation.attrs.get("title", "validation"))
    origin = " (synthetic)" if validation.attrs.get("synthetic") else ""
    return f"{name}{origin}\n{text}"


INK, DASHED, DOTTED = 6, 1, 3


def comparison_sheet(validation: xr.Dataset, *, place: str, sizes: Sequence[float] = ()) -> Sheet:
    """Return the figure of `plot_comparison` as plain data, the ends of a band as dotted lines.

    Parameters
    ----------
    validation : xarray.Dataset
        `measured`, `predicted`, `low`, `high` (channel, movement, time) [N].
    place : str
        Such as "sleeper 6".
    sizes : sequence of float, optional
        Of the objects [m]; default as `plot_comparison`.

    Raises
    ------
    ResponseError
        When nothing was thrown at that place.
    """
    chosen = compared_movements(validation, place=place, sizes=sizes)
    rows = []
    for name in chosen["channel"].values:
        one = chosen.sel(channel=name)
        if np.isfinite(one["measured"].values).any():
            lines = [
                line for number in range(one.sizes["movement"]) for line in _lines(one, number)
            ]
            rows.append(Row(f"{str(name).capitalize()}\nforce [kN]", tuple(lines)))
            apart = [_difference(one, number) for number in range(one.sizes["movement"])]
            rows.append(Row("difference\n[kN]", tuple(apart)))
    return Sheet(
        name=f"compared-{place.replace(' ', '-')}",
        title=f"Object at {place}: measured, and predicted with the band of 95 %",
        caption="Coloured: predicted; dotted: between these 95 % of measurements should lie; "
        "black: measured. Difference: measured less predicted.",
        x_label="Time since onset of motion [s]",
        rows=tuple(rows),
    )


def _name(part: xr.Dataset) -> str:
    size = float(part["size"])
    what = f"{size * MILLI:g} mm" if size > 0 else "no object"
    return what + (" (used for the fit)" if bool(only_fitted(part)) else "")


def _difference(one: xr.Dataset, number: int) -> Line:
    part = one.isel(movement=number)
    y = (part["measured"].values - part["predicted"].values) * KILO
    return Line(label=_name(part), x=part["time"].values, y=y, colour=number, width=1.0)


def _lines(one: xr.Dataset, number: int) -> list[Line]:
    part = one.isel(movement=number)
    what = _name(part)
    time = part["time"].values

    def line(values: str, label: str, *, colour: int, dash: int, width: float = 1.3) -> Line:
        y = part[values].values * KILO
        return Line(label=label, x=time, y=y, colour=colour, dash=dash, width=width)

    found = [line("predicted", f"predicted, {what}", colour=number, dash=0, width=1.6)]
    found += [
        line(end, f"band, {what}: {end}", colour=number, dash=DOTTED, width=0.7)
        for end in ("low", "high")
    ]
    dash = 0 if number == 0 else DASHED
    return [*found, line("measured", f"measured, {what}", colour=INK, dash=dash, width=1.0)]
