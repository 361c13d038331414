"""Mechanism from panel records, kept in memory by the values that shape it.

See `build_rails` for the rails, `laws` for what acts on them, `shape_key` for what shapes it.

These files alone see both definition and mechanics.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import MechanicsError
from turnout.core.lru_cache import LRUCache
from turnout.core.threads import one_blas_thread
from turnout.law.friction import FrictionCourses, no_courses
from turnout.mechanism.build_rails import SIGN, stock_rail_data, switch_rail_data, with_scale
from turnout.mechanism.drive_machines import drive_machines
from turnout.mechanism.laws import LawLayout, LawRows, law_table, lay_out
from turnout.mechanism.mechanism import LawIndex, Mechanism, RailBody, RailData, ReducedRail
from turnout.mechanism.object_laws import divided, obstructions_of
from turnout.mechanism.object_rows import (
    approach_row,
    is_off_node,
    local_flexibility,
    node_rows,
)
from turnout.mechanism.reduce import reduce_rail
from turnout.mechanism.shape_key import LAWS_ALONE, shape_of
from turnout.mechanism.travel import RailRows, Travel, rail_travel
from turnout.panel.foreign_object import PlacedObject
from turnout.panel.load import LoadedPanel
from turnout.panel.model import Panel

Floats = NDArray[np.float64]

_MATRICES = ("stiffness", "mass", "damping", "load")


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
    places = _reference(panel)
    objects = sorted(divided(objects), key=lambda item: is_off_node(places, item))
    placed = _placed(panel, objects)
    layout, linear = placed.layout, placed.linear
    objects = placed.softened(objects)
    return Mechanism(
        stiffness=linear.stiffness,
        mass=linear.mass,
        damping=linear.damping,
        load=linear.load,
        rows=placed.rows,
        laws=law_table(layout, panel, objects, travel=linear.travel),
        law_names=layout.law_names,
        friction_names=layout.friction_names,
        index=replace(layout.index, object_parts=object_parts(objects)),
        rails=linear.rails,
        shapes=linear.travel.shapes,
        machines=drive_machines(panel, layout.index),
        obstructions=obstructions_of(layout.index, objects),
        courses=friction_courses(panel, layout.index, linear.travel),
        core=linear.rows,
        reduced=linear.reduced,
    )


def object_parts(objects: Sequence[PlacedObject]) -> dict[str, tuple[str, ...]]:
    """Return the names of the parts of every object, of which most have one."""
    found: dict[str, tuple[str, ...]] = {}
    for item in objects:
        whole = item.whole or item.name
        found[whole] = (*found.get(whole, ()), item.name)
    return found


@dataclass(frozen=True, slots=True, eq=False)
class _Linear:
    """A mechanism without its laws."""

    stiffness: Floats
    mass: Floats
    damping: Floats
    load: Floats
    rows: Floats
    rails: tuple[RailBody, ...]
    reduced: tuple[ReducedRail, ...]
    travel: Travel


@dataclass(frozen=True, slots=True)
class _Frame:
    """Common parts of panels that differ in the scales of sections too.

    `rails` are without these scales; the records are those that the key names by identity. `kept`
    are the linear parts by the scales.
    """

    layout: LawLayout
    rails: tuple[RailData, ...]
    records: object
    kept: "LRUCache[_Kept]"

    def scaled(self, panel: Panel) -> list[RailData]:
        """Return the rails with the scales that a panel gives for their sections."""
        return [with_scale(d, panel) if d.name in panel.rail else d for d in self.rails]


@dataclass(frozen=True, slots=True, eq=False)
class _Placed:
    """Rails with the rows of objects.

    `rows` begin with those of `linear`, which has the rows of objects that are nodes of its rails.
    `yields` is what the rails yield to each object beyond their reduced coordinates [m/N].
    """

    linear: _Linear
    layout: LawLayout
    rows: Floats
    yields: tuple[float, ...]

    def softened(self, objects: Sequence[PlacedObject]) -> list[PlacedObject]:
        """Return the objects in series with the flexibility of the rails, if any."""
        return [
            replace(item, stiffness=1.0 / (1.0 / item.stiffness + flexibility))
            if flexibility
            else item
            for item, flexibility in zip(objects, self.yields, strict=True)
        ]


@dataclass(frozen=True, slots=True, eq=False)
class _Kept:
    """Common parts of panels that differ in values of laws and motion alone.

    `placed` are the same rails with objects, by the places of these.
    """

    frame: _Frame
    linear: _Linear
    # a megabyte each
    placed: LRUCache[_Placed] = field(default_factory=lambda: LRUCache[_Placed](64))


_frames = LRUCache[_Frame](64)
_by_reference = LRUCache[tuple[_Kept, Panel]](64)


def _reference(panel: Panel) -> Panel:
    """Return a panel that differs in values of laws alone, the same one for many."""
    return panel.reference_panel(LAWS_ALONE) if isinstance(panel, LoadedPanel) else panel


def _kept(panel: Panel, objects: Sequence[PlacedObject]) -> _Kept:
    """Return layout and linear part, or those of a panel that differs in laws and motion alone."""
    first = _reference(panel)
    known = (id(first), tuple([(item.name, item.rail, item.x, item.height) for item in objects]))
    found = None if first is panel else _by_reference.get(known)
    if found is not None:
        return found[0]
    if not isinstance(panel, LoadedPanel) or not all(m.digest for m in panel.matrices.values()):
        own = _made_frame(panel, objects, records=None)
        return _Kept(own, _made_linear(panel, own))
    (key, scales), records = shape_of(panel, objects)
    frame = _frames.get(key)
    if frame is None:
        frame = _frames.put(key, _made_frame(panel, objects, records=records))
    made = frame.kept.get(scales)
    if made is None:
        made = _Kept(frame, _made_linear(panel, frame))
        for name in (*_MATRICES, "rows"):
            getattr(made.linear, name).flags.writeable = False
        frame.kept.put(scales, made)
    if first is not panel:  # others will have it too
        _by_reference.put(known, (made, first))
    return made


def clear_mechanisms() -> None:
    """Empty the memory of layouts and linear parts."""
    _frames.clear()
    _by_reference.clear()


def _placed(panel: Panel, objects: Sequence[PlacedObject]) -> _Placed:
    """Put objects on the rails, those between the nodes last, or find them in the same places."""
    bare = _kept(panel, ())
    if not objects:
        return _Placed(bare.linear, bare.frame.layout, bare.linear.rows, ())
    places = tuple([(item.name, item.rail, item.x, item.height) for item in objects])
    found = bare.placed.get(places)
    if found is None:
        with one_blas_thread():
            found = bare.placed.put(places, _put_objects(bare, panel, objects))
    return found


def _put_objects(bare: _Kept, panel: Panel, objects: Sequence[PlacedObject]) -> _Placed:
    """Add the rows of objects to those of rails, which are made with nodes for them if need be."""
    kept, added = bare, objects
    places = _reference(panel)
    standing = [item for item in objects if not is_off_node(places, item)]
    between = objects[len(standing) :]
    rails = kept.frame.scaled(panel)
    rows = node_rows(panel, standing, rails, bare.linear.rails)
    if rows is None:
        kept, added, rows = _kept(panel, standing), between, []
        rails = kept.frame.scaled(panel)
    linear, layout = kept.linear, kept.frame.layout
    if not added:
        return _Placed(linear, layout, linear.rows, (0.0,) * len(standing))
    rows += [approach_row(panel, item, linear.rails) for item in between]
    yields = [local_flexibility(panel, item, rails=rails) for item in between]
    stacked = np.vstack((linear.rows, *rows))
    stacked.flags.writeable = False
    layout = layout.with_objects([item.name for item in added])
    return _Placed(linear, layout, stacked, (*(0.0 for _ in standing), *yields))


def _made_frame(panel: Panel, objects: Sequence[PlacedObject], *, records: object) -> _Frame:
    layout = lay_out(panel, objects)
    rails = tuple(_rail_data(panel, layout.rows, objects))
    # about ten megabytes each
    return _Frame(layout, rails, records, LRUCache[_Kept](4))


def _made_linear(panel: Panel, frame: _Frame) -> _Linear:
    layout, rows = frame.layout, frame.layout.rows
    with one_blas_thread():
        rails = _reduced_rails(frame.scaled(panel))
        switch_rails = {rail.body.name: rail for rail in rails if rail.body.name in panel.rail}
        held = {name: _held_rows(name, rail, layout) for name, rail in switch_rails.items()}
        travel = rail_travel(panel, switch_rails, held)
    return _Linear(
        stiffness=_block_diagonal([r.stiffness for r in rails]),
        mass=_block_diagonal([r.mass for r in rails]),
        damping=_block_diagonal([r.damping for r in rails]),
        load=np.concatenate([r.load for r in rails]),
        rows=_stacked_rows(rows, rails),
        rails=tuple(rail.body for rail in rails),
        reduced=tuple(rails),
        travel=travel,
    )


def _block_diagonal(blocks: list[Floats]) -> Floats:
    """Return square matrices along the diagonal of one."""
    ends = np.cumsum([0, *(block.shape[0] for block in blocks)])
    found = np.zeros((ends[-1], ends[-1]))
    for block, first, last in zip(blocks, ends[:-1], ends[1:], strict=True):
        found[first:last, first:last] = block
    return found


def _held_rows(name: str, rail: ReducedRail, layout: LawLayout) -> RailRows:
    """Return the rows of a rail at its feet and wherever something moves it."""
    index, standing = layout.index, layout.standing.row

    def row(law: int) -> Floats | None:
        """Return the part of a law's row that belongs to the rail itself."""
        beyond = law - standing.size
        number = int(standing[law]) if beyond < 0 else layout.further[beyond]
        points = [point for owner, point in layout.rows.rows[number] if owner == name]
        return rail.rows[points].sum(axis=0) if points else None

    def rows(members: Mapping[str, int], sign: float = 1.0) -> dict[str, Floats]:
        found = {key: row(law) for key, law in members.items()}
        return {key: sign * own for key, own in found.items() if own is not None}

    feet = [law for (own, _), group in index.chair.items() if own == name for law in group]
    linkages = {key: law for (key, own), law in index.back_drive.items() if own == name}
    return RailRows(
        feet=np.array([row(law) for law in feet]).reshape(-1, rail.body.count),
        drives=rows(index.drive),
        links=rows(index.link, rail.body.closes),
        back_drives=rows(linkages),
    )


