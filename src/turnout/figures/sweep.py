"""Figures of a sweep: maps over two inputs, Sobol indices as bars, main effects as lines."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.value_text import shown_unit
from turnout.figures.style import COLOURS, GREY, put_title
from turnout.metric.sensitivity import Effect, OutputEffects
from turnout.metric.sweep_map import NOT_THROWN, STATES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


KILO, MILLI = 1e-3, 1e3
# Safe for all colour vision; letters in the cells distinguish them in grey print.
STATE_COLOURS = (
    *(
        "#009E73",
        "#DDDDDD",
        "#BBBBBB",
        "#F0E442",
        "#56B4E9",
        "#E69F00",
        "#F5C97A",
        "#B8A0C8",
        "#CC79A7",
    ),
    *("#D55E00", "#999999", "#FFFFFF"),
)
STATE_LETTERS = ("", "N", "B", "C", "L", "S", "O", "!", "L!", "U", "?", "")
# A number is written into each cell up to so many columns.
MOST_WRITTEN = 16
TITLES = {
    "peak_force": ("Largest effort of a drive on closing [kN]", KILO),
    "object_force_peak": ("Largest force on the object [kN]", KILO),
    "end_gap": ("Residual gap at a drive [mm]", MILLI),
    "least_gauge": ("Least track gauge [mm]", MILLI),
}
AXIS_TITLES = {
    "object.size": ("Object size [mm]", MILLI, 0.0),
    "object.x": ("Place of the object [m]", 1.0, 0.0),
    "object.at": ("", 1.0, 0.0),
    "temperature": ("Temperature [°C]", 1.0, -273.15),
}


def plot_sweep_map(cells: xr.Dataset) -> "Figure":
    """Draw forces, gap and end states of a sweep over two inputs.

    Parameters
    ----------
    cells : xarray.Dataset
        From `turnout.metric.sweep_map.sweep_map`.

    Returns
    -------
    matplotlib.figure.Figure
        Efforts and object force [kN], residual gap and least gauge [mm], if it is known, and how
        the throws ended.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows, columns = cells["state"].shape
    wide, high = 1.6 + 0.42 * columns, 1.3 + 0.26 * rows
    shown = [name for name in TITLES if name in cells or name != "least_gauge"]
    count = len(shown) // 2 + 1
    size = (2 * max(wide, 4.5), count * max(high, 2.6) + 1.0)
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(count, 2, sharex=True, sharey=True)
    for ax, name in zip(axes.flat, shown, strict=False):
        if name in cells:
            plot_cells(cells, name, ax=ax)
    plot_states(cells, ax=axes.flat[len(shown)])
    for ax in axes.flat[len(shown) + 1 :]:
        ax.set_axis_off()
    put_title(figure, _title(cells), left=False)
    figure.legend(
        handles=_legend(cells), loc="outside lower center", ncols=4, frameon=False, fontsize=8
    )
    return figure


def plot_cells(cells: xr.Dataset, name: str, *, ax: "Axes") -> "Axes":
    """Draw one quantity in colour, with its number in each cell that has room for it.

    Parameters
    ----------
    cells : xarray.Dataset
        From `turnout.metric.sweep_map.sweep_map`.
    name : str
        "peak_force", "object_force_peak", "end_gap" or "least_gauge".
    ax : matplotlib.axes.Axes
        Axes to draw on.
    """
    title, factor = TITLES[name]
    values = factor * cells[name].to_numpy()
    known = values[np.isfinite(values)]
    least = float(known.min()) if name == "least_gauge" and known.size else 0.0
    masked = np.ma.masked_invalid(values)
    mesh = ax.pcolormesh(masked, cmap="viridis", vmin=least, rasterized=True)
    if ax.figure is not None:
        ax.figure.colorbar(mesh, ax=ax, pad=0.01, fraction=0.04)
    largest = float(known.max()) if known.size else 0.0
    texts = np.where(np.isnan(values), "", np.char.mod("%.1f", values))
    colours = np.where(values > least + 0.6 * (largest - least), "black", "white")
    _write(ax, texts, colours)
    _framed(ax, cells, title)
    return ax


