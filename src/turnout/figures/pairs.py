"""A table of scatter plots: each pair of some quantities, with their distributions in between."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import ResponseError
from turnout.figures.style import COLOURS, GREY, put_title

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

CELL = 1.25
"""Height and width of a cell [inches]."""
BINS = 12


def plot_pairs(
    values: Mapping[str, Floats], *, bounds: Mapping[str, tuple[float, float]], title: str
) -> "Figure":
    """Draw each pair of quantities within the bounds that were stated for them.

    Parameters
    ----------
    values : mapping of str to ndarray, shape (n,)
        At least two quantities by name with unit, for the axes.
    bounds : mapping of str to (float, float)
        Ends of their axes.
    title : str
        Above the figure.

    Returns
    -------
    matplotlib.figure.Figure
        Below the diagonal the pairs, on it the distributions; rank correlations above it.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    names = list(values)
    if len(names) < 2:
        message = "nothing to draw: pairs need at least two quantities"
        raise ResponseError(message)
    count = len(names)
    figure = Figure(figsize=(CELL * count + 1.0, CELL * count + 0.8), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(count, count, squeeze=False)
    ranks = {name: np.argsort(np.argsort(values[name])).astype(np.float64) for name in names}
    for row, below in enumerate(names):
        for column, across in enumerate(names):
            ax = axes[row, column]
            ax.tick_params(labelsize=7, labelleft=column == 0 and row > 0, labelbottom=False)
            if row == count - 1:
                ax.tick_params(labelbottom=True)
                ax.set_xlabel(across.replace(" [", "\n["), fontsize=8)
            if column == 0:
                ax.set_ylabel(below.replace(" [", "\n["), fontsize=8)
            ax.set_xlim(bounds[across])
            if row == column:
                edges = np.linspace(*bounds[across], BINS + 1)
                ax.hist(values[across], bins=edges, color=COLOURS[0], alpha=0.7)
                ax.set_yticks([])
            elif row > column:
                ax.plot(values[across], values[below], ".", color=COLOURS[0], markersize=3)
                ax.set_ylim(bounds[below])
            else:
                _correlation(ax, ranks[across], ranks[below])
    put_title(figure, title)
    return figure


def _correlation(ax: object, first: Floats, second: Floats) -> None:
    """Write a rank correlation, the darker the stronger."""
    found = float(np.corrcoef(first, second)[0, 1])
    ax.set_axis_off()  # type: ignore[attr-defined]
    ax.text(  # type: ignore[attr-defined]
        *(0.5, 0.5, f"{found:+.2f}"),
        transform=ax.transAxes,  # type: ignore[attr-defined]
        ha="center",
        va="center",
        fontsize=10,
        color="black" if abs(found) >= 0.3 else GREY,
    )
