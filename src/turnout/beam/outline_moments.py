r"""Geometry of an outline: moments of area, and the edges of the foot on a slide chair.

Area, centroid and second moments are exact for the polygon: by Green's theorem an integral over the
section is one along its boundary, and along a straight edge
from :math:`(y_i, z_i)` to :math:`(y_j, z_j)` that is a polynomial. With
:math:`c = y_i z_j - y_j z_i`

.. math::

    A = \tfrac{1}{2} \sum c, \quad
    \int y\,dA = \tfrac{1}{6} \sum c\,(y_i + y_j), \quad
    \int y^2\,dA = \tfrac{1}{12} \sum c\,(y_i^2 + y_i y_j + y_j^2), \quad
    \int y z\,dA = \tfrac{1}{24} \sum c\,(2 y_i z_i + y_i z_j + y_j z_i + 2 y_j z_j).

Clockwise holes count negative by themselves. Arcs are as accurate as the polygon that replaces
them. The foot is the part of the section within a small height above its lowest point.
"""

from dataclasses import dataclass

import numpy as np

from turnout.beam.outline import FloatArray, Outline


@dataclass(frozen=True, slots=True)
class AreaMoments:
    """Moments of a section's area; second moments about axes through the centroid.

    Parameters
    ----------
    area : float
        A [m^2].
    centroid_y, centroid_z : float
        Position of the centroid in the frame of the outline [m].
    second_moment_vertical : float
        I_y, the integral of z^2 [m^4]; resists vertical bending.
    second_moment_lateral : float
        I_z, the integral of y^2 [m^4]; resists lateral bending.
    product_moment : float
        I_yz, the integral of y z [m^4].
    """

    area: float
    centroid_y: float
    centroid_z: float
    second_moment_vertical: float
    second_moment_lateral: float
    product_moment: float


def area_moments(outline: Outline) -> AreaMoments:
    """Integrate the moments of an outline's area.

    Parameters
    ----------
    outline : Outline
        In any frame [m].

    Returns
    -------
    AreaMoments
        Second moments about the centroid, its position in the frame of the outline.

    Examples
    --------
    >>> from turnout.beam.outline import make_outline
    >>> moments = area_moments(make_outline([[0, 0], [2, 0], [2, 6], [0, 6]]))
    >>> moments.area, moments.centroid_z, moments.second_moment_vertical
    (12.0, 3.0, 36.0)
    """
    origin = outline.points.mean(axis=0)  # near the centroid, so that nothing large cancels
    sums = np.sum([_ring_sums(ring - origin) for ring in (outline.points, *outline.holes)], axis=0)
    area, first_y, first_z, lateral, vertical, product = (float(value) for value in sums)
    y, z = first_y / area, first_z / area
    return AreaMoments(
        area=area,
        centroid_y=float(origin[0]) + y,
        centroid_z=float(origin[1]) + z,
        second_moment_vertical=vertical - area * z**2,
        second_moment_lateral=lateral - area * y**2,
        product_moment=product - area * y * z,
    )


def principal_moments(moments: AreaMoments) -> tuple[float, float, float]:
    """Return the greatest and the least second moment [m^4] and the angle of the first one's axis.

    Parameters
    ----------
    moments : AreaMoments
        About axes through the centroid [m^4].

    Returns
    -------
    greatest, least : float
        Principal second moments [m^4].
    angle : float
        From the y axis towards z to the axis about which the greatest acts [rad], in
        (-pi/2, pi/2]; zero where all axes are alike.

    Examples
    --------
    >>> from turnout.beam.outline import make_outline, rotate
    >>> upright = make_outline([[-1, -3], [1, -3], [1, 3], [-1, 3]])
    >>> greatest, least, angle = principal_moments(area_moments(rotate(upright, angle=0.2)))
    >>> round(greatest, 9), round(least, 9), round(angle, 9)
    (36.0, 4.0, 0.2)
    """
    mean = 0.5 * (moments.second_moment_vertical + moments.second_moment_lateral)
    difference = 0.5 * (moments.second_moment_vertical - moments.second_moment_lateral)
    radius = float(np.hypot(difference, moments.product_moment))
    if radius <= 1e-12 * mean:
        return mean, mean, 0.0
    angle = 0.5 * float(np.arctan2(-moments.product_moment, difference))
    return mean + radius, mean - radius, angle


def _ring_sums(ring: FloatArray) -> FloatArray:
    """Sum over the edges: area, first moments in y and z, and of y^2, z^2, y z."""
    y, z = ring.T
    y_next, z_next = np.roll(ring, -1, axis=0).T
    cross = y * z_next - y_next * z
    mixed = 2.0 * y * z + y * z_next + y_next * z + 2.0 * y_next * z_next
    rows = [
        cross / 2.0,
        cross * (y + y_next) / 6.0,
        cross * (z + z_next) / 6.0,
        cross * (y**2 + y * y_next + y_next**2) / 12.0,
        cross * (z**2 + z * z_next + z_next**2) / 12.0,
        cross * mixed / 24.0,
    ]
    return np.asarray(np.sum(rows, axis=1), dtype=float)


# What lies this much above the lowest point still counts as the underside [m].
UNDERSIDE_DEPTH = 1e-3


def foot_edges(outline: Outline, *, depth: float = UNDERSIDE_DEPTH) -> tuple[float, float]:
    """Return the lateral positions between which a section stands on a plane [m].

    The section's part below its lowest point plus `depth` is taken, so that chamfers, and the
    slight tilt of a drawn underside, do not take the foot away.

    Parameters
    ----------
    outline : Outline
        In any frame with z up.
    depth : float
        How far above the lowest point a vertex still belongs to the underside [m].

    Returns
    -------
    least, most : float
        Least and largest y of the underside [m].

    Examples
    --------
    >>> from turnout.beam.outline import make_outline
    >>> foot = make_outline([[-0.05, 0.0], [0.06, 0.0005], [0.06, 0.02], [-0.05, 0.02]])
    >>> foot_edges(foot)
    (-0.05, 0.06)
    """
    start = outline.points
    end = np.roll(start, -1, axis=0)
    level = float(start[:, 1].min()) + depth
    inside = start[start[:, 1] <= level, 0]
    crosses = (start[:, 1] <= level) != (end[:, 1] <= level)
    crossings = _intersect_level(start[crosses], end[crosses], level)
    found = np.concatenate([inside, crossings])
    return float(found.min()), float(found.max())


def _intersect_level(start: FloatArray, end: FloatArray, level: float) -> FloatArray:
    """Return y at which edges, shape (n, 2) each end, cross a height [m]."""
    share = (level - start[:, 1]) / (end[:, 1] - start[:, 1])
    crossing: FloatArray = start[:, 0] + share * (end[:, 0] - start[:, 0])
    return crossing
