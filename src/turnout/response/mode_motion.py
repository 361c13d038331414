"""What kind of motion a shape is: on which rail, in which direction, and where it is largest.

Shapes are complex displacements of the foot line. Kinetic energies are taken rail by rail from the
sections alone: each direction at the centroid, torsion with the polar moment of inertia.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.mechanism.rail import RailData

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

MOTIONS = ("lateral", "vertical", "torsion", "along")
HEAD = 0.1
"""Height above the foot at which the motion of a turning rail is looked at as well [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class BodyShape:
    """The shape of one rail.

    Attributes
    ----------
    data : RailData
        The rail.
    x : ndarray, shape (n,)
        Nodes [m].
    nodes : ndarray of complex, shape (n, 6)
        ux ... rz of the foot line.
    """

    data: RailData
    x: Floats
    nodes: Complexes


def kinetic_shares(shapes: list[BodyShape]) -> Floats:
    """Return the shares of kinetic energy, shape (n_bodies, 4), in the order of `MOTIONS` [-]."""
    energy = np.array([_energies(shape) for shape in shapes])
    total = energy.sum()
    shares: Floats = energy / total if total > 0 else energy
    return shares


def _energies(shape: BodyShape) -> Floats:
    data = shape.data
    middle = 0.5 * (shape.nodes[1:] + shape.nodes[:-1])
    if data.matrices is None:
        height = 0.5 * (data.axis_height[1:] + data.axis_height[:-1])
        section = data.sections
        y, z = section.centroid_y, section.centroid_z + height
        area = section.area
        polar = section.second_moment_lateral + section.second_moment_vertical
    else:  # the sections are not known: a rail of even mass, seen at half the height of its head
        ones = np.ones(middle.shape[0])
        y, z, area, polar = 0.0 * ones, 0.5 * HEAD * ones, ones, (0.5 * HEAD) ** 2 * ones
    lateral = middle[:, 1] - z * middle[:, 3]
    vertical = middle[:, 2] + y * middle[:, 3]
    along = middle[:, 0] + z * middle[:, 4] - y * middle[:, 5]
    length = np.diff(shape.x)
    squares = (
        area * np.abs(lateral) ** 2,
        area * np.abs(vertical) ** 2,
        polar * np.abs(middle[:, 3]) ** 2,
        area * np.abs(along) ** 2,
    )
    return np.array([float(np.sum(length * square)) for square in squares])


def largest(shapes: list[BodyShape]) -> tuple[int, int, complex]:
    """Return body, node and displacement where foot or head move most, across the rail.

    Either the lateral or vertical displacement of the foot, or the lateral one of the head.
    """
    best = (0, 0, 0.0 + 0.0j)
    for number, shape in enumerate(shapes):
        nodes = shape.nodes
        moved = np.stack((nodes[:, 1] - HEAD * nodes[:, 3], nodes[:, 1], nodes[:, 2]))
        at = np.unravel_index(int(np.argmax(np.abs(moved))), moved.shape)
        if np.abs(moved[at]) > abs(best[2]):
            best = (number, int(at[1]), complex(moved[at]))
    return best


def on_common_grid(shapes: list[BodyShape], x: Floats) -> Complexes:
    """Interpolate shapes to common places, shape (n_bodies, 6, n); NaN beyond a rail."""
    found = np.full((len(shapes), 6, x.size), np.nan + 0j, dtype=np.complex128)
    for number, shape in enumerate(shapes):
        inside = (x >= shape.x[0] - 1e-9) & (x <= shape.x[-1] + 1e-9)
        for direction in range(6):
            found[number, direction, inside] = np.interp(
                x[inside], shape.x, shape.nodes[:, direction]
            )
    return found
