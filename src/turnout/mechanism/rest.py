"""A switch at rest, from its panel alone: rails in plan, and the forces that press them home.

A drawing needs no gauge: each stock rail is laid on a base line of its own. The switch rail that is
closed at t = 0 belongs to the route that is drawn straight, so its stock rail curves away from it;
the other switch rail curves away from a straight stock rail.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turnout.panel.check_shape import elastic_force, pressed_home
from turnout.panel.layout import SIDE, estimated_displacement, estimated_unloaded_gap
from turnout.panel.model import Panel
from turnout.panel.profile import running_edge_distance

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class RailLine:
    """A switch rail and its stock rail in plan.

    Attributes
    ----------
    rail : str
        Name of the switch rail.
    side : float
        1 where it closes in +y, else -1.
    x : ndarray, shape (n,)
        Places [m].
    stock_edge, closed_edge, open_edge : ndarray, shape (n,)
        Lateral positions of the running edges [m], +y the closing direction of the instrumented
        rail, from the stock rail's base line.
    width : ndarray, shape (n,)
        Width of the switch rail's head at the running edge: what the planing left [m].
    """

    rail: str
    side: float
    x: Floats
    stock_edge: Floats
    closed_edge: Floats
    open_edge: Floats
    width: Floats


def resting_gap(panel: Panel, rail: str, x: ArrayLike, *, closed: bool) -> Floats | None:
    """Estimate the gap at rest of a rail that is closed or open, from the markers alone.

    Parameters
    ----------
    panel : Panel
        The panel.
    rail : str
        Name of a switch rail.
    x : array_like, shape (n,)
        Places [m].
    closed : bool
        Which of its two positions.

    Returns
    -------
    ndarray, shape (n,), or None
        Distance to the stock rail [m], at least 0; exact where the rail is stress-free, elsewhere
        within some 3 mm, see `turnout.panel.layout`. None where it has no stock rail.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> default = load_panel("uic60-760-1-15")
    >>> resting_gap(default, "straight", [0.3, 3.6], closed=True).round(4).tolist()
    [0.0, 0.0046]
    >>> resting_gap(default, "straight", [0.3], closed=False).round(4).tolist()
    [0.117]
    """
    record = panel.rail[rail]
    places = np.atleast_1d(np.asarray(x, dtype=np.float64))
    gap = estimated_unloaded_gap(panel, rail, places)
    if gap is None:
        return None
    position = "closed" if closed == (record.closes == "+y") else "open"
    to = None if panel.schedule.starts == position else position
    moved = estimated_displacement(panel, rail, places, to=to)
    return np.maximum(gap - SIDE[record.closes] * moved, 0.0)


def rail_line(panel: Panel, rail: str, x: ArrayLike) -> RailLine:
    """Lay a switch rail and its stock rail out in plan.

    Parameters
    ----------
    panel : Panel
        The panel.
    rail : str
        Name of a switch rail.
    x : array_like, shape (n,)
        Places [m].

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> line = rail_line(load_panel("uic60-760-1-15"), "straight", [3.6])
    >>> line.closed_edge.round(4).tolist(), line.stock_edge.round(4).tolist()
    ([-0.0046], [0.0214])
    """
    record = panel.rail[rail]
    places = np.atleast_1d(np.asarray(x, dtype=np.float64))
    side = SIDE[record.closes]
    edge = record.running_edge
    apart = np.zeros(places.shape) if edge is None else running_edge_distance(edge, places)
    closed = resting_gap(panel, rail, places, closed=True)
    opened = resting_gap(panel, rail, places, closed=False)
    nothing = np.zeros(places.shape)
    # The rail that is closed at the start is straight when it is closed.
    straight = (panel.schedule.starts == "closed") == (record.closes == "+y")
    stock = side * apart if straight else nothing
    head = record.head_width
    return RailLine(
        rail=rail,
        side=side,
        x=places,
        stock_edge=stock,
        closed_edge=stock - side * (apart + (nothing if closed is None else closed)),
        open_edge=stock - side * (apart + (nothing if opened is None else opened)),
        width=apart if head is None else np.minimum(apart, head),
    )


@dataclass(frozen=True, slots=True)
class RestingForce:
    """Force of a drive on a closed rail, and the force from which on it slips without moving.

    Attributes
    ----------
    drive, rail, key : str
        Names, and the key of the over-travel that presses the rail home.
    reach : float
        This over-travel [m].
    fit : float
        Gap that the closed rail leaves at the drive before it is pressed home [m].
    force, limit : float
        Force that it would need, and slip level [N].
    most : float
        Over-travel at which the drive would begin to slip [m].
    """

    drive: str
    rail: str
    key: str
    reach: float
    fit: float
    force: float
    limit: float
    most: float

    @property
    def slips(self) -> bool:
        """True if the drive slips at rest."""
        return self.force >= self.limit


def resting_slips(panel: Panel) -> list[RestingForce]:
    """Return the drives that slip at rest; values drawn by a study may bring a panel there.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> panel = load_panel("uic60-760-1-15")
    >>> resting_slips(panel)
    []
    >>> stiff = panel.with_overrides({"drive.2.stiffness": "7500 kN/m"})
    >>> [(found.drive, found.rail) for found in resting_slips(stiff)]
    [('2', 'straight'), ('2', 'curved')]
    """
    return [found for found in resting_forces(panel) if found.slips]


def resting_forces(panel: Panel) -> list[RestingForce]:
    """Return the force of each drive on each rail that it closes.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> found = resting_forces(load_panel("uic60-760-1-15"))
    >>> [(item.drive, item.rail, round(item.force / 1e3, 2)) for item in found][:2]
    [('1', 'straight', 3.0), ('1', 'curved', 1.5)]
    """
    records = {"rail": panel.rail, "drive": panel.drive, "link": panel.link}
    found = []
    for name, drive in panel.drive.items():
        limit = drive.saturation_force
        for rail, key, fit in pressed_home(records, name):
            reach = getattr(drive, key)
            force, most = elastic_force(drive, reach - fit), limit / drive.stiffness + fit
            found.append(RestingForce(name, rail, key, reach, fit, force, limit, most))
    return found
