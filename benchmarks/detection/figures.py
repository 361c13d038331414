"""Figures of the benchmark: detections against false alarms, and over the size of objects."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmarks.detection.data import Side
from benchmarks.detection.definition import HARD, MID_SPAN, SOUND
from benchmarks.detection.method import object_touched
from benchmarks.detection.metrics import roc_curve
from benchmarks.detection.score import KNOWN_PLACE
from benchmarks.detection.verdicts import read_verdicts
from turnout.figures.style import COLOURS, put_title

Floats = NDArray[np.float64]
LINES = ("-", "--", ":")
DIFFERENT = 6
"""First colours of the style, none of which is black."""
LEAST_RATE = 1e-4
"""False-alarm rate where the axis begins [-]."""


def plot_benchmark_roc(curves: Mapping[str, tuple[Floats, Floats]], *, title: str) -> Figure:
    """Draw detections against false alarms of several methods.

    Parameters
    ----------
    curves : mapping of str to (ndarray, ndarray)
        By method: shares of false alarms and of detections, rising [-].
    title : str
        What the throws were.
    """
    figure, ax = _figure()
    for number, (name, (false, seen)) in enumerate(curves.items()):
        ax.plot(np.maximum(false, LEAST_RATE), seen, label=name, drawstyle="steps-post",
                **_style(number, len(curves)))  # fmt: skip
    ax.axvline(1e-3, color="0.6", linewidth=0.8)
    ax.set_xscale("log")
    ax.set_xlim(LEAST_RATE, 1.0)
    ax.set_xlabel("False alarms, share of sound throws [-]")
    ax.set_ylabel("Detected, share of touched objects [-]")
    _name_lines(figure, ax)
    put_title(figure, title)
    return figure


def plot_benchmark_pod(
    size: Floats, curves: Mapping[str, Floats], *, title: str, bound: float | None = None
) -> Figure:
    """Draw the share of objects that is detected over their size.

    Parameters
    ----------
    size : ndarray, shape (n,)
        Middles of classes [m].
    curves : mapping of str to ndarray, shape (n,)
        Share by method [-]; NaN where a class is empty.
    title : str
        What the throws were.
    bound : float, optional
        a90 of the bound at a known place, mean over the places [m].
    """
    figure, ax = _figure()
    for number, (name, share) in enumerate(curves.items()):
        known = np.isfinite(share)
        ax.plot(1e3 * size[known], share[known], marker="o", markersize=3, label=name,
                **_style(number, len(curves)))  # fmt: skip
    ax.axhline(0.9, color="0.6", linewidth=0.8)
    if bound is not None:
        ax.plot([1e3 * bound], [0.9], "D", color="black", label="bound, place known")
    ax.set_xlim(0.0, 1e3 * float(size.max()) + 1.0)
    ax.set_xlabel("Size of the object [mm]")
    ax.set_ylabel("Detected, share of objects [-]")
    _name_lines(figure, ax)
    put_title(figure, title)
    return figure


def _figure() -> tuple[Figure, Axes]:
    figure = Figure(figsize=(9.0, 4.8), layout="constrained")
    FigureCanvasAgg(figure)
    ax = figure.subplots()
    ax.set_ylim(0.0, 1.02)
    ax.grid(visible=True, color="0.88", linewidth=0.6)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
    return figure, ax


def _name_lines(figure: Figure, ax: Axes) -> None:
    """Put the legend beside the axes."""
    figure.legend(*ax.get_legend_handles_labels(), fontsize=8, loc="outside right upper")


def _style(number: int, count: int) -> dict[str, Any]:
    """Return a line of its own for each method; the last one, this program's, is heavy."""
    if number == count - 1:
        return {"color": "black", "linewidth": 2.0}
    return {
        "color": COLOURS[number % DIFFERENT],
        "linestyle": LINES[number // DIFFERENT % len(LINES)],
        "linewidth": 1.3,
    }


EDGES = 1e-3 * np.array([1.0, 3.0, 5.0, 7.0, 9.0, 11.0, 13.0, 15.0, 17.5, 20.0, 23.0, 27.0, 31.0])
"""Of the classes of sizes [m]."""


def benchmark_curves(
    results: Mapping[str, Mapping[str, Any]], side: Side, place: Path
) -> tuple[dict[str, tuple[Floats, Floats]], Floats, dict[str, Floats]]:
    """Return curves over false alarms, middles of classes of sizes, and curves over size.

    Parameters
    ----------
    results : mapping of str to mapping
        Of the methods, by name.
    side : Side
        Judged test throws, of the same track.
    place : Path
        Folder with their verdict files.
    """
    sound, touched = side.labels["role"] == SOUND, object_touched(side)
    middle = np.isin(side.labels["place"], MID_SPAN) & np.isin(side.labels["kind"], HARD)
    which = np.digitize(side.labels["size"], EDGES) - 1
    roc, pod = {}, {}
    for name, result in results.items():
        verdicts = read_verdicts(place / f"{name}.csv", throws=side.throw, positions=side.positions)
        title = str(result["title"])
        roc[title] = roc_curve(verdicts.score[sound], verdicts.score[touched])
        share = []
        for number in range(len(EDGES) - 1):
            own = middle & (which == number)
            share.append(float(verdicts.alarm[own].mean()) if own.sum() >= LEAST_DRAWN else np.nan)
        pod[title] = np.array(share)
    return roc, 0.5 * (EDGES[1:] + EDGES[:-1]), pod


LEAST_DRAWN = 4
"""Objects in a class that is drawn."""


def bound_mid_span(history: int) -> float | None:
    """Return a90 of the bound at a known place, mean of sleepers 4 to 8 [m].

    Examples
    --------
    >>> round(1e3 * bound_mid_span(20), 2)
    9.62
    """
    found = KNOWN_PLACE.get(history)
    return None if found is None else 1e-3 * float(np.mean(found[4:9]))
