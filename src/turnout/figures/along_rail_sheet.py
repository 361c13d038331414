"""Results along the rails, as sheets: gaps, shapes over time, chairs."""

import json
from typing import Any

import numpy as np
import xarray as xr

from turnout.figures.sheet import Level, Line, Moment, Row, Sheet
from turnout.figures.style import title_of
from turnout.figures.throw import shown_movements
from turnout.metric.panel_check import LEAST_LOAD

KILO, MILLI = 1e-3, 1e3
INSTANTS = 7
PLACE = "x from the toe [m]"


def shape_sheet(dataset: xr.Dataset, *, compare: xr.Dataset | None = None) -> Sheet:
    """Return the gap along each switch rail at the end of a run.

    Parameters
    ----------
    dataset : xarray.Dataset
        A run with gaps along the rails.
    compare : xarray.Dataset, optional
        A second run of the same panel, dashed, such as the one without an object.

    Returns
    -------
    Sheet
        The rail that should be closed above, the other one below it; then the gauge beside the
        closed rail, if the run has kept it.
    """
    closed = _closed_rail(dataset)
    rails = sorted(map(str, dataset["rail"].values), key=lambda rail: rail != closed)
    rows = []
    for rail in rails:
        lines = [_end_gap(dataset, rail, "at the end", colour=0)]
        if compare is not None:
            free = compare.attrs.get("foreign_objects") == "[]"
            text = "without an object" if free else "to compare"
            lines.append(_end_gap(compare, rail, text, colour=1))
        if rail == closed:
            lines += _marks(dataset)
        state = "closed" if rail == closed else "open"
        rows.append(Row(f"Gap of the\n{state} rail [mm]", tuple(lines), _limit(dataset, rail)))
    rows += [_gauge_row(dataset)] if "gauge" in dataset else []
    return Sheet(
        name="rail-shape",
        title=f"Gap along the rails at the end: {title_of(dataset)}",
        caption="The distance between switch rail and stock rail at contact height. An object "
        "holds the closed rail open around its place; each control contact (TKK) detects "
        "only the gap at its own place.",
        x_label=PLACE,
        rows=tuple(rows),
        moments=_drive_places(dataset),
    )


def gap_sheet(dataset: xr.Dataset, *, instants: int = INSTANTS) -> Sheet:
    """Return the gap along the closing rail at several instants.

    Parameters
    ----------
    dataset : xarray.Dataset
        A run with gaps along the rails.
    instants : int
        How many, evenly over the last movement; the end of the run is one more.

    Returns
    -------
    Sheet
        One row; later instants are darker.
    """
    rail = _closed_rail(dataset)
    first, last = _last_movement(dataset)
    times = [*np.linspace(first, last, instants), float(dataset["time"][-1])]
    lines = []
    for number, when in enumerate(times):
        there = dataset["gap"].sel(rail=rail).sel(time=when, method="nearest")
        lines.append(
            Line(
                label=f"t = {float(there['time']):.2f} s",
                x=dataset["x"].values,
                y=MILLI * there.values,
                colour=shade_of(number / (len(times) - 1)),
                dash=0 if number < len(times) - 1 else 1,
            )
        )
    return Sheet(
        name="gap-over-time",
        title=f"Gap along rail {rail} while it closes",
        caption="Each line is one instant. Clustered curves at a wide gap: the rail is blocked.",
        x_label=PLACE,
        rows=(Row("Gap [mm]", (*lines, *_marks(dataset))),),
        moments=_drive_places(dataset),
    )


def chair_sheet(dataset: xr.Dataset) -> Sheet:
    """Return the loads of the slide chairs in the last movement of a run.

    Parameters
    ----------
    dataset : xarray.Dataset
        A run with chair forces.

    Returns
    -------
    Sheet
        Largest normal force, friction at the end, and the share of time without load, by chair.
    """
    first, last = _last_movement(dataset)
    within = (dataset["time"] >= first) & (dataset["time"] <= last)
    moved = dataset.isel(time=np.flatnonzero(within.values))
    normal = moved["chair_normal_force"]
    lifted = 100 * (normal < LEAST_LOAD).mean("time")
    friction = dataset["chair_friction_force"].isel(time=-1)
    parts = (
        ("Largest load\n[kN]", KILO * normal.max("time")),
        ("Friction on rail\nat the end [kN]", KILO * friction),
        ("Lifted off\n[% of movement]", lifted),
    )
    return Sheet(
        name="chair-forces",
        title="Slide chairs in the last movement",
        caption="A chair that carries nothing for long does not support the rail; one that "
        "carries much brakes it. Friction at the end is what still holds the rail.",
        x_label=PLACE,
        rows=tuple(Row(label, _by_rail(dataset, values)) for label, values in parts),
        moments=_drive_places(dataset),
    )


