"""The records of mechanics: one rail as data, and the mechanism of all of them.

One rail as data: beams or matrices, linear supports, the points where laws act. The record that
mechanics hands to integration and response.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from turnout.beam.material import ElasticMaterial
from turnout.beam.section_record import SectionProperties
from turnout.law.friction import FrictionCourses, no_courses
from turnout.law.obstruction import Obstructions, no_obstructions
from turnout.law.table import LawTable
from turnout.machine.components import Machine
from turnout.panel.profile import Spline
from turnout.panel.records import RailMatrices

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
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
    at_interface : ndarray of bool, shape (6 n_nodes,)
        Which of these follow from interface coordinates alone, exactly.
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
    at_interface: NDArray[np.bool_]
    frequency_kept: float
    frequency_omitted: float
    n_full: int
    n_interface: int
    with_supports: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Matrices:
    """Linear system of a mechanism.

    Attributes
    ----------
    stiffness, mass, damping : ndarray, shape (n, n)
        Of all bodies; linear supports are included.
    load : ndarray, shape (n,)
        Constant load (gravity) [N].
    """

    stiffness: Floats
    mass: Floats
    damping: Floats
    load: Floats


class JoinedRails:
    """The same of rails that only laws join; each matrix is put together when it is asked for.

    Parameters
    ----------
    rails : sequence of ReducedRail
        In the order of their coordinates.
    """

    def __init__(self, rails: "Sequence[ReducedRail]") -> None:
        self.rails = tuple(rails)

    @cached_property
    def stiffness(self) -> Floats:
        """Stiffness of all rails."""
        return _block_diagonal([rail.stiffness for rail in self.rails])

    @cached_property
    def mass(self) -> Floats:
        """Mass of all rails."""
        return _block_diagonal([rail.mass for rail in self.rails])

    @cached_property
    def damping(self) -> Floats:
        """Damping of all rails."""
        return _block_diagonal([rail.damping for rail in self.rails])

    @cached_property
    def load(self) -> Floats:
        """Weight of all rails [N]."""
        found = np.concatenate([rail.load for rail in self.rails])
        found.flags.writeable = False
        return found


def _block_diagonal(blocks: list[Floats]) -> Floats:
    """Return square matrices along the diagonal of one, which is read-only."""
    ends = np.cumsum([0, *(block.shape[0] for block in blocks)])
    found = np.zeros((ends[-1], ends[-1]))
    for block, first, last in zip(blocks, ends[:-1], ends[1:], strict=True):
        found[first:last, first:last] = block
    found.flags.writeable = False
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Mechanism:
    """Linear bodies, the rows that laws act on, and the laws.

    Attributes
    ----------
    matrices : Matrices or JoinedRails
        Of the bodies; `stiffness`, `mass`, `damping` and `load` are its.
    core : ndarray, shape (n, n_coordinates)
        Generalised displacement of each row but those of foreign objects, shared by mechanisms
        whose objects stand elsewhere.
    laws : LawTable
        All laws, addressing rows by index.
    law_names, friction_names : tuple of str
        For messages and look-up.
    index : LawIndex
        Indices of the laws of each family, by name.
    rails : tuple of RailBody
        For the recovery of shapes.
    shapes : dict of str to RailShape
        How far each switch rail moves between closed and open.
    machines : DriveMachines, optional
        Machines that move the inputs of drives without markers.
    object_rows : ndarray, optional
        Rows of foreign objects, which come last, as their laws do.
    obstructions : Obstructions
        Laws that remember what was done to them.
    courses : FrictionCourses
        Friction that differs along the stroke.
    nominal : Mechanism, optional
        The same of the nominal panel, of one whose rails were reduced to its shapes.
    """

    matrices: Matrices | JoinedRails
    core: Floats
    laws: LawTable
    law_names: tuple[str, ...] = ()
    friction_names: tuple[str, ...] = ()
    index: "LawIndex" = field(default_factory=lambda: LawIndex())
    rails: tuple[RailBody, ...] = ()
    shapes: "dict[str, RailShape]" = field(default_factory=dict)
    machines: "DriveMachines | None" = None
    obstructions: Obstructions = field(default_factory=no_obstructions)
    courses: FrictionCourses = field(default_factory=no_courses)
    object_rows: Floats | None = None
    nominal: "Mechanism | None" = None

    @property
    def rows(self) -> Floats:
        """All rows, put together when they are asked for."""
        return self.core if self.object_rows is None else np.vstack((self.core, self.object_rows))

    @property
    def n_rows(self) -> int:
        """Number of all rows."""
        return len(self.core) + (0 if self.object_rows is None else len(self.object_rows))

    @property
    def stiffness(self) -> Floats:
        """Stiffness of all bodies, shape (n, n)."""
        return self.matrices.stiffness

    @property
    def mass(self) -> Floats:
        """Mass of all bodies, shape (n, n)."""
        return self.matrices.mass

    @property
    def damping(self) -> Floats:
        """Damping of all bodies, shape (n, n)."""
        return self.matrices.damping

    @property
    def load(self) -> Floats:
        """Constant load, shape (n,) [N]."""
        return self.matrices.load

    @property
    def reduced(self) -> "tuple[ReducedRail, ...]":
        """The reduced rails that the matrices are of; none of a mechanism made by hand."""
        return self.matrices.rails if isinstance(self.matrices, JoinedRails) else ()


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


@dataclass(frozen=True, slots=True, eq=False)
class DriveMachines:
    """The machines of drives as the kernels take them, one row each; see `drive_machines`.

    Attributes
    ----------
    names : tuple of str
        Of the drives.
    records : tuple of Machine
        As fitted to their drives: rod, limits, stroke.
    inputs, laws : ndarray of int, shape (n,)
        The input that each moves, and the law of its rod.
    constants, tables, commands, shared_resistance
        See `turnout.machine.compute.couple.Machines`.
    start : ndarray, shape (n, STATES)
        At rest where the schedule starts.
    shift : ndarray, shape (n,)
        Input less the rod position of the machine, which is 0 at home [m].
    lock_gap : ndarray, shape (n,)
        The limit contact acts in closing only with the rail so near to home, else inf [m].
    """

    names: tuple[str, ...]
    records: tuple[Machine, ...]
    inputs: Ints
    laws: Ints
    constants: Floats
    tables: Floats
    commands: Floats
    shared_resistance: float
    start: Floats
    shift: Floats
    lock_gap: Floats


@dataclass(frozen=True, slots=True)
class Wait:
    """Wait of a schedule for machines that still move: before a movement, or at its end.

    Attributes
    ----------
    time : float
        Onset of the next movement, or the end, by the schedule [s].
    rest : float
        How long the schedule rests before that once its markers have arrived [s].
    longest : float
        How long it waits at most [s].
    """

    time: float
    rest: float
    longest: float


@dataclass(frozen=True, slots=True)
class LawIndex:
    """Indices of the laws of each family in the law table, by name.

    Keys are (rail, name) where a family stands on several rails, else the name. A chair has one
    contact and one friction law for each foot point, and so has a roller on it; long objects have
    several parts, each with a law in `object` by its own name.
    """

    drive: dict[str, int] = field(default_factory=dict)
    back_drive: dict[tuple[str, str], int] = field(default_factory=dict)
    link: dict[str, int] = field(default_factory=dict)
    stop: dict[tuple[str, str], int] = field(default_factory=dict)
    chair: dict[tuple[str, str], tuple[int, ...]] = field(default_factory=dict)
    chair_friction: dict[tuple[str, str], tuple[int, ...]] = field(default_factory=dict)
    roller: dict[tuple[str, str], tuple[int, ...]] = field(default_factory=dict)
    roller_friction: dict[tuple[str, str], tuple[int, ...]] = field(default_factory=dict)
    bond: dict[tuple[str, str], int] = field(default_factory=dict)
    object: dict[str, int] = field(default_factory=dict)
    object_parts: dict[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def object_laws(self) -> dict[str, list[int]]:
        """Laws of every whole object by its name."""
        return {
            name: [self.object[part] for part in parts] for name, parts in self.object_parts.items()
        }


@dataclass(frozen=True, slots=True)
class Point:
    """A displacement of a point fixed to a rail's section; `sign` turns it around."""

    x: float
    direction: str
    y: float = 0.0
    z: float = 0.0
    sign: float = 1.0


