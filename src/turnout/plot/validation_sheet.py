"""Measured and predicted forces of a place over time, with the band of 95 %, as a sheet."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from turnout.plot.sheet import Line, Row, Sheet
from turnout.plot.validation import compared_movements

KILO, MILLI = 1e-3, 1e3
INK, DASHED, DOTTED = 6, 1, 3


def comparison_sheet(validation: xr.Dataset, *, place: str, sizes: Sequence[float] = ()) -> Sheet:
    """Return what `plot_comparison` draws, the ends of a band as dotted lines.

    Parameters
    ----------
    validation : xarray.Dataset
        `measured`, `predicted`, `low`, `high` (channel, movement, time) [N].
    place : str
        Such as "sleeper 6".
    sizes : sequence of float, optional
        Of the objects [m]; default as `plot_comparison`.

    Raises
    ------
    ResponseError
        When nothing was thrown at that place.
    """
    chosen = compared_movements(validation, place=place, sizes=sizes)
    rows = []
    for name in chosen["channel"].values:
        one = chosen.sel(channel=name)
        if np.isfinite(one["measured"].values).any():
            lines = [
                line for number in range(one.sizes["movement"]) for line in _lines(one, number)
            ]
            rows.append(Row(f"{str(name).capitalize()}\nforce [kN]", tuple(lines)))
    return Sheet(
        name=f"compared-{place.replace(' ', '-')}",
        title=f"Object at {place}: measured, and predicted with the band of 95 %",
        caption="Coloured: predicted; dotted: between these 95 % of measurements should lie; "
        "black: measured.",
        x_label="Time since onset of motion [s]",
        rows=tuple(rows),
        one_legend=True,
    )


def _lines(one: xr.Dataset, number: int) -> list[Line]:
    part = one.isel(movement=number)
    size = float(part["size"])
    what = f"{size * MILLI:g} mm" if size > 0 else "no object"
    what += " (used for the fit)" if bool(part["used"]) else ""
    time = part["time"].values

    def line(values: str, label: str, *, colour: int, dash: int, width: float = 1.3) -> Line:
        y = part[values].values * KILO
        return Line(label=label, x=time, y=y, colour=colour, dash=dash, width=width)

    found = [line("predicted", f"predicted, {what}", colour=number, dash=0, width=1.6)]
    found += [
        line(end, f"band, {what}: {end}", colour=number, dash=DOTTED, width=0.7)
        for end in ("low", "high")
    ]
    dash = 0 if number == 0 else DASHED
    return [*found, line("measured", f"measured, {what}", colour=INK, dash=dash, width=1.0)]
