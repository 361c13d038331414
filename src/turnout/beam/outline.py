"""The outline of a cross-section as data: a polygon with or without holes.

Axes: y lateral, z up, both in metres, in whatever frame the outline is drawn; the functions here
move an outline from one frame to another and return a new one.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from turnout.core.errors import MechanicsError

if TYPE_CHECKING:
    import shapely

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """A cross-section's boundary; `make_outline` makes one from any list of points.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        Vertices (y, z) of the outer boundary [m], counter-clockwise, the first one not repeated.
    holes : tuple of ndarray, each of shape (m, 2)
        Vertices of the inner boundaries [m], clockwise.

    Raises
    ------
    MechanicsError
        If a boundary has fewer than three vertices, a value is not finite, boundaries cross or
        touch themselves or each other along a line, or the area is zero.
    """

    points: FloatArray
    holes: tuple[FloatArray, ...] = ()

    def __post_init__(self) -> None:
        """Refuse outlines without area, naming the place of a boundary that crosses itself."""
        from shapely import is_valid_reason

        for ring in (self.points, *self.holes):
            if ring.ndim != 2 or ring.shape[1] != 2 or ring.shape[0] < 3:
                msg = f"a boundary needs three or more points (y, z), not an array {ring.shape}"
                raise MechanicsError(msg)
            if not np.isfinite(ring).all():
                row = int(np.flatnonzero(~np.isfinite(ring).all(axis=1))[0])
                msg = f"point {row} of the outline is not finite: {ring[row].tolist()}"
                raise MechanicsError(msg)
        polygon = polygon_of(self)
        if not polygon.is_valid or polygon.area <= 0.0:
            msg = f"the outline encloses no section: {is_valid_reason(polygon)}"
            raise MechanicsError(msg)
        if ring_area(self.points) < 0.0 or any(ring_area(hole) > 0.0 for hole in self.holes):
            msg = "outer boundaries run counter-clockwise, holes clockwise; see make_outline"
            raise MechanicsError(msg)


def make_outline(points: npt.ArrayLike, *, holes: tuple[npt.ArrayLike, ...] = ()) -> Outline:
    """Make an outline from vertices in either sense of rotation, closed or not.

    Parameters
    ----------
    points : array_like, shape (n, 2)
        Vertices (y, z) of the outer boundary [m]; a last one equal to the first is dropped.
    holes : tuple of array_like, each of shape (m, 2)
        Vertices of the inner boundaries [m].

    Returns
    -------
    Outline
        Outer boundary counter-clockwise, holes clockwise, none closed.

    Examples
    --------
    >>> clockwise = make_outline([[0, 0], [0, 0.1], [0.2, 0.1], [0.2, 0], [0, 0]])
    >>> clockwise.points.shape, round(ring_area(clockwise.points), 6)
    ((4, 2), 0.02)
    """
    return Outline(
        points=_orient(_drop_repeated(points), sense=1.0),
        holes=tuple(_orient(_drop_repeated(hole), sense=-1.0) for hole in holes),
    )


def ring_area(ring: FloatArray) -> float:
    """Return the area that a boundary encloses [m^2], positive if it runs counter-clockwise."""
    from_first = ring - ring[0]
    after = np.roll(from_first, -1, axis=0)
    return 0.5 * float(np.sum(from_first[:, 0] * after[:, 1] - after[:, 0] * from_first[:, 1]))


def move(outline: Outline, *, y: float = 0.0, z: float = 0.0) -> Outline:
    """Return the outline shifted by (y, z) [m].

    Examples
    --------
    >>> square = make_outline([[0, 0], [1, 0], [1, 1], [0, 1]])
    >>> move(square, y=2.0).points[0].tolist()
    [2.0, 0.0]
    """
    shift = np.array([y, z])
    return replace(
        outline, points=outline.points + shift, holes=tuple(h + shift for h in outline.holes)
    )


def rotate(outline: Outline, *, angle: float, about: tuple[float, float] = (0.0, 0.0)) -> Outline:
    """Return the outline turned by `angle` [rad], from y towards z, about a point (y, z) [m].

    Examples
    --------
    >>> square = make_outline([[0, 0], [1, 0], [1, 1], [0, 1]])
    >>> rotate(square, angle=np.pi / 2).points[1].round(12).tolist()
    [0.0, 1.0]
    """
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.array([[c, s], [-s, c]])  # acts on rows
    centre = np.array(about)
    return replace(
        outline,
        points=(outline.points - centre) @ rotation + centre,
        holes=tuple((h - centre) @ rotation + centre for h in outline.holes),
    )


def scale(outline: Outline, *, factor: float) -> Outline:
    """Return the outline with all lengths multiplied by a positive factor [-].

    Examples
    --------
    >>> square = make_outline([[0, 0], [1, 0], [1, 1], [0, 1]])
    >>> ring_area(scale(square, factor=3.0).points)
    9.0
    """
    if factor <= 0.0:
        msg = f"the factor of a scaled outline must be positive, not {factor:g}"
        raise MechanicsError(msg)
    return replace(
        outline, points=outline.points * factor, holes=tuple(h * factor for h in outline.holes)
    )


def mirror(outline: Outline) -> Outline:
    """Return the outline mirrored in the plane y = 0: the same rail on the other side of the track.

    Examples
    --------
    >>> triangle = make_outline([[0, 0], [1, 0], [0, 1]])
    >>> mirror(triangle).points.tolist()
    [[0.0, 1.0], [-1.0, 0.0], [0.0, 0.0]]
    """
    flip = np.array([-1.0, 1.0])
    return replace(
        outline,
        points=outline.points[::-1] * flip + 0.0,  # -0.0 becomes 0.0
        holes=tuple(h[::-1] * flip + 0.0 for h in outline.holes),
    )


def densify(outline: Outline, *, length: float) -> Outline:
    """Return the outline with each edge divided evenly into parts no longer than `length` [m].

    Examples
    --------
    >>> square = make_outline([[0, 0], [1, 0], [1, 1], [0, 1]])
    >>> densify(square, length=0.5).points[:3].tolist()
    [[0.0, 0.0], [0.5, 0.0], [1.0, 0.0]]
    """
    if length <= 0.0:
        msg = f"the length of a densified outline's edges must be positive, not {length:g}"
        raise MechanicsError(msg)
    return replace(
        outline,
        points=_divide(outline.points, length),
        holes=tuple(_divide(h, length) for h in outline.holes),
    )


def polygon_of(outline: Outline) -> "shapely.Polygon":
    """Return the outline as a shapely polygon."""
    from shapely import Polygon

    return Polygon(outline.points, outline.holes)


def outline_of(polygon: "shapely.Polygon") -> Outline:
    """Return a shapely polygon as an outline."""
    holes = tuple(np.array(hole.coords) for hole in polygon.interiors)
    return make_outline(np.array(polygon.exterior.coords), holes=holes)


def _drop_repeated(points: npt.ArrayLike) -> FloatArray:
    ring = np.asarray(points, dtype=float)
    closed = ring.ndim == 2 and ring.shape[0] > 1 and bool(np.all(ring[0] == ring[-1]))
    return ring[:-1] if closed else ring


def _orient(ring: FloatArray, *, sense: float) -> FloatArray:
    if ring.ndim != 2 or ring.shape[1] != 2 or ring.shape[0] < 3:
        return ring  # refused by the record
    return ring[::-1].copy() if ring_area(ring) * sense < 0.0 else ring.copy()


def _divide(ring: FloatArray, length: float) -> FloatArray:
    edges = np.roll(ring, -1, axis=0) - ring
    parts = np.maximum(np.ceil(np.hypot(*edges.T) / length - 1e-9), 1.0).astype(int)
    fractions = [np.arange(count)[:, None] / count for count in parts]
    pieces = [
        start + fraction * edge
        for start, edge, fraction in zip(ring, edges, fractions, strict=True)
    ]
    return np.concatenate(pieces)
