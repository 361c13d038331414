"""Draw a sheet on paper: stacked axes that share x."""

from typing import TYPE_CHECKING

import numpy as np

from turnout.core.errors import ResponseError
from turnout.figures.sheet import Line, Row, Sheet, counted
from turnout.figures.style import COLOURS, DASHES, GREY, SHADE, new_figure, put_title, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SYMBOLS = {
    "circle": "o",
    "square": "s",
    "triangle up": "^",
    "triangle down": "v",
    "cross": "x",
}

# Height of a figure of one row [inches].
SINGLE_ROW_HEIGHT = 4.0


def draw_sheet(sheet: Sheet) -> "Figure":
    """Draw a sheet.

    Parameters
    ----------
    sheet : Sheet
        Figure as data.

    Returns
    -------
    matplotlib.figure.Figure
        Its axes are the rows of the sheet, from above.

    Raises
    ------
    ResponseError
        When the sheet has no line.

    Examples
    --------
    >>> from turnout.figures.sheet import Row
    >>> line = Line(label="force", x=np.arange(3.0), y=np.arange(3.0))
    >>> sheet = Sheet(name="f", title="", caption="", x_label="t", rows=(Row("F [kN]", (line,)),))
    >>> draw_sheet(sheet).axes[0].get_ylabel()
    'F [kN]'
    """
    if not any(row.lines for row in sheet.rows):
        message = f"nothing to draw: {sheet.title} has no line"
        raise ResponseError(message)
    figure, axes = new_figure(len(sheet.rows))
    if len(sheet.rows) == 1:
        figure.set_figheight(SINGLE_ROW_HEIGHT)
    span = _span(sheet)
    for ax, row in zip(axes, sheet.rows, strict=True):
        _draw_row(ax, sheet, row, span=span)
    _name_places(axes[0], sheet)
    if counted(sheet):
        axes[-1].locator_params(axis="x", integer=True)
    axes[-1].set_xlabel(sheet.x_label)
    figure.align_ylabels(axes)
    put_title(figure, sheet.title)
    return figure


def draw_row(sheet: Sheet, row: Row, *, ax: "Axes | None" = None) -> "Axes":
    """Draw one row of a sheet as a figure of its own.

    Parameters
    ----------
    sheet : Sheet
        Sheet that holds the row; gives time axis and title.
    row : Row
        One of its rows.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; default a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ResponseError
        When the row has no line.
    """
    if not row.lines:
        message = f"nothing to draw: {row.label} has no line"
        raise ResponseError(message)
    if ax is None:
        figure, (ax,) = new_figure(1)
        figure.set_figheight(SINGLE_ROW_HEIGHT)
        put_title(figure, sheet.title)
    _draw_row(ax, sheet, row, span=_span(sheet))
    _name_places(ax, sheet)
    ax.set_xlabel(sheet.x_label)
    return ax


def _draw_row(ax: "Axes", sheet: Sheet, row: Row, *, span: tuple[float, float]) -> None:
    for line in row.lines:
        _draw(ax, line)
    styled(ax, row.label, span=span)
    for level in row.levels:
        _level(ax, level.at, level.text)
    for band in sheet.bands:
        ax.axvspan(band.start, band.end, color=SHADE, linewidth=0, zorder=0)
    for moment in sheet.moments:
        ax.axvline(moment.at, color="black", linewidth=0.8, linestyle=":")
    if ax.get_legend_handles_labels()[1] and (not sheet.one_legend or row is _fullest(sheet)):
        ax.legend(loc="center left", bbox_to_anchor=(1.005, 0.5), frameon=False, fontsize=9)


def _fullest(sheet: Sheet) -> Row:
    """Return the row with the most lines, which names them for all."""
    return max(sheet.rows, key=lambda row: len(row.lines))


def colour_of(line: Line) -> str:
    """Return the colour of a line."""
    return line.colour if isinstance(line.colour, str) else COLOURS[line.colour % len(COLOURS)]


def _span(sheet: Sheet) -> tuple[float, float]:
    """Return the range of the x axis: lines fill it, marks and bars keep a margin."""
    lines = [line for row in sheet.rows for line in row.lines if np.asarray(line.x).size]
    low = min(float(np.min(line.x)) for line in lines)
    high = max(float(np.max(line.x)) for line in lines)
    if all(line.style == "line" for line in lines) and high > low:
        return low, high
    room = 0.03 * (high - low) or 0.5
    return low - room, high + room


def _draw(ax: "Axes", line: Line) -> None:
    colour = colour_of(line)
    if line.style == "bars":
        ax.bar(line.x, line.y, width=line.width, color=colour, label=line.label, zorder=2)
        return
    ax.plot(
        line.x,
        line.y,
        color=colour,
        linestyle="none" if line.style == "marks" else DASHES[line.dash % len(DASHES)],
        linewidth=line.width,
        marker=None if line.style == "line" else SYMBOLS[line.symbol],
        markersize=6 if line.style == "marks" else 4.5,
        markeredgecolor="black" if line.style == "marks" and line.symbol != "cross" else None,
        label=line.label,
        zorder=4 if line.style == "marks" else 3,
    )


def _level(ax: "Axes", at: float, text: str) -> None:
    ax.axhline(at, color=GREY, linestyle=(0, (6, 3)), linewidth=0.8, zorder=1)
    if text:
        ax.annotate(
            text,
            xy=(0.0, at),
            xycoords=("axes fraction", "data"),
            xytext=(3, 2),
            textcoords="offset points",
            va="bottom",
            color=GREY,
            fontsize=8,
        )


def _name_places(ax: "Axes", sheet: Sheet) -> None:
    """Write the texts of bands above the first axes; moments too, or beside their line."""
    above = [(0.5 * (band.start + band.end), band.text) for band in sheet.bands]
    above += [] if sheet.bands else [(moment.at, moment.text) for moment in sheet.moments]
    for at, text in above:
        _place(ax, at, text, offset=(0, 2), ha="center", va="bottom")
    for moment in sheet.moments if sheet.bands else ():
        _place(ax, moment.at, moment.text, offset=(-4, -3), ha="right", va="top")


def _place(ax: "Axes", at: float, text: str, *, offset: tuple[int, int], ha: str, va: str) -> None:
    ax.annotate(
        text,
        xy=(at, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=offset,
        textcoords="offset points",
        ha=ha,
        va=va,
        color=GREY,
        fontsize=8,
    )
