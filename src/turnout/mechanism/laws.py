"""Places of the laws on the rails of a panel, and the table of their values.

Places are found once for all panels that differ in values of laws alone; the table is filled for
each. Chairs and stops, of which there are most, come first in it and are filled all at once.
"""

import math
import operator
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import MechanicsError
from turnout.law.table import LawTable, LawTableBuilder, SharedTableParts
from turnout.mechanism.build_rails import SIGN, approach_ends, object_ends, rail_feet, stands_on
from turnout.mechanism.mechanism import LawIndex, Point
from turnout.mechanism.object_laws import add_bond, add_object
from turnout.mechanism.travel import Travel, drive_at, unloaded_gap
from turnout.panel.foreign_object import PlacedObject
from turnout.panel.markers import offset_at
from turnout.panel.model import Panel
from turnout.panel.records import Chair, Drive, Link, Linkage, Stop

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(slots=True)
class LawRows:
    """Points of each rail in the order of their rows, before the rails are reduced.

    A row is a sum over points: (rail, index of the point within the rail).
    """

    points: dict[str, list[Point]]
    rows: list[list[tuple[str, int]]] = field(default_factory=list)

    def point(self, rail: str, point: Point) -> int:
        """Register a point of a rail; return its index there."""
        self.points[rail].append(point)
        return len(self.points[rail]) - 1

    def add(self, *parts: tuple[str, Point]) -> int:
        """Add a row that sums points; return its index."""
        self.rows.append([(rail, self.point(rail, point)) for rail, point in parts])
        return len(self.rows) - 1


@dataclass(frozen=True, slots=True, eq=False)
class RailStops:
    """Stops and studs of one rail.

    Attributes
    ----------
    rail : str
        The rail.
    laws : ndarray of int, shape (n_stops,)
        Their laws.
    x, clearance : ndarray, shape (n_stops,)
        Places, and what each leaves between rail and stock rail when both touch [m].
    """

    rail: str
    laws: Ints
    x: Floats
    clearance: Floats


@dataclass(frozen=True, slots=True, eq=False)
class LawLayout:
    """Places of all laws, which stay while their values change.

    Attributes
    ----------
    rows : Rows
        Of all laws.
    index : LawIndex
        Laws by what they belong to.
    law_names, friction_names : tuple of str
        For messages.
    standing : LawTable
        Laws of chairs and of stops, without values; the first of all laws.
    stops : tuple of RailStops
        Those with stops.
    contacts, chairs : ndarray of int, shape (n_contacts,)
        Laws of the feet on plates and rollers of chairs, and the number of the chair of each, of
        rollers after all chairs; frictions have this order.
    closed : ndarray of int, shape (n_contacts,)
        Segments in which these laws have a force.
    further : tuple of int
        Rows of drives, links, back drives and objects, whose laws follow.
    tables : dict
        Shared parts of the tables of these laws, by how the further ones are laid out.
    """

    rows: LawRows
    index: LawIndex
    law_names: tuple[str, ...]
    friction_names: tuple[str, ...]
    standing: LawTable
    stops: tuple[RailStops, ...]
    contacts: Ints
    chairs: Ints
    closed: Ints
    further: tuple[int, ...]
    tables: dict[Hashable, SharedTableParts] = field(default_factory=dict)

    def with_objects(self, names: Sequence[str]) -> "LawLayout":
        """Return the layout with the laws of further objects, whose rows come last."""
        count, n_rows = len(self.law_names), len(self.rows.rows)
        laws = {name: count + number for number, name in enumerate(names)}
        return replace(
            self,
            index=replace(self.index, object=self.index.object | laws),
            law_names=(*self.law_names, *(f"object {name}" for name in names)),
            further=(*self.further, *range(n_rows, n_rows + len(names))),
        )