def shade_of(share: float) -> str:
    """Return a colour from pale yellow-green to dark blue, seen alike by any eyes, for 0 to 1.

    Examples
    --------
    >>> shade_of(0.0), shade_of(1.0)
    ('#7ad151', '#440154')
    """
    # Colours of the scale viridis at even steps, without its palest end.
    steps = np.array([[122, 209, 81], [34, 168, 132], [42, 120, 142], [65, 68, 135], [68, 1, 84]])
    at = np.linspace(0.0, 1.0, len(steps))
    red, green, blue = (round(float(np.interp(share, at, part))) for part in steps.T)
    return f"#{red:02x}{green:02x}{blue:02x}"


def _last_movement(dataset: xr.Dataset) -> tuple[float, float]:
    """Return onset and end of the last movement that a run has come to, else of the run [s]."""
    spans = shown_movements(dataset)
    if not spans:
        return float(dataset["time"][0]), float(dataset["time"][-1])
    return spans[-1][1:]


def _closed_rail(dataset: xr.Dataset) -> str:
    """Return the rail that should be closed at the end."""
    rails = [str(rail) for rail in dataset["rail"].values]
    own = str(dataset.attrs.get("instrumented_rail", rails[0]))
    spans = shown_movements(dataset)
    if not spans or spans[-1][0].to == "closed":
        return own
    return next((rail for rail in rails if rail != own), own)


def _end_gap(dataset: xr.Dataset, rail: str, text: str, *, colour: int) -> Line:
    values = MILLI * dataset["gap"].sel(rail=rail).isel(time=-1).values
    return Line(
        label=f"rail {rail}, {text}", x=dataset["x"].values, y=values, colour=colour, dash=colour
    )


def _limit(dataset: xr.Dataset, rail: str) -> tuple[Level, ...]:
    limit = float(dataset.attrs.get("flangeway_limit", np.nan))
    if rail == _closed_rail(dataset) or np.isnan(limit):
        return ()
    return (Level(MILLI * limit, "smallest permitted flangeway"),)


def _gauge_row(dataset: xr.Dataset) -> Row:
    nominal, limit = (float(dataset.attrs[f"gauge_{name}"]) for name in ("nominal", "limit"))
    narrow = MILLI * (dataset["gauge"].isel(time=-1).values - nominal)
    line = Line(label="at the end", x=dataset["x"].values, y=narrow, colour=0)
    levels = () if np.isnan(limit) else (Level(MILLI * (limit - nominal), "least gauge allowed"),)
    return Row("Gauge less\nnominal [mm]", (line,), levels)


def _marks(dataset: xr.Dataset) -> list[Line]:
    """Return the objects and the limits of the sensors, at their places."""
    marks = []
    objects: list[dict[str, Any]] = json.loads(dataset.attrs.get("foreign_objects", "[]"))
    if objects:
        marks.append(
            Line(
                label="object",
                x=np.array([item["x"] for item in objects]),
                y=MILLI * np.array([item["size"] for item in objects]),
                colour=1,
                style="marks",
                symbol="square",
            )
        )
    if "sensor_limit" in dataset.coords:
        marks.append(
            Line(
                label="limit of TKK",
                x=dataset["sensor_x"].values,
                y=MILLI * dataset["sensor_limit"].values,
                colour=2,
                style="marks",
                symbol="triangle down",
            )
        )
    return marks


def _drive_places(dataset: xr.Dataset) -> tuple[Moment, ...]:
    if "drive_x" not in dataset.coords:
        return ()
    return tuple(
        Moment(float(dataset["drive_x"].sel(drive=name)), f"Drive {name}")
        for name in dataset["drive"].values
    )


def _by_rail(dataset: xr.Dataset, values: xr.DataArray) -> tuple[Line, ...]:
    symbols = ("circle", "square", "triangle up", "triangle down")
    return tuple(
        Line(
            label=f"rail {rail}",
            x=dataset["chair_x"].values,
            y=values.sel(rail=rail).values,
            colour=number,
            dash=number,
            style="line and marks",
            symbol=symbols[number % len(symbols)],
            width=0.9,
        )
        for number, rail in enumerate(dataset["rail"].values)
    )
