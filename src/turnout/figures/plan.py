"""A panel in plan, and the gap along its closed rails.

The gap along the rails of a panel when they lie closed, with the limits that it must keep. A panel
in plan: rails, supports, drives, links, sensors, and the gap along the closed rails.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import xarray as xr
from numpy.typing import NDArray

from turnout.figures.style import COLOURS, DASHES, GREY, MILLI, SHADE, put_title
from turnout.mechanism.rest import RailLine, rail_line, resting_gap
from turnout.panel.layout import extent, stands_at
from turnout.panel.model import Panel
from turnout.panel.records import Placed
from turnout.throw.slip import last_instant_at

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


POINTS = 200


def plot_closed_gap(panel: Panel, *, dataset: xr.Dataset | None = None, ax: "Axes") -> "Axes":
    """Draw the gap along each rail when it lies closed, and the limits of sensors and lock.

    Parameters
    ----------
    panel : Panel
        Checked panel; its layout is drawn in metres.
    dataset : xarray.Dataset, optional
        A throw of it; without one, or one without an instant, gaps are estimated from the strokes.
    ax : matplotlib.axes.Axes
        Axes to draw on.

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
            closed = last_instant_at(dataset, to="closed" if rail.closes == "+y" else "open")
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


# The lateral scale is this many times the longitudinal one.
EXAGGERATION = 8
# Between the two stock rails the track is drawn this wide [m]; its true width changes nothing.
TRACK = 0.8
# Free strips beside the stock rails for what stands there, and at both ends [m].
BEYOND, MARGIN = 0.24, 0.5
# The rod of a back drive runs along the track so far from its rail [m].
ASIDE = 0.1
PLAN_WIDTH, GAP_HEIGHT = 12.0, 1.7  # inches


def plot_plan(panel: Panel, *, dataset: xr.Dataset | None = None) -> "Figure":
    """Draw a panel from above, and below it the gap along each rail when it lies closed.

    Parameters
    ----------
    panel : Panel
        Checked panel; its layout is drawn in metres.
    dataset : xarray.Dataset, optional
        A throw of it without an object: the closed gaps are taken from it. Otherwise they are
        estimated from the strokes.

    Returns
    -------
    matplotlib.figure.Figure
        Running edges are where their formula puts them, lateral distances `EXAGGERATION` times
        larger than along the track; the track between the two stock rails is drawn narrower.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    start, end = extent(panel)
    lines = {
        name: rail_line(panel, name, np.linspace(rail.start, rail.end, POINTS))
        for name, rail in panel.rail.items()
    }
    low, high = _span(panel, lines)
    height = PLAN_WIDTH * EXAGGERATION * (high - low) / (end - start + 2 * MARGIN)
    figure = Figure(figsize=(12.5, height + GAP_HEIGHT + 1.4), layout="constrained")
    FigureCanvasAgg(figure)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(height, GAP_HEIGHT))
    _sleepers(top, panel, (low, high))
    for name, line in lines.items():
        _rails(top, panel, line)
        _supports(top, panel, line)
        _sensors(top, panel, name)
    _links(top, panel)
    _back_drives(top, panel)
    _drives(top, panel)
    _frame(top, (start - MARGIN, end + MARGIN), (low, high))
    plot_closed_gap(panel, dataset=dataset, ax=bottom)
    handles, labels = top.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=6, frameon=False, fontsize=8)
    put_title(figure, _title(panel))
    return figure


def _title(panel: Panel) -> str:
    title = f"{panel.name}: plan, lateral scale {EXAGGERATION} times that along the track"
    known = [rail for rail in panel.rail.values() if rail.running_edge is not None]
    if len(panel.rail) > 1:
        title += "; the track between is drawn narrower"
    return title if known else f"{title}; no running edge given, rails drawn parallel"


def _base(line: RailLine) -> float:
    """Return the lateral place of a stock rail's base line in the drawing [m]."""
    return 0.5 * line.side * TRACK


def _at(panel: Panel, rail: str, x: float) -> tuple[float, float, float]:
    """Return stock rail, closed and open running edge of a rail at one place in the drawing."""
    line = rail_line(panel, rail, [x])
    base = _base(line)
    edges = (line.stock_edge, line.closed_edge, line.open_edge)
    return tuple(float(edge[0]) + base for edge in edges)  # type: ignore[return-value]


def _label(ax: "Axes", text: str) -> str:
    """Return a legend text the first time only."""
    return text if text not in ax.get_legend_handles_labels()[1] else "_"


