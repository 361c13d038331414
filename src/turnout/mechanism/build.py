"""Mechanism from panel records, kept in memory by the values that shape it.

See `build_rails` for the rails, `laws` for what acts on them, `shape_key` for what shapes it.

These files alone see both definition and mechanics.
"""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import MechanicsError
from turnout.core.lru_cache import LRUCache
from turnout.core.threads import one_blas_thread
from turnout.law.friction import FrictionCourses, curve_arrays, no_courses
from turnout.law.friction_state import FrictionCurve
from turnout.law.table import LawTable
from turnout.mechanism.build_rails import (
    SIGN,
    STOCK,
    held_by,
    object_ends,
    stock_rail_data,
    supports_of,
    switch_rail_data,
    with_scales,
)
from turnout.mechanism.drive_machines import drive_machines
from turnout.mechanism.laws import LawLayout, LawRows, law_table, lay_out
from turnout.mechanism.mechanism import (
    JoinedRails,
    Mechanism,
    Point,
    RailBody,
    RailData,
    ReducedRail,
)
from turnout.mechanism.object_laws import divided, obstructions_of
from turnout.mechanism.object_rows import (
    LocalFlexibility,
    ObjectEnd,
    approach_row,
    ends_on_nodes,
    is_at_interface,
    is_off_node,
    needs_node,
)
from turnout.mechanism.reduce import reduce_rail
from turnout.mechanism.shape_key import Variation, shape_of, variation_of
from turnout.mechanism.travel import RailRows, Travel, rail_travel
from turnout.mechanism.varied_rails import (
    STEP,
    RailFamily,
    clear_families,
    nominal_scale,
    rail_family,
    varied_rail,
)
from turnout.panel.foreign_object import PlacedObject
from turnout.panel.load import LoadedPanel
from turnout.panel.model import Panel

Floats = NDArray[np.float64]


def build_mechanism(
    panel: Panel, objects: Sequence[PlacedObject] = (), *, nominal: LoadedPanel | None = None
) -> Mechanism:
    """Build the mechanism of a panel with foreign objects in place.

    Parameters
    ----------
    panel : Panel
        A checked panel.
    objects : sequence of PlacedObject
        Foreign objects with place, rail and time in SI.
    nominal : LoadedPanel, optional
        Panel whose rails give the shapes that those of `panel` are reduced to where they differ in
        factors of sections or in fastenings alone, see `turnout.mechanism.varied_rails`. By default
        each rail has its own.

    Returns
    -------
    Mechanism
        One input a drive, in the order of ``panel.drive``: its marker position [m].
    """
    objects = sorted(divided(objects), key=lambda item: is_off_node(panel, item))
    placed = _placed(panel, objects, nominal)
    layout, linear = placed.layout, placed.linear
    objects = placed.softened(objects)
    laws = law_table(layout, panel, objects, travel=linear.travel)
    laws, courses = friction_courses(panel, laws, layout, linear.travel)
    return Mechanism(
        matrices=linear.matrices,
        core=linear.rows,
        object_rows=placed.rows,
        laws=laws,
        law_names=layout.law_names,
        friction_names=layout.friction_names,
        index=replace(layout.index, object_parts=object_parts(objects)),
        rails=linear.rails,
        shapes=linear.travel.shapes,
        machines=drive_machines(panel, layout.index),
        obstructions=obstructions_of(layout.index, objects),
        courses=courses,
        nominal=linear.nominal,
    )


