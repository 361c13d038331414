"""The rails of a panel as data for beams: meshes, sections, supports.

Beside `turnout.mechanism.build` the only file that sees both definition and mechanics.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from turnout.beam.material import Material
from turnout.beam.mesh import mesh_nodes
from turnout.errors import MechanicsError
from turnout.mechanism.rail import Point, RailData, Support, rayleigh_factors
from turnout.panel.foreign_object import PlacedObject
from turnout.panel.load import LoadedPanel
from turnout.panel.model import Panel
from turnout.panel.profile import section_columns, section_values
from turnout.panel.rail_matrices import RailMatrices
from turnout.panel.support_records import Fastening
from turnout.section.properties import SectionProperties

Floats = NDArray[np.float64]
SIGN = {"+y": 1.0, "-y": -1.0}


def stock_body(panel: Panel, rail: str) -> str | None:
    """Return the name of the body of the flexible stock rail that a switch rail faces, or None."""
    for name, stock in panel.stock_rail.items():
        if stock.faces == rail:
            return f"stock rail {name}"
    return None


def stands_on(rails: Sequence[str] | None, rail: str) -> bool:
    """Tell whether something that names its rails, or none for all, stands on this one."""
    return rails is None or rail in rails


def stations(panel: Panel, rail: str, objects: Sequence[PlacedObject]) -> Floats:
    """Return the positions where something stands at a switch rail, rising [m]."""
    places = [
        item.x
        for family in (panel.chair, panel.fastening, panel.stop, panel.stud)
        for item in family.values()
        if stands_on(item.rails, rail)
    ]
    places += [d.x for d in panel.drive.values() if d.rail == rail]
    places += [k.x for k in panel.link.values() if rail in k.rails]
    places += [s.x for s in panel.sensor.values() if s.rail == rail]
    places += [o.x for o in objects if o.rail == rail]
    return np.unique(np.round(places, 9))


def switch_rail_data(
    panel: Panel, name: str, points: tuple[Point, ...], objects: Sequence[PlacedObject]
) -> RailData:
    """Return one switch rail with its fastenings, chair dashpots and points.

    Parameters
    ----------
    panel : Panel
        The panel.
    name : str
        Name of the switch rail.
    points : tuple of Point
        Where laws act on it.
    objects : sequence of PlacedObject
        Foreign objects, whose places become nodes.
    """
    rail = panel.rail[name]
    x = mesh_nodes(
        rail.start,
        rail.end,
        element_length=panel.discretisation.element_length,
        forced=stations(panel, name, objects),
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
        material=_material(panel),
        gravity=panel.gravity,
        clamped=("last",) if rail.heel == "clamped" else (),
        damping=rayleigh_factors(panel.damping.ratio, list(panel.damping.frequencies)),
        supports=_supports(
            [f for f in panel.fastening.values() if stands_on(f.rails, name)], foot_height=0.0
        ),
        dashpots=tuple(
            Support(Point(chair.x, "uz", y=offset, z=chair.foot_height), 0.0, chair.damping)
            for chair in panel.chair.values()
            if chair.damping > 0 and stands_on(chair.rails, name)
            for offset in chair.foot_offsets
        ),
        points=points,
        cutoff_frequency=panel.discretisation.superelement_cutoff,
        matrices=_matrices(panel, name),
    )


def _matrices(panel: Panel, name: str) -> RailMatrices | None:
    """Return the matrices that a rail has in place of beams; only a loaded panel holds them."""
    if panel.rail[name].matrices is None:
        return None
    if isinstance(panel, LoadedPanel):
        return panel.matrices[name]
    msg = f"rail {name} has matrices in a file; load the panel with load_panel"
    raise MechanicsError(msg)


def stock_rail_data(panel: Panel, name: str, points: tuple[Point, ...]) -> RailData:
    """Return one stock rail with its fastenings and the points where switch rail or object touch.

    Its reference line is its own foot; heights of points are measured from there.
    """
    stock = panel.stock_rail[name]
    fastenings = [f for f in panel.stock_fastening.values() if stands_on(f.rails, name)]
    places = np.array([f.x for f in fastenings] + [p.x for p in points])
    x = mesh_nodes(
        stock.start,
        stock.end,
        element_length=panel.discretisation.element_length,
        forced=np.unique(np.round(places, 9)),
    )
    columns = section_columns(panel.section[stock.section])
    ones = np.ones(x.size - 1)
    value = {key: float(column[0]) * ones for key, column in columns.items()}
    return RailData(
        name=f"stock rail {name}",
        closes=1.0,
        x=x,
        axis_height=np.zeros(x.size),
        sections=_properties(value, side=SIGN[panel.rail[stock.faces].closes]),
        material=_material(panel),
        gravity=panel.gravity,
        clamped=("first", "last") if stock.ends == "clamped" else (),
        damping=rayleigh_factors(panel.damping.ratio, list(panel.damping.frequencies)),
        supports=_supports(fastenings, foot_height=stock.foot_height),
        dashpots=(),
        points=points,
        cutoff_frequency=panel.discretisation.superelement_cutoff,
    )


def _material(panel: Panel) -> Material:
    return Material(
        youngs_modulus=panel.material.youngs_modulus,
        poisson_ratio=panel.material.poisson_ratio,
        density=panel.material.density,
    )


def _supports(fastenings: Sequence[Fastening], *, foot_height: float) -> tuple[Support, ...]:
    """Return the springs and dashpots of fastenings, seen from a rail with its foot there."""
    return tuple(
        Support(Point(f.x, direction, z=f.height - foot_height), stiffness, damping)
        for f in fastenings
        for direction, stiffness, damping in (
            ("ux", f.stiffness_x, f.damping_x),
            ("uy", f.stiffness_y, f.damping_y),
            ("uz", f.stiffness_z, f.damping_z),
            ("rx", f.stiffness_roll, 0.0),
            ("ry", f.stiffness_pitch, 0.0),
            ("rz", f.stiffness_yaw, 0.0),
        )
        if stiffness > 0 or damping > 0
    )


def _sections(panel: Panel, name: str, x: Floats) -> SectionProperties:
    """Evaluate the section table of a switch rail."""
    return _properties(section_values(panel, name, x), side=SIGN[panel.rail[name].closes])


def _properties(values: dict[str, Floats], *, side: float) -> SectionProperties:
    """Turn table columns, whose y offsets point towards the stock rail, into panel axes."""
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