def plot_states(cells: xr.Dataset, *, ax: "Axes") -> "Axes":
    """Draw the outcomes of the throws of each cell, the worst if there are several.

    Parameters
    ----------
    cells : xarray.Dataset
        From `turnout.metric.sweep_map.sweep_map`.
    ax : matplotlib.axes.Axes
        Axes to draw on.
    """
    from matplotlib.colors import BoundaryNorm, ListedColormap

    state = cells["state"].to_numpy()
    norm = BoundaryNorm(np.arange(len(STATES) + 1) - 0.5, len(STATES))
    ax.pcolormesh(state, cmap=ListedColormap(STATE_COLOURS), norm=norm, rasterized=True)
    _write(ax, np.array(STATE_LETTERS)[state], np.full(state.shape, "black"))
    several = int(cells["throws"].max()) > 1
    _framed(ax, cells, "How it ended" + (", the worst of each cell" if several else ""))
    return ax


def _write(ax: "Axes", texts: NDArray[np.str_], colours: NDArray[Any]) -> None:
    if texts.shape[1] > MOST_WRITTEN:
        return
    for row, column in np.ndindex(*texts.shape):
        if texts[row, column]:
            ax.text(
                column + 0.5, row + 0.5, str(texts[row, column]), ha="center", va="center",
                fontsize=6.5, color=str(colours[row, column]),
            )  # fmt: skip


def _framed(ax: "Axes", cells: xr.Dataset, title: str) -> None:
    """Give axes their ticks, grey the cells without a throw, and put the first row on top."""
    nothing = np.ma.masked_where(cells["throws"].to_numpy() > 0, np.ones(cells["throws"].shape))
    ax.pcolor(nothing, cmap="Greys", vmin=0.0, vmax=8.0, hatch="///", edgecolor="0.8", linewidth=0)
    for axis, name in ((ax.xaxis, "x"), (ax.yaxis, "y")):
        labels = _ticks(cells, name)
        axis.set_ticks(np.arange(len(labels)) + 0.5, labels, fontsize=8)
        axis.set_tick_params(length=0)
    if len(_ticks(cells, "x")) > 8:
        ax.tick_params(axis="x", rotation=0, labelsize=7)
    ax.set_title(title, fontsize=9, loc="left")
    last = ax.get_subplotspec()
    if last is None or last.is_last_row():
        ax.set_xlabel(_axis_title(cells, "x"))
    if last is None or last.is_first_col():
        ax.set_ylabel(_axis_title(cells, "y"))
    if not ax.yaxis_inverted():
        ax.invert_yaxis()
    ax.spines[:].set_color(GREY)


def _axis_title(cells: xr.Dataset, name: str) -> str:
    key = str(cells.attrs[f"{name}_input"])
    units = str(cells[name].attrs.get("units", ""))
    if key in AXIS_TITLES:
        return AXIS_TITLES[key][0]
    return f"{key} [{units}]" if units not in ("", "1") else key


def _ticks(cells: xr.Dataset, name: str) -> list[str]:
    values = cells[name].to_numpy()
    if values.dtype.kind not in "fiu":
        return [str(value) for value in values]
    _, factor, offset = AXIS_TITLES.get(str(cells.attrs[f"{name}_input"]), ("", 1.0, 0.0))
    return [f"{factor * value + offset:.3g}" for value in values]


def _title(cells: xr.Dataset) -> str:
    name = str(cells.attrs.get("name") or cells.attrs.get("study") or "sweep")
    thrown, rest = int(cells["throws"].sum()), int(cells.attrs["skipped"])
    text = f"{name}: {thrown} throws"
    return text + (f", {rest} skipped after a drive slipped" if rest else "")


def _legend(cells: xr.Dataset) -> list[Any]:
    from matplotlib.patches import Patch

    found = sorted(set(np.unique(cells["state"].to_numpy()).tolist()))
    return [
        Patch(
            facecolor=STATE_COLOURS[state],
            edgecolor="0.7",
            hatch="///" if state == NOT_THROWN else None,
            label=f"{STATE_LETTERS[state]}  {STATES[state]}".strip(),
        )
        for state in found
    ]


# Main effects are drawn for the most influential inputs.
MOST_EFFECTS = 4


