"""From panel records to a mechanism: laws and rows; see `build_rails` for the rails.

These two files alone see both definition and mechanics.
"""

from collections import OrderedDict
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from turnout.errors import MechanicsError
from turnout.law.table import LawTableBuilder
from turnout.mechanism.build_rails import (
    SIGN,
    rail_feet,
    stands_on,
    stock_body,
    stock_rail_data,
    switch_rail_data,
)
from turnout.mechanism.mechanism import LawIndex, Mechanism, RailBody
from turnout.mechanism.rail import Point, RailData, ReducedRail
from turnout.mechanism.reduce import reduce_rail
from turnout.mechanism.shape import shape_of
from turnout.mechanism.threads import one_blas_thread
from turnout.panel.drive_records import Drive, Link
from turnout.panel.foreign_object import PlacedObject
from turnout.panel.load import LoadedPanel
from turnout.panel.model import Panel
from turnout.panel.motion import start_offset
from turnout.panel.profile import stock_rail_gap
from turnout.panel.rail_records import Rail
from turnout.panel.support_records import Chair, Stop

Floats = NDArray[np.float64]

MOST_LINEAR = 32
"""So many linear parts are kept in memory, the latest used."""


@dataclass(slots=True)
class _Rows:
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


def build_mechanism(panel: Panel, objects: Sequence[PlacedObject] = ()) -> Mechanism:
    """Build the mechanism of a panel with foreign objects in place.

    Parameters
    ----------
    panel : Panel
        A checked panel.
    objects : sequence of PlacedObject
        Foreign objects with place, rail and time in SI.

    Returns
    -------
    Mechanism
        One input a drive, in the order of ``panel.drive``: its marker position [m].
    """
    layout = _layout(panel, objects)
    linear = _kept_linear(panel, layout.rows, objects)
    return Mechanism(
        stiffness=linear.stiffness,
        mass=linear.mass,
        damping=linear.damping,
        load=linear.load,
        rows=linear.rows,
        laws=layout.laws.table(),
        law_names=tuple(layout.law_names),
        friction_names=tuple(layout.friction_names),
        index=layout.index,
        rails=linear.rails,
    )


@dataclass(frozen=True, slots=True)
class _Linear:
    """What a mechanism is without its laws."""

    stiffness: Floats
    mass: Floats
    damping: Floats
    load: Floats
    rows: Floats
    rails: tuple[RailBody, ...]


_linear: OrderedDict[Hashable, tuple[_Linear, object]] = OrderedDict()


def _kept_linear(panel: Panel, rows: _Rows, objects: Sequence[PlacedObject]) -> _Linear:
    """Return the linear part, or that of a panel which differs in laws and motion alone."""
    if not isinstance(panel, LoadedPanel) or not all(m.digest for m in panel.matrices.values()):
        return _made_linear(panel, rows, objects)
    key, records = shape_of(panel, objects)
    if key not in _linear:
        made = _made_linear(panel, rows, objects)
        for array in (made.stiffness, made.mass, made.damping, made.load, made.rows):
            array.flags.writeable = False
        _linear[key] = made, records
        while len(_linear) > MOST_LINEAR:
            _linear.popitem(last=False)
    _linear.move_to_end(key)
    return _linear[key][0]


def forget() -> None:
    """Empty the memory of linear parts."""
    _linear.clear()


def _made_linear(panel: Panel, rows: _Rows, objects: Sequence[PlacedObject]) -> _Linear:
    with one_blas_thread():
        rails = _reduced_rails(_rail_data(panel, rows, objects))
    return _Linear(
        stiffness=block_diag(*(r.stiffness for r in rails)),
        mass=block_diag(*(r.mass for r in rails)),
        damping=block_diag(*(r.damping for r in rails)),
        load=np.concatenate([r.load for r in rails]),
        rows=_stacked_rows(rows, rails),
        rails=tuple(r.body for r in rails),
    )


