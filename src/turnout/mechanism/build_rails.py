"""The rails of a panel as data for beams: meshes, sections, supports.

See `turnout.mechanism.build` for what is made of them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from turnout.beam.assembly import DOF
from turnout.beam.material import ElasticMaterial
from turnout.beam.mesh import mesh_nodes
from turnout.core.errors import MechanicsError
from turnout.mechanism.mechanism import Point, RailData, Support, rayleigh_factors
from turnout.mechanism.rail_sections import (
    FOOT_EDGES,
    foot_spans,
    in_panel_axes,
    scale_sections,
    section_values,
    station_columns,
)
from turnout.panel.foreign_object import PlacedObject
from turnout.panel.load import LoadedPanel
from turnout.panel.model import Panel
from turnout.panel.records import Chair, Fastening, Rail, RailMatrices

Floats = NDArray[np.float64]
SIGN = {"+y": 1.0, "-y": -1.0}
STOCK = "stock rail "
"""Beginning of the name of a stock rail's body."""


def stock_body(panel: Panel, rail: str) -> str | None:
    """Return the name of the body of the flexible stock rail that a switch rail faces, or None."""
    for name, stock in panel.stock_rail.items():
        if stock.faces == rail:
            return f"{STOCK}{name}"
    return None


def stands_on(rails: Sequence[str] | None, rail: str) -> bool:
    """Return True if a rail is among `rails`, or if these are None, which means all."""
    return rails is None or rail in rails


def stations(panel: Panel, rail: str, objects: Sequence[PlacedObject]) -> Floats:
    """Return the positions of all parts and objects at a switch rail, rising [m]."""
    places = [
        item.x
        for family in (panel.chair, panel.fastening, panel.stop, panel.stud)
        for item in family.values()
        if stands_on(item.rails, rail)
    ]
    places += [d.x for d in panel.drive.values() if d.rail == rail]
    places += [k.x for k in panel.link.values() if rail in k.rails]
    for item in panel.back_drive.values():
        if stands_on(item.rails, rail):
            places += [item.x, panel.drive[item.drive].x]
    places += [s.x for s in panel.sensor.values() if s.rail in (None, rail)]
    places += [o.x for o in objects if o.rail == rail]
    return np.unique(np.round(places, 9))


def switch_rail_data(
    panel: Panel, name: str, points: tuple[Point, ...], objects: Sequence[PlacedObject]
) -> RailData:
    """Return one switch rail with its fastenings, chair dashpots and points.

    Its sections are those of the table or the outlines; see `with_scales`.

    Parameters
    ----------
    panel : Panel
        The panel.
    name : str
        Name of the switch rail.
    points : tuple of Point
        Points that laws act on.
    objects : sequence of PlacedObject
        Foreign objects at places of the panel, which become nodes.
    """
    rail = panel.rail[name]
    x = mesh_nodes(
        rail.start,
        rail.end,
        element_length=panel.discretisation.element_length,
        forced=stations(panel, name, objects),
    )
    side = SIGN[rail.closes]
    values = section_values(panel, name, 0.5 * (x[1:] + x[:-1]))
    sections = in_panel_axes(values, side=side)
    axis_height = np.zeros(x.size)
    if rail.axis == "centroid":
        axis_height = section_values(panel, name, x)["centroid_height"]
        sections = replace(
            sections,
            centroid_z=np.zeros(x.size - 1),
            shear_centre_z=sections.shear_centre_z - sections.centroid_z,
        )
    damped = {
        key: chair
        for key, chair in panel.chair.items()
        if chair.damping > 0 and stands_on(chair.rails, name)
    }
    return RailData(
        name=name,
        closes=side,
        x=x,
        axis_height=axis_height,
        sections=sections,
        material=_material(panel),
        gravity=panel.gravity,
        clamped=("last",) if rail.heel == "clamped" else (),
        damping=rayleigh_factors(panel.damping.ratio, list(panel.damping.frequencies)),
        supports=_held(panel, name),
        dashpots=tuple(
            Support(point, 0.0, damped[key].damping)
            for key, feet in rail_feet(panel, name, damped).items()
            for point in feet
        ),
        points=points,
        cutoff_frequency=panel.discretisation.superelement_cutoff,
        matrices=_matrices(panel, name),
        plan=_plan(rail, x, radius=rail.curve_radius, side=-side),
    )


