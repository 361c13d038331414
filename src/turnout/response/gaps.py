"""Open distances between switch rails and stock rails, and the flangeway behind them."""

import numpy as np
from numpy.typing import NDArray

from turnout.panel.layout import SIDE
from turnout.panel.model import Panel
from turnout.panel.profile import running_edge_distance, stock_rail_gap
from turnout.response.recovery import Ints, Motion, lateral_displacement
from turnout.response.route import Throw, open_rail, wanted_closed

Floats = NDArray[np.float64]


def contact_height(panel: Panel, rail: str, x: Floats) -> Floats:
    """Return the height at which a rail meets its stock rail.

    That of its stops and studs, linear in between; that of a foreign object where there are none.

    Parameters
    ----------
    panel : Panel
        The panel.
    rail : str
        Name of the rail.
    x : ndarray, shape (n,)
        Places [m].

    Returns
    -------
    ndarray, shape (n,)
        [m] above the reference line.
    """
    stops = [*panel.stop.values(), *panel.stud.values()]
    found = sorted((s.x, s.height) for s in stops if s.rails is None or rail in s.rails)
    if not found:
        return np.full(np.shape(x), panel.object_defaults.height)
    places, heights = np.array(found).T
    height: Floats = np.interp(x, places, heights)
    return height


def stock_gap(panel: Panel, rail: str, x: Floats) -> Floats:
    """Return the gap of the unloaded rail, shape (n,) [m]; NaN without a stock rail."""
    gap = stock_rail_gap(panel.rail[rail], x)
    return np.full(np.shape(x), np.nan) if gap is None else gap


def rail_gap(
    panel: Panel, motion: Motion, rail: str, *, x: Floats, z: Floats, at: Ints | None = None
) -> Floats:
    """Return the open distance to the stock rail, shape (n_points, n_times) [m].

    A flexible stock rail takes part with its own displacement at the same height; beyond its ends
    it is held.
    """
    moved = lateral_displacement(motion, rail, x=x, z=z, at=at)
    for name, stock in panel.stock_rail.items():
        if stock.faces == rail:
            body = f"stock rail {name}"
            inside = np.clip(x, stock.start, stock.end)
            moved -= lateral_displacement(motion, body, x=inside, z=z - stock.foot_height, at=at)
    side = SIDE[panel.rail[rail].closes]
    gap: Floats = stock_gap(panel, rail, x)[:, np.newaxis] - side * moved
    return gap


def drive_gaps(panel: Panel, motion: Motion, time: Floats) -> Floats:
    """Return the gap at each drive's rod, of the rail that should be closed.

    That is the rail which the present or last movement closes; before the first movement, the one
    that is closed where the schedule starts. A panel with one rail has no choice.

    Returns
    -------
    ndarray, shape (n_drives, n_times)
        [m]
    """
    x = np.array([drive.x for drive in panel.drive.values()])
    z = np.array([drive.height for drive in panel.drive.values()])
    gap = np.full((x.size, time.size), np.nan)
    for rail, when in wanted_closed(panel, time):
        if when.any():
            gap[:, when] = rail_gap(panel, motion, rail, x=x, z=z, at=np.flatnonzero(when))
    return gap


def sensor_gaps(panel: Panel, motion: Motion) -> Floats:
    """Return the gap at each sensor, shape (n_sensors, n_times) [m]."""
    return np.concatenate(
        [
            rail_gap(
                panel, motion, sensor.rail, x=np.array([sensor.x]), z=np.array([sensor.height])
            )
            for sensor in panel.sensor.values()
        ]
    )


def least_flangeway(
    panel: Panel, motion: Motion, throw: Throw, *, at: int
) -> tuple[float, float, str] | None:
    """Return the least flangeway [m] of the rail that is open after a throw, its place, the rail.

    The flangeway is the gap, and behind the planing also by how much the running edges lie further
    apart than a full head is wide.

    Parameters
    ----------
    panel, motion
        Panel and run.
    throw : Throw
        The movement.
    at : int
        Index of the instant.

    Returns
    -------
    tuple or None
        None where the panel does not say what it takes.
    """
    name = open_rail(panel, throw.to)
    if name is None:
        return None
    rail = panel.rail[name]
    if rail.running_edge is None or rail.head_width is None or rail.stock_rail_gap is None:
        return None
    x = motion.rails[name].x
    z = contact_height(panel, name, x)
    gap = rail_gap(panel, motion, name, x=x, z=z, at=np.array([at]))[:, 0]
    beyond = running_edge_distance(rail.running_edge, x) - rail.head_width
    flangeway = gap + np.maximum(beyond, 0.0)
    place = int(np.argmin(flangeway))
    return float(flangeway[place]), float(x[place]), name