def plot_sweep_effects(outputs: Sequence[OutputEffects], *, title: str = "") -> "Figure":
    """Draw a row for each output: Sobol indices, then main effects of the strongest inputs.

    Parameters
    ----------
    outputs : sequence of OutputEffects
        At least one.
    title : str
        Of the figure.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    inputs = max(len(item.indices) for item in outputs)
    shown = min(MOST_EFFECTS, max(len(item.effects) for item in outputs))
    high = max(2.2, 0.24 * inputs + 1.0)
    figure = Figure(figsize=(4.6 + 2.1 * shown, high * len(outputs) + 0.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(
        len(outputs), 1 + shown, squeeze=False, width_ratios=[1.5, *([1.0] * shown)]
    )
    for row, item in zip(axes, outputs, strict=True):
        plot_indices(item, ax=row[0])
        for ax, effect in zip(row[1:], strongest(item, shown), strict=False):
            plot_effect(item, effect, ax=ax)
        low = min((ax.get_ylim()[0] for ax in row[1:]), default=0.0)
        top = max((ax.get_ylim()[1] for ax in row[1:]), default=1.0)
        for number, ax in enumerate(row[1:]):
            ax.set_ylim(low, top)
            ax.set_visible(ax.has_data())
            if number:
                ax.tick_params(labelleft=False)
                ax.set_ylabel("")
    if title:
        put_title(figure, title, left=False)
    return figure


def strongest(item: OutputEffects, count: int) -> list[Effect]:
    """Return the main effects of the most influential inputs of an output.

    Examples
    --------
    >>> from turnout.metric.sensitivity import NumericOutput
    >>> output = NumericOutput(name="y", units="N", values=np.zeros(2))
    >>> strongest(OutputEffects(output=output, indices=(), effects=()), 3)
    []
    """
    weight = {
        index.name: index.first if np.isnan(index.total) else index.total for index in item.indices
    }
    ranked = sorted(item.effects, key=lambda effect: -weight.get(effect.name, 0.0))
    return ranked[:count]


def plot_indices(item: OutputEffects, *, ax: "Axes") -> "Axes":
    """Draw first-order and, if known, total Sobol indices of an output with intervals."""
    place = np.arange(len(item.indices))
    total = not all(np.isnan(index.total) for index in item.indices)
    wide = 0.38 if total else 0.7
    kinds = [("first", 0, wide / 2 if total else 0.0)] + [("total", 1, -wide / 2)] * total
    for kind, colour, shift in kinds:
        values = [getattr(index, kind) for index in item.indices]
        halves = [getattr(index, f"{kind}_confidence") for index in item.indices]
        ax.barh(
            place - shift, values, wide, xerr=halves, color=COLOURS[colour], label=kind,
            error_kw={"elinewidth": 0.8, "ecolor": "black", "capsize": 2},
        )  # fmt: skip
    if all(np.isnan(index.first) for index in item.indices):
        text = "no sensitivity:\none throw per value"
        ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", va="center", color=GREY)
    ax.set_yticks(place, [index.name for index in item.indices], fontsize=7)
    ax.invert_yaxis()
    ax.axvline(0.0, color=GREY, linewidth=0.6)
    ax.set_xlim(min(0.0, ax.get_xlim()[0]), max(1.0, ax.get_xlim()[1]))
    ax.set_xlabel("Sobol index [-], 95 % intervals", fontsize=8)
    ax.set_title(item.output.name, fontsize=9, loc="left")
    ax.spines[["top", "right"]].set_visible(False)
    if total:
        ax.legend(frameon=False, fontsize=7, loc="lower right")
    return ax


def plot_effect(item: OutputEffects, effect: Effect, *, ax: "Axes") -> "Axes":
    """Draw the mean of an output over one input, with its 95 % interval."""
    unit, size = shown_unit(item.output.units)
    mean, half = effect.mean / size, np.nan_to_num(effect.confidence) / size
    if isinstance(effect.levels[0], str):
        x = np.arange(len(effect.levels), dtype=np.float64)
        ax.set_xticks(x, [str(level) for level in effect.levels], rotation=90, fontsize=6)
        ax.errorbar(x, mean, half, fmt="o", color=COLOURS[0], markersize=3, linewidth=0.8)
    else:
        text, scale, offset = effect_axis(effect)
        x = scale * np.array(effect.levels, dtype=np.float64) + offset
        ax.fill_between(x, mean - half, mean + half, color=COLOURS[0], alpha=0.25, linewidth=0)
        ax.plot(x, mean, marker="o", markersize=3, color=COLOURS[0], linewidth=1.2)
        ax.set_xlabel(text, fontsize=8)
    ax.set_ylabel(f"Mean [{unit}]" if unit else "Mean", fontsize=8)
    ax.tick_params(labelsize=7)
    ax.grid(visible=True, color="0.88", linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def effect_axis(effect: Effect) -> tuple[str, float, float]:
    """Return the title of an input's axis, and factor and offset from SI to its values."""
    if effect.name in AXIS_TITLES:
        return AXIS_TITLES[effect.name]
    unit, size = shown_unit(effect.units)
    return (f"{effect.name} [{unit}]" if unit else effect.name), 1.0 / size, 0.0
