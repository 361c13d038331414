"""Cross-section properties along a rail: what the beams are made of, station by station."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from turnout.plot.style import COLOURS, DASHES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FloatArray = npt.NDArray[np.float64]
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
        What is drawn.

    Returns
    -------
    matplotlib.figure.Figure
        It belongs to no window.
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
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure


def _dressed(ax: "Axes", label: str, *, legend: bool) -> None:
    ax.set_ylabel(label)
    ax.grid(visible=True, color="0.85", linewidth=0.6)
    ax.axhline(0.0, color="0.5", linewidth=0.6, zorder=1)
    ax.spines[["top", "right"]].set_visible(False)
    if legend:
        ax.legend(loc="center left", bbox_to_anchor=(1.005, 0.5), frameon=False)
