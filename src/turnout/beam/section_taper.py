"""Sections of planed switch rails, cut to fit the stock rail that they close against.

Where the running edges of the two rails are a distance w apart, the closed switch rail is its full
outline, less the stock rail with a clearance and everything on the far side of it, its top below
the stock rail's by an amount that depends on w. The stock rail lies towards negative y: y grows
away from it, towards the middle of the track of the stock rail's route. Outlines returned here have
y = 0 at the switch rail's own running edge and z = 0 where its full outline has it, so they can be
strung along a rail whose running edge is known.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from turnout.beam.outline import FloatArray, Outline, move, outline_of, polygon_of
from turnout.core.errors import MechanicsError

# Vertices closer together than this after cutting are merged [m].
_SMALLEST_EDGE = 1e-6
# Longer mitres than this many clearances are cut off square.
_MITRE_LIMIT = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Planing:
    """Planing of a switch rail to fit its stock rail.

    Parameters
    ----------
    running_edge_switch, running_edge_stock : float
        Lateral position of the running edge in the frame of each rail's outline [m].
    seat_height : float
        Height of the switch rail's z = 0 above the stock rail's [m].
    clearance : float
        Distance kept from the stock rail's outline [m], zero or more.
    lowering_offset : ndarray, shape (n,)
        Offsets of the running edges [m] at which the lowering is given, increasing.
    lowering : ndarray, shape (n,)
        Top of the planed rail below that of the stock rail there [m], zero or more; linear between,
        held beyond the ends.
    least_thickness : float
        A tongue of steel thinner than this is left out [m]; zero keeps all.
    """

    running_edge_switch: float
    running_edge_stock: float
    seat_height: float
    clearance: float
    lowering_offset: FloatArray
    lowering: FloatArray
    least_thickness: float = 0.0

    def __post_init__(self) -> None:
        """Refuse negative distances and a lowering table that is no function."""
        problems = [
            f"{name} must not be negative: {np.min(value):g} m"
            for name in ("clearance", "least_thickness", "lowering")
            if np.min(value := getattr(self, name)) < 0.0
        ]
        if self.lowering.ndim != 1 or self.lowering.shape != self.lowering_offset.shape:
            problems.append("lowering and lowering_offset must be lists of the same length")
        elif np.any(np.diff(self.lowering_offset) <= 0.0):
            problems.append(f"lowering_offset must increase: {self.lowering_offset.tolist()}")
        if problems:
            msg = "not a planing: " + "; ".join(problems)
            raise MechanicsError(msg)


@dataclass(frozen=True, slots=True, eq=False)
class PlanedOutline:
    """One cut through a planed rail.

    Parameters
    ----------
    running_edge_offset : float
        Distance w between the running edges [m].
    outline : Outline
        The largest piece left; y from the switch rail's running edge, z from its foot [m].
    stock_rail : Outline
        The stock rail beside it, in the same frame [m].
    dropped_areas : tuple of float
        Areas of the other pieces, which the cuts severed, largest first [m^2].
    thin_area : float
        Area left out as thinner than `Planing.least_thickness` [m^2].
    """

    running_edge_offset: float
    outline: Outline
    stock_rail: Outline
    dropped_areas: tuple[float, ...]
    thin_area: float


def planed_section(
    switch_rail: Outline, stock_rail: Outline, *, running_edge_offset: float, planing: Planing
) -> PlanedOutline:
    """Cut a switch rail at one place along it.

    Parameters
    ----------
    switch_rail, stock_rail : Outline
        Full outlines, each in its own frame, z up and y away from the stock rail.
    running_edge_offset : float
        Distance w of the switch rail's running edge from the stock rail's [m].
    planing : Planing
        Clearance, lowering and running edges of both rails.

    Returns
    -------
    PlanedOutline
        The largest piece that is left, and the areas of the others.

    Raises
    ------
    MechanicsError
        If nothing is left.

    Examples
    --------
    >>> from turnout.beam.outline import make_outline
    >>> bar = make_outline([[-0.03, 0], [0.03, 0], [0.03, 0.1], [-0.03, 0.1]])
    >>> flat = np.zeros(1)
    >>> plan = Planing(0.03, 0.03, 0.0, 0.002, lowering_offset=flat, lowering=flat)
    >>> cut = planed_section(bar, bar, running_edge_offset=0.04, planing=plan)
    >>> cut.outline.points.min(axis=0).round(9).tolist()  # 40 mm are left, less the clearance
    [-0.038, 0.0]
    """
    offset = running_edge_offset
    beside = move(stock_rail, y=-planing.running_edge_stock - offset, z=-planing.seat_height)
    full = polygon_of(move(switch_rail, y=-planing.running_edge_switch))
    stock = polygon_of(beside)
    reach = stock.bounds[2] - full.bounds[0] + planing.clearance
    left = full.difference(_shadow(stock, clearance=planing.clearance, reach=max(reach, 0.0)))
    lowering = float(np.interp(offset, planing.lowering_offset, planing.lowering))
    y_least, z_least, y_most, _ = full.bounds
    left = left.intersection(shapely.box(y_least, z_least, y_most, stock.bounds[3] - lowering))
    pieces = _split_pieces(left, smallest=1e-6 * full.area)
    if not pieces:
        apart = f"{1e3 * offset:g} mm apart"
        msg = f"nothing of the switch rail is left where the running edges are {apart}"
        raise MechanicsError(msg)
    whole = pieces[0]
    thick = _remove_thin(whole, thickness=planing.least_thickness)
    tidy = shapely.set_precision(thick.simplify(_SMALLEST_EDGE), _SMALLEST_EDGE)
    return PlanedOutline(
        running_edge_offset=offset,
        outline=outline_of(_split_pieces(tidy, smallest=0.0)[0]),
        stock_rail=beside,
        dropped_areas=tuple(piece.area for piece in pieces[1:]),
        thin_area=whole.area - thick.area,
    )


def planed_sections(
    switch_rail: Outline,
    stock_rail: Outline,
    *,
    running_edge_offsets: npt.ArrayLike,
    planing: Planing,
) -> list[PlanedOutline]:
    """Cut a switch rail at several places; see `planed_section`.

    Parameters
    ----------
    switch_rail, stock_rail : Outline
        Full outlines, as for `planed_section`.
    running_edge_offsets : array_like, shape (n,)
        Distances of the running edges [m].
    planing : Planing
        Clearance, lowering and running edges of both rails.

    Returns
    -------
    list of PlanedOutline, length n
    """
    return [
        planed_section(switch_rail, stock_rail, running_edge_offset=float(offset), planing=planing)
        for offset in np.asarray(running_edge_offsets, dtype=float)
    ]


def _shadow(polygon: shapely.Polygon, *, clearance: float, reach: float) -> shapely.Geometry:
    """Return the polygon grown by the clearance and swept towards negative y."""
    grown = polygon.buffer(clearance, join_style="mitre", mitre_limit=_MITRE_LIMIT)
    ring = np.array(grown.exterior.coords)
    swept = np.array([-reach - (ring[:, 0].max() - ring[:, 0].min()), 0.0])
    quads = np.stack([ring[:-1], ring[1:], ring[1:] + swept, ring[:-1] + swept], axis=1)
    slanted = quads[np.abs(np.diff(ring[:, 1])) > 0.0]
    return shapely.union_all([shapely.Polygon(grown.exterior), *shapely.polygons(slanted)])


def _split_pieces(geometry: shapely.Geometry, *, smallest: float) -> list[shapely.Polygon]:
    """Return the polygons of a geometry above the smallest area, the largest first."""
    parts = [part for part in shapely.get_parts(geometry) if isinstance(part, shapely.Polygon)]
    return sorted((part for part in parts if part.area > smallest), key=lambda part: -part.area)


def _remove_thin(polygon: shapely.Polygon, *, thickness: float) -> shapely.Polygon:
    """Remove the parts thinner than `thickness` [m], but keep sharp corners."""
    if thickness == 0.0:
        return polygon
    options = {"join_style": "mitre", "mitre_limit": _MITRE_LIMIT}
    core = _split_pieces(polygon.buffer(-0.5 * thickness, **options), smallest=0.0)
    if not core:
        msg = f"all of the section is thinner than {1e3 * thickness:g} mm"
        raise MechanicsError(msg)
    thick = _split_pieces(
        core[0].buffer(0.5 * thickness, **options).intersection(polygon), smallest=0.0
    )
    # A removed area this small is only a corner that was rounded off.
    removed = polygon.area - thick[0].area
    return thick[0] if removed > thickness**2 else polygon
