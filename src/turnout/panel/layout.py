"""Opening of rails, estimated from the marker positions alone, and their extent.

Checks of a panel compare the sizes of objects with it. Between the drives and on to the first
fastening behind them a rail is taken as a prismatic beam, whose shape under forces at the drives is
a cubic spline: it needs no stiffness, and for a tapered rail this is within 3 mm.
`turnout.mechanism.travel` has the shapes exactly, `turnout.mechanism.rest` rails in plan.
"""

from collections.abc import Sequence
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
    stock_rail_gap,
)
from turnout.panel.records import Drive, OnRails, Sensor

FloatArray = npt.NDArray[np.float64]


_openings = LRUCache[tuple[float | None]](256)


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
    ways = tuple(
        (drive.rail, drive.x, drive.stroke, drive.over_travel_open, drive.over_travel_closed)
        for drive in panel.drive.values()
    )
    # drives, whose stiffness often varies, by what counts of them
    key = panel.key_of("rail", "link", "fastening", "schedule", "movement"), ways, rail, x
    known = _openings.get(key) or _openings.put(key, (_largest_opening(panel, rail, x),))
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
    """Estimate the gap to the unloaded stock rail in the stress-free position, shape (n,) [m].

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


def estimated_displacement(
    panel: Panel, rail: str, x: npt.ArrayLike, *, to: str | None
) -> FloatArray:
    """Estimate a rail's offset from its stress-free position, shape (n,) [m], positive closing.

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
    """Estimate displacements for several positions at once, shape (n_positions, n)."""
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
    """Return the first place behind the drives at which the rail is clamped or fastened."""
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


def stands_at(item: OnRails | Sensor, rail: str) -> bool:
    """Return True if a chair, fastening, stop, stud or sensor belongs to a rail."""
    if isinstance(item, Sensor):
        return item.rail in (None, rail)
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