def lay_out(panel: Panel, objects: Sequence[PlacedObject]) -> LawLayout:
    """Place every row and law.

    Parameters
    ----------
    panel : Panel
        A checked panel.
    objects : sequence of PlacedObject
        Foreign objects, of which names and places count.
    """
    stocks = [f"stock rail {name}" for name in panel.stock_rail]
    rows = LawRows({name: [] for name in (*panel.rail, *stocks)})
    laws, index = LawTableBuilder(), LawIndex()
    names: list[str] = []
    feet_names: list[str] = []
    numbers = {name: number for number, name in enumerate(panel.chair)}
    feet_of: list[tuple[int, int]] = []
    for rail_name, rail in panel.rail.items():
        chairs = {k: chair for k, chair in panel.chair.items() if stands_on(chair.rails, rail_name)}
        for name, feet in rail_feet(panel, rail_name, chairs).items():
            key = (rail_name, name)
            for group, contacts in enumerate(
                _add_chair(rows, laws, index, key, chairs[name], feet)
            ):
                feet_of += [(law, group * len(numbers) + numbers[name]) for law in contacts]
                names += [f"chair {name} of rail {rail_name}"] * len(contacts)
                feet_names += [f"chair {name} of rail {rail_name}"] * len(contacts)
        for name, stop, kind in _stops(panel):
            if rail.has_stock_rail and stands_on(stop.rails, rail_name):
                index.stop[rail_name, name] = _add_stop(rows, laws, panel, rail_name, stop)
                names.append(f"{kind} {name} of rail {rail_name}")
    further: list[int] = []
    for name, drive in panel.drive.items():
        index.drive[name] = len(names)
        names.append(f"drive {name}")
        further.append(rows.add(*_rod_end(drive)))
    for name, link in panel.link.items():
        index.link[name] = len(names)
        names.append(f"link {name}")
        further.append(rows.add(*zip(link.rails, _link_ends(panel, link), strict=True)))
    for (name, rail_name), parts in _back_drive_ends(panel).items():
        index.back_drive[name, rail_name] = len(names)
        names.append(f"back drive {name} of rail {rail_name}")
        further.append(rows.add(*parts))
    standing = laws.table()
    for (rail_name, name), frictions in index.chair_friction.items():
        if panel.chair[name].frozen_force > 0.0 and frictions:
            index.bond[rail_name, name] = len(names)
            names.append(f"ice on chair {name} of rail {rail_name}")
            further.append(int(standing.friction_row[frictions[0]]))
    contacts_and_chairs = np.array(feet_of, dtype=np.int64).reshape(-1, 2)
    bare = LawLayout(
        rows=rows,
        index=index,
        law_names=tuple(names),
        friction_names=tuple(feet_names),
        standing=standing,
        stops=_stops_by_rail(panel, index),
        contacts=contacts_and_chairs[:, 0],
        chairs=contacts_and_chairs[:, 1],
        closed=standing.segment_start[contacts_and_chairs[:, 0]] + 1,
        further=tuple(further),
    )
    found = bare.with_objects([item.name for item in objects])
    for item in objects:
        rows.add(*object_ends(panel, item))
    return found


SOFT_STIFFNESS = 750e3 * 2.0**-22
"""Of a spring that pulls with a given force wherever its end is: 0.1 m change 0.02 N. A softer one
is stretched further, and the energy in it leaves fewer digits for that of the rails [N/m]."""


def law_table(
    layout: LawLayout,
    panel: Panel,
    objects: Sequence[PlacedObject],
    *,
    travel: Travel,
    loads: Sequence[int] = (),
) -> LawTable:
    """Return the laws of a panel with the values that it gives them.

    Parameters
    ----------
    layout : Layout
        Of this panel, or of one that differs in values of laws alone.
    panel : Panel
        A checked panel.
    objects : sequence of PlacedObject
        Foreign objects in the places of the layout.
    travel : Travel
        Of the rails, for the shapes and lengths that follow from it.
    loads : sequence of int
        Rows along which forces are given, each by an input that follows those of the drives.
    """
    laws = LawTableBuilder()
    further = iter(layout.further)
    for number, drive in enumerate(panel.drive.values()):
        if drive.machine is not None:
            _add_rod(laws, next(further), panel, drive, number)
            continue
        _add_drive(laws, next(further), drive, number)
    for name, link in panel.link.items():
        _add_linkage(laws, next(further), link, free_length(panel, name, travel) + link.adjustment)
    for name, _ in layout.index.back_drive:
        back_drive = panel.back_drive[name]
        _add_linkage(laws, next(further), back_drive, back_drive.adjustment)
    for (_, name), frictions in zip(layout.index.bond, _bonded(layout), strict=True):
        add_bond(laws, next(further), panel.chair[name], feet=len(frictions))
    for item in objects:
        gap = float(_gap(panel, travel, item.rail, np.array([item.x]))[0])
        add_object(laws, next(further), item, clearance=gap - item.size)
    for number, row in enumerate(loads, len(panel.drive)):
        laws.add_piecewise(
            row, breakpoints=(), slopes=(SOFT_STIFFNESS,), input_index=number, base_segment=0
        )
    return _fill_chairs_and_stops(laws.after(layout.standing, layout.tables), layout, panel, travel)


