r"""Lengths and cross-sections along a rail, and the splines through their points.

Cubic splines through a few points.

The slopes :math:`s` at the knots follow from continuous curvature,

.. math:: h_i s_{i-1} + 2 (h_{i-1} + h_i) s_i + h_{i-1} s_{i+1}
          = 3 (h_i d_{i-1} + h_{i-1} d_i)

with the lengths :math:`h` and mean slopes :math:`d` of the intervals, and one condition at each
end. De Boor, A Practical Guide to Splines, 1978, chapter IV. It is written out here since a library
for it takes longer to load than many throws.

Lengths and cross-sections along a rail: stock rail gap, running edge, section table.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from turnout.panel.model import Panel
from turnout.panel.records import Profile, Rail, RunningEdge, SectionTable

FloatArray = npt.NDArray[np.float64]

ENDS = ("not-a-knot", "natural", "clamped")
"""Third derivative continuous at the next knot; no curvature; no slope."""


@dataclass(frozen=True, slots=True, eq=False)
class Spline:
    """A cubic spline.

    Attributes
    ----------
    knots : ndarray, shape (n,)
        Rising.
    values, slopes : ndarray, shape (n, ...)
        At the knots.
    """

    knots: FloatArray
    values: FloatArray
    slopes: FloatArray

    def __call__(self, x: npt.ArrayLike) -> FloatArray:
        """Return the values at places, shape (..., ...); beyond the ends the last cubic goes on."""
        places = np.asarray(x, dtype=np.float64)
        last = self.knots.size - 2
        at = np.minimum(np.maximum(self.knots.searchsorted(places, side="right") - 1, 0), last)
        start = self.knots[at]
        length = self.knots[at + 1] - start
        share = (places - start) / length
        own = (..., *(np.newaxis,) * (self.values.ndim - 1))
        s, h = share[own], length[own]
        rest = 1.0 - s
        found: FloatArray = rest * rest * (1.0 + 2.0 * s) * self.values[at]
        found = found + s * s * (1.0 + 2.0 * rest) * self.values[at + 1]
        found = found + h * s * rest * (rest * self.slopes[at] - s * self.slopes[at + 1])
        return found

    def through(self, values: FloatArray) -> "Spline":
        """Return the not-a-knot spline through other values, shape (n,), at the same knots."""
        return Spline(self.knots, values, _slope_operator(self.knots.tobytes()) @ values)


def cubic_spline(knots: Sequence[float], values: npt.ArrayLike, *, ends: tuple[str, str]) -> Spline:
    """Return the cubic spline through some points.

    Parameters
    ----------
    knots : sequence of float
        Rising, at least two; three for the end "not-a-knot".
    values : array_like, shape (n, ...)
        At the knots.
    ends : tuple of str
        Conditions at the first and the last knot, of `ENDS`.

    Examples
    --------
    >>> cube = cubic_spline([0, 1, 2, 3], [0, 1, 8, 27], ends=("not-a-knot", "not-a-knot"))
    >>> round(float(cube(2.5)), 9)
    15.625
    """
    x, y = np.asarray(knots, dtype=np.float64), np.asarray(values, dtype=np.float64)
    n, length = x.size, np.diff(x)
    rise = np.diff(y, axis=0) / length.reshape(-1, *(1,) * (y.ndim - 1))
    if n == 3 and ends == ("not-a-knot", "not-a-knot"):  # which leaves one parabola
        bend = (rise[1] - rise[0]) / (length[0] + length[1])
        first = rise[0] - length[0] * bend
        slopes = np.stack((first, first + 2 * length[0] * bend, rise[1] + length[1] * bend))
        return Spline(x, y, slopes)
    matrix, right = _slope_matrix(x.tobytes(), ends), np.zeros_like(y)
    across = length.reshape(-1, *(1,) * (y.ndim - 1))
    right[1:-1] = 3.0 * (across[1:] * rise[:-1] + across[:-1] * rise[1:])
    for row, order in ((0, slice(None)), (n - 1, slice(None, None, -1))):
        right[row] = _end(ends[0 if row == 0 else 1], length[order], rise[order], n)[1]
    solved = np.linalg.solve(matrix, right.reshape(n, -1))
    return Spline(x, y, np.asarray(solved, dtype=np.float64).reshape(y.shape))


@lru_cache(maxsize=32)
def _slope_operator(knots: bytes) -> FloatArray:
    """Return the matrix that takes values to the slopes of their not-a-knot spline."""
    x = np.frombuffer(knots)
    return cubic_spline(x.tolist(), np.eye(x.size), ends=("not-a-knot", "not-a-knot")).slopes


@lru_cache(maxsize=32)
def _slope_matrix(knots: bytes, ends: tuple[str, str]) -> FloatArray:
    """Return the matrix of the equations for the slopes, which the knots alone determine."""
    length = np.diff(np.frombuffer(knots))
    n, nothing = length.size + 1, np.zeros_like(length)
    matrix = np.zeros((n, n))
    for i in range(1, n - 1):
        before, after = length[i - 1], length[i]
        matrix[i, i - 1 : i + 2] = after, 2.0 * (before + after), before
    for row, end in ((0, ends[0]), (n - 1, ends[1])):
        # seen from that end, so that both are written once
        order = slice(None) if row == 0 else slice(None, None, -1)
        matrix[row, order][: min(n, 3)] = _end(end, length[order], nothing[order], n)[0]
    matrix.flags.writeable = False
    return matrix


def _end(end: str, length: FloatArray, rise: FloatArray, n: int) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients of the first three slopes, and the right side, of one end."""
    if end == "clamped":
        return np.array([1.0, 0.0, 0.0])[:n], np.zeros_like(rise[0])
    if end == "natural":
        return np.array([2.0, 1.0, 0.0])[:n], 3.0 * rise[0]
    one, two = length[0], length[1]
    both = one + two
    right = ((one + 2.0 * both) * two * rise[0] + one * one * rise[1]) / both
    return np.array([two, both, 0.0]), right


