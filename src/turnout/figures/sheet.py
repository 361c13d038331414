"""Content of a figure as plain data: one description for paper and for pages.

Thinning of curves that keeps their appearance.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def thinned(x: Floats, values: Floats, *, most: int) -> tuple[Floats, Floats]:
    """Return at most a given number of points of a curve, with the same appearance.

    The curve is cut into parts of equal length, and of each the lowest, the highest and the first
    missing point stay, besides both ends of the curve: no peak gets lower, no tear is bridged.

    Parameters
    ----------
    x, values : ndarray, shape (n,)
        The curve; NaN in `values` where it is torn.
    most : int
        How many points may stay, at least 5.

    Returns
    -------
    (ndarray, ndarray), shape (m,)
        Points of the curve in their order.

    Examples
    --------
    >>> thinned(np.arange(7.0), np.array([0.0, 5.0, 1.0, 2.0, -3.0, 1.0, 1.0]), most=5)
    (array([0., 1., 4., 6.]), array([ 0.,  5., -3.,  1.]))
    """
    if values.size <= most:
        return x, values
    parts = max(1, (most - 2) // 3)
    size = -(-values.size // parts)
    padded = np.full(-(-values.size // size) * size, np.nan)
    padded[: values.size] = values
    rows = padded.reshape(-1, size)
    there = np.isfinite(rows)
    lowest = np.argmin(np.where(there, rows, np.inf), axis=1)
    highest = np.argmax(np.where(there, rows, -np.inf), axis=1)
    missing = np.where(there.all(axis=1), lowest, np.argmin(there, axis=1))
    begin = np.arange(rows.shape[0]) * size
    at = np.concatenate([begin + lowest, begin + highest, begin + missing, [0, values.size - 1]])
    kept = np.unique(np.minimum(at, values.size - 1))
    return x[kept], values[kept]


Style = Literal["line", "marks", "line and marks", "bars"]

# Points of a thinned line; a screen resolves no more.
MOST_POINTS = 1600
DECIMALS = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Line:
    """A curve, a set of marks or a set of bars.

    Attributes
    ----------
    label : str
        For the legend.
    x, y : ndarray
        In the units of the axes; a NaN tears a line.
    colour : int or str
        Place among the colours of `turnout.figures.style`, or a colour of its own ("#rrggbb").
    dash : int
        Place among the dashes.
    style : str
        "line", "marks", "line and marks" or "bars".
    symbol : str
        "circle", "square", "triangle up", "triangle down" or "cross".
    width : float
        Of a line in points, of bars in units of x.
    """

    label: str
    x: NDArray[Any]
    y: NDArray[Any]
    colour: int | str = 0
    dash: int = 0
    style: Style = "line"
    symbol: str = "circle"
    width: float = 1.3


@dataclass(frozen=True, slots=True)
class Level:
    """A value that lines are read against, drawn dashed across: its place and its name."""

    at: float
    text: str


@dataclass(frozen=True, slots=True)
class Band:
    """A part of the x axis, shaded: start, end and text."""

    start: float
    end: float
    text: str


@dataclass(frozen=True, slots=True)
class Moment:
    """A place on the x axis, dotted upright, with its text."""

    at: float
    text: str


@dataclass(frozen=True, slots=True)
class Row:
    """One of the stacked axes: label with its unit, lines, levels."""

    label: str
    lines: tuple[Line, ...]
    levels: tuple[Level, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """A figure of stacked axes that share x.

    Attributes
    ----------
    name : str
        For files and links, such as "chair-forces".
    title : str
        Heading above the axes.
    caption : str
        How to read it, in a sentence or two.
    x_label : str
        With its unit.
    rows : tuple of Row
        From above.
    bands, moments : tuple
        Over all rows.
    one_legend : bool
        Whether the rows show the same lines, so that one legend serves all.
    """

    name: str
    title: str
    caption: str
    x_label: str
    rows: tuple[Row, ...]
    bands: tuple[Band, ...] = ()
    moments: tuple[Moment, ...] = ()
    one_legend: bool = False


def sheet_record(sheet: Sheet, *, most: int = MOST_POINTS) -> dict[str, Any]:
    """Return a sheet as plain data for a page, its lines thinned with their peaks kept.

    Parameters
    ----------
    sheet : Sheet
        Rows of lines over one axis.
    most : int
        Points of a line at most.

    Returns
    -------
    dict
        Of texts, numbers, lists and None (for NaN), fit for JSON.

    Examples
    --------
    >>> line = Line(label="force", x=np.arange(3.0), y=np.array([0.0, np.nan, 2.0]))
    >>> sheet = Sheet(name="f", title="", caption="", x_label="t", rows=(Row("F [kN]", (line,)),))
    >>> sheet_record(sheet)["rows"][0]["lines"][0]["y"]
    [0.0, None, 2.0]
    """
    return {
        "name": sheet.name,
        "title": sheet.title,
        "x_label": sheet.x_label,
        "counted": counted(sheet),
        "rows": [
            {
                "label": row.label,
                "lines": [_line_record(line, most) for line in row.lines],
                "levels": [{"at": level.at, "text": level.text} for level in row.levels],
            }
            for row in sheet.rows
        ],
        "bands": [{"start": b.start, "end": b.end, "text": b.text} for b in sheet.bands],
        "one_legend": sheet.one_legend,
        "moments": [{"at": moment.at, "text": moment.text} for moment in sheet.moments],
    }


# More numbers than this are not all named on an axis.
MOST_COUNTED = 20


def counted(sheet: Sheet) -> bool:
    """Return True if the x axis counts something, so that only whole numbers belong on it."""
    rows = [np.asarray(line.x, dtype=float) for row in sheet.rows for line in row.lines]
    x = np.concatenate(rows) if rows else np.zeros(0)
    return x.size > 0 and bool(np.all(x == np.round(x)) and np.ptp(x) < MOST_COUNTED)


def _line_record(line: Line, most: int) -> dict[str, Any]:
    x, y = np.asarray(line.x, dtype=float), np.asarray(line.y, dtype=float)
    if line.style == "line":
        x, y = thinned(x, y, most=most)
    return {
        "label": line.label,
        "x": _numbers(x),
        "y": _numbers(y),
        "colour": line.colour,
        "dash": line.dash,
        "style": line.style,
        "symbol": line.symbol,
        "width": line.width,
    }


def _numbers(values: ArrayLike) -> list[float | None]:
    """Return numbers short enough for a page."""
    # Adding zero turns a negative zero into a plain one.
    rounded = np.round(np.asarray(values, dtype=float), DECIMALS) + 0.0
    if np.isfinite(rounded).all():
        return list(rounded.tolist())
    torn = rounded.astype(object)
    torn[~np.isfinite(rounded)] = None
    return list(torn.tolist())