def with_scales(data: RailData, scales: tuple[float, float]) -> RailData:
    """Return a rail of `switch_rail_data` or `stock_rail_data` with the factors of its sections.

    Parameters
    ----------
    data : RailData
        Without them.
    scales : tuple of float
        `section_scale` and `lateral_inertia_scale`.
    """
    every, lateral = scales
    return replace(data, sections=scale_sections(data.sections, every=every, lateral=lateral))


def supports_of(panel: Panel, body: str) -> tuple[Support, ...]:
    """Return the springs and dashpots that hold a switch rail, or the body of a stock rail."""
    name = body.removeprefix(STOCK)
    return _held(panel, name) if name == body else _stock_held(panel, name)


def held_by(data: RailData, factors: Sequence[float]) -> RailData:
    """Return a rail with factors of the stiffness that holds it, in the order of `DOF`."""
    supports = tuple(
        replace(item, stiffness=factors[DOF.index(item.point.direction)] * item.stiffness)
        for item in data.supports
    )
    return replace(data, supports=supports)


def _matrices(panel: Panel, name: str) -> RailMatrices | None:
    """Return the matrices that a rail has in place of beams; only a loaded panel holds them."""
    if panel.rail[name].matrices is None:
        return None
    if isinstance(panel, LoadedPanel):
        return panel.matrices[name]
    msg = f"rail {name} has matrices in a file; load the panel with load_panel"
    raise MechanicsError(msg)


def stock_rail_data(panel: Panel, name: str, points: tuple[Point, ...]) -> RailData:
    """Return one stock rail with its fastenings and its contact points with switch rail or object.

    Its sections are without the factors of its panel.
    Its reference line is its own foot; heights of points are measured from there.
    """
    stock = panel.stock_rail[name]
    held = [f.x for f in panel.stock_fastening.values() if stands_on(f.rails, name)]
    places = np.array(held + [p.x for p in points])
    x = mesh_nodes(
        stock.start,
        stock.end,
        element_length=panel.discretisation.element_length,
        forced=np.unique(np.round(places, 9)),
    )
    side = SIGN[panel.rail[stock.faces].closes]
    columns = station_columns(panel, stock.section)
    value = {key: np.full(x.size - 1, column[0]) for key, column in columns.items()}
    return RailData(
        name=f"{STOCK}{name}",
        closes=1.0,
        x=x,
        axis_height=np.zeros(x.size),
        sections=in_panel_axes(value, side=side),
        material=_material(panel),
        gravity=panel.gravity,
        clamped=("first", "last") if stock.ends == "clamped" else (),
        damping=rayleigh_factors(panel.damping.ratio, list(panel.damping.frequencies)),
        supports=_stock_held(panel, name),
        dashpots=(),
        points=points,
        cutoff_frequency=panel.discretisation.superelement_cutoff,
        plan=_plan(panel.rail[stock.faces], x, radius=stock.curve_radius, side=side),
    )


def approach_ends(panel: Panel, name: str, *, x: float, height: float) -> list[tuple[str, Point]]:
    """Return the points whose sum is a switch rail's approach to its stock rail, with their rails.

    Parameters
    ----------
    panel : Panel
        The panel.
    name : str
        Name of the switch rail.
    x, height : float
        Place, and height above the foot of the switch rail [m].
    """
    side = SIGN[panel.rail[name].closes]
    ends = [(name, Point(x, "uy", z=height, sign=side))]
    body = stock_body(panel, name)
    if body is not None:
        foot = next(s.foot_height for s in panel.stock_rail.values() if s.faces == name)
        ends.append((body, Point(x, "uy", z=height - foot, sign=-side)))
    return ends


def object_ends(panel: Panel, item: PlacedObject) -> list[tuple[str, Point]]:
    """Return the points whose sum is the approach of a switch rail to its stock rail at an object.

    On a sloping face the force is normal to it: with `face_slope` t its work is that of the lateral
    force along ``u_y - t u_z``, so that t times the force lifts the switch rail.
    """
    ends = approach_ends(panel, item.rail, x=item.x, height=item.height)
    if item.face_slope:
        ends.append((item.rail, Point(item.x, "uz", z=item.height, sign=-item.face_slope)))
    return ends