def _rails(ax: "Axes", panel: Panel, line: RailLine) -> None:
    """Draw the heads of a stock rail and of its switch rail, closed (filled) and open (outline)."""
    base, side = _base(line), line.side
    width = panel.rail[line.rail].head_width or 0.0
    if panel.rail[line.rail].has_stock_rail:
        x = _along_stock_rail(panel, line)
        edge = base + _stock_edge(panel, line, x)
        ax.fill_between(
            x,
            edge,
            edge + side * width,
            color="0.55",
            linewidth=0.8,
            label=_label(ax, "Stock rail"),
            zorder=3,
        )
    colour = COLOURS[0]
    closed, opened = base + line.closed_edge, base + line.open_edge
    ax.fill_between(
        line.x,
        closed,
        closed + side * line.width,
        color=colour,
        linewidth=0.8,
        label=_label(ax, "Switch rail closed"),
        zorder=4,
    )
    ax.plot(
        line.x,
        opened,
        color=colour,
        linestyle=DASHES[1],
        linewidth=1.1,
        label=_label(ax, "Running edge open (estimate)"),
        zorder=4,
    )
    ax.annotate(
        f"switch rail {line.rail}",
        xy=(line.x[-1], closed[-1]),
        xytext=(0, -8 * side),
        textcoords="offset points",
        ha="right",
        va="top" if side > 0 else "bottom",
        fontsize=8,
        color=colour,
    )


def _stock_edge(panel: Panel, line: RailLine, x: npt.ArrayLike) -> NDArray[np.float64]:
    """Return the running edge of a stock rail, straight ahead of the toe [m]."""
    places = np.asarray(x, dtype=np.float64)
    return rail_line(panel, line.rail, np.maximum(places, line.x[0])).stock_edge


def _along_stock_rail(panel: Panel, line: RailLine) -> NDArray[np.float64]:
    """Return places along the stock rail of a rail: its own length, or at least the rail's [m]."""
    own = [stock for stock in panel.stock_rail.values() if stock.faces == line.rail]
    first = min([line.x[0], *(stock.start for stock in own)])
    last = max([line.x[-1], *(stock.end for stock in own)])
    return np.unique(np.append(np.linspace(first, last, POINTS), [line.x[0], line.x[-1]]))


def _sleepers(ax: "Axes", panel: Panel, span: tuple[float, float]) -> None:
    """Draw a bar at every sleeper, chair and fastening; number the named sleepers."""
    families: Iterable[Iterable[Placed]] = (
        panel.sleeper.values(),
        panel.chair.values(),
        panel.fastening.values(),
        panel.stock_fastening.values(),
    )
    places = np.unique(np.round([item.x for family in families for item in family], 6))
    low, high = span
    for number, x in enumerate(places):
        label = "Sleeper" if number == 0 else "_"
        ax.fill_between(
            [x - 0.12, x + 0.12], low, high, color=SHADE, linewidth=0, label=label, zorder=0
        )
    for name, sleeper in panel.sleeper.items():
        ax.annotate(name, (sleeper.x, low), ha="center", va="bottom", fontsize=7, color=GREY)


def _span(panel: Panel, lines: dict[str, RailLine]) -> tuple[float, float]:
    """Return the lateral bounds of the drawing [m]; drives and sensors need room beside it."""
    beside = {drive.rail for drive in panel.drive.values()}
    beside |= {name for name in lines for item in panel.sensor.values() if stands_at(item, name)}
    edges = [
        _base(line) + edge + line.side * (BEYOND if line.rail in beside else 0.5 * BEYOND)
        for line in lines.values()
        for edge in (line.stock_edge, line.closed_edge)
    ]
    edges += [
        _base(line) + _stock_edge(panel, line, _along_stock_rail(panel, line))
        + line.side * 0.5 * BEYOND
        for line in lines.values()
    ]  # fmt: skip
    values = np.concatenate(edges)
    values = np.append(values, [_base(line) + line.open_edge.min() for line in lines.values()])
    return float(values.min()) - 0.04, float(values.max()) + 0.04


def _supports(ax: "Axes", panel: Panel, line: RailLine) -> None:
    """Mark chairs below the rail's way, fastenings on it, stops and studs at the stock rail."""
    for chair in panel.chair.values():
        if stands_at(chair, line.rail):
            _, closed, opened = _at(panel, line.rail, chair.x)
            low, high = sorted((closed + line.side * 0.03, opened - line.side * 0.03))
            ax.fill_between(
                [chair.x - 0.09, chair.x + 0.09],
                low,
                high,
                color="0.75",
                linewidth=0,
                label=_label(ax, "Slide chair"),
                zorder=1,
            )
    _stock_fastenings(ax, panel, line)
    marks = (
        (panel.fastening, "x", "black", "Fastening", 1),
        (panel.stop, "|", COLOURS[1], "Stop (close fit)", 0),
        (panel.stud, "D", COLOURS[1], "Stud", 0),
    )
    for family, marker, colour, label, which in marks:
        places = [item.x for item in family.values() if stands_at(item, line.rail)]
        if not places:
            continue
        ax.plot(
            places,
            [_at(panel, line.rail, x)[which] for x in places],
            marker=marker,
            markersize=5,
            color=colour,
            linestyle="none",
            label=_label(ax, label),
            zorder=6,
        )


