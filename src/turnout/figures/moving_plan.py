"""A panel seen from above as plain data for a page: its parts, and the motion of its rails."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.mechanism.rest import RailLine, rail_line, resting_gap
from turnout.panel.layout import extent, stands_at
from turnout.panel.model import Panel
from turnout.panel.records import OnRails, Placed

Floats = NDArray[np.float64]
POINTS, FRAMES = 120, 121
MOVING = ("gap", "lateral_displacement", "drive_force", "object_force", "chair_normal_force")


def plan_record(panel: Panel) -> dict[str, Any]:
    """Return the parts of a panel's plan that do not move.

    Parameters
    ----------
    panel : Panel
        Checked panel; positions and lengths [m].

    Returns
    -------
    dict
        Positions along the rails and across them [m]; lateral ones count from the base line of each
        stock rail, +y the closing direction of the instrumented rail. Fit for JSON.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> [item["x"] for item in plan_record(load_panel("uic60-760-1-15"))["drives"]]
    [0.3, 6.9]
    """
    start, end = extent(panel)
    return {
        "start": start,
        "end": end,
        "rails": [_rail_record(panel, name) for name in panel.rail],
        "stock_rails": [
            {"faces": rail.faces, "start": rail.start, "end": rail.end}
            for rail in panel.stock_rail.values()
        ],
        "sleepers": _places(panel.sleeper.items()),
        "beams": _bays(panel),
        "chairs": _on_rails(panel, panel.chair.items()),
        "fastenings": _on_rails(panel, panel.fastening.items()),
        "stops": _on_rails(panel, [*panel.stop.items(), *panel.stud.items()]),
        "drives": [
            {"name": name, "x": drive.x, "rail": drive.rail, "height": drive.height}
            for name, drive in panel.drive.items()
        ],
        "links": [
            {"name": name, "x": link.x, "rails": link.rails, "height": link.height}
            for name, link in panel.link.items()
        ],
        "sensors": [
            {"name": name, "x": sensor.x, "rail": rail}
            for name, sensor in panel.sensor.items()
            for rail in panel.rail
            if stands_at(sensor, rail)
        ],
        "object_rail": panel.object_defaults.rail,
        "object_height": panel.object_defaults.height,
    }


def motion_record(panel: Panel, dataset: xr.Dataset, *, frames: int = FRAMES) -> dict[str, Any]:
    """Return the motion of rails and the forces in a run, at so many instants.

    Parameters
    ----------
    panel : Panel
        Panel that was thrown.
    dataset : xarray.Dataset
        The run; its `gap` or `lateral_displacement` at some places along the rails.
    frames : int
        Instants, evenly over the run; fewer where it has fewer.

    Returns
    -------
    dict
        ``time`` [s]; ``at``, the indices of the instants in the dataset; for each rail ``x``,
        ``edge`` (instant, x), its running edge as in `plan_record`, and ``gap`` (instant, x), its
        distance from the stock rail, without one from where it lies when closed [m]; forces [N],
        chairs by rail. None stands for NaN.
    """
    size = dataset.sizes["time"]
    at = np.unique(np.linspace(0, size - 1, min(frames, size)).round().astype(int))
    # Cutting these only: cutting all that a run holds takes several times as long.
    some = dataset[[name for name in MOVING if name in dataset]].isel(time=at)
    rails = {}
    for name in panel.rail:
        x, edge, gap = _edges(panel, some, name)
        rails[name] = {
            "x": x.round(4).tolist(),
            "edge": _listed(edge, 6),
            "gap": _listed(gap, 6),
        }
    record: dict[str, Any] = {
        "time": some["time"].values.tolist(),
        "at": at.tolist(),
        "rails": rails,
        "drive_force": _channel(some, "drive_force", ("time", "drive")),
        "object_force": _channel(some, "object_force", ("time",)),
        "chair_force": {},
    }
    if "chair_normal_force" in some:
        record["chair_force"] = {
            str(name): _listed(
                some["chair_normal_force"].sel(rail=name).transpose("time", "chair").values, 1
            )
            for name in some["rail"].values
        }
    return record


def _edges(panel: Panel, dataset: xr.Dataset, rail: str) -> tuple[Floats, Floats, Floats]:
    """Return places, running edge and gap (time, x) of a rail; at its end it stays as it lies."""
    held = panel.rail[rail].end
    x = dataset["x"].values
    x = x[(x >= panel.rail[rail].start - 1e-9) & (x < held - 1e-9)]
    line = rail_line(panel, rail, np.append(x, held))
    own = dataset.sel(rail=rail, x=x)
    resting = resting_gap(panel, rail, line.x, closed=True)
    resting = np.zeros(line.x.size) if resting is None else resting
    gap = own["gap"].transpose("time", "x").values
    if np.isnan(gap).all():
        moved = own["lateral_displacement"].transpose("time", "x").values
        from_closed = line.side * (line.closed_edge - _start_edge(panel, line))[:-1]
        gap = resting[:-1] + from_closed - line.side * (moved - moved[0])
    gap = np.concatenate((gap, np.full((gap.shape[0], 1), resting[-1])), axis=1)
    apart = line.side * (line.stock_edge - line.closed_edge) - resting
    return line.x, line.stock_edge - line.side * (apart + gap), gap


def _start_edge(panel: Panel, line: RailLine) -> Floats:
    closed = (panel.schedule.starts == "closed") == (panel.rail[line.rail].closes == "+y")
    return line.closed_edge if closed else line.open_edge


def _rail_record(panel: Panel, name: str) -> dict[str, Any]:
    rail = panel.rail[name]
    line = rail_line(panel, name, np.linspace(rail.start, rail.end, POINTS))
    return {
        "name": name,
        "side": line.side,
        "start": rail.start,
        "end": rail.end,
        "has_stock_rail": rail.has_stock_rail,
        "head_width": rail.head_width or 0.0,
        "x": line.x.round(4).tolist(),
        "stock": _listed(line.stock_edge, 6),
        "closed": _listed(line.closed_edge, 6),
        "open": _listed(line.open_edge, 6),
        "width": _listed(line.width, 6),
    }


def _bays(panel: Panel) -> list[float]:
    """Return the places that need a sleeper, as a part stands on it."""
    families: Iterable[Iterable[Placed]] = (
        panel.sleeper.values(),
        panel.chair.values(),
        panel.fastening.values(),
        panel.stock_fastening.values(),
    )
    places = {round(item.x, 4) for family in families for item in family}
    return sorted(places)


def _places(items: Iterable[tuple[str, Placed]]) -> list[dict[str, Any]]:
    return [{"name": name, "x": item.x} for name, item in items]


def _on_rails(panel: Panel, items: Iterable[tuple[str, OnRails]]) -> list[dict[str, Any]]:
    return [
        {"name": name, "x": item.x, "rails": [r for r in panel.rail if stands_at(item, r)]}
        for name, item in items
    ]


def _channel(dataset: xr.Dataset, name: str, dims: tuple[str, ...]) -> Any:
    if name not in dataset:
        return None
    return _listed(dataset[name].transpose(*dims).values, 1)


def _listed(values: Floats, decimals: int) -> Any:
    """Return numbers as lists with None for NaN; adding zero makes a negative zero a plain one."""
    rounded = np.round(np.asarray(values, dtype=np.float64), decimals) + 0.0
    if not np.isnan(rounded).any():
        return rounded.tolist()
    torn = rounded.astype(object)
    torn[np.isnan(rounded)] = None
    return torn.tolist()
