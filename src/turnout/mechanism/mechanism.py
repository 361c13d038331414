"""The record that mechanics hands to integration and response."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from turnout.law.table import LawTable
from turnout.panel.spline import Spline

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class RailBody:
    """One reduced rail within a mechanism.

    Attributes
    ----------
    name : str
        Name of the rail.
    closes : float
        +1.0 if it closes towards +y, -1.0 if towards -y.
    x : ndarray, shape (n_nodes,)
        Nodes along the rail [m].
    first, count : int
        Place of its reduced coordinates in the mechanism's.
    recovery : ndarray, shape (6 n_nodes, count)
        ux, uy, uz, rx, ry, rz of the foot line at each node for unit reduced coordinates.
    frequency_kept, frequency_omitted : float
        Highest fixed-interface mode kept and first one left out [Hz].
    n_full, n_interface : int
        Degrees of freedom before the reduction, and at the interface.
    with_supports : bool
        The fastenings came with the rail's matrices, not from the panel.
    """

    name: str
    closes: float
    x: Floats
    first: int
    count: int
    recovery: Floats
    frequency_kept: float
    frequency_omitted: float
    n_full: int
    n_interface: int
    with_supports: bool = False


@dataclass(frozen=True, slots=True)
class Mechanism:
    """Linear bodies, the rows where laws act, and the laws.

    Attributes
    ----------
    stiffness, mass, damping : ndarray, shape (n, n)
        Of all bodies; linear supports are included.
    load : ndarray, shape (n,)
        Constant load (gravity) [N].
    rows : ndarray, shape (n_rows, n)
        Generalised displacement of each row.
    laws : LawTable
        All laws, addressing rows by index.
    law_names, friction_names : tuple of str
        For messages and look-up.
    law_index : dict
        Family -> (member names ..., law indices): see `turnout.mechanism.build`.
    rails : tuple of RailBody
        For the recovery of shapes.
    shapes : dict of str to RailShape
        How far each switch rail moves between closed and open.
    """

    stiffness: Floats
    mass: Floats
    damping: Floats
    load: Floats
    rows: Floats
    laws: LawTable
    law_names: tuple[str, ...] = ()
    friction_names: tuple[str, ...] = ()
    index: "LawIndex" = field(default_factory=lambda: LawIndex())
    rails: tuple[RailBody, ...] = ()
    shapes: "dict[str, RailShape]" = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class RailShape:
    """The way of a switch rail from closed to open, without friction and contact.

    Attributes
    ----------
    travel : Spline
        Distance between the two positions at contact height, over x [m].
    """

    travel: Spline

    def travel_at(self, x: Floats) -> Floats:
        """Return the way at places [m]; beyond the ends of the rail it is held."""
        knots = self.travel.knots
        return self.travel(np.clip(x, knots[0], knots[-1]))


@dataclass(frozen=True, slots=True)
class LawIndex:
    """Where the laws of each family stand: names to indices into the law table.

    Keys are (rail, name) where a family stands on several rails, else the name. A chair has one
    contact and one friction law for each foot point.
    """

    drive: dict[str, int] = field(default_factory=dict)
    back_drive: dict[tuple[str, str], int] = field(default_factory=dict)
    link: dict[str, int] = field(default_factory=dict)
    stop: dict[tuple[str, str], int] = field(default_factory=dict)
    chair: dict[tuple[str, str], tuple[int, ...]] = field(default_factory=dict)
    chair_friction: dict[tuple[str, str], tuple[int, ...]] = field(default_factory=dict)
    object: dict[str, int] = field(default_factory=dict)
