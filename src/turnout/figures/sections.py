"""Figures of cross-sections: outlines side by side, and properties along a rail.

Outlines of cross-sections side by side, with centroid and shear centre. Cross-section properties
along a rail: what the beams are made of, station by station.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from turnout.beam.outline import Outline
from turnout.beam.section_record import FloatArray, SectionProperties
from turnout.figures.style import COLOURS, DASHES, GREY, MILLI, SHADE, put_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


MARGIN = 8.0  # mm
PANEL_WIDTH = 2.0  # inches


def plot_section_outlines(
    outlines: Sequence[Outline],
    *,
    titles: Sequence[str],
    properties: SectionProperties | None = None,
    behind: Sequence[Outline] = (),
    columns: int = 5,
) -> "Figure":
    """Draw outlines to one scale, one panel each.

    Parameters
    ----------
    outlines : sequence of Outline, length n
        All in frames with the same origin, such as the running edge.
    titles : sequence of str, length n
    properties : SectionProperties, shape (n,), optional
        Adds the centroid (cross) and the shear centre (ring).
    behind : sequence of Outline, length n, optional
        Outline beside each section, in the same frame, drawn as a thin line.
    columns : int
        Panels in a row.

    Returns
    -------
    matplotlib.figure.Figure
        It is not shown in a window.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    low, high = _limits(outlines)
    across = min(columns, len(outlines))
    rows = -(-len(outlines) // across)
    height = PANEL_WIDTH * (high[1] - low[1]) / (high[0] - low[0])
    figure = Figure(
        figsize=(PANEL_WIDTH * across + 0.7, (height + 0.3) * rows + 0.8), layout="constrained"
    )
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, across, sharex=True, sharey=True, squeeze=False)
    for index, ax in enumerate(grid.flat):
        if index >= len(outlines):
            ax.set_axis_off()
            continue
        if behind:
            _draw(ax, behind[index], face="none", edge="0.6", width=0.7)
        _draw(ax, outlines[index], face=SHADE, edge=COLOURS[0], width=1.2)
        ax.set_title(titles[index], fontsize=9)
        if properties is not None:
            _mark(ax, properties, index)
        _bare(ax, low, high)
    for ax in grid[:, 0]:
        ax.set_ylabel("z [mm]")
    for index in range(len(outlines) - across, len(outlines)):
        ax = grid.flat[index]
        ax.set_xlabel("y [mm]")
        ax.tick_params(labelbottom=True)
    if properties is not None:
        handles, labels = grid.flat[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    return figure


def _limits(outlines: Sequence[Outline]) -> tuple[FloatArray, FloatArray]:
    """Return the corners of a window that holds all outlines, with a margin [mm]."""
    points = MILLI * np.concatenate([outline.points for outline in outlines])
    return points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN


def _draw(ax: "Axes", outline: Outline, *, face: str, edge: str, width: float) -> None:
    """Fill an outline; holes run the other way round and stay empty."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    rings = [np.concatenate([ring, ring[:1]]) for ring in (outline.points, *outline.holes)]
    path = Path.make_compound_path(*(Path(MILLI * ring, closed=True) for ring in rings))
    ax.add_patch(PathPatch(path, facecolor=face, edgecolor=edge, linewidth=width))


def _mark(ax: "Axes", properties: SectionProperties, index: int) -> None:
    """Mark centroid and shear centre."""
    marks = (
        (properties.centroid_y, properties.centroid_z, "+", COLOURS[6], "centroid"),
        (properties.shear_centre_y, properties.shear_centre_z, "o", COLOURS[1], "shear centre"),
    )
    for y, z, marker, colour, label in marks:
        ax.plot(
            MILLI * y[index],
            MILLI * z[index],
            marker=marker,
            color=colour,
            linestyle="none",
            markerfacecolor="none",
            label=label,
        )


def _bare(ax: "Axes", low: FloatArray, high: FloatArray) -> None:
    """Set one scale for both axes and a line at the running edge."""
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])
    ax.set_aspect("equal")
    ax.axvline(0.0, color=GREY, linewidth=0.8, linestyle=":", zorder=0, label="running edge")
    ax.spines[["top", "right"]].set_visible(False)
    ax.tick_params(labelsize=8)


# Rows of the figure: label, size of the unit in SI, columns with their names on the screen.
ROWS: tuple[tuple[str, float, dict[str, str]], ...] = (
    ("Area [cm$^2$]", 1e-4, {"area": "$A$"}),
    (
        "Second moments\nand torsion [cm$^4$]",
        1e-8,
        {
            "second_moment_vertical": "$I_y$ vertical",
            "second_moment_lateral": "$I_z$ lateral",
            "product_moment": "$I_{yz}$",
            "torsion_constant": "$J$",
        },
    ),
    (
        "Height above\nthe foot [mm]",
        1e-3,
        {"centroid_height": "centroid", "shear_centre_height": "shear centre"},
    ),
    (
        "Offset towards\nthe stock rail [mm]",
        1e-3,
        {"centroid_offset": "centroid", "shear_centre_offset": "shear centre"},
    ),
)


def plot_section_values(
    x: npt.ArrayLike, values: Mapping[str, FloatArray], *, title: str
) -> "Figure":
    """Draw section properties along a rail, a mark at each station, straight in between.

    Parameters
    ----------
    x : array_like, shape (n,)
        Stations [m].
    values : mapping of str to ndarray, shape (n,)
        Columns of a section table by their names, in SI.
    title : str
        Heading.

    Returns
    -------
    matplotlib.figure.Figure
        It is not shown in a window.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 8.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(ROWS), 1, sharex=True)
    for ax, (label, unit, columns) in zip(axes, ROWS, strict=True):
        for number, (column, name) in enumerate(columns.items()):
            ax.plot(
                x,
                np.asarray(values[column]) / unit,
                color=COLOURS[number],
                linestyle=DASHES[number],
                marker=".",
                label=name,
            )
        _dressed(ax, label, legend=len(columns) > 1)
    axes[-1].set_xlabel("x from the toe [m]")
    figure.align_ylabels(axes)
    put_title(figure, title)
    return figure


def _dressed(ax: "Axes", label: str, *, legend: bool) -> None:
    ax.set_ylabel(label)
    ax.grid(visible=True, color="0.85", linewidth=0.6)
    ax.axhline(0.0, color="0.5", linewidth=0.6, zorder=1)
    ax.spines[["top", "right"]].set_visible(False)
    if legend:
        ax.legend(loc="center left", bbox_to_anchor=(1.005, 0.5), frameon=False)
