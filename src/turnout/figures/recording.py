"""Recordings over time: the columns as they were recorded, or forces and currents made of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.errors import ResponseError
from turnout.figures.sheet import thinned
from turnout.figures.style import COLOURS, COMPARED, DASHES, KILO, new_figure, put_title, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# More points than these are thinned, their peaks kept.
MOST_POINTS = 8000
MOST_ROWS = 16


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """A line to draw: its label and unit, times [s] and values."""

    label: str
    unit: str
    time: NDArray[np.float64]
    values: NDArray[np.float64]


def plot_columns(traces: Sequence[Trace], *, title: str = "") -> "Figure":
    """Draw the columns of a recording, each on axes of its own.

    Parameters
    ----------
    traces : sequence of Trace
        In the order of the file; those after the sixteenth are omitted, as the title states.
    title : str
        Of the figure.

    Returns
    -------
    matplotlib.figure.Figure
        Stacked axes that share time.
    """
    if not traces:
        message = "nothing to draw: there are no channels"
        raise ResponseError(message)
    shown = traces[:MOST_ROWS]
    figure, axes = new_figure(len(shown))
    span = _span(shown)
    for number, (ax, trace) in enumerate(zip(axes, shown, strict=True)):
        _line(ax, trace, colour=COLOURS[number % (len(COLOURS) - 1)])
        styled(ax, f"{trace.label}\n[{trace.unit or '-'}]", span=span)
        _fit(ax, trace.values)
    axes[-1].set_xlabel("Time [s]")
    figure.align_ylabels(axes)
    left = len(traces) - len(shown)
    put_title(figure, f"{title}{f' (and {left} more channels)' if left else ''}")
    return figure


def plot_measured(dataset: xr.Dataset, *, title: str = "") -> "Figure":
    """Draw measured forces [kN], currents [A] and powers [W], unfiltered values in grey behind.

    Parameters
    ----------
    dataset : xarray.Dataset
        In schema terms; channels that it lacks, or that are NaN throughout, are left out.
    title : str
        Of the figure.

    Returns
    -------
    matplotlib.figure.Figure
        Stacked axes that share time.
    """
    rows = [
        ("Drive force\non rail [kN]", _of_drives(dataset, "drive_force", KILO)),
        ("Motor current\n[A]", _of_drives(dataset, "drive_current", 1.0)),
        ("Motor power\n[W]", _of_drives(dataset, "drive_power", 1.0)),
        ("Object force\n[kN]", _of_object(dataset)),
    ]
    rows = [(label, traces) for label, traces in rows if traces]
    if not rows:
        message = "nothing to draw: the dataset has no force, current or power"
        raise ResponseError(message)
    figure, axes = new_figure(len(rows))
    for ax, (label, traces) in zip(axes, rows, strict=True):
        for number, (trace, before) in enumerate(traces):
            if before is not None:
                before_label = "unfiltered" if number == len(traces) - 1 else None
                _line(ax, before, colour=COMPARED, width=0.6, label=before_label)
            place = -1 if label.startswith("Object") else number % (len(COLOURS) - 1)
            _line(ax, trace, colour=COLOURS[place], dash=DASHES[place], label=trace.label)
        styled(ax, label, span=_span([trace for trace, _ in traces]))
        ax.legend(loc="center left", bbox_to_anchor=(1.005, 0.5), frameon=False)
    axes[-1].set_xlabel("Time [s]")
    figure.align_ylabels(axes)
    put_title(figure, title or str(dataset.attrs.get("title", "")))
    return figure


Pair = tuple[Trace, Trace | None]


def _of_drives(dataset: xr.Dataset, name: str, factor: float) -> list[Pair]:
    if name not in dataset:
        return []
    pairs = []
    for drive in dataset["drive"].values:
        pair = _pair(dataset.sel(drive=drive), name, f"Drive {drive}", factor)
        if pair is not None:
            pairs.append(pair)
    return pairs


def _of_object(dataset: xr.Dataset) -> list[Pair]:
    pair = _pair(dataset, "object_force", "Object", KILO) if "object_force" in dataset else None
    return [pair] if pair is not None else []


def _pair(dataset: xr.Dataset, name: str, label: str, factor: float) -> Pair | None:
    """Return a channel and its values before filtering; None if it is NaN throughout."""
    time, values = dataset["time"].values, dataset[name].values * factor
    if not np.isfinite(values).any():
        return None
    kept = f"{name}_unfiltered"
    before = Trace(label, "", time, dataset[kept].values * factor) if kept in dataset else None
    return Trace(label, "", time, values), before


def _span(traces: Sequence[Trace]) -> tuple[float, float]:
    first = min(float(trace.time[0]) for trace in traces)
    last = max(float(trace.time[-1]) for trace in traces)
    return first, last if last > first else first + 1.0


def _fit(ax: "Axes", values: NDArray[np.float64]) -> None:
    """Fill the axes with a raw column, which may stand far from zero."""
    there = values[np.isfinite(values)]
    if there.size and np.ptp(there) > 0:
        least, largest = float(there.min()), float(there.max())
        room = 0.06 * (largest - least)
        ax.set_ylim(least - room, largest + room)


def _line(
    ax: "Axes",
    trace: Trace,
    *,
    colour: str,
    width: float = 1.1,
    dash: str | tuple[int, tuple[float, ...]] = "-",
    label: str | None = None,
) -> None:
    time, values = thinned(trace.time, trace.values, most=MOST_POINTS)
    ax.plot(time, values, color=colour, linewidth=width, linestyle=dash, label=label)