def rail_data(panel: Panel, objects: Sequence[PlacedObject] = ()) -> list[RailData]:
    """Return every rail of a panel as data, in the order of the mechanism's bodies.

    Parameters
    ----------
    panel : Panel
        A checked panel.
    objects : sequence of PlacedObject
        Foreign objects; those at places of the panel become nodes.
    """
    objects = [item for item in divided(objects) if not is_off_node(panel, item)]
    return _made_frame(panel, objects, records=None).scaled(panel)


def _rail_data(panel: Panel, rows: LawRows, objects: Sequence[PlacedObject]) -> list[RailData]:
    """Return the rails, switch rails without the scales of their sections."""
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


def _stacked_rows(rows: LawRows, rails: list[ReducedRail]) -> Floats:
    size = sum(rail.body.count for rail in rails)
    matrix = np.zeros((len(rows.rows), size))
    listed: dict[str, list[tuple[int, int]]] = {rail.body.name: [] for rail in rails}
    for number, parts in enumerate(rows.rows):
        for rail_name, point in parts:
            listed[rail_name].append((number, point))
    for rail in rails:
        numbers, points = np.array(listed[rail.body.name], dtype=np.intp).reshape(-1, 2).T
        place = slice(rail.body.first, rail.body.first + rail.body.count)
        np.add.at(matrix[:, place], numbers, rail.rows[points])
    return matrix


