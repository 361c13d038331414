"""Sheets of one throw over time: forces, markers and gaps; energies."""

import numpy as np
import xarray as xr

from turnout.figures.sheet import Band, Level, Line, Moment, Row, Sheet
from turnout.figures.style import KILO, title_of
from turnout.figures.throw import shown_movements, throw_rows
from turnout.throw.slip import slips

ENERGIES = (
    ("work_markers", "Work of the drives"),
    ("energy_friction", "Lost to friction"),
    ("energy_damping", "Lost to dampers"),
    ("energy_strain", "Bent rails"),
    ("energy_contact", "Bushings and contacts"),
)


def throw_sheet(dataset: xr.Dataset, *, title: str | None = None) -> Sheet:
    """Return forces, markers and gaps of a run over time.

    Parameters
    ----------
    dataset : xarray.Dataset
        One movement or run, simulated or measured; channels that it lacks are left out.
    title : str, optional
        Panel, objects and outcome without one.

    Returns
    -------
    Sheet
        Rows as `plot_throw` draws them.
    """
    time = dataset["time"].values
    rows = []
    for label, curves in throw_rows(dataset):
        if not curves:
            continue
        lines = [
            Line(
                label=curve.label.replace("\n", " "),
                x=time,
                y=curve.values,
                colour=curve.colour,
                dash=curve.colour,
            )
            for curve in curves
        ]
        force = label.startswith("Drive force")
        marks = _slip_marks(dataset) if force else []
        rows.append(
            Row(label, (*lines, *marks), _slip_levels(dataset) if force else ()),
        )
    return Sheet(
        name="throw",
        title=title_of(dataset) if title is None else title,
        caption="Forces are those on the rail, positive in the closing direction; shaded is the "
        "time in which the drives are commanded to move.",
        x_label="Time [s]",
        rows=tuple(rows),
        bands=_bands(dataset),
        moments=_first_contact(dataset),
    )


def energy_sheet(dataset: xr.Dataset) -> Sheet:
    """Return the energy balance of a run.

    Parameters
    ----------
    dataset : xarray.Dataset
        A simulated run with energies.

    Returns
    -------
    Sheet
        Two rows: the large terms, and energy residual and numerical dissipation, in millijoules.
    """
    time = dataset["time"].values
    lines = tuple(
        Line(label=text, x=time, y=dataset[name].values, colour=number, dash=number)
        for number, (name, text) in enumerate(ENERGIES)
        if name in dataset
    )
    small = tuple(
        Line(label=text, x=time, y=1e3 * dataset[name].values, colour=number, dash=number)
        for number, (name, text) in enumerate(
            (("energy_numerical", "Numerical dissipation"), ("energy_residual", "Energy residual"))
        )
        if name in dataset
    )
    rows = [Row("Energy [J]", lines), Row("Energy [mJ]", small)]
    return Sheet(
        name="energy",
        title="Energy balance",
        caption="From the start of the run. The energy residual checks the program, the numerical "
        "dissipation checks the time step; both should be close to zero.",
        x_label="Time [s]",
        rows=tuple(row for row in rows if row.lines),
        bands=_bands(dataset),
    )


def _bands(dataset: xr.Dataset) -> tuple[Band, ...]:
    return tuple(
        Band(start, end, f"{span.name} ({'closing' if span.to == 'closed' else 'opening'})")
        for span, start, end in shown_movements(dataset)
    )


def _slip_levels(dataset: xr.Dataset) -> tuple[Level, ...]:
    """Return the forces at which a drive slips, if the dataset has them."""
    if "saturation_force" not in dataset.coords:
        return ()
    limits = np.unique(dataset["saturation_force"].values) * KILO
    return tuple(
        Level(float(side * limit), "slips" if side > 0 else "")
        for limit in limits
        for side in (1, -1)
    )


def _slip_marks(dataset: xr.Dataset) -> list[Line]:
    """Return a mark at the start of each drive's slip."""
    if "drive_slipping" not in dataset:
        return []
    names = [str(name) for name in dataset["drive"].values]
    marks = []
    for slip in slips(dataset):
        force = dataset["drive_force"].sel(drive=slip.drive).sel(time=slip.time, method="nearest")
        marks.append(
            Line(
                label=f"Drive {slip.drive} begins to slip",
                x=np.array([slip.time]),
                y=np.array([float(force) * KILO]),
                colour=names.index(slip.drive),
                style="marks",
                symbol="triangle down" if force > 0 else "triangle up",
            )
        )
    return marks


def _first_contact(dataset: xr.Dataset) -> tuple[Moment, ...]:
    if "contact_time" not in dataset or np.isnan(float(dataset["contact_time"])):
        return ()
    when = float(dataset["contact_time"])
    return (Moment(when, f"contact {when:.2f} s"),)
