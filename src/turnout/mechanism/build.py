"""From panel records to a mechanism: the only file that sees both definition and mechanics."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from turnout.beam.material import Material
from turnout.beam.mesh import mesh_nodes
from turnout.errors import MechanicsError
from turnout.law.table import LawTableBuilder
from turnout.mechanism.mechanism import LawIndex, Mechanism
from turnout.mechanism.rail import (
    Point,
    RailData,
    ReducedRail,
    Support,
    rayleigh_factors,
    reduce_rail,
)
from turnout.mechanism.threads import one_blas_thread
from turnout.panel.foreign_object import PlacedObject
from turnout.panel.model import Chair, Drive, Fastening, Link, Panel, Rail, Stop
from turnout.panel.motion import start_offset
from turnout.panel.profile import section_values, stock_rail_gap
from turnout.section.properties import SectionProperties

Floats = NDArray[np.float64]
SIGN = {"+y": 1.0, "-y": -1.0}


@dataclass(slots=True)
class _Rows:
    """Points of each rail in the order of their rows, before the rails are reduced.

    A row is a sum over points: (rail, index of the point within the rail, weight).
    """

    points: dict[str, list[Point]]
    rows: list[list[tuple[str, int, float]]] = field(default_factory=list)
    names: list[str] = field(default_factory=list)

    def point(self, rail: str, point: Point) -> int:
        """Register a point of a rail; return its index there."""
        self.points[rail].append(point)
        return len(self.points[rail]) - 1

    def add(self, *parts: tuple[str, Point]) -> int:
        """Add a row that sums points; return its index."""
        self.rows.append([(rail, self.point(rail, point), 1.0) for rail, point in parts])
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
    rows = _Rows({name: [] for name in panel.rail})
    laws = LawTableBuilder()
    index = LawIndex()
    law_names: list[str] = []
    friction_names: list[str] = []
    for rail_name, rail in panel.rail.items():
        for name, chair in panel.chair.items():
            if _stands_on(chair.rails, rail_name):
                key = (rail_name, name)
                contacts, frictions = _add_chair(rows, laws, rail_name, chair)
                index.chair[key], index.chair_friction[key] = contacts, frictions
                law_names += [f"chair {name} of rail {rail_name}"] * len(contacts)
                friction_names += [f"chair {name} of rail {rail_name}"] * len(frictions)
        for name, stop, kind in _stops(panel):
            if rail.stock_rail_gap is not None and _stands_on(stop.rails, rail_name):
                index.stop[rail_name, name] = _add_stop(rows, laws, rail_name, rail, stop)
                law_names.append(f"{kind} {name} of rail {rail_name}")
    for number, (name, drive) in enumerate(panel.drive.items()):
        index.drive[name] = _add_drive(rows, laws, drive, number)
        law_names.append(f"drive {name}")
    for name, link in panel.link.items():
        index.link[name] = _add_link(rows, laws, panel, link)
        law_names.append(f"link {name}")
    for item in objects:
        index.object[item.name] = _add_object(rows, laws, panel.rail[item.rail], item)
        law_names.append(f"object {item.name}")
    with one_blas_thread():
        rails = _reduced_rails(panel, rows, objects)
    return Mechanism(
        stiffness=block_diag(*(r.stiffness for r in rails)),
        mass=block_diag(*(r.mass for r in rails)),
        damping=block_diag(*(r.damping for r in rails)),
        load=np.concatenate([r.load for r in rails]),
        rows=_stacked_rows(rows, rails),
        laws=laws.table(),
        law_names=tuple(law_names),
        friction_names=tuple(friction_names),
        index=index,
        rails=tuple(r.body for r in rails),
    )


def stations(panel: Panel, objects: Sequence[PlacedObject] = ()) -> dict[str, Floats]:
    """Return the positions on each rail where something stands, rising [m]."""
    found: dict[str, Floats] = {}
    for rail_name in panel.rail:
        places = [
            item.x
            for family in (panel.chair, panel.fastening, panel.stop, panel.stud)
            for item in family.values()
            if _stands_on(item.rails, rail_name)
        ]
        places += [d.x for d in panel.drive.values() if d.rail == rail_name]
        places += [k.x for k in panel.link.values() if rail_name in k.rails]
        places += [s.x for s in panel.sensor.values() if s.rail == rail_name]
        places += [o.x for o in objects if o.rail == rail_name]
        found[rail_name] = np.unique(np.round(places, 9))
    return found


def _stands_on(rails: list[str] | None, rail: str) -> bool:
    return rails is None or rail in rails


def _stops(panel: Panel) -> list[tuple[str, Stop, str]]:
    """Return stops and studs with names that do not collide."""
    named = [(name, stop, "stop") for name, stop in panel.stop.items()]
    return named + [(f"stud {name}", stud, "") for name, stud in panel.stud.items()]


def _add_chair(
    rows: _Rows, laws: LawTableBuilder, rail: str, chair: Chair
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Add a contact and a friction law for each foot point of a chair."""
    slide = rows.add((rail, Point(chair.x, "uy", z=chair.foot_height)))
    contacts, frictions = [], []
    for offset in chair.foot_offsets:
        down = Point(chair.x, "uz", y=offset, z=chair.foot_height, sign=-1.0)
        contact = laws.add_contact(
            rows.add((rail, down)),
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


def _add_stop(rows: _Rows, laws: LawTableBuilder, name: str, rail: Rail, stop: Stop) -> int:
    point = Point(stop.x, "uy", z=stop.height, sign=SIGN[rail.closes])
    gap = _gap(rail, stop.x) + stop.clearance
    return laws.add_contact(rows.add((name, point)), stiffness=stop.stiffness, clearance=gap)


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


def _add_object(rows: _Rows, laws: LawTableBuilder, rail: Rail, item: PlacedObject) -> int:
    point = Point(item.x, "uy", z=item.height, sign=SIGN[rail.closes])
    return laws.add_contact(
        rows.add((item.rail, point)),
        stiffness=item.stiffness,
        clearance=_gap(rail, item.x) - item.size,
        appears=item.appears,
        disappears=item.disappears,
        waits=True,
    )


def _reduced_rails(panel: Panel, rows: _Rows, objects: Sequence[PlacedObject]) -> list[ReducedRail]:
    places = stations(panel, objects)
    rails: list[ReducedRail] = []
    first = 0
    for name in panel.rail:
        data = _rail_data(panel, name, tuple(rows.points[name]), places[name])
        rails.append(reduce_rail(data, first=first))
        first += rails[-1].body.count
    return rails


def _rail_data(panel: Panel, name: str, points: tuple[Point, ...], places: Floats) -> RailData:
    rail = panel.rail[name]
    x = mesh_nodes(
        rail.start,
        rail.end,
        element_length=panel.discretisation.element_length,
        forced=places,
    )
    dashpots = tuple(
        Support(Point(chair.x, "uz", y=offset, z=chair.foot_height), 0.0, chair.damping)
        for chair in panel.chair.values()
        if chair.damping > 0 and _stands_on(chair.rails, name)
        for offset in chair.foot_offsets
    )
    sections = _sections(panel, name, 0.5 * (x[1:] + x[:-1]))
    axis_height = np.zeros(x.size)
    if rail.axis == "centroid":
        axis_height = _sections(panel, name, x).centroid_z
        sections = replace(
            sections,
            centroid_z=np.zeros(x.size - 1),
            shear_centre_z=sections.shear_centre_z - sections.centroid_z,
        )
    return RailData(
        name=name,
        closes=SIGN[rail.closes],
        x=x,
        axis_height=axis_height,
        sections=sections,
        material=Material(
            youngs_modulus=panel.material.youngs_modulus,
            poisson_ratio=panel.material.poisson_ratio,
            density=panel.material.density,
        ),
        gravity=panel.gravity,
        clamped=rail.heel == "clamped",
        damping=rayleigh_factors(panel.damping.ratio, panel.damping.frequencies),
        supports=tuple(
            support
            for fastening in panel.fastening.values()
            if _stands_on(fastening.rails, name)
            for support in _fastening_supports(fastening)
        ),
        dashpots=dashpots,
        points=points,
        cutoff_frequency=panel.discretisation.superelement_cutoff,
    )


def _fastening_supports(fastening: Fastening) -> list[Support]:
    f = fastening
    values = (
        ("ux", f.stiffness_x, f.damping_x),
        ("uy", f.stiffness_y, f.damping_y),
        ("uz", f.stiffness_z, f.damping_z),
        ("rx", f.stiffness_roll, 0.0),
        ("ry", f.stiffness_pitch, 0.0),
        ("rz", f.stiffness_yaw, 0.0),
    )
    return [
        Support(Point(f.x, direction, z=f.height), stiffness, damping)
        for direction, stiffness, damping in values
        if stiffness > 0 or damping > 0
    ]


def _sections(panel: Panel, name: str, x: Floats) -> SectionProperties:
    """Evaluate the section table of a rail; its y offsets point towards the stock rail."""
    values = section_values(panel, name, x)
    side = SIGN[panel.rail[name].closes]
    return SectionProperties(
        area=values["area"],
        second_moment_vertical=values["second_moment_vertical"],
        second_moment_lateral=values["second_moment_lateral"],
        product_moment=side * values["product_moment"],
        torsion_constant=values["torsion_constant"],
        shear_factor_vertical=values["shear_factor_vertical"],
        shear_factor_lateral=values["shear_factor_lateral"],
        centroid_y=side * values["centroid_offset"],
        centroid_z=values["centroid_height"],
        shear_centre_y=side * values["shear_centre_offset"],
        shear_centre_z=values["shear_centre_height"],
    )


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
        for rail_name, point, weight in parts:
            rail = by_name[rail_name]
            place = slice(rail.body.first, rail.body.first + rail.body.count)
            matrix[number, place] += weight * rail.rows[point]
    return matrix