def friction_courses(panel: Panel, index: LawIndex, travel: Travel) -> FrictionCourses:
    """Return the courses of all frictions on chairs that have one.

    The opening counts from the closed position of the rail at the chair: a rail that is stress-free
    at a share of its way has come from there by this share.

    Parameters
    ----------
    panel : Panel
        With the courses of its chairs.
    index : LawIndex
        Frictions by rail and chair.
    travel : Travel
        Ways of the rails from closed to open.
    """
    if all(chair.friction_factor is None for chair in panel.chair.values()):
        return no_courses()
    rows: list[tuple[int, float, float, float]] = []
    courses: list[tuple[tuple[float, ...], list[float]]] = []
    for (rail, name), frictions in index.chair_friction.items():
        chair, shape = panel.chair[name], travel.shapes.get(rail)
        if chair.friction_factor is None or chair.friction_opening is None or shape is None:
            continue
        way = float(shape.travel_at(np.array([chair.x]))[0])
        if not np.isfinite(way):
            message = (
                f"chair.{name}.friction_opening: how far rail {rail} moves there is not known; "
                "give the rail fit_gap in place of stock_rail_gap"
            )
            raise MechanicsError(message)
        closed, side = panel.rail[rail].fraction * way, SIGN[panel.rail[rail].closes]
        for friction in frictions:
            rows.append((friction, chair.friction_coefficient, closed, side))
            courses.append((tuple(chair.friction_opening), chair.friction_factor))
    if not rows:
        return no_courses()
    columns = np.array(rows, dtype=float).T
    counts = [len(opening) for opening, _ in courses]
    return FrictionCourses(
        friction=columns[0].astype(np.int64),
        coefficient=columns[1].copy(),
        closed=columns[2].copy(),
        side=columns[3].copy(),
        start=np.concatenate(([0], np.cumsum(counts))).astype(np.int64),
        opening=np.concatenate([opening for opening, _ in courses]).astype(float),
        factor=np.concatenate([factor for _, factor in courses]).astype(float),
        at=np.full(len(rows), -1, dtype=np.int64),
    )
