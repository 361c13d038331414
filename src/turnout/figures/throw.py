"""Figures of one throw over time: forces, markers, gaps, energy.

Object force, drive forces, markers and gaps as stacked axes; energies as a sheet.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from turnout.core.errors import ResponseError
from turnout.figures.style import (
    COLOURS,
    COMPARED,
    DASHES,
    GREY,
    KILO,
    MILLI,
    SHADE,
    new_figure,
    put_title,
    styled,
    title_of,
)
from turnout.throw.slip import Slip, Span, movements, slips

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


MEAN = 0.1  # of currents, as published [s]


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """One line: values in the units of its axes, its label and its place among the colours."""

    label: str
    values: np.ndarray
    colour: int


def plot_throw(
    dataset: xr.Dataset,
    *,
    compare: xr.Dataset | None = None,
    overlay: xr.Dataset | None = None,
) -> "Figure":
    """Draw a run over time, as the published figures do.

    Parameters
    ----------
    dataset : xarray.Dataset
        Simulated or measured; channels that it lacks are left out.
    compare : xarray.Dataset, optional
        A second run, drawn thin and grey behind the first.
    overlay : xarray.Dataset, optional
        The same throw by another program, drawn wide and pale under the lines that it should
        meet; the legend calls it by ``attrs["title"]``.

    Returns
    -------
    matplotlib.figure.Figure
        Stacked axes that share time: object force, drive forces [kN], marker displacements and
        gaps [mm]. Movements are shaded, the first contact and slips are marked, the saturation
        force is dashed.

    Raises
    ------
    ResponseError
        When there is nothing to draw, or the overlay has a drive or sensor that the run has not.
    """
    if "throw" in dataset.dims:
        message = "a sequence of throws is drawn throw by throw: dataset.isel(throw=0), ..."
        raise ResponseError(message)
    under = _under(dataset, overlay) if overlay is not None else {}
    rows = [(label, curves) for label, curves in throw_rows(dataset) if curves or under.get(label)]
    if not rows:
        message = "nothing to draw: the dataset has no forces, displacements or gaps"
        raise ResponseError(message)
    behind = dict(throw_rows(compare)) if compare is not None else {}
    figure, axes = new_figure(len(rows))
    time = dataset["time"].values
    for ax, (label, curves) in zip(axes, rows, strict=True):
        for curve in behind.get(label, []) if compare is not None else []:
            _draw(ax, compare["time"].values, curve, behind=True)  # type: ignore[index]
        for curve in curves:
            _draw(ax, time, curve, behind=False)
        for curve in under.get(label, []) if overlay is not None else []:
            _draw_under(ax, overlay["time"].values, curve)  # type: ignore[index]
        styled(ax, label, span=(float(time[0]), float(time[-1])))
        _shade(ax, dataset)
        if "drive_force" in dataset and label.startswith("Drive force"):
            _saturation(ax, dataset)
            _slips(ax, dataset)
        if label.startswith("Object"):
            _contact(ax, dataset)
        ax.legend(loc="center left", bbox_to_anchor=(1.005, 0.5), frameon=False)
    _name_movements(axes[0], dataset)
    axes[-1].set_xlabel("Time [s]")
    figure.align_ylabels(axes)
    put_title(figure, title_of(dataset, compare))
    return figure


def _under(dataset: xr.Dataset, overlay: xr.Dataset) -> dict[str, list[Curve]]:
    """Return the curves of an overlay, in the colours of the run and with its own name."""
    problems = [
        f"{family} '{name}' is not in the run, which has {', '.join(map(str, known))}"
        for family in ("drive", "sensor")
        if family in overlay.coords
        for known in [dataset[family].values.tolist() if family in dataset.coords else ["none"]]
        for name in overlay[family].values.tolist()
        if name not in known
    ]
    title = overlay.attrs.get("title", "overlay")
    if problems:
        message = f"overlay {title}: " + "; ".join(problems)
        raise ResponseError(message)
    full = overlay.reindex(
        {
            family: dataset[family].values
            for family in ("drive", "sensor")
            if family in overlay.coords
        }
    )
    ours = {
        (row, curve.label): curve.colour for row, curves in throw_rows(dataset) for curve in curves
    }
    return {
        label: [
            Curve(
                f"{curve.label},\n{title}",
                curve.values,
                ours.get((label, curve.label), curve.colour),
            )
            for curve in curves
            if np.isfinite(curve.values).any()
        ]
        for label, curves in throw_rows(full)
    }


def throw_rows(dataset: xr.Dataset) -> list[tuple[str, list[Curve]]]:
    """Return label and curves of each of the stacked axes, in screen units, some without any."""
    forces = _of_drives(dataset, "drive_force", KILO)
    objects = []
    if "object_force" in dataset and dataset.attrs.get("foreign_objects", "") != "[]":
        objects = [Curve("Object", dataset["object_force"].values * KILO, len(COLOURS) - 1)]
    gaps = [
        Curve(f"{curve.label}\n(closing rail)", _torn(curve.values, dataset), curve.colour)
        for curve in _of_drives(dataset, "drive_gap", MILLI)
    ]
    if "sensor_gap" in dataset:
        for number, name in enumerate(dataset["sensor"].values, start=len(gaps)):
            values = dataset["sensor_gap"].sel(sensor=name).values * MILLI
            gaps.append(Curve(str(name), values, number))
    measured = dataset.attrs.get("kind") == "measurement"
    powers = _of_drives(dataset, "drive_power", 1.0)  # of machines, which have currents then
    currents = _of_drives(dataset, "drive_current", 1.0) if powers or measured else []
    if not measured:
        powers, currents = ([_averaged(c, dataset) for c in of] for of in (powers, currents))
    place = "Rod end\nposition [mm]" if powers else "Marker\nposition [mm]"
    return [
        ("Object force\n[kN]", objects),
        ("Drive force\non rail [kN]", forces),
        ("Motor current,\n0.1 s mean [A]", currents),
        ("Power drawn,\n0.1 s mean [W]", powers),
        (place, _of_drives(dataset, "drive_displacement", MILLI)),
        ("Gap to stock\nrail [mm]", gaps),
    ]


def _of_drives(dataset: xr.Dataset, channel: str, factor: float) -> list[Curve]:
    if channel not in dataset:
        return []
    rows = factor * dataset[channel].transpose("drive", ...)
    kept = [(n, row) for n, row in enumerate(rows) if row.notnull().any()]  # markers: no current
    return [Curve(f"Drive {row['drive'].item()}", row.values, n) for n, row in kept]


def _averaged(curve: Curve, dataset: xr.Dataset) -> Curve:
    """Return a curve as means over 0.1 s, as clamps show currents."""
    time = dataset["time"].values
    count = max(1, round(MEAN / (time[1] - time[0]))) if time.size > 1 else 1
    padded = np.pad(curve.values, (count // 2, count - 1 - count // 2), mode="edge")
    return replace(curve, values=np.convolve(padded, np.full(count, 1.0 / count), mode="valid"))


def _torn(values: np.ndarray, dataset: xr.Dataset) -> np.ndarray:
    """Tear a curve at the start of a movement, as the rail that should be closed changes there."""
    torn = values.copy()
    time = dataset["time"].values
    for span in movements(dataset):
        at = int(np.searchsorted(time, span.start - 1e-9))
        torn[at : at + 1] = np.nan
    return torn


def _draw(ax: "Axes", time: np.ndarray, curve: Curve, *, behind: bool) -> None:
    number = curve.colour % len(COLOURS)
    if behind:
        ax.plot(time, curve.values, color=COMPARED, linewidth=0.8, zorder=1.5)
        return
    ax.plot(
        time,
        curve.values,
        color=COLOURS[number],
        linestyle=DASHES[number],
        linewidth=1.3,
        label=curve.label,
    )


def _draw_under(ax: "Axes", time: np.ndarray, curve: Curve) -> None:
    """Draw a curve of the overlay: wide and pale, so that a line upon it stays visible."""
    ax.plot(
        time,
        curve.values,
        color=COLOURS[curve.colour % len(COLOURS)],
        linewidth=4.0,
        alpha=0.3,
        solid_capstyle="butt",
        label=curve.label,
        zorder=1.8,
    )


def shown_movements(dataset: xr.Dataset) -> list[tuple[Span, float, float]]:
    """Return each movement with the part of it that lies within the time of a dataset."""
    first, last = float(dataset["time"][0]), float(dataset["time"][-1])
    parts = [(span, max(span.start, first), min(span.end, last)) for span in movements(dataset)]
    return [(span, start, end) for span, start, end in parts if start < end]


def _shade(ax: "Axes", dataset: xr.Dataset) -> None:
    """Shade the time in which markers move."""
    for _, start, end in shown_movements(dataset):
        ax.axvspan(start, end, color=SHADE, linewidth=0, zorder=0)


def _name_movements(ax: "Axes", dataset: xr.Dataset) -> None:
    for span, start, end in shown_movements(dataset):
        ax.annotate(
            f"{span.name} ({'closing' if span.to == 'closed' else 'opening'})",
            xy=(0.5 * (start + end), 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 2),
            textcoords="offset points",
            ha="center",
            va="bottom",
            color=GREY,
            fontsize=8,
        )


def _saturation(ax: "Axes", dataset: xr.Dataset) -> None:
    """Dash the saturation force of each drive if the axes come near it."""
    if "saturation_force" not in dataset.coords:
        return
    for limit in np.unique(dataset["saturation_force"].values) * KILO:
        for side in (-limit, limit):
            ax.axhline(side, color=GREY, linestyle=(0, (6, 3)), linewidth=0.8, zorder=1)
        ax.annotate(
            "slips",
            xy=(0.0, limit),
            xycoords=("axes fraction", "data"),
            xytext=(3, -2),
            textcoords="offset points",
            va="top",
            color=GREY,
            fontsize=7,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0},
        )


def _slips(ax: "Axes", dataset: xr.Dataset) -> None:
    """Mark the instants at which a drive reaches its saturation force."""
    if "drive_slipping" not in dataset:
        return
    names = [str(name) for name in dataset["drive"].values]
    found: list[Slip] = slips(dataset)
    for number, slip in enumerate(found):
        force = dataset["drive_force"].sel(drive=slip.drive).sel(time=slip.time, method="nearest")
        ax.plot(
            [slip.time],
            [float(force) * KILO],
            marker="v" if force > 0 else "^",
            color=COLOURS[names.index(slip.drive) % len(COLOURS)],
            markeredgecolor="black",
            markersize=7,
            linestyle="none",
            label="Slip begins" if number == 0 else None,
            zorder=5,
        )


def _contact(ax: "Axes", dataset: xr.Dataset) -> None:
    """Mark the first contact with a foreign object."""
    if "contact_time" not in dataset or np.isnan(float(dataset["contact_time"])):
        return
    when = float(dataset["contact_time"])
    ax.axvline(when, color="black", linewidth=0.8, linestyle=":")
    ax.annotate(
        f"first contact\n{when:.2f} s",
        xy=(when, 0.95),
        xycoords=("data", "axes fraction"),
        xytext=(-4, 0),
        textcoords="offset points",
        ha="right",
        va="top",
        fontsize=8,
    )
