"""Colours, titles and files of figures; nothing global is touched."""

import io
import json
import textwrap
from typing import TYPE_CHECKING

import xarray as xr

from turnout.core.errors import FileError
from turnout.metric.summary import format_overrides
from turnout.throw.slip import unfinished
from turnout.throw.verdict import break_note, verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito, safe for all colour vision; dashes distinguish lines in grey print.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
DASHES: tuple[str | tuple[int, tuple[float, ...]], ...] = (
    "-",
    (0, (5, 1.5)),
    (0, (3, 1, 1, 1)),
    (0, (1.5, 1)),
    (0, (8, 2)),
    (0, (3, 1, 1, 1, 1, 1)),
    "-",
)
GREY, SHADE, COMPARED = "0.35", "0.93", "0.6"
FIGURE_SIZE = (9.0, 1.9)
SUFFIXES = (".png", ".pdf", ".svg")
KILO, MILLI = 1e-3, 1e3
"""Factors from SI to kN and mm."""
RESOLUTION = 150
TITLE_SIZE, POINTS_PER_INCH = 11, 72
# Mean width of a character of the title font, over its size [-].
CHARACTER_WIDTH = 0.6


def new_figure(rows: int) -> "tuple[Figure, list[Axes]]":
    """Return a figure of stacked axes that share time; it is not shown in a window."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(FIGURE_SIZE[0], FIGURE_SIZE[1] * rows + 0.8), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False)
    return figure, list(axes[:, 0])


def styled(ax: "Axes", label: str, *, span: tuple[float, float]) -> None:
    """Give axes their label, a light grid and the whole time span."""
    ax.set_ylabel(label)
    ax.grid(visible=True, color="0.85", linewidth=0.6)
    ax.set_axisbelow(True)
    ax.axhline(0.0, color="0.5", linewidth=0.6, zorder=1)
    ax.set_xlim(*span)
    ax.spines[["top", "right"]].set_visible(False)
    ax.margins(y=0.08)


def put_title(figure: "Figure", text: str, *, left: bool = True) -> None:
    """Write the title of a figure, in as many lines as its width needs.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        The figure, of its final width.
    text : str
        Lines that are too long are wrapped between words.
    left : bool
        Whether it begins at the left edge, or is centred.
    """
    width = int(figure.get_figwidth() * POINTS_PER_INCH / (CHARACTER_WIDTH * TITLE_SIZE))
    lines = [part for line in text.split("\n") for part in textwrap.wrap(line, width) or [""]]
    place = {"x": 0.01, "ha": "left"} if left else {}
    figure.suptitle("\n".join(lines), fontsize=TITLE_SIZE, **place)


def title_of(dataset: xr.Dataset, compare: xr.Dataset | None = None) -> str:
    """Return panel, objects and outcome of a run, and of the run that it is compared with."""
    parts = [_described(dataset)]
    if not dataset.attrs.get("complete", True):
        parts.append(f"NOT COMPLETE ({dataset.attrs.get('outcome', 'ended early')})")
    elif "locked" in dataset and dataset.sizes.get("time", 0):
        judged = verdict(dataset)
        state = "locked" if dataset["locked"].values[-1] else "not locked"
        parts.append(
            state if judged.kind == "not judged" else f"{judged.head[:1].lower()}{judged.head[1:]}"
        )
        parts.extend(unfinished(dataset).values())
        if break_note(dataset) and judged.kind != "depends on how it breaks":
            parts.append("verdict may depend on how an object breaks")
    text = ", ".join(parts)
    if compare is not None:
        text += f"\ngrey: {_described(compare)}"
    return text


def rendered(figure: "Figure", suffix: str) -> bytes:
    """Return a figure as the content of a file.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Any figure; stays open.
    suffix : str
        ".png", ".pdf" or ".svg".

    Raises
    ------
    FileError
        For another suffix.
    """
    if suffix.lower() not in SUFFIXES:
        message = f"a figure's name must end in {', '.join(SUFFIXES)}, not '{suffix}'"
        raise FileError(message)
    content = io.BytesIO()
    figure.savefig(content, format=suffix.lower().removeprefix("."), dpi=RESOLUTION)
    return content.getvalue()


def _described(dataset: xr.Dataset) -> str:
    attributes = dataset.attrs
    text = str(attributes.get("panel", attributes.get("title", "measurement")))
    changes = json.loads(attributes.get("overrides", "{}"))
    if changes:
        text += f" ({format_overrides(changes)})"
    if "foreign_objects" not in attributes:
        return text
    items = json.loads(attributes["foreign_objects"])
    objects = [f"{item['size'] * 1e3:g} mm at {item['place']}" for item in items]
    return f"{text}: {' and '.join(objects) if objects else 'no object'}"