def _stock_fastenings(ax: "Axes", panel: Panel, line: RailLine) -> None:
    """Mark the fastenings of a stock rail that bends, in the middle of its head."""
    for name, stock in panel.stock_rail.items():
        if stock.faces != line.rail:
            continue
        places = [item.x for item in panel.stock_fastening.values() if stands_at(item, name)]
        edge = _base(line) + _stock_edge(panel, line, places)
        middle = edge + 0.5 * line.side * (panel.rail[line.rail].head_width or 0.0)
        ax.plot(
            places,
            middle,
            marker="x",
            markersize=4,
            color="white",
            linestyle="none",
            label="_stock fastening",
            zorder=6,
        )


def _sensors(ax: "Axes", panel: Panel, rail: str) -> None:
    for name, sensor in panel.sensor.items():
        if not stands_at(sensor, rail):
            continue
        stock, _, _ = _at(panel, rail, sensor.x)
        side = 1.0 if panel.rail[rail].closes == "+y" else -1.0
        y = stock + side * 0.5 * BEYOND
        ax.plot(
            [sensor.x],
            [y],
            marker="v" if side > 0 else "^",
            color=COLOURS[2],
            markersize=8,
            linestyle="none",
            label=_label(ax, "TKK"),
            zorder=6,
        )
        ax.annotate(
            name, (sensor.x, y), xytext=(7, 0), textcoords="offset points", fontsize=8, va="center"
        )


def _links(ax: "Axes", panel: Panel) -> None:
    for link in panel.link.values():
        ends = [_at(panel, rail, link.x)[1] for rail in link.rails]
        ax.plot(
            [link.x, link.x],
            ends,
            color=COLOURS[3],
            linewidth=3,
            label=_label(ax, "Link"),
            zorder=2,
        )


def _back_drives(ax: "Axes", panel: Panel) -> None:
    """Draw the linkage from the place of its drive to the rails that it moves."""
    for name, back in panel.back_drive.items():
        rails = list(panel.rail) if back.rails is None else back.rails
        ends = [_at(panel, rail, back.x)[1] for rail in rails]
        drive = panel.drive[back.drive]
        side = 1.0 if panel.rail[drive.rail].closes == "+y" else -1.0
        begin = _at(panel, drive.rail, drive.x)[1]
        rod = begin - side * ASIDE
        ends.append(rod)
        x, y = [drive.x, drive.x, back.x], [begin, rod, rod]
        colour = COLOURS[4]
        ax.plot(x, y, color=colour, linewidth=2, label=_label(ax, "Back drive"), zorder=2)
        ax.plot([back.x, back.x], [min(ends), max(ends)], color=colour, linewidth=2, zorder=2)
        ax.annotate(
            f"Back drive {name}", (back.x, rod), xytext=(5, 0), textcoords="offset points",
            va="center", fontsize=8,
        )  # fmt: skip


def _drives(ax: "Axes", panel: Panel) -> None:
    """Draw a drive outside the stock rail of its rail, and its rod."""
    for name, drive in panel.drive.items():
        side = 1.0 if panel.rail[drive.rail].closes == "+y" else -1.0
        stock, closed, _ = _at(panel, drive.rail, drive.x)
        far = stock + side * 0.75 * BEYOND
        ax.plot([drive.x, drive.x], [far, closed], color="black", linewidth=1.2, zorder=2.5)
        ax.plot([drive.x], [closed], marker="o", markersize=4, color="black", zorder=6)
        ax.plot(
            [drive.x],
            [far],
            marker="s",
            markersize=11,
            color=COLOURS[5],
            markeredgecolor="black",
            linestyle="none",
            label=_label(ax, "Drive"),
            zorder=6,
        )
        ax.annotate(
            f"Drive {name}, {MILLI * drive.stroke:g} mm",
            (drive.x, far),
            xytext=(9, 0),
            textcoords="offset points",
            va="center",
            fontsize=8,
        )


def _frame(ax: "Axes", along: tuple[float, float], across: tuple[float, float]) -> None:
    ax.set_xlim(*along)
    ax.set_ylim(*across)
    ax.set_aspect(EXAGGERATION)
    ax.set_ylabel("across the track")
    ax.set_yticks([])
    ax.spines[["top", "right", "left"]].set_visible(False)
    ax.tick_params(labelbottom=False)
    end = along[1] - 0.1
    ax.plot([end, end], [-0.05, 0.05], color="black", linewidth=2)
    ax.annotate(
        "100 mm",
        (end, 0.0),
        xytext=(-4, 0),
        textcoords="offset points",
        ha="right",
        va="center",
        fontsize=8,
    )
