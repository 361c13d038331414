"""What a grid search tried, over the measurement."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from turnout.plot.style import COLOURS, DASHES, new_figure, put_title, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

KILO = 1e-3
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
    title = f"{curves.attrs['parameter']} against {curves.attrs['movement']}"
    put_title(figure, title)
    return figure


def _shown(curves: xr.Dataset) -> list[int]:
    """Return which values are drawn: the best, the ends, and what is between."""
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
        text = f"{value:g}" if unit == "1" else f"{value:g} {unit}"
        if value >= 1e4:
            text = f"{KILO * value:g} k{unit}"
        ax.plot(
            time,
            KILO * simulated[number],
            color=COLOURS[place % len(COLOURS)],
            linestyle=DASHES[place % len(DASHES)],
            linewidth=1.8 if number == best else 1.1,
            label=f"{text} (best)" if number == best else text,
        )