def evaluate_profile(profile: float | Profile, x: npt.ArrayLike) -> FloatArray:
    """Evaluate a constant or tabulated length; it is held constant beyond its ends.

    Parameters
    ----------
    profile : float or Profile
        A length [m], or a table that is interpolated linearly or by a not-a-knot cubic spline.
    x : array_like, shape (n,)
        Positions from the toe [m].

    Returns
    -------
    ndarray, shape (n,)
        The length at each position [m].

    Examples
    --------
    >>> table = Profile(x=["0 m", "2 m"], value=["0 m", "1 m"])
    >>> evaluate_profile(table, [0.5, 3.0])
    array([0.25, 1.  ])
    """
    position = np.asarray(x, dtype=np.float64)
    if not isinstance(profile, Profile):
        return np.full(position.shape, profile, dtype=np.float64)
    stations, values = tuple(profile.x), tuple(profile.value)
    if profile.interpolation == "linear" or len(stations) < 3:
        return np.asarray(np.interp(position, stations, values), dtype=np.float64)
    held = np.clip(position, stations[0], stations[-1])
    return np.asarray(_spline(stations, values)(held), dtype=np.float64)


@lru_cache(maxsize=64)
def _spline(stations: tuple[float, ...], values: tuple[float, ...]) -> Spline:
    """Return the spline of a table; a throw asks for its value at every stop and object."""
    return cubic_spline(stations, values, ends=("not-a-knot", "not-a-knot"))


def stock_rail_gap(rail: Rail, x: npt.ArrayLike) -> FloatArray | None:
    """Give the typed gap to the stock rail in the rail's stress-free position [m].

    None where no shape is typed: the rail has no stock rail, or its shape is computed.
    """
    if rail.stock_rail_gap is None:
        return None
    return evaluate_profile(rail.stock_rail_gap, x)


