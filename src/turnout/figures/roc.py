"""Detections against false alarms, with the limit of all detectors."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from turnout.figures.style import COLOURS, GREY, put_title

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEAST_ALARM_RATE = 1e-5
"""False-alarm rate at the start of the axis [-]."""
CHANCE = 0.05
"""Of no false alarm at the largest rate that is shown for none [-]."""


def plot_roc(
    *,
    false_alarms: NDArray[np.float64],
    detections: NDArray[np.float64],
    intervals: NDArray[np.float64],
    rate: NDArray[np.float64],
    bound: NDArray[np.float64],
    sound: int,
    title: str,
) -> "Figure":
    """Draw the curve of a detector and that of the bound.

    Parameters
    ----------
    false_alarms, detections : ndarray, shape (n_points,)
        Shares of the detector [-].
    intervals : ndarray, shape (n_points, 2)
        95 % of the detections [-].
    rate, bound : ndarray, shape (n_rates,)
        Of the bound [-].
    sound : int
        Sound throws of the detector.
    title : str
        Heading, with the kind of throws.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.8), layout="constrained")
    FigureCanvasAgg(figure)
    ax = figure.subplots()
    ax.plot(rate, bound, color="black", label="bound: place, size and signature known")
    ax.fill_between(rate, bound, 1.0, facecolor="white", edgecolor=GREY, hatch="///",
                    linewidth=0.0, label="out of reach")  # fmt: skip
    resolved = false_alarms > 0.0
    at = np.where(resolved, false_alarms, LEAST_ALARM_RATE)
    ax.plot(at[resolved], detections[resolved], "o-", color=COLOURS[0], markersize=3,
            label="detector, 95 % of its detections")  # fmt: skip
    ax.fill_between(at[resolved], *intervals[resolved].T, color=COLOURS[0], alpha=0.2, linewidth=0)
    if (~resolved).any():
        best = int(np.flatnonzero(~resolved)[np.argmax(detections[~resolved])])
        most = 1.0 - CHANCE ** (1.0 / sound)
        ax.plot([LEAST_ALARM_RATE, most], [detections[best]] * 2, ":", color=COLOURS[0],
                label=f"no false alarm in {sound}: anywhere up to {most:.2g}")  # fmt: skip
        ax.plot(most, detections[best], "|", color=COLOURS[0])
    ax.set_xscale("log")
    ax.set_xlim(0.8 * LEAST_ALARM_RATE, 1.0)
    ax.set_ylim(0.0, 1.02)
    ax.set_xlabel("False alarms, share of sound throws [-]")
    ax.set_ylabel("Detected, share of throws with objects [-]")
    ax.grid(visible=True, color="0.88", linewidth=0.6)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(fontsize=8, loc="lower right")
    put_title(figure, title)
    return figure
