"""Shapes of modes in plan and elevation, one above the other."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from turnout.core.errors import ResponseError
from turnout.figures.style import COLOURS, DASHES, GREY, put_title

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HEIGHT_OF_HEAD = 0.1  # m, where the twist of a rail shows
AMPLITUDE = 0.42  # of the distance between two modes


def plot_modes(
    dataset: xr.Dataset,
    *,
    system: str | None = None,
    ax: "Sequence[Axes] | None" = None,
) -> "Figure":
    """Draw the shapes of one system: plan (lateral) beside elevation (vertical).

    Parameters
    ----------
    dataset : xarray.Dataset
        From `turnout.modes`.
    system : str, optional
        Which system; default the panel at rest, which is the last but for the sticking one.
    ax : sequence of two Axes, optional
        Axes of plan and elevation; default a new figure.

    Returns
    -------
    matplotlib.figure.Figure
        Each mode on a line of its own, labelled with its frequency and damping. In the plan the
        foot is a full line and the head, 100 mm above it, a thin one: where they part the rail
        turns. All displacements of a mode have one scale.
    """
    names = list(dict.fromkeys(dataset["system"].values.tolist()))
    if system is None:
        resting = [name for name in names if name.startswith("panel at rest")]
        system = (resting or names)[0]
    if system not in names:
        known = ", ".join(f"'{name}'" for name in names)
        message = f"there are no modes of '{system}'; there are those of {known}"
        raise ResponseError(message)
    chosen = dataset.isel(mode=dataset["system"].values == system)
    figure, plan, elevation = _axes(chosen.sizes["mode"], ax)
    for at in range(chosen.sizes["mode"]):
        _draw(plan, elevation, chosen.isel(mode=at), -float(at))
    ticks = -np.arange(chosen.sizes["mode"], dtype=float)
    labels = [_label(chosen.isel(mode=at)) for at in range(chosen.sizes["mode"])]
    for axes, title in (
        (plan, "Plan: foot full, head thin"),
        (elevation, "Elevation: foot"),
    ):
        axes.set_title(title, fontsize=9, loc="left")
        axes.set_xlabel("x from the toe [m]")
        axes.set_yticks(ticks, labels if axes is plan else [""] * len(labels))
        axes.set_ylim(ticks[-1] - 0.6, 0.6)
        axes.set_xlim(float(dataset["x"][0]), float(dataset["x"][-1]))
        axes.grid(visible=True, axis="x", color="0.85", linewidth=0.6)
        axes.spines[["top", "right", "left"]].set_visible(False)
        axes.tick_params(axis="y", length=0)
    handles, names = plan.get_legend_handles_labels()
    legend = dict(zip(names, handles, strict=True))
    if ax is not None:
        elevation.legend(legend.values(), legend.keys(), loc="upper right", frameon=False)
    else:
        figure.legend(
            legend.values(),
            legend.keys(),
            loc="outside lower center",
            ncols=len(legend),
            frameon=False,
        )
        panel = dataset.attrs.get("panel", "panel")
        put_title(figure, f"{panel}: {system}")
    return figure


def _axes(count: int, ax: "Sequence[Axes] | None") -> "tuple[Figure, Axes, Axes]":
    if ax is not None:
        plan, elevation = ax
        return plan.figure, plan, elevation  # type: ignore[return-value]
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 0.75 * count + 1.6), layout="constrained")
    FigureCanvasAgg(figure)
    plan, elevation = figure.subplots(1, 2)
    return figure, plan, elevation


def _draw(plan: "Axes", elevation: "Axes", mode: xr.Dataset, base: float) -> None:
    """Draw one mode on its base line."""
    for axes in (plan, elevation):
        axes.axhline(base, color=GREY, linewidth=0.4, zorder=1)
    shape = mode["shape"]
    for number, rail in enumerate(shape["rail"].values):
        moved = shape.sel(rail=rail)
        x = shape["x"].values[np.isfinite(moved.sel(direction="uy").values)]
        if not x.size:
            continue
        moved = moved.sel(x=x)
        colour, dash = COLOURS[number % len(COLOURS)], DASHES[number % len(DASHES)]
        foot = moved.sel(direction="uy").values
        head = foot - HEIGHT_OF_HEAD * moved.sel(direction="rx").values
        rise = moved.sel(direction="uz").values
        for axes, values, width, label in (
            (plan, head, 0.6, None),
            (plan, foot, 1.4, str(rail)),
            (elevation, rise, 1.4, None),
        ):
            axes.plot(
                x,
                base + AMPLITUDE * values,
                color=colour,
                linestyle=dash,
                linewidth=width,
                label=label,
            )


def _label(mode: xr.Dataset) -> str:
    frequency, damping = float(mode["frequency"]), 100.0 * float(mode["damping_ratio"])
    if not np.isfinite(damping):
        return f"{int(mode['number'])}:  rigid body"
    return f"{int(mode['number'])}:  {frequency:.2f} Hz\n{damping:.1f} %"