@dataclass(frozen=True, slots=True)
class Support:
    """A linear spring and dashpot from a point of the rail to the ground."""

    point: Point
    stiffness: float
    damping: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class RailData:
    """Geometry, sections, supports and points of a rail, free of any file format.

    `axis_height`, one entry a node, is the height of the beams' reference line above the foot; the
    sections' heights are measured from it, those of points and supports from the foot. `damping`
    holds the factors of mass and beam stiffness; `dashpots` act in addition at points. `clamped`
    names the clamped ends, "first" and "last". `matrices` take the place of beams: `x`,
    `axis_height`, `sections` and `plan` mean nothing then. `plan`, one entry a node, is the lateral
    position of a reference line that is curved in plan; points stay offset along y there.
    """

    name: str
    closes: float
    x: Floats
    axis_height: Floats
    sections: SectionProperties
    material: ElasticMaterial
    gravity: float
    clamped: tuple[str, ...]
    damping: tuple[float, float]
    supports: tuple[Support, ...]
    dashpots: tuple[Support, ...]
    points: tuple[Point, ...]
    cutoff_frequency: float
    matrices: RailMatrices | None = None
    plan: Floats | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ReducedRail:
    """Matrices of one rail in reduced coordinates, and its points as rows."""

    body: RailBody
    stiffness: Floats
    mass: Floats
    damping: Floats
    load: Floats
    rows: Floats


def rayleigh_factors(ratio: float, frequencies: list[float]) -> tuple[float, float]:
    """Return the factors of mass [1/s] and stiffness [s] for a damping ratio at frequencies.

    Two frequencies [Hz] fix both factors; one gives stiffness-proportional damping.

    Examples
    --------
    >>> mass, stiffness = rayleigh_factors(0.02, [2.0, 12.0])
    >>> omega = 2 * np.pi * 12.0
    >>> round(mass / (2 * omega) + stiffness * omega / 2, 12)
    0.02
    """
    omega = 2.0 * np.pi * np.asarray(frequencies, dtype=float)
    if omega.size == 1:
        return 0.0, float(2.0 * ratio / omega[0])
    factor = float(2.0 * ratio / (omega[0] + omega[1]))
    return factor * float(omega[0] * omega[1]), factor