def contact_height(panel: Panel, rail: str, x: FloatArray) -> FloatArray:
    """Return the height at which a rail meets its stock rail.

    That of its stops and studs, linear in between; that of a foreign object where there are none.

    Parameters
    ----------
    panel : Panel
        The panel.
    rail : str
        Name of the rail.
    x : ndarray, shape (n,)
        Places [m].

    Returns
    -------
    ndarray, shape (n,)
        [m] above the reference line.
    """
    stops = [*panel.stop.values(), *panel.stud.values()]
    found = sorted([(s.x, s.height) for s in stops if s.rails is None or rail in s.rails])
    if not found:
        return np.full(np.shape(x), panel.object_defaults.height)
    places = np.asarray(x, dtype=np.float64)
    return _height_between(tuple(found), places.shape, places.tobytes())


@lru_cache(maxsize=64)
def _height_between(
    points: tuple[tuple[float, float], ...], shape: tuple[int, ...], x: bytes
) -> FloatArray:
    """Return heights linear between some points, read-only, as throws share them."""
    places, heights = np.array(points).T
    found: FloatArray = np.interp(np.frombuffer(x).reshape(shape), places, heights)
    found.flags.writeable = False
    return found


def running_edge_distance(edge: RunningEdge, x: npt.ArrayLike) -> FloatArray:
    r"""Return the distance between the running edges of stock and switch rail, on a circle.

    .. math:: w(x) = w_0 + (x + x_0)^2 / (2 R) \ge w_{min}

    A circle with w_0 = 0 touches the stock rail; with less it meets it at an angle.

    It goes on growing behind the place where the section of the switch rail is full.

    Parameters
    ----------
    edge : RunningEdge
        Radius R, lead :math:`x_0`, offset :math:`w_0` there, and least offset [m].
    x : array_like, shape (n,)
        Positions from the toe [m].

    Returns
    -------
    ndarray, shape (n,)
        Distance w [m]; ahead of the tangent point it is held at its least value.

    Examples
    --------
    >>> edge = RunningEdge(radius="760.7 m", lead="2.1 m", minimum="2.9 mm", maximum="80 mm")
    >>> running_edge_distance(edge, [0.0, 15.0]).round(4).tolist()
    [0.0029, 0.1922]
    """
    ahead = np.maximum(np.asarray(x, dtype=np.float64) + edge.lead, 0.0)
    return np.maximum(edge.tangent_offset + ahead**2 / (2.0 * edge.radius), edge.minimum)


def running_edge_offset(edge: RunningEdge, x: npt.ArrayLike) -> FloatArray:
    """Return the offset that the section depends on: the distance, up to that of full section.

    Parameters
    ----------
    edge : RunningEdge
        Its `maximum` is the offset of the full section [m].
    x : array_like, shape (n,)
        Positions from the toe [m].

    Returns
    -------
    ndarray, shape (n,)
        Offset w [m].

    Examples
    --------
    >>> edge = RunningEdge(radius="760.7 m", lead="2.1 m", minimum="2.9 mm", maximum="80 mm")
    >>> running_edge_offset(edge, [0.0, 15.0]).round(4).tolist()
    [0.0029, 0.08]
    """
    return np.minimum(running_edge_distance(edge, x), edge.maximum)


def running_edge_position(edge: RunningEdge, offset: float) -> float:
    """Give the position x [m] at which the circle has an offset [m]."""
    beyond = max(offset - edge.tangent_offset, 0.0)
    return math.sqrt(2.0 * edge.radius * beyond) - edge.lead


def stations_of(panel: Panel, section: str) -> tuple[str, FloatArray]:
    """Give the kind of a section's stations, and these.

    Parameters
    ----------
    panel : Panel
        The panel.
    section : str
        Name of a section of any kind.

    Returns
    -------
    kind : str
        "x" for positions along the rail, "offset" for offsets of the running edges, "none" for one
        outline all along.
    stations : ndarray, shape (n,)
        Rising [m].
    """
    if section in panel.planed_section:
        return "offset", np.asarray(panel.planed_section[section].running_edge_offset)
    if section in panel.outline_section:
        return "none", np.zeros(1)
    table = panel.section[section]
    if table.x is not None:
        return "x", np.asarray(table.x)
    return "offset", np.asarray(table.running_edge_offset)