def build_loaded(
    panel: Panel, objects: Sequence[PlacedObject], loads: Sequence[tuple[str, Point]]
) -> Mechanism:
    """Build the mechanism of a panel with points at which given forces act.

    Rails have nodes and coordinates at these points, so that what forces do there is exact.

    Parameters
    ----------
    panel, objects
        As for `build_mechanism`; objects stand at places of the panel.
    loads : sequence of (str, Point)
        Rails, and points of theirs at nodes, each with the direction of its force.

    Returns
    -------
    Mechanism
        After the inputs of the drives it has one for each force, ``force / SOFT_STIFFNESS``.
        Friction has its level in motion, whatever the speed.
    """
    objects = list(divided(objects))
    layout = lay_out(panel, objects)
    rows = [layout.rows.add(load) for load in loads]
    frame = _made_frame(panel, objects, layout)
    linear = _made_kept(panel, frame, frame.rails_of(variation_of(panel), panel)).linear
    laws = law_table(layout, panel, objects, travel=linear.travel, loads=rows)
    laws, courses = friction_courses(panel, laws, layout, linear.travel)
    names = tuple(f"load at x = {point.x:g} m of rail {rail}" for rail, point in loads)
    return Mechanism(
        matrices=linear.matrices,
        core=linear.rows,
        laws=laws,
        law_names=(*layout.law_names, *names),
        friction_names=layout.friction_names,
        index=replace(layout.index, object_parts=object_parts(objects)),
        rails=linear.rails,
        shapes=linear.travel.shapes,
        obstructions=obstructions_of(layout.index, objects),
        courses=courses.without_curves(),
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
    """A mechanism without its laws.

    Of varied rails `ratios` are those of their scales to the nominal ones.
    """

    matrices: JoinedRails
    rows: Floats
    rails: tuple[RailBody, ...]
    travel: Travel
    nominal: Mechanism | None = None
    ratios: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class _Frame:
    """Common parts of panels that differ in the matrices of their rails too.

    `rails` are without factors of sections, with fastenings of `holds`; `layouts` have the laws of
    objects too, by the names of these. `kept` are the linear parts
    by the variation, `varied` those in shapes of nominal rails, of the latest panels, and `begun`
    such rails of panels that come next.
    """

    layout: LawLayout
    rails: tuple[RailData, ...]
    holds: tuple[tuple[tuple[float, ...], ...], ...]
    kept: "LRUCache[_Kept]"
    varied: "LRUCache[_Kept]"
    begun: "LRUCache[_Varied]"
    layouts: LRUCache[LawLayout]

    def rails_of(self, variation: Variation, panel: Panel) -> list[RailData]:
        """Return the rails of a variation, whose fastenings are those of a panel."""
        rails: Sequence[RailData] = self.rails
        if variation.holds != self.holds:
            rails = [replace(rail, supports=supports_of(panel, rail.name)) for rail in rails]
        if variation.holding:
            of_switch, of_stock = variation.holding
            rails = [
                held_by(rail, of_stock if rail.name.startswith(STOCK) else of_switch)
                for rail in rails
            ]
        return [with_scales(*pair) for pair in zip(rails, variation.scales, strict=True)]


@dataclass(frozen=True, slots=True, eq=False)
class _Kept:
    """Common parts of panels that differ in values of laws and motion alone.

    `rails` are those of `linear`, `held` where the switch rails are held. `placed` are the same
    rails with objects, by the places of these. Of varied rails `base` are the nominal ones, which
    have these instead.
    """

    frame: _Frame
    rails: tuple[RailData, ...]
    held: dict[str, RailRows]
    linear: _Linear
    base: "_Kept | None" = None
    # a megabyte each
    placed: LRUCache["_Placed"] = field(default_factory=lambda: LRUCache[_Placed](64))
    nominal: LRUCache[Mechanism] = field(default_factory=lambda: LRUCache[Mechanism](4))
    locals: dict[tuple[str, float], LocalFlexibility] = field(default_factory=dict)

    families: dict[str, RailFamily | None] = field(default_factory=dict)

    def family(self, data: RailData, reduced: ReducedRail) -> RailFamily | None:
        """Return the family of one of the rails."""
        if data.name not in self.families:
            self.families[data.name] = rail_family(data, reduced)
        return self.families[data.name]

    def local(self, name: str, *, lateral: float = 1.0) -> LocalFlexibility:
        """Return the local flexibility of a rail, or of it with another lateral scale."""
        found = self.locals.get((name, lateral))
        if found is None:
            data = next(rail for rail in self.rails if rail.name == name)
            found = LocalFlexibility(with_scales(data, (1.0, lateral)))
            self.locals[name, lateral] = found
        return found


@dataclass(frozen=True, slots=True)
class Yield:
    """Local flexibility of a rail, and how it goes with the lateral scale.

    Shear and torsion of an element yield as well as its bending, so that it goes with a power of
    the lateral scale, and with the inverse of the section scale.

    Attributes
    ----------
    flexibility : float
        Of the nominal rail [m/N].
    exponent : float
        Of the ratio of lateral scales.
    """

    flexibility: float
    exponent: float = 0.0

    def of(self, scale: float, lateral: float) -> float:
        """Return the flexibility of a rail with ratios of both scales [m/N]."""
        return self.flexibility / scale * float(lateral**self.exponent)


@dataclass(frozen=True, slots=True, eq=False)
class _Placed:
    """Rails with the rows of objects.

    `rows` come after those of `linear`, which has those of objects that are nodes of its rails;
    `nodes` are these objects if the rails have no others. `yields` is what each rail yields to each
    object beyond its reduced coordinates.
    """

    linear: _Linear
    layout: LawLayout
    rows: Floats | None
    yields: tuple[Mapping[str, Yield], ...]
    nodes: tuple[PlacedObject, ...] = ()

    def softened(self, objects: Sequence[PlacedObject]) -> list[PlacedObject]:
        """Return the objects in series with the flexibility of the rails, if any."""
        ratios, found = self.linear.ratios, list[PlacedObject]()
        for item, yields in zip(objects, self.yields, strict=True):
            local = sum(own.of(*ratios.get(name, (1.0, 1.0))) for name, own in yields.items())
            softer = 1.0 / (1.0 / item.stiffness + local)
            found.append(replace(item, stiffness=softer) if local else item)
        return found


_frames = LRUCache[_Frame](64)
MOST_VARIED = 32
"""Panels of which rails are begun."""


def _kept(panel: Panel, objects: Sequence[PlacedObject], nominal: LoadedPanel | None) -> _Kept:
    """Return layout and linear part, or those of a panel that differs in laws and motion alone."""
    if not isinstance(panel, LoadedPanel) or not all(m.digest for m in panel.matrices.values()):
        own = _made_frame(panel, objects)
        return _made_kept(panel, own, own.rails_of(variation_of(panel), panel))
    frame, variation = _frame_of(panel, objects), variation_of(panel)
    if nominal is None:
        return _full(frame, variation, panel)
    known = (variation, nominal.hash)
    made = frame.varied.get(known)
    if made is None:
        varied = frame.begun.pop(known) or _varied(panel, frame, variation, nominal)
        if varied is None:
            made = _full(frame, variation, panel)
        else:
            made = _in_shapes_of(panel, frame, varied, nominal)
        frame.varied.put(known, made)
    return made


def _frame_of(panel: LoadedPanel, objects: Sequence[PlacedObject]) -> _Frame:
    """Return the common parts of panels of one shape."""
    key = shape_of(panel, objects)
    return _frames.get(key) or _frames.put(key, _made_frame(panel, objects))


def vary_rails(panels: Sequence[LoadedPanel], nominal: LoadedPanel) -> None:
    """Begin the rails of panels whose mechanisms come next, so that they are evaluated together.

    Parameters
    ----------
    panels : sequence of LoadedPanel
        At most `MOST_VARIED`.
    nominal : LoadedPanel
        As for `build_mechanism`.
    """
    for panel in panels:
        with suppress(MechanicsError):  # which building its mechanism raises too
            frame, variation = _frame_of(panel, ()), variation_of(panel)
            known = (variation, nominal.hash)
            if frame.varied.get(known) is None:
                varied = _varied(panel, frame, variation, nominal)
                if varied is not None:
                    frame.begun.put(known, varied)


def _full(frame: _Frame, variation: Variation, panel: Panel) -> _Kept:
    """Return rails with shapes of their own, whose fastenings are those of a panel."""
    found = frame.kept.get(variation)
    if found is None:
        made = _made_kept(panel, frame, frame.rails_of(variation, panel))
        found = frame.kept.put(variation, made)
    return found


class _Varied(NamedTuple):
    """Rails in shapes of nominal ones, which are those of `base`, and ratios of their scales."""

    base: _Kept
    rails: list[ReducedRail]
    ratios: dict[str, tuple[float, float]]


def _varied(
    panel: LoadedPanel, frame: _Frame, own: Variation, nominal: LoadedPanel
) -> _Varied | None:
    """Return rails in shapes of nominal ones; None of such, and of those that need their own."""
    of = variation_of(nominal)
    if own == of or not own.like(of):
        return None
    pairs = zip(own.scales, of.scales, strict=True)
    scales = tuple(
        (nominal_scale(every, of_every), nominal_scale(lateral, of_lateral))
        for (every, lateral), (of_every, of_lateral) in pairs
    )
    holding = tuple[tuple[float, ...], ...]()
    if own.holds != of.holds:
        ratios_of = own.stiffness_ratios(of)
        holding = tuple(tuple(nominal_scale(r, 1.0) for r in ratios) for ratios in ratios_of)
    elif own.scales == scales:
        return None
    base = _full(frame, Variation(scales, of.holds, holding), nominal)
    rails, factors = list[ReducedRail](), dict[str, tuple[float, float]]()
    changes = zip(base.rails, base.linear.matrices.rails, own.scales, scales, strict=True)
    for data, reduced, (every, lateral), (of_every, of_lateral) in changes:
        supports = data.supports if own.holds == of.holds else supports_of(panel, data.name)
        if (every, lateral) == (of_every, of_lateral) and supports == data.supports:
            rails.append(reduced)
        else:
            family = base.family(data, reduced)
            ratios = every / of_every, lateral / of_lateral
            if family is None:
                return None
            made = varied_rail(family, reduced.body, ratios=ratios, supports=supports)
            if made is None:
                return None
            rails.append(made)
            factors[data.name] = ratios
    return _Varied(base, rails, factors)


def _in_shapes_of(
    panel: LoadedPanel, frame: _Frame, varied: _Varied, nominal: LoadedPanel
) -> _Kept:
    """Return layout and linear part of rails in shapes of nominal ones."""
    base, of_base = varied.base, varied.base.linear
    made = _linear_of(panel, varied.rails, of_base.rails, of_base.rows, base.held, of_base.travel)
    known = _nominal_mechanism(base, nominal)
    linear = replace(made, nominal=known, ratios=varied.ratios)
    return _Kept(frame, base.rails, base.held, linear, base=base)


def _nominal_mechanism(base: _Kept, nominal: LoadedPanel) -> Mechanism:
    """Return the mechanism of nominal rails."""
    found = base.nominal.get(nominal.hash)
    if found is None:
        linear, layout = base.linear, base.frame.layout
        found = Mechanism(
            matrices=linear.matrices,
            core=linear.rows,
            laws=law_table(layout, nominal, (), travel=linear.travel),
            rails=linear.rails,
        )
        base.nominal.put(nominal.hash, found)
    return found


def clear_mechanisms() -> None:
    """Empty the memory of layouts, linear parts and families of rails."""
    clear_families()
    _frames.clear()


def _placed(panel: Panel, objects: Sequence[PlacedObject], nominal: LoadedPanel | None) -> _Placed:
    """Put objects on the rails, those between the nodes last, or find them in the same places."""
    bare = _kept(panel, (), nominal)
    if not objects:
        return _Placed(bare.linear, bare.frame.layout, None, ())
    base = bare.base or bare
    places = tuple(
        [(item.name, item.rail, item.x, item.height, item.face_slope) for item in objects]
    )
    varied = base is not bare
    found = base.placed.get((varied, places))
    if found is None:
        with one_blas_thread():
            made = _put_objects(base, panel, objects, nominal if varied else None)
        found = base.placed.put((varied, places), made)
    if not varied:
        return found
    linear = _kept(panel, found.nodes, nominal).linear if found.nodes else bare.linear
    return replace(found, linear=linear)


def _put_objects(
    bare: _Kept, panel: Panel, objects: Sequence[PlacedObject], nominal: LoadedPanel | None
) -> _Placed:
    """Add the rows of objects to those of rails, which are made with nodes for them if need be."""
    kept, nodes = bare, list[PlacedObject]()
    standing = [item for item in objects if not is_off_node(panel, item)]
    if any(needs_node(panel, item, kept.rails, kept.linear.rails) for item in standing):
        kept, nodes = _kept(panel, standing, nominal), standing
        kept = kept.base or kept
        if any(needs_node(panel, item, kept.rails, kept.linear.rails) for item in standing):
            message = "rails made with nodes for objects lack coordinates for them"
            raise MechanicsError(message)
    linear, bodies = kept.linear, {body.name: body for body in kept.linear.rails}
    ends = [ends_on_nodes(object_ends(panel, item), bodies) for item in objects]
    rows = np.array([approach_row(own, bodies) for own in ends])
    rows.flags.writeable = False
    yields = tuple([_yields(own, kept, bodies, varied=nominal is not None) for own in ends])
    names, frame = tuple([item.name for item in objects]), kept.frame
    layout = frame.layouts.get(names)
    if layout is None:
        layout = frame.layouts.put(names, frame.layout.with_objects(names))
    return _Placed(linear, layout, rows, yields, tuple(nodes))


def _yields(
    ends: Sequence[ObjectEnd], kept: _Kept, bodies: Mapping[str, RailBody], *, varied: bool
) -> dict[str, Yield]:
    """Return the local flexibility of each rail at an object, with an exponent if it may vary."""
    found, by_rail = dict[str, Yield](), dict[str, list[ObjectEnd]]()
    for end in ends:
        by_rail.setdefault(end.rail, []).append(end)
    for name, own in by_rail.items():
        if all(is_at_interface(bodies[name], end) for end in own):
            continue
        local, exponent = kept.local(name).at(own), 0.0
        if varied:
            wider = kept.local(name, lateral=STEP).at(own)
            exponent = math.log(wider / local) / math.log(STEP)
        found[name] = Yield(local, exponent)
    return found


def _made_frame(
    panel: Panel, objects: Sequence[PlacedObject], layout: LawLayout | None = None
) -> _Frame:
    rows = (layout or lay_out(panel, objects)).rows
    if layout is None:  # rows of objects are added to it
        layout = lay_out(panel, ())
    rails = tuple(_rail_data(panel, rows, objects))
    # about ten megabytes each; varied ones hold little
    kept, varied = LRUCache[_Kept](12), LRUCache[_Kept](4)
    begun, layouts = LRUCache[_Varied](MOST_VARIED), LRUCache[LawLayout](16)
    return _Frame(layout, rails, variation_of(panel).holds, kept, varied, begun, layouts)


def _made_kept(panel: Panel, frame: _Frame, data: Sequence[RailData]) -> _Kept:
    layout = frame.layout
    with one_blas_thread():
        rails = _reduced_rails(data)
        switch_rails = {rail.body.name: rail for rail in rails if rail.body.name in panel.rail}
        held = {name: _held_rows(name, rail, layout) for name, rail in switch_rails.items()}
        rows = _stacked_rows(layout.rows, rails)
        if isinstance(panel, LoadedPanel) and all(m.digest for m in panel.matrices.values()):
            rows.flags.writeable = False
        bodies = tuple(rail.body for rail in rails)
        linear = _linear_of(panel, rails, bodies, rows, held)
    return _Kept(frame, tuple(data), held, linear)


def _linear_of(
    panel: Panel,
    rails: Sequence[ReducedRail],
    bodies: tuple[RailBody, ...],
    rows: Floats,
    held: Mapping[str, RailRows],
    nominal: Travel | None = None,
) -> _Linear:
    """Put rails together; `nominal` is the travel of those that they vary."""
    switch_rails = {rail.body.name: rail for rail in rails if rail.body.name in panel.rail}
    with one_blas_thread():
        travel = rail_travel(panel, switch_rails, held, nominal=nominal)
    return _Linear(JoinedRails(rails), rows, bodies, travel)


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
    frame = _made_frame(panel, objects)
    return frame.rails_of(variation_of(panel), panel)


def _rail_data(panel: Panel, rows: LawRows, objects: Sequence[PlacedObject]) -> list[RailData]:
    """Return the rails without the scales of their sections."""
    data = [switch_rail_data(panel, n, tuple(rows.points[n]), objects) for n in panel.rail]
    data += [stock_rail_data(panel, n, tuple(rows.points[f"{STOCK}{n}"])) for n in panel.stock_rail]
    return data


def _reduced_rails(data: Sequence[RailData]) -> list[ReducedRail]:
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


def friction_courses(
    panel: Panel, laws: LawTable, layout: LawLayout, travel: Travel
) -> tuple[LawTable, FrictionCourses]:
    """Return the laws with levels of friction, its courses along the stroke, and its curves.

    The opening counts from the closed position of the rail at the chair: a rail that is stress-free
    at a share of its way has come from there by this share.

    Parameters
    ----------
    panel : Panel
        With the courses and curves of its chairs.
    laws : LawTable
        With the coefficients of the chairs.
    layout : LawLayout
        Frictions by rail and chair.
    travel : Travel
        Ways of the rails from closed to open.
    """
    if all(COURSE_OF_CHAIR(chair) == CONSTANT_FRICTION for chair in panel.chair.values()):
        return laws, no_courses()
    curves = {name: chair.friction_curves for name, chair in panel.chair.items()}
    rows: list[tuple[int, float, float, float]] = []
    openings, from_there = list[tuple[float, ...]](), list[FrictionCurve]()
    for (rail, name), frictions in layout.index.chair_friction.items():
        chair, shape = panel.chair[name], travel.shapes.get(rail)
        if len(curves[name]) == 1 or shape is None:
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
            openings.append(tuple(chair.friction_opening or ()))
            from_there += curves[name]
    columns = np.array(rows, dtype=float).reshape(-1, 4).T
    found = no_courses()._replace(
        friction=columns[0].astype(np.int64),
        coefficient=columns[1].copy(),
        closed=columns[2].copy(),
        side=columns[3].copy(),
        start=np.cumsum([0, *map(len, openings)], dtype=np.int64),
        opening=np.array([place for course in openings for place in course]),
        factor=np.array([curve.level for curve in from_there]),
        at=np.full(len(rows), -1, dtype=np.int64),
    )
    by_chair = [of_chair[0] for of_chair in curves.values()]
    if layout.index.roller:
        by_chair += [FrictionCurve(1.0)] * len(by_chair)
    levels = np.array([curve.level for curve in by_chair])[layout.chairs]
    levels[found.friction] = 1.0  # follow from the first step on
    laws = laws._replace(friction_coefficient=laws.friction_coefficient * levels)
    if all(curve.is_constant for curve in (*by_chair, *from_there)):
        return laws, found
    excess_from, fall_from, rise_from = curve_arrays(from_there)
    excess, fall, rise = (values[layout.chairs] for values in curve_arrays(by_chair))
    return laws, found._replace(
        excess_from=excess_from, fall_from=fall_from, rise_from=rise_from,
        excess=excess, fall=fall, rise=rise,
    )  # fmt: skip


COURSE_OF_CHAIR = attrgetter("friction_factor", "friction_state", "static_ratio", "friction_rise")
"""Values of a chair whose friction differs along the stroke or over speed."""
CONSTANT_FRICTION = (None, None, None, None)
"""The same of one whose friction does not."""