def _bonded(layout: LawLayout) -> list[tuple[int, ...]]:
    """Return the frictions of every chair that a rail is frozen to."""
    return [layout.index.chair_friction[key] for key in layout.index.bond]


def _stops_by_rail(panel: Panel, index: LawIndex) -> tuple[RailStops, ...]:
    """Return places and clearances of the stops of each rail."""
    stops = {name: stop for name, stop, _ in _stops(panel)}
    found = []
    for rail in panel.rail:
        laws = {name: law for (own, name), law in index.stop.items() if own == rail}
        if laws:
            x, clearance = np.array([[stops[name].x, stops[name].clearance] for name in laws]).T
            found.append(RailStops(rail, np.array(list(laws.values())), x, clearance))
    return tuple(found)


CHAIR_VALUES = attrgetter(
    "clearance", "normal_stiffness", "friction_coefficient", "stick_stiffness"
)
"""Values of a chair that the laws of its plate have."""


def _roller_values(chair: Chair) -> tuple[float, float, float, float]:
    """Return the same of its roller; a foot sticks to it as to the plate."""
    lift = chair.roller_lift or 0.0
    return (
        *(chair.clearance - lift, chair.roller_stiffness),
        *(chair.roller_friction, chair.stick_stiffness),
    )


def _fill_chairs_and_stops(
    table: LawTable, layout: LawLayout, panel: Panel, travel: Travel
) -> LawTable:
    """Fill the laws of chairs and stops, which come first in a new table, with their values.

    A stop's clearance counts from the rail's stress-free shape.
    """
    values = [CHAIR_VALUES(chair) for chair in panel.chair.values()]
    if layout.index.roller:
        values += [_roller_values(chair) for chair in panel.chair.values()]
    by_chair = np.array(values).reshape(-1, 4)
    of_feet = by_chair.T.take(layout.chairs, axis=1)  # unlike an index it leaves no gaps
    clearance, normal_stiffness, friction_coefficient, stick_stiffness = of_feet
    table.offset[layout.contacts] = clearance
    for stops in layout.stops:
        table.offset[stops.laws] = _gap(panel, travel, stops.rail, stops.x) + stops.clearance
    table.slope[layout.closed] = normal_stiffness
    return table._replace(
        friction_coefficient=friction_coefficient, stick_stiffness=stick_stiffness
    )


def _stops(panel: Panel) -> list[tuple[str, Stop, str]]:
    """Return stops and studs with names that do not collide."""
    named = [(name, stop, "stop") for name, stop in panel.stop.items()]
    return named + [(f"stud {name}", stud, "") for name, stud in panel.stud.items()]