def rail_feet(panel: Panel, name: str, chairs: Mapping[str, Chair]) -> dict[str, tuple[Point, ...]]:
    """Return the points of a switch rail's underside that chairs carry, as vertical rows.

    Those of the chair itself; else the two edges of the section's underside there, of which the
    one beside the stock rail comes first; else one point below the reference line.

    Parameters
    ----------
    panel : Panel
        The panel.
    name : str
        Name of the switch rail.
    chairs : mapping of str to Chair
        The chairs.

    Returns
    -------
    dict of str to tuple of Point
        By the names of the chairs that were given.
    """
    side = SIGN[panel.rail[name].closes]
    spans = foot_spans(panel, name, [chair.x for chair in chairs.values()])
    found = {}
    for number, (key, chair) in enumerate(chairs.items()):
        offsets = chair.foot_offsets
        if offsets is None:
            offsets = (0.0,) if spans is None else tuple(spans[number].tolist())
        found[key] = tuple(Point(chair.x, "uz", y=side * y, z=chair.foot_height) for y in offsets)
    return found


def fastening_offset(panel: Panel, name: str, fastening: Fastening) -> float:
    """Return the y of a fastening on a switch rail from its reference line, in panel axes [m].

    That is its own `offset`; else the middle of the underside of an outline, else zero.
    """
    return fastening_offsets(panel, name, [fastening])[0]


def fastening_offsets(panel: Panel, name: str, fastenings: Sequence[Fastening]) -> list[float]:
    """Return the offset of each of several fastenings, as `fastening_offset` does for one [m]."""
    side = SIGN[panel.rail[name].closes]
    spans = foot_spans(panel, name, [fastening.x for fastening in fastenings])
    middles = [0.0] * len(fastenings) if spans is None else (0.5 * spans.sum(axis=1)).tolist()
    return [
        side * (middle if fastening.offset is None else fastening.offset)
        for fastening, middle in zip(fastenings, middles, strict=True)
    ]


def _plan(rail: Rail, x: Floats, *, radius: float | None, side: float) -> Floats | None:
    """Return the lateral positions of a curved line's nodes, or None if it is straight.

    The circle touches the x axis where the running edge of the switch rail does, else at the toe;
    ahead of that the line is straight. Only differences along the line matter.
    """
    if radius is None:
        return None
    tangent = rail.start if rail.running_edge is None else -rail.running_edge.lead
    plan: Floats = side * np.maximum(x - tangent, 0.0) ** 2 / (2.0 * radius)
    return plan


def _held(panel: Panel, name: str) -> tuple[Support, ...]:
    """Return the springs and dashpots of a switch rail's fastenings, and of rods against roll."""
    found: list[Support] = []
    held = [f for f in panel.fastening.values() if stands_on(f.rails, name)]
    for fastening, y in zip(held, fastening_offsets(panel, name, held), strict=True):
        found += _springs(fastening, y=y, z=fastening.height)
    found += [
        Support(Point(drive.x, "rx"), drive.roll_stiffness)
        for drive in panel.drive.values()
        if drive.rail == name and drive.roll_stiffness > 0
    ]
    return tuple(found)


def _stock_held(panel: Panel, name: str) -> tuple[Support, ...]:
    """Return the springs and dashpots of a stock rail's fastenings."""
    stock = panel.stock_rail[name]
    side = SIGN[panel.rail[stock.faces].closes]
    columns = station_columns(panel, stock.section)
    middle = 0.5 * sum(float(columns[key][0]) for key in FOOT_EDGES if key in columns)
    return tuple(
        support
        for f in panel.stock_fastening.values()
        if stands_on(f.rails, name)
        for support in _springs(
            f,
            y=side * (middle if f.offset is None else f.offset),
            z=f.height - stock.foot_height,
        )
    )


def _springs(fastening: Fastening, *, y: float, z: float) -> list[Support]:
    """Return the springs and dashpots of a fastening at a point of the section."""
    f = fastening
    return [
        Support(Point(f.x, direction, y=y, z=z), stiffness, damping)
        for direction, stiffness, damping in (
            ("ux", f.stiffness_x, f.damping_x),
            ("uy", f.stiffness_y, f.damping_y),
            ("uz", f.stiffness_z, f.damping_z),
            ("rx", f.stiffness_roll, 0.0),
            ("ry", f.stiffness_pitch, 0.0),
            ("rz", f.stiffness_yaw, 0.0),
        )
        if stiffness > 0 or damping > 0
    ]


def _material(panel: Panel) -> ElasticMaterial:
    return ElasticMaterial(
        youngs_modulus=panel.material.youngs_modulus,
        poisson_ratio=panel.material.poisson_ratio,
        density=panel.material.density,
    )
