"""Channels of a campaign over time, a line for each object size at one place, as a sheet."""

import numpy as np
import xarray as xr

from turnout.errors import ResponseError
from turnout.plot.campaign import (
    channel_rows,
    chosen_movements,
    shown_span,
    size_label,
)
from turnout.plot.rail_sheet import shade_of
from turnout.plot.sheet import Line, Row, Sheet

INK = 6


def stacked_sheet(dataset: xr.Dataset, *, place: str, direction: str) -> Sheet:
    """Return what `plot_stacked` draws.

    Parameters
    ----------
    dataset : xarray.Dataset
        Dimensions movement and time, measured or simulated.
    place : str
        Such as "sleeper 6".
    direction : str
        "closing" or "opening".

    Raises
    ------
    ResponseError
        When nothing was thrown at that place, or nothing was measured.
    """
    chosen = chosen_movements(dataset, place=place, direction=direction)
    rows = channel_rows(chosen)
    if not rows:
        message = "nothing to draw: the dataset has no forces and no currents"
        raise ResponseError(message)
    first, last = shown_span(chosen, rows)
    time = chosen["time"].values
    within = (time >= first) & (time <= last)
    sizes = chosen["size"].values
    objects = np.sort(sizes[sizes > 0])

    def line(number: int, values: np.ndarray) -> Line:
        size = float(sizes[number])
        share = float(np.searchsorted(objects, size)) / max(1, objects.size - 1)
        return Line(
            label=size_label(chosen, number),
            x=time[within],
            y=values[within],
            colour=INK if size == 0 else shade_of(share),
            width=1.5 if size == 0 else 1.1,
        )

    return Sheet(
        name=f"{place.replace(' ', '-')}-{direction}",
        title=f"Object at {place}, {direction}",
        caption="A line for each object size; black without an object. Time counts from the onset "
        "of motion.",
        x_label="Time since onset of motion [s]",
        one_legend=True,
        rows=tuple(
            Row(
                row.label,
                tuple(
                    line(number, row.channel.isel(movement=number).values * row.factor)
                    for number in range(sizes.size)
                    if np.isfinite(row.channel.isel(movement=number).values).any()
                ),
            )
            for row in rows
        ),
    )