def _add_chair(
    rows: LawRows,
    laws: LawTableBuilder,
    index: LawIndex,
    key: tuple[str, str],
    chair: Chair,
    feet: tuple[Point, ...],
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Add a contact and a friction law for each foot point, still without values.

    Returns
    -------
    plate, roller : tuple of int
        Contacts; frictions have their order.
    """
    rail = key[0]
    slide = rows.add((rail, Point(chair.x, "uy", z=chair.foot_height)))
    downs = [rows.add((rail, replace(foot, sign=-1.0))) for foot in feet]

    def carried() -> tuple[tuple[int, ...], tuple[int, ...]]:
        contacts, frictions = [], []
        for row in downs:
            contact = laws.add_contact(row, stiffness=0.0, clearance=0.0, base_closed=True)
            contacts.append(contact)
            frictions.append(
                laws.add_friction(
                    slide, normal=contact, friction_coefficient=0.0, stick_stiffness=0.0
                )
            )
        return tuple(contacts), tuple(frictions)

    index.chair[key], index.chair_friction[key] = carried()
    if chair.roller_lift is None:
        return index.chair[key], ()
    index.roller[key], index.roller_friction[key] = carried()
    return index.chair[key], index.roller[key]


def _add_stop(rows: LawRows, laws: LawTableBuilder, panel: Panel, name: str, stop: Stop) -> int:
    """Add a contact, still without its clearance."""
    return laws.add_contact(
        rows.add(*approach_ends(panel, name, x=stop.x, height=stop.height)),
        stiffness=stop.stiffness,
        clearance=0.0,
    )


def _add_drive(laws: LawTableBuilder, row: int, drive: Drive, number: int) -> None:
    if drive.extension is not None and drive.force is not None:
        extension: Sequence[float] = drive.extension
        inner = (np.diff(drive.force) / np.diff(extension)).tolist()
        slopes = [*inner[:1], *inner, *inner[-1:]]
        base = int(np.searchsorted(extension, 0.0))
    else:
        reach = drive.saturation_force / drive.stiffness
        extension, base = [-reach, reach], 1
        slopes = [drive.saturated_stiffness, drive.stiffness, drive.saturated_stiffness]
    laws.add_piecewise(
        row, breakpoints=extension, slopes=slopes, input_index=number, base_segment=base
    )


def _add_rod(laws: LawTableBuilder, row: int, panel: Panel, drive: Drive, number: int) -> None:
    """Add the rod of a machine, which never slips: the clutch does. It may have lost motion."""
    play, k = 0.5 * panel.machine[drive.machine or ""].rod.play, drive.stiffness
    ends, slopes = ([-play, play], [k, 0.0, k]) if play > 0.0 else ([], [k])
    laws.add_piecewise(
        row,
        breakpoints=ends,
        slopes=slopes,
        input_index=number,
        base_segment=len(ends) // 2,
    )


def _rod_end(drive: Drive) -> list[tuple[str, Point]]:
    """Return the points whose sum is the way of a rod's rail end.

    A stiff rod whose machine end neither lifts nor carries a moment turns about it: with
    `rod_slope` t its rail end goes by ``u_y + t u_z``, so that t times its force acts upwards.
    """
    ends = [(drive.rail, Point(drive.x, "uy", z=drive.height))]
    if drive.rod_slope:
        ends.append((drive.rail, Point(drive.x, "uz", z=drive.height, sign=drive.rod_slope)))
    return ends


def _link_ends(panel: Panel, link: Link) -> list[Point]:
    """Return the ends of a link, whose row is its lengthening.

    The rail that closes towards +y stands on that side.
    """
    signs = [SIGN[panel.rail[rail].closes] for rail in link.rails]
    return [Point(link.x, "uy", z=link.height, sign=sign) for sign in signs]


def _back_drive_ends(panel: Panel) -> dict[tuple[str, str], list[tuple[str, Point]]]:
    """Return both places of every back drive on every rail that it moves.

    The row is how much further closed its place is than the motion at the drive makes it.
    """
    found = {}
    for name, item in panel.back_drive.items():
        drive = panel.drive[item.drive]
        for rail, record in panel.rail.items():
            if stands_on(item.rails, rail):
                side = SIGN[record.closes]
                second = Point(item.x, "uy", z=item.height, sign=side)
                first = Point(drive.x, "uy", z=drive.height, sign=-item.ratio * side)
                found[name, rail] = [(rail, second), (rail, first)]
    return found


def _add_linkage(laws: LawTableBuilder, row: int, linkage: Linkage, free: float) -> None:
    """Add a linear spring that is free of force at a value of its row, or around it with play."""
    play = 0.5 * linkage.lost_motion
    breakpoints = [-play, play] if play > 0 else []
    slopes = [linkage.stiffness, 0.0, linkage.stiffness] if play > 0 else [linkage.stiffness]
    laws.add_piecewise(
        row,
        breakpoints=breakpoints,
        slopes=slopes,
        offset=free,
        base_segment=-1 if play > 0 else 0,
    )


def free_length(panel: Panel, name: str, travel: Travel) -> float:
    """Return the lengthening at which a link is free of force, without its adjustment [m].

    Lengths count from where both rails are stress-free. The link is free of force in the through
    route: the instrumented rail closed and the other open. Where both rails move alike at the link,
    as those of a symmetric panel do, that holds in every position.
    """
    link = panel.link[name]
    drive = drive_at(panel, link.x)
    ways = {
        rail: travel.link_ends[name, rail] if drive is None else drive.stroke for rail in link.rails
    }
    if not all(map(math.isfinite, ways.values())):
        msg = (
            f"link.{name}.x = {link.x:g} m: its length follows from how far both rails move "
            "there, and no drive or other link moves one of them; move the link to a drive"
        )
        raise MechanicsError(msg)
    signs = [SIGN[panel.rail[rail].closes] for rail in link.rails]
    ends = [offset_at(panel, rail, ways[rail]) for rail in link.rails]
    return float(sum(map(operator.mul, signs, ends)))


def _gap(panel: Panel, travel: Travel, name: str, x: Floats) -> Floats:
    """Return the gap of a rail to its stock rail [m], which must be there."""
    gap = unloaded_gap(panel, travel.shapes.get(name), name, x)
    if gap is None:
        msg = f"a foreign object or stop at x = {x[0]:g} m needs a stock rail; give fit_gap"
        raise MechanicsError(msg)
    return gap
