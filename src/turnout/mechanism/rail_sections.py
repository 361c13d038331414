"""Sections of a panel's rails as numbers along them, tabulated or from drawn outlines.

Columns are those of `turnout.panel.records.SectionTable`: y positive TOWARDS the stock
rail, from the rail's reference line. An outline adds the edges of its underside, where the chairs
carry it. What is computed from outlines is kept by its content.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from turnout.beam.outline import Outline, make_outline, ring_area
from turnout.beam.section_record import SectionProperties
from turnout.core.content_cache import cached_arrays
from turnout.core.errors import MechanicsError
from turnout.panel.model import Panel
from turnout.panel.profile import (
    between_stations,
    outline_points,
    section_columns,
    section_stations,
)
from turnout.panel.records import PlanedSection

if TYPE_CHECKING:
    from turnout.beam.section_taper import PlanedOutline, Planing

Floats = NDArray[np.float64]

SAME_STATION = 1e-3  # m
FOOT_EDGES = ("foot_edge_stock", "foot_edge_track")
"""Columns of the underside's edges: the one beside the stock rail, and the other."""


def section_values(panel: Panel, rail: str, x: npt.ArrayLike) -> dict[str, Floats]:
    """Evaluate the section of a switch rail along it.

    Parameters
    ----------
    panel : Panel
        The panel.
    rail : str
        Name of the rail.
    x : array_like, shape (n,)
        Positions from the toe [m].

    Returns
    -------
    dict of str to ndarray, shape (n,)
        Each column by its name, in SI; `FOOT_EDGES` only where the section is an outline.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> round(float(section_values(load_panel("sb1"), "switch", [1.0])["area"][0]), 6)
    0.0093
    """
    columns = station_columns(panel, panel.rail[rail].section)
    return between_stations(panel, rail, columns, x)


def station_columns(panel: Panel, section: str) -> dict[str, Floats]:
    """Return all columns of a section at its own stations.

    Parameters
    ----------
    panel : Panel
        The panel.
    section : str
        Name of a section of any kind.

    Returns
    -------
    dict of str to ndarray, shape (n_stations,)
    """
    if section in panel.section:
        return {name: np.array(v) for name, v in section_columns(panel.section[section]).items()}
    poisson = panel.material.poisson_ratio
    if section in panel.outline_section:
        outline = panel.outline_section[section].outline
        parts: list[object] = [_points(panel, outline), poisson]
    else:
        planed = panel.planed_section[section]
        parts = [
            _points(panel, planed.outline),
            _points(panel, planed.stock_outline),
            panel.outline[planed.outline].running_edge,
            panel.outline[planed.stock_outline].running_edge,
            *planed.model_dump(exclude={"outline", "stock_outline"}).values(),
            poisson,
        ]
    return cached_arrays("section", parts, lambda: _computed(panel, section))


def section_outlines(panel: Panel, section: str) -> list[tuple[Outline, Outline | None]]:
    """Return the outlines of a drawn section, each with the stock rail's beside it if there is one.

    Parameters
    ----------
    panel : Panel
        The panel.
    section : str
        Name of an outline section or a planed section.

    Returns
    -------
    list of (Outline, Outline or None)
        One entry a station; y positive AWAY from the stock rail, from the reference line [m].

    Raises
    ------
    MechanicsError
        If planing leaves nothing at some station.
    """
    if section in panel.outline_section:
        return [(make_outline(_points(panel, panel.outline_section[section].outline)), None)]
    return [(cut.outline, cut.stock_rail) for cut in planed_outlines(panel, section)]


def planed_outlines(panel: Panel, section: str) -> "list[PlanedOutline]":
    """Return the cuts of a planed section, one per station, with the severed steel.

    Raises
    ------
    MechanicsError
        If planing leaves nothing at some station.
    """
    from turnout.beam.section_taper import planed_sections

    planed = panel.planed_section[section]
    try:
        return planed_sections(
            make_outline(_points(panel, planed.outline)),
            make_outline(_points(panel, planed.stock_outline)),
            running_edge_offsets=planed.running_edge_offset,
            planing=_planing(panel, planed),
        )
    except MechanicsError as error:
        msg = f"planed_section.{section}: {error}; check its outlines and offsets"
        raise MechanicsError(msg) from None


@dataclass(frozen=True, slots=True, kw_only=True)
class SeveredSteel:
    """Steel severed by planing at a station, which is left out.

    Attributes
    ----------
    running_edge_offset : float
        The station [m].
    area, share : float
        Area left out [m^2], and its share of the rest [-].
    height : float
        Top of what remains above the underside [m].
    """

    running_edge_offset: float
    area: float
    share: float
    height: float


