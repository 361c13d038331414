"""The figure of a test campaign: responses or hits over size, and the probability of detection."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.figures.style import COLOURS, GREY, put_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WANTED = 0.9


def plot_pod(dataset: xr.Dataset) -> "Figure":
    """Draw the dataset of `turnout pod`: above responses, if there are any, below the curve.

    Parameters
    ----------
    dataset : xarray.Dataset
        With required_size and required_size_bound over probability, and the throws.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    responses = "threshold" in dataset.attrs
    figure = Figure(figsize=(7.5, 8.0 if responses else 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    rows = list(figure.subplots(2 if responses else 1, 1, sharex=True, squeeze=False)[:, 0])
    if responses:
        _draw_responses(rows[0], dataset)
    _draw_curve(rows[-1], dataset)
    said = dataset.attrs
    count = f"{said['throws']} throws on {said['switches']} switch"
    assisted = ", model-assisted" if said["model_assisted"] else ""
    figure.align_ylabels(rows)
    put_title(
        figure, f"Probability of detection: {count}{'es' * (said['switches'] != 1)}{assisted}"
    )
    return figure


def _switches(dataset: xr.Dataset) -> list[tuple[str, str, NDArray[np.bool_]]]:
    """Return name, colour and throws with objects of each switch."""
    names, used = dataset["switch"].to_numpy().astype(str), dataset["size"].to_numpy() > 0.0
    return [
        (name, COLOURS[number % len(COLOURS)], (names == name) & used)
        for number, name in enumerate(dict.fromkeys(names))
    ]


def _draw_responses(ax: "Axes", dataset: xr.Dataset) -> None:
    said = dataset.attrs
    size, response = 1e3 * dataset["size"].to_numpy(), dataset["response"].to_numpy()
    low, high = said["least"], said["most"]
    for name, colour, used in _switches(dataset):
        known = used & (response > low) & (response < high)
        ax.plot(size[known], response[known], "o", color=colour, markersize=4, label=name)
        for side, mark in ((response <= low, "v"), (response >= high, "^")):
            at = np.clip(response, low, high)
            ax.plot(
                size[used & side], at[used & side], mark, color=colour,
                markerfacecolor="none", markersize=5,
            )  # fmt: skip
    along = np.geomspace(size[size > 0].min(), size.max(), 200)
    x = np.log(1e-3 * along) if said["size_scale"] == "log" else 1e-3 * along
    mean = said["intercept"] + said["slope"] * x
    spread = float(np.hypot(said["switch_deviation"], said["error_deviation"]))
    back = np.exp if said["response_scale"] == "log" else np.asarray
    ax.plot(along, back(mean), color="black", linewidth=1.2)
    ax.fill_between(
        along, back(mean - 1.645 * spread), back(mean + 1.645 * spread),
        color="0.9", zorder=0, label="90 % of throws",
    )  # fmt: skip
    ax.axhline(said["threshold"], color=COLOURS[1], linestyle="--", label="threshold")
    for value, text in ((low, "floor"), (high, "slip")):
        if np.isfinite(value):
            ax.axhline(value, color=GREY, linestyle=":", linewidth=1.0)
            ax.annotate(
                text, (1.0, value), xycoords=("axes fraction", "data"), xytext=(-2, 2),
                textcoords="offset points", ha="right", fontsize=8, color=GREY,
            )  # fmt: skip
    if said["response_scale"] == "log":
        ax.set_yscale("log")
    shown = response[(size > 0) & np.isfinite(response)]
    if said["response_scale"] == "log":
        shown = shown[shown > 0]
        ax.set_ylim(0.7 * max(min(shown.min(), said["threshold"]), low), 1.4 * shown.max())
    unit = dataset["response"].attrs.get("units", "")
    ax.set_ylabel(f"Response [{unit if unit not in ('', '1') else '-'}]")
    _style(ax)
    ax.legend(fontsize=8, ncols=2, loc="upper left", title="Switch", title_fontsize=8)


def _draw_curve(ax: "Axes", dataset: xr.Dataset) -> None:
    said = dataset.attrs
    share = dataset["probability"].to_numpy()
    needed, bound = (1e3 * dataset[name] for name in ("required_size", "required_size_bound"))
    ax.plot(needed, share, color=COLOURS[0], label="probability of detection")
    ax.plot(bound, share, color=COLOURS[0], linestyle="--", label="95 % confidence bound")
    ax.axhline(WANTED, color=GREY, linewidth=0.8, linestyle=":")
    for name, text in (("a90", "a90"), ("a90_95", "a90/95")):
        value = 1e3 * said[name]
        if np.isfinite(value):
            ax.plot([value, value], [0.0, WANTED], color=GREY, linewidth=0.8)
            ax.annotate(
                f"{text} {value:.1f} mm", (value, 0.03), xytext=(3, 0), rotation=90,
                textcoords="offset points", fontsize=8, va="bottom",
            )  # fmt: skip
    size, hit = 1e3 * dataset["size"].to_numpy(), dataset["hit"].to_numpy() > 0
    if "threshold" not in said:
        for number, (_, colour, used) in enumerate(_switches(dataset)):
            lift = 0.012 * number
            for of, at in ((used & hit, 1.02 + lift), (used & ~hit, -0.02 - lift)):
                ax.plot(size[of], np.full(of.sum(), at), "|", color=colour, markersize=6)
    if said["size_scale"] == "log":
        ax.set_xscale("log")
    reach = np.concatenate([size[size > 0], [1e3 * said["a90_95"]]])
    reach = reach[np.isfinite(reach)]
    ax.set_xlim(0.9 * reach.min(), 1.1 * reach.max())
    ax.set_ylim(-0.12, 1.12)
    ax.set_yticks(np.linspace(0.0, 1.0, 6))
    if said["size_scale"] == "log":
        ticks = [
            t
            for t in (0.5, 1, 2, 3, 5, 7, 10, 15, 20, 30, 50)
            if ax.get_xlim()[0] < t < ax.get_xlim()[1]
        ]
        ax.set_xticks(ticks, [f"{t:g}" for t in ticks])
        ax.set_xticks([], minor=True)
    ax.set_xlabel("Object size [mm]")
    ax.set_ylabel("Probability of detection [-]")
    _style(ax)
    ax.legend(fontsize=8, loc="center right")


def _style(ax: "Axes") -> None:
    ax.grid(visible=True, color="0.88", linewidth=0.6)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