def rail_data(panel: Panel, objects: Sequence[PlacedObject] = ()) -> list[RailData]:
    """Return every rail of a panel as data, in the order of the mechanism's bodies.

    Parameters
    ----------
    panel : Panel
        A checked panel.
    objects : sequence of PlacedObject
        Foreign objects, whose places become nodes.
    """
    return _rail_data(panel, _layout(panel, objects).rows, objects)


@dataclass(frozen=True, slots=True)
class _Layout:
    """Rows and laws before the rails are reduced."""

    rows: _Rows
    laws: LawTableBuilder
    index: LawIndex
    law_names: list[str]
    friction_names: list[str]


def _layout(panel: Panel, objects: Sequence[PlacedObject]) -> _Layout:
    """Put every row and law where it acts."""
    stocks = [f"stock rail {name}" for name in panel.stock_rail]
    rows = _Rows({name: [] for name in (*panel.rail, *stocks)})
    laws = LawTableBuilder()
    index = LawIndex()
    law_names: list[str] = []
    friction_names: list[str] = []
    for rail_name, rail in panel.rail.items():
        chairs = {k: chair for k, chair in panel.chair.items() if stands_on(chair.rails, rail_name)}
        for name, feet in rail_feet(panel, rail_name, chairs).items():
            key = (rail_name, name)
            contacts, frictions = _add_chair(rows, laws, rail_name, chairs[name], feet)
            index.chair[key], index.chair_friction[key] = contacts, frictions
            law_names += [f"chair {name} of rail {rail_name}"] * len(contacts)
            friction_names += [f"chair {name} of rail {rail_name}"] * len(frictions)
        for name, stop, kind in _stops(panel):
            if rail.stock_rail_gap is not None and stands_on(stop.rails, rail_name):
                index.stop[rail_name, name] = _add_stop(rows, laws, panel, rail_name, stop)
                law_names.append(f"{kind} {name} of rail {rail_name}")
    for number, (name, drive) in enumerate(panel.drive.items()):
        index.drive[name] = _add_drive(rows, laws, drive, number)
        law_names.append(f"drive {name}")
    for name, link in panel.link.items():
        index.link[name] = _add_link(rows, laws, panel, link)
        law_names.append(f"link {name}")
    for item in objects:
        index.object[item.name] = _add_object(rows, laws, panel, item)
        law_names.append(f"object {item.name}")
    return _Layout(rows, laws, index, law_names, friction_names)


def _stops(panel: Panel) -> list[tuple[str, Stop, str]]:
    """Return stops and studs with names that do not collide."""
    named = [(name, stop, "stop") for name, stop in panel.stop.items()]
    return named + [(f"stud {name}", stud, "") for name, stud in panel.stud.items()]