def severed_steel(panel: Panel, section: str) -> list[SeveredSteel]:
    """Return the severed steel at each station of a planed section."""
    found = []
    for cut in planed_outlines(panel, section):
        area = sum(cut.dropped_areas) + cut.thin_area
        share = area / ring_area(cut.outline.points)
        height = float(cut.outline.points[:, 1].max())
        found.append(
            SeveredSteel(
                running_edge_offset=cut.running_edge_offset, area=area, share=share, height=height
            )
        )
    return found


def foot_spans(panel: Panel, rail: str, x: npt.ArrayLike) -> Floats | None:
    """Return the edges of a rail's underside, towards its stock rail positive, or None.

    Parameters
    ----------
    panel : Panel
        The panel.
    rail : str
        Name of the rail.
    x : array_like, shape (n,)
        Positions from the toe [m].

    Returns
    -------
    ndarray, shape (n, 2), or None
        The edge beside the stock rail and the other one [m]; None for a tabulated section.
    """
    if panel.rail[rail].section in panel.section:
        return None
    values = section_values(panel, rail, x)
    return np.stack([values[edge] for edge in FOOT_EDGES], axis=1)


def in_panel_axes(values: dict[str, Floats], *, side: float) -> SectionProperties:
    """Turn columns, whose y points towards the stock rail, into panel axes.

    Parameters
    ----------
    values : dict of str to ndarray, shape (n,)
        Columns by name.
    side : float
        +1.0 for a rail that closes towards +y, else -1.0.
    """
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


def scale_sections(
    sections: SectionProperties, *, every: float, lateral: float
) -> SectionProperties:
    r"""Apply the `section_scale` c and the `lateral_inertia_scale` s of a rail to its sections.

    .. math:: A, I_y, J \to c\,(A, I_y, J), \quad I_z \to c\,s\,I_z, \quad
              I_{yz} \to c \sqrt{s}\, I_{yz}.

    The second factor is that of a section whose area is moved sideways, :math:`y \to \sqrt{s}\,y`
    about the centroid, so that :math:`I_{yz}^2 < I_y I_z` stays true. Lateral bending frequencies
    go with :math:`\sqrt{s}`, deflections under a force with :math:`1 / (c\,s)`.

    Parameters
    ----------
    sections : SectionProperties
        Of the section that the rail names.
    every, lateral : float
        c and s [-].
    """
    if every == lateral == 1.0:
        return sections
    return replace(
        sections,
        area=every * sections.area,
        second_moment_vertical=every * sections.second_moment_vertical,
        second_moment_lateral=every * lateral * sections.second_moment_lateral,
        product_moment=every * np.sqrt(lateral) * sections.product_moment,
        torsion_constant=every * sections.torsion_constant,
    )


def _points(panel: Panel, outline: str) -> Floats:
    record = panel.outline[outline]
    return outline_points(record.points, symmetric=record.symmetric)


def _planing(panel: Panel, planed: PlanedSection) -> "Planing":
    from turnout.beam.section_taper import Planing

    return Planing(
        running_edge_switch=float(panel.outline[planed.outline].running_edge or 0.0),
        running_edge_stock=float(panel.outline[planed.stock_outline].running_edge or 0.0),
        seat_height=planed.seat_height,
        clearance=planed.clearance,
        lowering_offset=np.array(planed.lowering_offset),
        lowering=np.array(planed.lowering),
        least_thickness=planed.least_thickness,
    )


def _computed(panel: Panel, section: str) -> dict[str, Floats]:
    """Analyse the outlines of a section and turn them to y towards the stock rail."""
    from turnout.beam.outline_moments import foot_edges
    from turnout.beam.section_analysis import analyse_outlines

    outlines = [outline for outline, _ in section_outlines(panel, section)]
    found = analyse_outlines(outlines, poisson_ratio=panel.material.poisson_ratio).properties
    edges = -np.array([foot_edges(outline) for outline in outlines])
    return {
        "area": found.area,
        "second_moment_vertical": found.second_moment_vertical,
        "second_moment_lateral": found.second_moment_lateral,
        "product_moment": -found.product_moment,
        "torsion_constant": found.torsion_constant,
        "shear_factor_vertical": found.shear_factor_vertical,
        "shear_factor_lateral": found.shear_factor_lateral,
        "centroid_height": found.centroid_z,
        "centroid_offset": -found.centroid_y,
        "shear_centre_height": found.shear_centre_z,
        "shear_centre_offset": -found.shear_centre_y,
        FOOT_EDGES[0]: edges[:, 0].copy(),
        FOOT_EDGES[1]: edges[:, 1].copy(),
    }


def rail_stations(panel: Panel, rail: str) -> Floats:
    """Return the ends of a rail and the stations of its section between them, rising [m].

    A station within a millimetre of an end is left out: it would be the same row of a table.
    """
    record = panel.rail[rail]
    stations = np.unique(np.round(section_stations(panel, rail), 6))
    inside = (stations > record.start + SAME_STATION) & (stations < record.end - SAME_STATION)
    return np.concatenate([[record.start], stations[inside], [record.end]])
