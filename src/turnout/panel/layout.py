"""Where rails lie in plan, and how far they open.

How far a rail stands open at a place, estimated from the marker positions alone.

Between the drives and on to the first fastening behind them a rail is taken as a prismatic beam,
whose shape under forces at the drives is a cubic spline. For a tapered rail this is within 3 mm.

Where rails lie in plan: running edges of stock and switch rails, open and closed.

A drawing needs no gauge: each stock rail is laid on a base line of its own. The switch rail that is
closed at t = 0 belongs to the route that is drawn straight, so its stock rail curves away from it;
the other switch rail curves away from a straight stock rail.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from turnout.core.lru_cache import LRUCache
from turnout.panel.markers import marker_level, ordered_movements, start_offset
from turnout.panel.model import Panel
from turnout.panel.profile import (
    Spline,
    cubic_spline,
    evaluate_profile,
    running_edge_distance,
    stock_rail_gap,
)
from turnout.panel.records import Drive, OnRails

FloatArray = npt.NDArray[np.float64]

MOST_OPENINGS = 256
"""Openings of rails at so many places are kept in memory, the latest used."""


# Throws of a study share the records that openings follow from; these are named by their identity,
# and drives, whose stiffness often varies, by what counts of them.
_openings = LRUCache[tuple[float | None, object]](MOST_OPENINGS)


def largest_opening(panel: Panel, rail: str, x: float) -> float | None:
    """Estimate the largest distance between a rail and its stock rail at rest.

    Parameters
    ----------
    panel : Panel
        A panel whose rails, drives and movements are valid.
    rail : str
        Name of the rail.
    x : float
        Position [m].

    Returns
    -------
    float or None
        Distance [m], at least 0; None where the rail has no stock rail.
    """
    families = (panel.rail, panel.link, panel.fastening, panel.schedule, panel.movement)
    ways = tuple(
        (drive.rail, drive.x, drive.stroke, drive.over_travel_open, drive.over_travel_closed)
        for drive in panel.drive.values()
    )
    key = (*map(id, families), ways, rail, x)
    known = _openings.get(key)
    if known is None:
        known = _openings.put(key, (_largest_opening(panel, rail, x), families))
    return known[0]


def _largest_opening(panel: Panel, rail: str, x: float) -> float | None:
    record = panel.rail[rail]
    gap = estimated_unloaded_gap(panel, rail, [x])
    if gap is None:
        return None
    side = 1.0 if record.closes == "+y" else -1.0
    to = [None, *(item.to for _, item in ordered_movements(panel))]
    states = _displaced(panel, rail, [x], to)[:, 0]
    return max(0.0, float(np.max(gap[0] - side * states)))


def estimated_unloaded_gap(panel: Panel, rail: str, x: npt.ArrayLike) -> FloatArray | None:
    """Give the gap to the unloaded stock rail in the stress-free position, shape (n,) [m].

    As typed; where the shape is computed it is estimated like everything here, and
    `turnout.mechanism.travel` has it exactly. None where the rail has no stock rail.
    """
    record = panel.rail[rail]
    if record.fit_gap is None:
        return stock_rail_gap(record, x)
    places = np.asarray(x, dtype=np.float64)
    gap = evaluate_profile(record.fit_gap, places)
    strokes = {drive.x: [drive.stroke] for drive in _moving(panel, rail)}
    if strokes:
        travel = _beam_shapes(strokes, _held_at(panel, rail, max(strokes)), places)[0]
        gap = gap + record.fraction * travel
    return gap


def _moving(panel: Panel, rail: str) -> list[Drive]:
    """Give the drives of a rail; one without drives follows those of the rail it is linked to."""
    drives = [drive for drive in panel.drive.values() if drive.rail == rail]
    if not drives and any(rail in link.rails for link in panel.link.values()):
        drives = list(panel.drive.values())
    return drives


def displaced(panel: Panel, rail: str, x: npt.ArrayLike, *, to: str | None) -> FloatArray:
    """Estimate where a rail rests from its stress-free position, shape (n,) [m], positive closing.

    Parameters
    ----------
    panel : Panel
        The panel.
    rail : str
        Name of the rail; one without drives follows those of the rail that it is linked to.
    x : array_like, shape (n,)
        Positions [m].
    to : str or None
        Position of the instrumented rail, "open" or "closed"; None for the start.
    """
    at_places: FloatArray = _displaced(panel, rail, x, [to])[0]
    return at_places


def _displaced(panel: Panel, rail: str, x: npt.ArrayLike, to: Sequence[str | None]) -> FloatArray:
    """Do what `displaced` does for several positions at once, shape (n_positions, n)."""
    x = np.asarray(x, dtype=np.float64)
    drives = _moving(panel, rail)
    if not drives:
        return np.zeros((len(to), x.size))
    starts = panel.schedule.starts
    places = {
        drive.x: [
            start_offset(panel, rail, drive.stroke)
            + (marker_level(drive, item, starts=starts) if item else 0.0)
            for item in to
        ]
        for drive in drives
    }
    return _beam_shapes(places, _held_at(panel, rail, max(places)), x)


def _held_at(panel: Panel, rail: str, behind: float) -> float | None:
    """Give the first place behind the drives where the rail is clamped or fastened."""
    record = panel.rail[rail]
    places = [
        item.x
        for item in panel.fastening.values()
        if item.x > behind and item.stiffness_y > 0 and (item.rails is None or rail in item.rails)
    ]
    if record.heel == "clamped" and record.end > behind:
        places.append(record.end)
    return min(places, default=None)


def _beam_shapes(places: dict[float, list[float]], held: float | None, x: FloatArray) -> FloatArray:
    knots = tuple(sorted(places))
    values = np.array([places[knot] for knot in knots])
    if held is None:
        return np.array([np.interp(x, knots, column) for column in values.T])
    spline = _unit_shapes(knots, held)
    shapes = spline(np.clip(x, knots[0], held))
    shapes += np.minimum(x - knots[0], 0.0)[:, np.newaxis] * spline.slopes[0]
    return np.where(x >= held, 0.0, (shapes @ values).T)


@lru_cache(maxsize=64)
def _unit_shapes(knots: tuple[float, ...], held: float) -> Spline:
    """Return the shapes of a beam that is moved by one at each knot, and clamped at a place."""
    moved = np.eye(len(knots) + 1, len(knots))
    return cubic_spline([*knots, held], moved, ends=("natural", "clamped"))


SIDE = {"+y": 1.0, "-y": -1.0}


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
    """Return whether a chair, fastening, stop or stud belongs to a rail."""
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
