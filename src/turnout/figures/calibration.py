"""Figures of a calibration: misfits of a grid search, fitted forces, values with intervals."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.errors import ResponseError
from turnout.core.value_text import value_text
from turnout.figures.draw import draw_sheet
from turnout.figures.sheet import Line, Row, Sheet
from turnout.figures.style import COLOURS, DASHES, GREY, KILO, new_figure, put_title, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]
# A correlation beyond which the square is so dark that its number is white [-].
DARK = 0.6
# More lines than this are unreadable; the best and evenly spread ones are drawn.
MOST_VALUES = 5


def plot_sweep(curves: xr.Dataset) -> "Figure":
    """Draw simulated signals at the values of a grid over the measured ones.

    Parameters
    ----------
    curves : xarray.Dataset
        `drive_force` (value, drive, time), `measured_drive_force` (drive, time), and the same of
        `object_force` where a load cell was mounted [N]; `misfit` (value) as share of the range.
        Attributes: `parameter`, `unit`, `movement`.

    Returns
    -------
    matplotlib.figure.Figure
        A row for each force [kN]; the measurement is black and wide, the best value is marked.
    """
    drives = [str(name) for name in curves["drive"].values]
    loaded = "measured_object_force" in curves
    figure, axes = new_figure(len(drives) + loaded)
    shown = _shown(curves)
    time = curves["time"].values
    rows = [
        (
            f"Drive {name} [kN]",
            curves["measured_drive_force"].sel(drive=name).values,
            curves["drive_force"].sel(drive=name).values,
        )
        for name in drives
    ]
    if loaded:
        rows.append(
            ("Object [kN]", curves["measured_object_force"].values, curves["object_force"].values)
        )
    for ax, (label, measured, simulated) in zip(axes, rows, strict=True):
        ax.plot(time, KILO * measured, color="black", linewidth=2.6, alpha=0.75, label="measured")
        _draw(ax, time, simulated, curves, shown)
        styled(ax, label, span=(float(time[0]), float(time[-1])))
    axes[0].legend(loc="center left", bbox_to_anchor=(1.005, 0.5), frameon=False)
    axes[-1].set_xlabel("Time from the onset [s]")
    figure.align_ylabels(axes)
    title = f"{curves.attrs['parameter']} tried on {curves.attrs['movement']}"
    put_title(figure, title)
    return figure


def _shown(curves: xr.Dataset) -> list[int]:
    """Return the indices of the values to draw: the best, the ends, and some between them."""
    count = curves.sizes["value"]
    best = int(np.argmin(curves["misfit"].values))
    spread = np.linspace(0, count - 1, min(count, MOST_VALUES - 1)).round().astype(int).tolist()
    return sorted({best, *spread}) if count > MOST_VALUES else list(range(count))


def _draw(
    ax: "Axes", time: np.ndarray, simulated: np.ndarray, curves: xr.Dataset, shown: list[int]
) -> None:
    best = int(np.argmin(curves["misfit"].values))
    unit = curves.attrs["unit"]
    for place, number in enumerate(shown):
        value = float(curves["value"].values[number])
        text = value_text(value, unit=unit, digits=4)
        ax.plot(
            time,
            KILO * simulated[number],
            color=COLOURS[place % len(COLOURS)],
            linestyle=DASHES[place % len(DASHES)],
            linewidth=1.8 if number == best else 1.1,
            label=f"{text} (best)" if number == best else text,
        )


PERCENT = 100.0


def plot_intervals(dataset: xr.Dataset, *, ax: "Axes | None" = None) -> "Axes":
    """Draw fitted parameters with their 95 % intervals, relative to their start values.

    Parameters
    ----------
    dataset : xarray.Dataset
        `value`, `low`, `high` and `start` by parameter, in SI.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; default a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        A line a parameter; the dotted line is the start.

    Raises
    ------
    ResponseError
        When there is no parameter.

    Examples
    --------
    >>> rows = {"value": 0.31, "low": 0.3, "high": 0.32, "start": 0.3}
    >>> known = xr.Dataset({name: ("parameter", [value]) for name, value in rows.items()})
    >>> plot_intervals(known.assign_coords(parameter=["friction"])).get_xlabel()
    'Change from the start value [%]'
    """
    count = dataset.sizes["parameter"]
    if not count:
        message = "nothing to draw: no parameter was fitted"
        raise ResponseError(message)
    if ax is None:
        figure, (ax,) = new_figure(1)
        figure.set_figheight(1.2 + 0.35 * count)
    start = dataset["start"].to_numpy()
    scale = np.where(start != 0, abs(start), abs(dataset["value"].to_numpy()))
    value, low, high = (
        PERCENT * (dataset[name].to_numpy() - start) / scale for name in ("value", "low", "high")
    )
    places = -np.arange(count, dtype=float)
    ax.errorbar(
        value, places, xerr=(value - low, high - value), fmt="o", color=COLOURS[0], capsize=4
    )
    ax.axvline(0.0, color=GREY, linewidth=0.8, linestyle=":")
    ax.set_yticks(places, [str(name) for name in dataset["parameter"].values])
    ax.set_ylim(places[-1] - 0.6, 0.6)
    ax.set_xlabel("Change from the start value [%]")
    ax.grid(visible=True, axis="x", color="0.85", linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
    ax.set_title(str(dataset.attrs.get("title", "")), loc="left", fontsize=11)
    return ax


# Measured lines are wide and light, so that a fitted one on top of them leaves both to be seen.
MEASURED_COLOUR, MEASURED_WIDTH = "#9e9e9e", 4.5


def fit_sheet(signals: xr.Dataset, movement: str) -> Sheet:
    """Return measured and fitted forces of a movement, and their differences.

    Parameters
    ----------
    signals : xarray.Dataset
        `measured`, `fitted`, `residual` (movement, channel, time) [N].
    movement : str
        Which one.

    Returns
    -------
    Sheet
        Two rows a channel: forces [kN], then the residual [N] with its root mean square.

    Raises
    ------
    ResponseError
        When the movement was not compared.
    """
    one = signals.sel(movement=movement)
    rows: list[Row] = []
    for name in (str(name) for name in one["channel"].values):
        channel = one.sel(channel=name)
        measured = channel["measured"].to_numpy()
        known = np.flatnonzero(np.isfinite(measured))
        if not known.size:
            continue
        part = slice(int(known[0]), int(known[-1]) + 1)
        time, rest = one["time"].to_numpy()[part], channel["residual"].to_numpy()[part]
        forces = (
            Line(
                label="measured",
                x=time,
                y=KILO * measured[part],
                colour=MEASURED_COLOUR,
                width=MEASURED_WIDTH,
            ),
            Line(label="fitted", x=time, y=KILO * channel["fitted"].to_numpy()[part]),
        )
        rms = float(np.sqrt(np.nanmean(rest**2)))
        left = Line(label=f"RMS {rms:.2g} N", x=time, y=rest, colour=1, width=1.0)
        rows += [Row(f"{name} [kN]", forces), Row("Residual [N]", (left,))]
    if not rows:
        message = f"nothing to draw: {movement} was not compared"
        raise ResponseError(message)
    number = [str(name) for name in signals["movement"].values].index(movement)
    return Sheet(
        name=f"fit-{number + 1}",
        title=str(signals.attrs["texts"][number]),
        caption="Fitted with onset, friction, zeros and gains of this movement; means over 20 ms.",
        x_label="Time from the onset [s]",
        rows=tuple(rows),
    )


def plot_fit(signals: xr.Dataset, movement: str) -> "Figure":
    """Draw the sheet of `fit_sheet`."""
    return draw_sheet(fit_sheet(signals, movement))


def plot_correlations(names: Sequence[str], correlation: Floats) -> "Figure":
    """Draw the correlations of fitted values as coloured squares with their numbers.

    Parameters
    ----------
    names : sequence of str
        Of the values.
    correlation : ndarray, shape (p, p)
        Between -1 and 1 [-].

    Returns
    -------
    matplotlib.figure.Figure
    """
    if not names:
        message = "nothing to draw: no parameter was fitted"
        raise ResponseError(message)
    figure, (ax,) = new_figure(1)
    figure.set_size_inches(3.6 + 0.75 * len(names), 1.2 + 0.55 * len(names))
    ax.imshow(correlation, cmap="RdBu_r", vmin=-1.0, vmax=1.0, aspect="auto")
    for (row, column), value in np.ndenumerate(correlation):
        ink = "white" if abs(value) > DARK else "black"
        ax.text(column, row, f"{value:+.2f}", ha="center", va="center", color=ink, fontsize=8)
    numbers = [str(number + 1) for number in range(len(names))]
    ax.set_xticks(range(len(names)), numbers)
    labels = [f"{number} {name}" for number, name in zip(numbers, names, strict=True)]
    ax.set_yticks(range(len(names)), labels)
    put_title(figure, "Correlations of the fitted values")
    return figure