def _add_chair(
    rows: _Rows, laws: LawTableBuilder, rail: str, chair: Chair, feet: tuple[Point, ...]
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Add a contact and a friction law for each foot point of a chair."""
    slide = rows.add((rail, Point(chair.x, "uy", z=chair.foot_height)))
    contacts, frictions = [], []
    for foot in feet:
        contact = laws.add_contact(
            rows.add((rail, replace(foot, sign=-1.0))),
            stiffness=chair.normal_stiffness,
            clearance=chair.clearance,
            base_closed=True,
        )
        contacts.append(contact)
        frictions.append(
            laws.add_friction(
                slide,
                normal=contact,
                friction_coefficient=chair.friction_coefficient,
                stick_stiffness=chair.stick_stiffness,
            )
        )
    return tuple(contacts), tuple(frictions)


def _approach(rows: _Rows, panel: Panel, name: str, *, x: float, height: float) -> int:
    """Add the row of a switch rail's approach to its stock rail, positive closing."""
    side = SIGN[panel.rail[name].closes]
    ends = [(name, Point(x, "uy", z=height, sign=side))]
    body = stock_body(panel, name)
    if body is not None:
        foot = next(s.foot_height for s in panel.stock_rail.values() if s.faces == name)
        ends.append((body, Point(x, "uy", z=height - foot, sign=-side)))
    return rows.add(*ends)


def _add_stop(rows: _Rows, laws: LawTableBuilder, panel: Panel, name: str, stop: Stop) -> int:
    return laws.add_contact(
        _approach(rows, panel, name, x=stop.x, height=stop.height),
        stiffness=stop.stiffness,
        clearance=_gap(panel.rail[name], stop.x) + stop.clearance,
    )


def _add_drive(rows: _Rows, laws: LawTableBuilder, drive: Drive, number: int) -> int:
    row = rows.add((drive.rail, Point(drive.x, "uy", z=drive.height)))
    if drive.extension is not None and drive.force is not None:
        extension, force = np.array(drive.extension), np.array(drive.force)
        inner = np.diff(force) / np.diff(extension)
        slopes = np.concatenate((inner[:1], inner, inner[-1:]))
        return laws.add_piecewise(
            row,
            breakpoints=extension,
            slopes=slopes,
            input_index=number,
            base_segment=int(np.searchsorted(extension, 0.0)),
        )
    reach = drive.saturation_force / drive.stiffness
    return laws.add_piecewise(
        row,
        breakpoints=np.array([-reach, reach]),
        slopes=np.array([drive.saturated_stiffness, drive.stiffness, drive.saturated_stiffness]),
        input_index=number,
        base_segment=1,
    )


def _add_link(rows: _Rows, laws: LawTableBuilder, panel: Panel, link: Link) -> int:
    """Add a spring that is slack where the rails start; tension is positive.

    The rail that closes towards +y stands on that side. The distance of a start from the
    stress-free position is interpolated between the strokes of the drives.
    """
    signs = [SIGN[panel.rail[rail].closes] for rail in link.rails]
    ends = [Point(link.x, "uy", z=link.height, sign=sign) for sign in signs]
    drives = sorted((drive.x, drive.stroke) for drive in panel.drive.values())
    travel = float(np.interp(link.x, *np.array(drives).T))
    starts = [start_offset(panel, rail, travel) for rail in link.rails]
    return laws.add_piecewise(
        rows.add(*zip(link.rails, ends, strict=True)),
        breakpoints=np.empty(0),
        slopes=np.array([link.stiffness]),
        offset=float(np.dot(signs, starts)),
        base_segment=0,
    )


def _add_object(rows: _Rows, laws: LawTableBuilder, panel: Panel, item: PlacedObject) -> int:
    return laws.add_contact(
        _approach(rows, panel, item.rail, x=item.x, height=item.height),
        stiffness=item.stiffness,
        clearance=_gap(panel.rail[item.rail], item.x) - item.size,
        appears=item.appears,
        disappears=item.disappears,
        waits=True,
    )


def _rail_data(panel: Panel, rows: _Rows, objects: Sequence[PlacedObject]) -> list[RailData]:
    data = [switch_rail_data(panel, n, tuple(rows.points[n]), objects) for n in panel.rail]
    data += [
        stock_rail_data(panel, n, tuple(rows.points[f"stock rail {n}"])) for n in panel.stock_rail
    ]
    return data


def _reduced_rails(data: list[RailData]) -> list[ReducedRail]:
    rails: list[ReducedRail] = []
    first = 0
    for rail in data:
        rails.append(reduce_rail(rail, first=first))
        first += rails[-1].body.count
    return rails


def _gap(rail: Rail, x: float) -> float:
    """Return the gap of a rail to its stock rail [m], which must be there."""
    gap = stock_rail_gap(rail, x)
    if gap is None:
        msg = f"a foreign object or stop at x = {x:g} m needs a stock rail; give stock_rail_gap"
        raise MechanicsError(msg)
    return float(gap)


def _stacked_rows(rows: _Rows, rails: list[ReducedRail]) -> Floats:
    by_name = {rail.body.name: rail for rail in rails}
    size = sum(rail.body.count for rail in rails)
    matrix = np.zeros((len(rows.rows), size))
    for number, parts in enumerate(rows.rows):
        for rail_name, point in parts:
            rail = by_name[rail_name]
            place = slice(rail.body.first, rail.body.first + rail.body.count)
            matrix[number, place] += rail.rows[point]
    return matrix
