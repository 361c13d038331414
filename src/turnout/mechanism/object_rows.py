r"""Rows of foreign objects on the rails, which stay the same for all places of an object.

A point of a rail between two nodes follows the cubic through displacement and slope at
both, and the linear course of the roll. What a rail yields at an object beyond its reduced
coordinates, between nodes and where no coordinate of its own lifts it along a sloping face,

.. math:: f = r_i^T K_{ii}^{-1} r_i - \sum_k (\phi_k^T r_i)^2 / \omega_k^2

with the row r of the object at the inner coordinates i and the fixed-interface modes that are kept,
is put in series with the stiffness of the object. Against rails with a node at the object its force
differs by 0.1 % where sections change along the rail, by 0.01 % on prismatic rails, and those of
drives by less than 0.02 % (root mean square, of the peak).
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from turnout.beam.craig_bampton import Superelement
from turnout.beam.mesh import MERGE_DISTANCE
from turnout.beam.spectrum import Factor, factorise
from turnout.core.errors import MechanicsError
from turnout.mechanism.build_rails import approach_ends, object_ends
from turnout.mechanism.mechanism import Point, RailBody, RailData
from turnout.mechanism.reduce import superelement_of
from turnout.mechanism.structure import Structure, form_rows
from turnout.panel.foreign_object import PlacedObject
from turnout.panel.model import Panel

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

RX, PER_NODE = 3, 6
CUBIC = {"uy": (1, 5, 1.0), "uz": (2, 4, -1.0)}
"""Displacement and rotation of a node, and the slope that the rotation makes, by direction."""


def is_off_node(panel: Panel, item: PlacedObject) -> bool:
    """Return True if an object stands at none of the places of its rail and of the stock rail.

    Rails that came as matrices have only the nodes that they came with.
    """
    rail, x = panel.rail[item.rail], item.x
    faced = [stock for stock in panel.stock_rail.values() if stock.faces == item.rail]
    ends = [(rail.start, rail.end), *((stock.start, stock.end) for stock in faced)]
    if rail.matrices is not None or not all(first < x < last for first, last in ends):
        return False
    families = (
        *(panel.chair, panel.sleeper, panel.drive, panel.stop, panel.stud, panel.fastening),
        *(panel.link, panel.back_drive, panel.sensor, panel.stock_fastening),
    )
    low, high = x - MERGE_DISTANCE, x + MERGE_DISTANCE
    return not [at for family in families for at in family.values() if low < at.x < high]


def offnode_row(nodes: Floats, *, x: float, z: float, direction: str = "uy") -> tuple[Ints, Floats]:
    """Return the nodal displacements that move a point on the reference line, and their weights.

    Parameters
    ----------
    nodes : ndarray, shape (n,)
        Places of the nodes, rising [m].
    x, z : float
        Place of the point, at a node if one is as near as `MERGE_DISTANCE`, and its height above
        the foot line [m].
    direction : {"uy", "uz"}
        Of its displacement; roll moves it sideways alone.

    Returns
    -------
    at : ndarray of int, shape (6,)
        Into ux, uy, uz, rx, ry, rz of all nodes.
    weights : ndarray, shape (6,)

    Examples
    --------
    >>> at, weights = offnode_row(np.array([0.0, 1.0]), x=0.5, z=0.2)
    >>> at.tolist(), weights.tolist()
    ([1, 5, 7, 11, 3, 9], [0.5, 0.125, 0.5, -0.125, -0.1, -0.1])
    """
    nearest = float(nodes[np.abs(nodes - x).argmin()])
    x = nearest if abs(nearest - x) <= MERGE_DISTANCE else x
    left = min(max(int(nodes.searchsorted(x, side="right")) - 1, 0), nodes.size - 2)
    start, end = nodes[left : left + 2].tolist()
    length = end - start
    s = (x - start) / length
    r = 1.0 - s
    first, second = PER_NODE * left, PER_NODE * (left + 1)
    shift, turn, slope = CUBIC[direction]
    arm = z if direction == "uy" else 0.0
    at = [first + shift, first + turn, second + shift, second + turn, first + RX, second + RX]
    weights = [r * r * (1.0 + 2.0 * s), slope * length * s * r * r, s * s * (1.0 + 2.0 * r)]
    weights += [-slope * length * s * s * r, -arm * r, -arm * s]
    return np.array(at), np.array(weights)


class ObjectEnd(NamedTuple):
    """A point of a rail at an object, as of `offnode_row`, and the sign of its displacement."""

    rail: str
    sign: float
    at: Ints
    weights: Floats


def ends_on_nodes(
    ends: Iterable[tuple[str, Point]], bodies: Mapping[str, RailBody]
) -> list[ObjectEnd]:
    """Return points of rails as displacements of the nodes of these."""
    found = []
    for name, point in ends:
        row = offnode_row(bodies[name].x, x=point.x, z=point.z, direction=point.direction)
        found.append(ObjectEnd(name, point.sign, *row))
    return found


def approach_row(ends: Sequence[ObjectEnd], bodies: Mapping[str, RailBody]) -> Floats:
    """Return the row of a switch rail's approach to its stock rail at an object.

    Parameters
    ----------
    ends : sequence of ObjectEnd
        Of the object.
    bodies : mapping of str to RailBody
        The reduced rails.
    """
    row = np.zeros(sum(body.count for body in bodies.values()))
    for end in ends:
        body = bodies[end.rail]
        row[body.first : body.first + body.count] += end.sign * (
            end.weights @ body.recovery[end.at]
        )
    return row


def needs_node(
    panel: Panel,
    item: PlacedObject,
    rails: Sequence[RailData],
    bodies: Sequence[RailBody],
) -> bool:
    """Return whether a rail lacks coordinates across it for an object at one of its places.

    Parameters
    ----------
    panel, item
        As of `approach_row`.
    rails : sequence of RailData
        All rails without the object.
    bodies : sequence of RailBody
        The same, reduced.

    Raises
    ------
    MechanicsError
        When a rail that came as matrices has no such node.
    """
    given = {data.name: data for data in rails if data.matrices is not None}
    for name, point in object_ends(panel, item):
        if name in given:
            form_rows(superelement_of(given[name])[0], (point,), name=name)
    by_name = {body.name: body for body in bodies}
    across = approach_ends(panel, item.rail, x=item.x, height=item.height)
    ends = ends_on_nodes(across, by_name)
    return not all(is_at_interface(by_name[end.rail], end) for end in ends)


def is_at_interface(body: RailBody, end: ObjectEnd) -> bool:
    """Return whether the interface coordinates of a rail alone move one of its points."""
    return bool(body.at_interface[end.at[end.weights != 0.0]].all())


class LocalFlexibility:
    """Flexibility of a rail between its nodes, beyond its reduced coordinates.

    Parameters
    ----------
    data : RailData
        The rail. It is factorised when it is first asked for a place, and each of its elements is
        solved for once.
    """

    def __init__(self, data: RailData) -> None:
        self._data = data
        self._blocks: dict[int, Floats] = {}

    @cached_property
    def _inside(self) -> tuple[Structure, Superelement, Ints, Factor]:
        structure, element, _ = superelement_of(self._data)
        inner = np.setdiff1d(np.arange(structure.load.size), element.interface)
        factor = factorise(sp.csr_array(structure.stiffness[inner][:, inner]))
        if factor is None:
            name = self._data.name
            msg = f"rail {name} is not held between the places of its stops, chairs and drives"
            raise MechanicsError(msg)
        return structure, element, inner, factor

    def at(self, ends: Sequence[ObjectEnd]) -> float:
        """Return the flexibility along the sum of displacements of points at one place [m/N]."""
        whole, first = np.zeros(2 * PER_NODE), int(ends[0].at.min()) // PER_NODE
        for end in ends:
            whole[end.at - PER_NODE * first] += end.sign * end.weights
        if first not in self._blocks:
            self._blocks[first] = self._block(first)
        return float(whole @ self._blocks[first] @ whole)

    def _block(self, first: int) -> Floats:
        """Return the flexibility of the motion of an element's two nodes, shape (12, 12)."""
        structure, element, inner, factor = self._inside
        motion = structure.motion[PER_NODE * first : PER_NODE * (first + 2)][:, inner].toarray()
        modes = element.transformation[inner, element.interface.size :]
        kept = (motion @ modes) / (2.0 * np.pi * element.frequencies_kept)
        found: Floats = motion @ factor.solve(motion.T) - kept @ kept.T
        return found
