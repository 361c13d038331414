"""A throw of a machine on a one-mass rail: current, speed, force, positions, clutch."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from turnout.figures.style import COLOURS, COMPARED, DASHES, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ROWS: tuple[tuple[str, tuple[tuple[str, str, float], ...]], ...] = (
    ("Current [A]", (("current", "", 1.0),)),
    ("Shaft speed\n[rad/s]", (("speed", "motor", 1.0), ("gear_speed", "behind the clutch", 1.0))),
    ("Rod force [kN]", (("rod_force", "", 1e-3),)),
    ("Position [mm]", (("rod_position", "rod", 1e3), ("rail_position", "rail", 1e3))),
    ("Clutch torque\n[N m]", (("clutch_torque", "", 1.0),)),
)
SHARED_LABEL_TIME = 0.05
"""Events nearer to each other than this share of the time share a text."""


def plot_machine(dataset: xr.Dataset) -> "Figure":
    """Draw a throw of a machine over time; dotted lines are its events.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `turnout.throw.machine.machine_dataset`.

    Returns
    -------
    matplotlib.figure.Figure
        Stacked axes that share time.
    """
    figure, axes = new_figure(len(ROWS))
    time = dataset["time"].values
    span = (float(time[0]), float(time[-1]))
    for ax, (label, lines) in zip(axes, ROWS, strict=True):
        for number, (name, text, factor) in enumerate(lines):
            values, colour = factor * dataset[name].values, COLOURS[number]
            ax.plot(time, values, label=text, color=colour, ls=DASHES[number], lw=1.2)
        styled(ax, label, span=span)
        for instant in np.unique(dataset["event_time"].values):
            ax.axvline(float(instant), color=COMPARED, linestyle=":", linewidth=0.8)
        if len(lines) > 1:
            ax.legend(loc="best", fontsize="small", frameon=False)
    _name_events(axes[0], dataset)
    axes[-1].set_xlabel("Time [s]")
    figure.align_ylabels(axes)
    title = f"{dataset.attrs['machine']}: {dataset.attrs['outcome']}"
    figure.suptitle(title, x=0.01, ha="left")
    return figure


def _name_events(ax: "Axes", dataset: xr.Dataset) -> None:
    """Write the events above the first axes; those near to each other share a text."""
    near = SHARED_LABEL_TIME * float(np.ptp(dataset["time"].values))
    texts: dict[float, str] = {}
    last = -np.inf
    for instant, text in zip(dataset["event_time"].values, dataset["event"].values, strict=True):
        if instant - last > near:
            last = float(instant)
        texts[last] = f"{texts[last]}, {text}" if last in texts else str(text)
    for instant, text in texts.items():
        ax.text(
            instant,
            1.02,
            text,
            transform=ax.get_xaxis_transform(),
            fontsize="small",
            rotation=12,
            rotation_mode="anchor",
        )
