r"""Way of each rail from its closed to its open position, and the shapes that follow.

Held by its drives, a rail takes the shape of least energy without friction and without contact to
stock rails or studs: its feet stay on the chairs, the drives stand at their strokes. Rails are
linear, so the way :math:`D(x)` from closed to open is a combination of static shapes of the reduced
rail, exact at all its places, and the stress-free shape at the fraction f of that way leaves

.. math:: g_0(x) = g_{fit}(x) + f\, D(x)

to the unloaded stock rail, with the gap :math:`g_{fit}` that the rail leaves when it is held
closed. A rail without a drive of its own is held where links at places of drives, or else any
links, join it to the other rail; a back drive holds its second place at its ratio.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from turnout.core.errors import MechanicsError
from turnout.core.lru_cache import LRUCache
from turnout.mechanism.mechanism import Matrices, RailShape, ReducedRail
from turnout.mechanism.varied_rails import VariedRail
from turnout.panel.model import Panel
from turnout.panel.place import SAME_PLACE
from turnout.panel.profile import contact_height, cubic_spline, evaluate_profile, stock_rail_gap
from turnout.panel.records import Drive

Floats = NDArray[np.float64]
UY, RX, PER_NODE = 1, 3, 6

HOLDING_STIFFNESS = 1e9
"""Stiffness that keeps a foot on its chair, far above that of any chair [N/m]."""
MOST_MISSED = 1e-6
"""Distance from its open position of a rail that stands there [m]."""
MOST_ROLL = 0.1
"""A rail that rolls more on its way is asked to stand at two positions at one place [rad]."""


@dataclass(slots=True, eq=False)
class RailRows:
    """Rows of one reduced rail at which it is held.

    Attributes
    ----------
    feet : ndarray, shape (n_feet, count)
        Vertical displacements of the feet on chairs.
    drives, links : dict of str to ndarray, shape (count,)
        Lateral displacements towards +y at the rods of its own drives, and at the ends of links.
    back_drives : dict of str to ndarray, shape (count,)
        Lengthening of a linkage: zero where its place moves at its ratio of that at its drive.
    """

    feet: Floats
    drives: dict[str, Floats] = field(default_factory=dict)
    links: dict[str, Floats] = field(default_factory=dict)
    back_drives: dict[str, Floats] = field(default_factory=dict)
    _holding: Floats | None = None

    def holding(self, held: Floats) -> Floats:
        """Return the stiffness that holds the rail at its feet and at the rows of what moves it.

        The rows are the same for all panels with these rails.
        """
        if self._holding is None:
            fixed = np.concatenate((self.feet, held))
            self._holding = HOLDING_STIFFNESS * fixed.T @ fixed
        return self._holding


@dataclass(frozen=True, slots=True)
class Travel:
    """The way of every rail and link end from closed to open.

    Attributes
    ----------
    shapes : dict of str to RailShape
        By rail.
    link_ends : dict of (link, rail) to float
        Way of the rail at the end of the link, positive opening [m].
    """

    shapes: dict[str, RailShape]
    link_ends: dict[tuple[str, str], float]


def rail_travel(
    panel: Panel,
    rails: Mapping[str, ReducedRail],
    rows: Mapping[str, RailRows],
    *,
    nominal: Travel | None = None,
) -> Travel:
    """Find the way of all rails from their closed to their open positions.

    Parameters
    ----------
    panel : Panel
        A checked panel.
    rails : mapping of str to ReducedRail
        Its switch rails.
    rows : mapping of str to RailRows
        Rows at which each of them is held.

    Raises
    ------
    MechanicsError
        When drives, links and back drives ask one rail for more than it can do.
    """
    shapes: dict[str, RailShape] = {}
    link_ends: dict[tuple[str, str], float] = {}
    driven = {name for name in rails if rows[name].drives}
    for name in sorted(rails, key=lambda rail: rail not in driven):
        moved, way = _moved(panel, name, rails[name], rows[name], link_ends)
        like = None if nominal is None else nominal.shapes[name]
        shapes[name] = _shape(panel, name, rails[name].body.x, way, like)
        for link, row in rows[name].links.items():
            link_ends[link, name] = float(row @ moved)
    return Travel(shapes, link_ends)


def _moved(
    panel: Panel,
    name: str,
    rail: ReducedRail,
    rows: RailRows,
    link_ends: Mapping[tuple[str, str], float],
) -> tuple[Floats, Floats]:
    """Return a rail's way from closed to open, as if it opened to +y, in reduced coordinates.

    Second is that of its nodes.
    """
    held = _held_places(panel, name, rows, link_ends)
    if not held:
        return np.zeros(rail.body.count), np.zeros(rail.body.recovery.shape[0])
    matrix = np.array([row for row, _ in held])
    wanted = np.array([way for _, way in held])

    def yielded(matrices: ReducedRail | Matrices) -> Floats:
        # What is held may be all that holds the rail, so it stiffens it; that changes no shape.
        return cho_solve(cho_factor(matrices.stiffness + rows.holding(matrix)), matrix.T)

    def unit_ways(matrices: Matrices) -> tuple[Floats, ...]:
        shapes = yielded(matrices)
        return (np.asarray(np.linalg.solve(matrix @ shapes, shapes.T).T, dtype=np.float64),)

    try:
        found = None
        if isinstance(rail, VariedRail):
            found = rail.follow(("ways", matrix.tobytes()), unit_ways)
        if found is None:
            shapes = yielded(rail)
            moved: Floats = shapes @ np.linalg.solve(matrix @ shapes, wanted)
        else:
            moved = found[0] @ wanted
    except np.linalg.LinAlgError:
        moved = np.full(rail.body.count, np.nan)
    way: Floats = rail.body.recovery @ moved
    missed = np.abs(matrix @ moved - wanted).max()
    if missed <= MOST_MISSED and np.abs(way[RX::PER_NODE]).max() < MOST_ROLL:
        return moved, way
    if panel.rail[name].fit_gap is None:  # what is typed needs no travel
        return np.full(rail.body.count, np.nan), np.full(way.size, np.nan)
    message = (
        f"rail.{name}.fit_gap: the rail cannot stand open as its drives, links and back drives "
        "ask: two of them hold the same place, or nothing holds the rail; take one of them away, "
        "or type the shape (stock_rail_gap)"
    )
    raise MechanicsError(message)


def _held_places(
    panel: Panel,
    name: str,
    rows: RailRows,
    link_ends: Mapping[tuple[str, str], float],
) -> list[tuple[Floats, float]]:
    """Return the rows at which a rail is held, with the way of each [m]."""
    held = [(row, panel.drive[drive].stroke) for drive, row in rows.drives.items()]
    if not held:
        held = _held_by_links(panel, name, rows, link_ends)
    if not held:
        return []
    return held + [(row, 0.0) for row in rows.back_drives.values()]


def _held_by_links(
    panel: Panel,
    name: str,
    rows: RailRows,
    link_ends: Mapping[tuple[str, str], float],
) -> list[tuple[Floats, float]]:
    """Return the rows of links that hold a rail without drives: those at drives, if any."""
    at_drives, elsewhere = [], []
    for link, row in rows.links.items():
        record = panel.link[link]
        drive = drive_at(panel, record.x)
        if drive is not None:
            at_drives.append((row, drive.stroke))
            continue
        other = next(rail for rail in record.rails if rail != name)
        if (link, other) in link_ends:
            elsewhere.append((row, link_ends[link, other]))
    return at_drives or elsewhere


def drive_at(panel: Panel, x: float) -> Drive | None:
    """Return the drive that stands at a place, or None."""
    for drive in panel.drive.values():
        if abs(drive.x - x) < SAME_PLACE:
            return drive
    return None


def _shape(panel: Panel, name: str, x: Floats, way: Floats, like: RailShape | None) -> RailShape:
    travel = way[UY::PER_NODE] - contact_height(panel, name, x) * way[RX::PER_NODE]
    if like is not None:
        return RailShape(like.travel.through(travel))
    return RailShape(cubic_spline(x.tolist(), travel, ends=("not-a-knot", "not-a-knot")))


_at_places = LRUCache[tuple[Floats, Floats]](256)


def unloaded_gap(panel: Panel, shape: RailShape | None, rail: str, x: Floats) -> Floats | None:
    """Return the gap of a rail to its unloaded stock rail in its stress-free position.

    Parameters
    ----------
    panel : Panel
        The panel.
    shape : RailShape or None
        Of the rail; None where only typed shapes are needed.
    rail : str
        Name of the rail.
    x : ndarray, shape (n,)
        Places [m].

    Returns
    -------
    ndarray, shape (n,), or None
        [m]; None where the rail has no stock rail.
    """
    record = panel.rail[rail]
    fit = record.fit_gap
    if fit is None:
        return stock_rail_gap(record, x)
    if shape is None:
        message = f"rail {rail}: its shape is computed, and the mechanism does not hold it"
        raise MechanicsError(message)
    way = shape.travel
    of_way = (way.knots.tobytes(), way.values.tobytes(), way.slopes.tobytes())
    key = fit, x.tobytes(), *of_way
    closed, travel = _at_places.get(key) or _at_places.put(
        key, (evaluate_profile(fit, x), shape.travel_at(x))
    )
    return closed + record.fraction * travel
