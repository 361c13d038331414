"""What decides over the outputs of a sweep: indices as bars, main effects as lines."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from turnout.metric.effects import Decided, Effect
from turnout.plot.style import COLOURS, GREY
from turnout.plot.sweep_map import AXIS_TITLES, KILO, MILLI

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Main effects are drawn of the inputs that decide most.
MOST_EFFECTS = 4
SCREEN = {"N": ("kN", KILO), "m": ("mm", MILLI), "N/m": ("kN/mm", 1e-6), "K": ("K", 1.0)}


def plot_sweep_effects(outputs: Sequence[Decided], *, title: str = "") -> "Figure":
    """Draw a row for each output: its indices, then the main effects of the strongest inputs.

    Parameters
    ----------
    outputs : sequence of Decided
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
        figure.suptitle(title, fontsize=11)
    return figure


def strongest(item: Decided, count: int) -> list[Effect]:
    """Return the main effects of the inputs that decide most over an output.

    Examples
    --------
    >>> from turnout.metric.effects import Output
    >>> output = Output(name="y", units="N", values=np.zeros(2))
    >>> strongest(Decided(output=output, indices=(), effects=()), 3)
    []
    """
    weight = {
        index.name: index.first if np.isnan(index.total) else index.total for index in item.indices
    }
    ranked = sorted(item.effects, key=lambda effect: -weight.get(effect.name, 0.0))
    return ranked[:count]


def plot_indices(item: Decided, *, ax: "Axes") -> "Axes":
    """Draw first and, where they are known, total indices of an output with their intervals."""
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
    ax.set_yticks(place, [index.name for index in item.indices], fontsize=7)
    ax.invert_yaxis()
    ax.axvline(0.0, color=GREY, linewidth=0.6)
    ax.set_xlim(min(0.0, ax.get_xlim()[0]), max(1.0, ax.get_xlim()[1]))
    ax.set_xlabel("Share of the variance [-], 95 % intervals", fontsize=8)
    ax.set_title(item.output.name, fontsize=9, loc="left")
    ax.spines[["top", "right"]].set_visible(False)
    if total:
        ax.legend(frameon=False, fontsize=7, loc="lower right")
    return ax


def plot_effect(item: Decided, effect: Effect, *, ax: "Axes") -> "Axes":
    """Draw the mean of an output over one input, with its 95 % interval."""
    unit, factor = SCREEN.get(item.output.units, (item.output.units, 1.0))
    mean, half = factor * effect.mean, factor * np.nan_to_num(effect.confidence)
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
    ax.set_ylabel(f"Mean [{unit}]" if unit not in ("", "1") else "Mean", fontsize=8)
    ax.tick_params(labelsize=7)
    ax.grid(visible=True, color="0.88", linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def effect_axis(effect: Effect) -> tuple[str, float, float]:
    """Return the title of an input's axis, and what turns SI into what it shows."""
    if effect.name in AXIS_TITLES:
        return AXIS_TITLES[effect.name]
    unit, factor = SCREEN.get(effect.units, (effect.units, 1.0))
    return (f"{effect.name} [{unit}]" if unit not in ("", "1") else effect.name), factor, 0.0
