"""A rail before its reduction: matrices, and the motion of its foot line at nodes.

However the matrices came about, from beams or from another program, a displacement of the foot line
is a row over the coordinates, and a point fixed to the section follows from rows of its node:
``u_px = u_x + r_y z - r_z y``, ``u_py = u_y - r_x z``, ``u_pz = u_z + r_x y``.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from turnout.beam.assembly import DOF, assemble_beam
from turnout.beam.mesh import MERGE_DISTANCE
from turnout.core.errors import MechanicsError
from turnout.mechanism.mechanism import Point, RailData, Support
from turnout.panel.records import RailMatrices

Floats = NDArray[np.float64]
ARMS: dict[str, tuple[tuple[str, str, float], ...]] = {
    "ux": (("ry", "z", 1.0), ("rz", "y", -1.0)),
    "uy": (("rx", "z", -1.0),),
    "uz": (("rx", "y", 1.0),),
}


@dataclass(frozen=True, slots=True, eq=False)
class Structure:
    """A rail with its fastenings, in its free coordinates.

    Attributes
    ----------
    stiffness, mass : csr_array, shape (n, n)
        Of the rail and its fastenings.
    load : ndarray, shape (n,)
        Own weight [N].
    x : ndarray, shape (n_nodes,)
        Nodes [m].
    motion : csr_array, shape (6 n_nodes, n)
        ux ... rz of the foot line at each node for unit coordinates.
    known : ndarray of bool, shape (6 n_nodes,)
        Whether the coordinates say what that displacement is; if not, its row is zero.
    names : tuple of str
        Of the coordinates.
    beyond_rayleigh : csr_array, shape (n, n)
        The rest of the damping; chair dashpots are left out: they act at points.
    reduced : bool
        The matrices are a superelement already, not to be reduced again.
    mirror : ndarray, shape (n,), optional
        Signs that turn the coordinates into those of the rail's image in the plane of x and z.
    rayleigh : tuple of float
        Factors of mass [1/s] and stiffness [s] in the damping.
    """

    stiffness: sp.csr_array
    mass: sp.csr_array
    load: Floats
    x: Floats
    motion: sp.csr_array
    known: NDArray[np.bool_]
    names: tuple[str, ...]
    beyond_rayleigh: sp.csr_array
    reduced: bool = False
    mirror: Floats | None = None
    rayleigh: tuple[float, float] = (0.0, 0.0)

    @property
    def damping(self) -> sp.csr_array:
        """The whole damping, as a csr_array of shape (n, n)."""
        of_mass, of_stiffness = self.rayleigh
        return sp.csr_array(
            of_mass * self.mass + of_stiffness * self.stiffness + self.beyond_rayleigh
        )


def rail_structure(data: RailData) -> Structure:
    """Assemble a rail from beams, or take its matrices, and add its fastenings.

    Parameters
    ----------
    data : RailData
        The rail.

    Raises
    ------
    MechanicsError
        When there is no node, or no coordinate, where something acts.
    """
    bare = bare_structure(data)
    whole = data.matrices is None or not data.matrices.with_supports
    springs, dashpots = _supports(bare, data.name, data.supports if whole else ())
    free = _free_coordinates(data, bare)
    beyond = bare.beyond_rayleigh + dashpots - bare.rayleigh[1] * springs
    return replace(
        bare,
        stiffness=_square(bare.stiffness + springs, free),
        mass=_square(bare.mass, free),
        load=bare.load[free],
        motion=sp.csr_array(bare.motion[:, free]),
        names=tuple(bare.names[i] for i in free),
        mirror=None if bare.mirror is None else bare.mirror[free],
        beyond_rayleigh=_square(beyond, free),
    )


def _free_coordinates(data: RailData, bare: Structure) -> NDArray[np.intp]:
    """Return the coordinates of a rail that are not clamped."""
    ends = {"first": 0, "last": bare.x.size - 1}
    clamped = np.zeros(bare.load.size, dtype=bool)
    whole = data.matrices is None or not data.matrices.with_supports
    for end in data.clamped if whole and not bare.reduced else ():
        at = bare.motion[6 * ends[end] : 6 * ends[end] + 6]
        clamped[np.unique(at.nonzero()[1])] = True
    return np.flatnonzero(~clamped)


def _bare_beams(data: RailData) -> Structure:
    """Return the coordinates of a rail of beams, whose matrices are still zero."""
    size = 6 * data.x.size
    nothing = sp.csr_array((size, size))
    return Structure(
        stiffness=nothing,
        mass=nothing,
        beyond_rayleigh=nothing,
        rayleigh=data.damping,
        load=np.zeros(size),
        x=data.x,
        motion=_lowered(sp.eye_array(size, format="csr"), data.axis_height),
        known=np.ones(size, dtype=bool),
        names=tuple(f"{d} at x = {x:g} m" for x in data.x for d in DOF),
        mirror=np.tile([1.0, -1.0, 1.0, -1.0, 1.0, -1.0], data.x.size),
    )


def unsupported_beams(data: RailData) -> tuple[sp.csr_array, sp.csr_array, Floats]:
    """Return stiffness, mass and weight of the beams of a rail alone, in its free coordinates."""
    bare = beam_structure(data)
    free = _free_coordinates(data, bare)
    return _square(bare.stiffness, free), _square(bare.mass, free), bare.load[free]


def bare_structure(data: RailData) -> Structure:
    """Assemble the beams of a rail, or take its matrices, neither supported nor clamped."""
    return beam_structure(data) if data.matrices is None else given_structure(data, data.matrices)


def beam_structure(data: RailData) -> Structure:
    """Assemble the beams of a rail, neither supported nor clamped."""
    beam = assemble_beam(
        data.x,
        data.sections,
        data.material,
        y=data.plan,
        gravity=data.gravity,
        name=f"rail {data.name}",
    )
    return replace(
        _bare_beams(data),
        stiffness=beam.stiffness,
        mass=beam.mass,
        load=beam.gravity_load,
    )


def given_structure(data: RailData, given: RailMatrices) -> Structure:
    """Take the matrices of another program as they are."""
    size = given.stiffness.shape[0]
    x = np.unique(np.round(given.x, 9))
    rows = sp.csr_array(sp.eye_array(size)) if given.rows is None else given.rows
    node = np.searchsorted(x, np.round(given.x, 9))
    at = 6 * node + np.array([DOF.index(d) for d in given.direction])
    place = sp.csr_array((np.ones(at.size), (at, np.arange(at.size))), shape=(6 * x.size, at.size))
    known = np.zeros(6 * x.size, dtype=bool)
    known[at] = True
    height = np.zeros(x.size)
    height[node] = given.z
    motion = _lowered(sp.csr_array(place @ rows), height)
    weight = given.unit_weight
    if weight is None:
        weight = -(given.mass @ _lifted(motion))
    return Structure(
        stiffness=given.stiffness,
        mass=given.mass,
        beyond_rayleigh=sp.csr_array((size, size)) if given.damping is None else given.damping,
        rayleigh=data.damping if given.damping is None else (0.0, 0.0),
        load=data.gravity * weight,
        x=x,
        motion=motion,
        known=known,
        names=tuple(f"{d} at x = {at:g} m" for at, d in zip(given.x, given.direction, strict=True))
        if given.rows is None
        else tuple(f"coordinate {i + 1}" for i in range(size)),
        reduced=given.rows is not None,
    )


def form_rows(structure: Structure, points: tuple[Point, ...], *, name: str) -> sp.csr_array:
    """Form the rows that take coordinates to displacements of points fixed to the sections.

    Raises
    ------
    MechanicsError
        Naming every point whose node or coordinate is missing.
    """
    problems: list[str] = []
    entries: list[list[tuple[int, float]]] = []
    for point in points:
        try:
            entries.append(_entries(structure, point))
        except MechanicsError as error:
            problems.append(str(error))
            entries.append([])
    if problems:
        text = "; ".join(dict.fromkeys(problems))
        msg = f"rail {name}: {text}"
        raise MechanicsError(msg)
    number = [i for i, parts in enumerate(entries) for _ in parts]
    column = [at for parts in entries for at, _ in parts]
    value = [weight for parts in entries for _, weight in parts]
    picked = sp.csr_array((value, (number, column)), shape=(len(points), structure.known.size))
    return sp.csr_array(picked @ structure.motion)


def _entries(structure: Structure, point: Point) -> list[tuple[int, float]]:
    """Return the displacements of the foot line that a point follows, with their weights."""
    nearest = int(np.argmin(np.abs(structure.x - point.x)))
    if not abs(structure.x[nearest] - point.x) <= MERGE_DISTANCE:
        msg = (
            f"there is no node at x = {point.x:g} m, the nearest is at "
            f"{structure.x[nearest]:.6g} m; put a node there"
        )
        raise MechanicsError(msg)
    offsets = {"y": point.y, "z": point.z}
    parts = [(point.direction, 1.0)] + [
        (rotation, sign * offsets[arm])
        for rotation, arm, sign in ARMS.get(point.direction, ())
        if offsets[arm] != 0.0
    ]
    lacking = [d for d, _ in parts if not structure.known[6 * nearest + DOF.index(d)]]
    if lacking:
        msg = f"the node at x = {point.x:g} m has no {' and no '.join(lacking)}, which is needed"
        raise MechanicsError(msg)
    return [(6 * nearest + DOF.index(d), point.sign * weight) for d, weight in parts]


def _supports(
    bare: Structure, name: str, supports: tuple[Support, ...]
) -> tuple[sp.csr_array, sp.csr_array]:
    """Return the matrices of springs and dashpots of fastenings."""
    rows = form_rows(bare, tuple(s.point for s in supports), name=name)
    springs = sp.diags_array(np.array([s.stiffness for s in supports]))
    dashpots = sp.diags_array(np.array([s.damping for s in supports]))
    return sp.csr_array(rows.T @ springs @ rows), sp.csr_array(rows.T @ dashpots @ rows)


def _lowered(motion: sp.csr_array, height: Floats) -> sp.csr_array:
    """Take displacements at heights above the foot down to the foot line, node by node."""
    nodes = np.arange(height.size)
    at = np.concatenate((6 * nodes, 6 * nodes + 1))
    turned = np.concatenate((6 * nodes + 4, 6 * nodes + 3))
    shift = sp.csr_array(
        (np.concatenate((-height, height)), (at, turned)), shape=(6 * height.size,) * 2
    )
    shift.eliminate_zeros()
    return sp.csr_array(motion + shift @ motion)


def _lifted(motion: sp.csr_array) -> Floats:
    """Return the coordinates in which every node rises by one [m], as nearly as they can."""
    rises = np.zeros(motion.shape[0])
    rises[2::6] = 1.0
    used = np.unique(motion.nonzero()[0])
    found: Floats = np.linalg.lstsq(motion[used].toarray(), rises[used], rcond=None)[0]
    return found


def _square(matrix: sp.csr_array, free: NDArray[np.intp]) -> sp.csr_array:
    if free.size == matrix.shape[0]:
        return sp.csr_array(matrix)
    return sp.csr_array(matrix.tocsr()[free][:, free])
