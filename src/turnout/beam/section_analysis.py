"""From outlines to section properties, with the error that the mesh leaves in them.

Area, centroid and second moments are exact for the polygon. Torsion constant, shear factors and
shear centre come from finite elements; they are solved on two meshes, the coarser with triangles
twice as large, and their difference is reported. Halving the triangles divides the error by 16
where the boundary is convex, by 2.5 at a re-entrant right angle, still by 2 at the end of a slit;
so once the mesh resolves the section the difference is at least the error of what is returned.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from turnout.beam.outline import FloatArray, Outline
from turnout.beam.outline_moments import AreaMoments, area_moments, principal_moments
from turnout.beam.section_record import SectionProperties
from turnout.core.errors import MechanicsError

# Triangles before refinement, per square root of the area: 10 mm on a rail.
_ELEMENTS_ACROSS = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class SectionAnalysis:
    """Section properties from outlines, one entry a station, with constants that beams do not use.

    Parameters
    ----------
    properties : SectionProperties, shape (n,)
        Positions are those of the outline's own frame.
    principal_angle : ndarray, shape (n,)
        From the y axis towards z to the axis of the greatest second moment [rad].
    principal_greatest, principal_least : ndarray, shape (n,)
        Principal second moments [m^4].
    warping_constant : ndarray, shape (n,)
        Gamma about the shear centre [m^6].
    shear_coupling : ndarray, shape (n,)
        Mixed term of the shear flexibility [-]; see `turnout.beam.shear_torsion`.
    error_torsion, error_shear_factor : ndarray, shape (n,)
        Relative change of the torsion constant, and of the worse shear factor, from the coarser
        mesh [-].
    error_shear_centre : ndarray, shape (n,)
        Distance by which the shear centre moved from the coarser mesh [m].
    """

    properties: SectionProperties
    principal_angle: FloatArray
    principal_greatest: FloatArray
    principal_least: FloatArray
    warping_constant: FloatArray
    shear_coupling: FloatArray
    error_torsion: FloatArray
    error_shear_factor: FloatArray
    error_shear_centre: FloatArray


def analyse_outline(
    outline: Outline,
    *,
    poisson_ratio: float = 0.3,
    element_length: float | None = None,
    refinements: int = 2,
) -> SectionAnalysis:
    """Compute the section properties of one outline.

    Parameters
    ----------
    outline : Outline
        In any frame; positions refer to it [m].
    poisson_ratio : float
        Poisson's ratio [-], above -1 and at most 0.5; only the shear factors depend on it.
    element_length : float, optional
        Longest edge of a triangle on the boundary before refinement [m]; by default a tenth of the
        square root of the area.
    refinements : int
        How often each triangle is divided into four, one or more.

    Returns
    -------
    SectionAnalysis
        One station.

    Examples
    --------
    >>> from turnout.beam.outline import make_outline
    >>> bar = make_outline([[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1]])
    >>> properties = analyse_outline(bar).properties
    >>> round(float(properties.torsion_constant[0]) / 0.1**4, 4)
    0.1406
    """
    return analyse_outlines(
        [outline],
        poisson_ratio=poisson_ratio,
        element_length=element_length,
        refinements=refinements,
    )


def analyse_outlines(
    outlines: Sequence[Outline],
    *,
    poisson_ratio: float = 0.3,
    element_length: float | None = None,
    refinements: int = 2,
) -> SectionAnalysis:
    """Compute the section properties of several outlines, one station each.

    Parameters
    ----------
    outlines : sequence of Outline
        One or more, each in its own frame.
    poisson_ratio, element_length, refinements
        As for `analyse_outline`.

    Returns
    -------
    SectionAnalysis
        n stations, in the order of the outlines.
    """
    if not outlines:
        msg = "no outlines were given"
        raise MechanicsError(msg)
    if not -1.0 < poisson_ratio <= 0.5:
        msg = f"Poisson's ratio lies above -1 and is at most 0.5, not {poisson_ratio:g}"
        raise MechanicsError(msg)
    if refinements < 1:
        msg = f"refinements must be at least 1 to estimate the error, not {refinements}"
        raise MechanicsError(msg)
    rows = []
    for outline in outlines:
        moments = area_moments(outline)
        length = moments.area**0.5 / _ELEMENTS_ACROSS if element_length is None else element_length
        fine, coarse = (
            _solve_elastic(outline, poisson_ratio=poisson_ratio, length=length, refinements=times)
            for times in (refinements, refinements - 1)
        )
        rows.append(_assemble_station(moments, fine, coarse))
    return _stack(rows)


def _solve_elastic(
    outline: Outline, *, poisson_ratio: float, length: float, refinements: int
) -> dict[str, float]:
    """Solve torsion and shear on one mesh; positions from the centroid."""
    from turnout.beam.shear_torsion import (
        mesh_outline,
        shear_loads,
        solve_neumann,
        solve_shear,
        solve_torsion,
        torsion_flux,
    )

    mesh = mesh_outline(outline, element_length=length, refinements=refinements)
    sources, fluxes = shear_loads(mesh, poisson_ratio=poisson_ratio)
    warping, *potentials = solve_neumann(
        mesh,
        sources=[np.zeros_like(mesh.y), *sources],
        fluxes=[torsion_flux(mesh), *fluxes],
    )
    torsion = solve_torsion(mesh, warping=warping)
    shear = solve_shear(mesh, warping=warping, potentials=potentials, fluxes=fluxes)
    return {
        "torsion_constant": torsion.torsion_constant,
        "shear_factor_vertical": shear.factor_vertical,
        "shear_factor_lateral": shear.factor_lateral,
        "shear_centre_y": torsion.shear_centre_y,
        "shear_centre_z": torsion.shear_centre_z,
        "warping_constant": torsion.warping_constant,
        "shear_coupling": shear.coupling,
    }


def _assemble_station(
    moments: AreaMoments, fine: dict[str, float], coarse: dict[str, float]
) -> dict[str, float]:
    """Gather one station: geometry, the finer solution and its distance from the coarser one."""
    greatest, least, angle = principal_moments(moments)
    change = {name: abs(fine[name] / coarse[name] - 1.0) for name in fine if "factor" in name}
    return {
        "area": moments.area,
        "second_moment_vertical": moments.second_moment_vertical,
        "second_moment_lateral": moments.second_moment_lateral,
        "product_moment": moments.product_moment,
        "centroid_y": moments.centroid_y,
        "centroid_z": moments.centroid_z,
        **fine,
        "shear_centre_y": moments.centroid_y + fine["shear_centre_y"],
        "shear_centre_z": moments.centroid_z + fine["shear_centre_z"],
        "principal_angle": angle,
        "principal_greatest": greatest,
        "principal_least": least,
        "error_torsion": abs(fine["torsion_constant"] / coarse["torsion_constant"] - 1.0),
        "error_shear_factor": max(change.values()),
        "error_shear_centre": float(
            np.hypot(
                fine["shear_centre_y"] - coarse["shear_centre_y"],
                fine["shear_centre_z"] - coarse["shear_centre_z"],
            )
        ),
    }


def _stack(rows: list[dict[str, float]]) -> SectionAnalysis:
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    names = SectionProperties.__dataclass_fields__
    properties = SectionProperties(**{name: columns.pop(name) for name in names})
    return SectionAnalysis(properties=properties, **columns)