def section_stations(panel: Panel, rail: str) -> FloatArray:
    """Return the positions of a rail's section stations and of the start of constant section.

    Parameters
    ----------
    panel : Panel
        The panel.
    rail : str
        Name of the rail.

    Returns
    -------
    ndarray, shape (n,)
        Rising positions [m] strictly between the ends of the rail; empty for a prismatic rail.
    """
    record = panel.rail[rail]
    (kind, stations), edge = stations_of(panel, record.section), record.running_edge
    if kind == "x":
        places = stations.tolist()
    elif kind == "offset" and edge is not None:
        bounds = (edge.minimum, edge.maximum)
        offsets = [w for w in stations.tolist() if bounds[0] < w < bounds[1]]
        places = [running_edge_position(edge, offset) for offset in (*offsets, *bounds)]
    else:
        places = []
    inside = {place for place in places if record.start < place < record.end}
    return np.array(sorted(inside), dtype=np.float64)


def between_stations(
    panel: Panel, rail: str, columns: Mapping[str, npt.ArrayLike], x: npt.ArrayLike
) -> dict[str, FloatArray]:
    """Interpolate values between a rail's stations: linear in between, held beyond the ends.

    Where the stations are running-edge offsets w, values are linear in w, not in x.

    Parameters
    ----------
    panel : Panel
        The panel.
    rail : str
        Name of the rail.
    columns : mapping of str to array_like, shape (n_stations,)
        Values at the stations of the rail's section.
    x : array_like, shape (n,)
        Positions from the toe [m].

    Returns
    -------
    dict of str to ndarray, shape (n,)
    """
    record, at = panel.rail[rail], np.asarray(x, dtype=np.float64)
    kind, stations = stations_of(panel, record.section)
    if kind == "offset" and record.running_edge is not None:
        at = running_edge_offset(record.running_edge, at)
    return {
        name: np.asarray(np.interp(at, stations, np.asarray(column)), dtype=np.float64)
        for name, column in columns.items()
    }


def outline_points(points: npt.ArrayLike, *, symmetric: bool) -> FloatArray:
    """Return all vertices of a drawn outline, with the mirror image if only half is given.

    Parameters
    ----------
    points : array_like, shape (n, 2)
        Vertices (y, z) as given [m].
    symmetric : bool
        Whether they are the half with y >= 0.

    Returns
    -------
    ndarray, shape (m, 2)

    Examples
    --------
    >>> outline_points([[0.0, 0.0], [1.0, 0.0], [0.0, 2.0]], symmetric=True).tolist()
    [[0.0, 0.0], [1.0, 0.0], [0.0, 2.0], [-1.0, 0.0]]
    """
    given = np.asarray(points, dtype=np.float64)
    if not symmetric:
        return given
    return np.concatenate([given, given[given[:, 0] > 0.0][::-1] * [-1.0, 1.0]])


def section_columns(table: SectionTable) -> dict[str, tuple[float, ...]]:
    """Give all columns of a section table, with the default of those that are left out."""
    zero = (0.0,) * len(table.area)
    offset = table.centroid_offset if table.centroid_offset is not None else zero
    height = table.centroid_height
    shear_height, shear_offset = table.shear_centre_height, table.shear_centre_offset
    return {
        "area": table.area,
        "second_moment_vertical": table.second_moment_vertical,
        "second_moment_lateral": table.second_moment_lateral,
        "product_moment": table.product_moment if table.product_moment is not None else zero,
        "torsion_constant": table.torsion_constant,
        "shear_factor_vertical": table.shear_factor_vertical,
        "shear_factor_lateral": table.shear_factor_lateral,
        "centroid_height": height,
        "centroid_offset": offset,
        "shear_centre_height": shear_height if shear_height is not None else height,
        "shear_centre_offset": shear_offset if shear_offset is not None else offset,
    }
