"""Where rails lie in plan: running edges of stock and switch rails, open and closed.

A drawing needs no gauge: each stock rail is laid on a base line of its own. The switch rail that is
closed at t = 0 belongs to the route that is drawn straight, so its stock rail curves away from it;
the other switch rail curves away from a straight stock rail.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from turnout.panel.model import Panel
from turnout.panel.opening import displaced, unloaded_gap
from turnout.panel.profile import running_edge_distance
from turnout.panel.record import OnRails

FloatArray = npt.NDArray[np.float64]
SIDE = {"+y": 1.0, "-y": -1.0}


@dataclass(frozen=True, slots=True)
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
    x: FloatArray
    stock_edge: FloatArray
    closed_edge: FloatArray
    open_edge: FloatArray
    width: FloatArray


def resting_gap(panel: Panel, rail: str, x: npt.ArrayLike, *, closed: bool) -> FloatArray | None:
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
        within some 3 mm, see `turnout.panel.opening`. None where it has no stock rail.

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
    gap = unloaded_gap(panel, rail, places)
    if gap is None:
        return None
    position = "closed" if closed == (record.closes == "+y") else "open"
    to = None if panel.schedule.starts == position else position
    moved = displaced(panel, rail, places, to=to)
    return np.maximum(gap - SIDE[record.closes] * moved, 0.0)


def rail_line(panel: Panel, rail: str, x: npt.ArrayLike) -> RailLine:
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


def stands_at(item: OnRails, rail: str) -> bool:
    """Tell whether a chair, fastening, stop or stud belongs to a rail."""
    return item.rails is None or rail in item.rails


def extent(panel: Panel) -> tuple[float, float]:
    """Give the first and the last x of all rails, stock rails too [m].

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> extent(load_panel("sb2"))
    (0.0, 18.6)
    """
    spans = [(rail.start, rail.end) for rail in panel.rail.values()]
    spans += [(rail.start, rail.end) for rail in panel.stock_rail.values()]
    return min(start for start, _ in spans), max(end for _, end in spans)
