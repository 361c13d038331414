"""Sparse matrices of a whole beam, with its DOFs addressed by position and name."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from turnout.beam.element import element_matrices
from turnout.beam.material import ElasticMaterial
from turnout.beam.mesh import MERGE_DISTANCE
from turnout.beam.section_record import SectionProperties
from turnout.core.errors import MechanicsError

FloatArray = npt.NDArray[np.float64]

DOF = ("ux", "uy", "uz", "rx", "ry", "rz")
"""Names of a node's degrees of freedom, in their order."""


@dataclass(frozen=True, slots=True, eq=False)
class BeamModel:
    """Matrices of an unsupported beam; DOF ``6 i + k`` is ``DOF[k]`` of node i.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Increasing node positions on the reference line [m].
    stiffness : csr_array, shape (6 n, 6 n)
        Singular: six rigid-body modes [N/m, N, N m].
    mass : csr_array, shape (6 n, 6 n)
        Consistent mass [kg, kg m, kg m^2].
    gravity_load : ndarray, shape (6 n,)
        Nodal loads of the own weight [N, N m].
    name : str
        Name for messages.
    """

    x: FloatArray
    stiffness: sp.csr_array
    mass: sp.csr_array
    gravity_load: FloatArray
    name: str = "beam"


def assemble_beam(
    x: npt.ArrayLike,
    sections: SectionProperties,
    material: ElasticMaterial,
    *,
    y: npt.ArrayLike | None = None,
    gravity: float = 9.81,
    name: str = "beam",
) -> BeamModel:
    r"""Assemble a beam, straight or curved in plan.

    A curved beam is a polygon of straight elements in its stress-free state. An element's axes are
    rotated by the heading :math:`\varphi` of its chord,

    .. math:: K = T^T K_e T, \quad T = \mathrm{diag}(R, R, R, R), \quad
              R = \begin{pmatrix} \cos\varphi & \sin\varphi & 0 \\
              -\sin\varphi & \cos\varphi & 0 \\ 0 & 0 & 1 \end{pmatrix},

    so bending in one element is in part torsion in the next. That is the coupling of a bar curved
    in plan with radius :math:`\rho` and arc length s: under the shear force V its bending moment
    about the horizontal normal and its torque follow :math:`M' = V + T / \rho`,
    :math:`T' = -M / \rho` (A. E. H. Love, The Mathematical Theory of Elasticity, 4th edition 1927,
    chapter XXI). The polygon approaches the arc with the square of the element length. All DOFs
    stay along the fixed axes.

    Parameters
    ----------
    x : array_like, shape (n,)
        Increasing node positions [m].
    sections : SectionProperties, shape (n - 1,)
        Properties at the middle of each element; the error of a smooth taper is of second order.
    material : Material
        Of all elements.
    y : array_like, shape (n,), optional
        Lateral node positions [m]; by default all zero.
    gravity : float
        Acceleration [m/s^2]; a positive value pulls along -z.
    name : str
        Name for messages.

    Returns
    -------
    BeamModel
        Unsupported, n nodes.

    Examples
    --------
    >>> steel = ElasticMaterial(youngs_modulus=2e11, poisson_ratio=0.25, density=8000.0)
    >>> two, nil = np.ones(2), np.zeros(2)
    >>> section = SectionProperties(1e-2 * two, *[1e-5 * two] * 2, nil, *[two] * 3, *[nil] * 4)
    >>> beam = assemble_beam([0.0, 1.0, 2.0], section, steel, gravity=10.0)
    >>> round(float(beam.gravity_load[2::6].sum()), 6)  # 2 m of 80 kg/m
    -1600.0
    """
    nodes = np.asarray(x, dtype=float)
    advance = np.diff(nodes)
    if nodes.ndim != 1 or nodes.size < 2 or not np.all(advance > 0.0):
        msg = f"{name}: node positions must be two or more and increase"
        raise MechanicsError(msg)
    if sections.area.size != advance.size:
        msg = f"{name}: {advance.size} elements need as many sections, not {sections.area.size}"
        raise MechanicsError(msg)
    sideways = np.zeros(advance.size) if y is None else np.diff(np.asarray(y, dtype=float))
    stiffness, mass, load = element_matrices(
        np.hypot(advance, sideways), sections, material, gravity=gravity
    )
    if np.any(sideways):
        rotation = _rotation_matrices(np.arctan2(sideways, advance))
        stiffness, mass = _rotate(stiffness, rotation), _rotate(mass, rotation)
        load = (load[:, None, :] @ rotation)[:, 0]
    pattern = _pattern(nodes.size)
    return BeamModel(
        x=nodes,
        stiffness=pattern.assemble(stiffness),
        mass=pattern.assemble(mass),
        gravity_load=pattern.add_loads(load),
        name=name,
    )


def node_index(model: BeamModel, x: float) -> int:
    """Find the node at position x [m].

    Raises
    ------
    MechanicsError
        If no node lies within `turnout.beam.mesh.MERGE_DISTANCE`; the text names the nearest.
    """
    nearest = int(np.argmin(np.abs(model.x - x)))
    if not abs(model.x[nearest] - x) <= MERGE_DISTANCE:
        msg = (
            f"{model.name}: there is no node at x = {x} m; the nearest is at "
            f"{model.x[nearest]:.6g} m; force the position when meshing"
        )
        raise MechanicsError(msg)
    return nearest


def dof_index(model: BeamModel, x: float, direction: str) -> int:
    """Find the index of a node's DOF by position and name.

    Parameters
    ----------
    model : BeamModel
        With a node at `x`.
    x : float
        Position of the node [m].
    direction : str
        One of `DOF`.

    Raises
    ------
    MechanicsError
        If there is no node at x or no such DOF.

    Examples
    --------
    >>> steel = ElasticMaterial(youngs_modulus=2e11, poisson_ratio=0.25, density=8000.0)
    >>> one, nil = np.ones(1), np.zeros(1)
    >>> section = SectionProperties(*[one] * 3, nil, *[one] * 3, *[nil] * 4)
    >>> dof_index(assemble_beam([0.0, 1.0], section, steel), 1.0, "uy")
    7
    """
    return 6 * node_index(model, x) + _component(direction)


def point_row(
    model: BeamModel, x: float, direction: str, *, y: float = 0.0, z: float = 0.0
) -> FloatArray:
    r"""Form the row that takes nodal displacements to those of a point fixed to the section.

    Transposed, it takes a force at that point to nodal forces and moments. With the offset
    r = (0, y, z) and the rotation theta the point moves by u + theta x r:

    .. math::

        u_{px} = u_x + r_y z - r_z y, \quad u_{py} = u_y - r_x z, \quad u_{pz} = u_z + r_x y.

    Parameters
    ----------
    model : BeamModel
        With a node at `x`.
    x : float
        Position of the node [m].
    direction : str
        One of `DOF`. A rotation is that of the section, whatever the offset.
    y, z : float
        Offset of the point from the reference line [m].

    Returns
    -------
    ndarray, shape (6 n,)
        Displacement [m] or rotation [rad] of the point per nodal one.

    Examples
    --------
    >>> steel = ElasticMaterial(youngs_modulus=2e11, poisson_ratio=0.25, density=8000.0)
    >>> one, nil = np.ones(1), np.zeros(1)
    >>> section = SectionProperties(*[one] * 3, nil, *[one] * 3, *[nil] * 4)
    >>> beam = assemble_beam([0.0, 1.0], section, steel)
    >>> point_row(beam, 0.0, "uy", z=0.3)[:6].tolist()
    [0.0, 1.0, 0.0, -0.3, 0.0, 0.0]
    """
    first = 6 * node_index(model, x)
    component = _component(direction)
    arms = {0: {4: z, 5: -y}, 1: {3: -z}, 2: {3: y}}.get(component, {})
    row = np.zeros(model.gravity_load.size)
    row[first + component] = 1.0
    for rotation, arm in arms.items():
        row[first + rotation] = arm
    return row


def _component(direction: str) -> int:
    if direction not in DOF:
        msg = f"there is no degree of freedom {direction!r}; allowed are {', '.join(DOF)}"
        raise MechanicsError(msg)
    return DOF.index(direction)


def _rotation_matrices(heading: FloatArray) -> FloatArray:
    """Stack the rotations, (n, 12, 12), from fixed axes to those of elements of a heading [rad]."""
    plane = np.tile(np.eye(3), (heading.size, 1, 1))
    plane[:, 0, 0] = plane[:, 1, 1] = np.cos(heading)
    plane[:, 0, 1] = np.sin(heading)
    plane[:, 1, 0] = -np.sin(heading)
    rotation = np.zeros((heading.size, 12, 12))
    for first in range(0, 12, 3):
        rotation[:, first : first + 3, first : first + 3] = plane
    return rotation


def _rotate(blocks: FloatArray, rotation: FloatArray) -> FloatArray:
    """Rotate element matrices, shape (n, 12, 12), to the fixed axes."""
    rotated: FloatArray = np.swapaxes(rotation, 1, 2) @ blocks @ rotation
    return rotated


@dataclass(frozen=True, slots=True, eq=False)
class _Pattern:
    """Places of the entries of elements in a row in the assembled matrix.

    Attributes
    ----------
    dofs : ndarray of int, shape (12 n_elements,)
        DOF of each entry of the elements' loads.
    place : ndarray of int, shape (144 n_elements,)
        Number of the stored entry that each entry of the elements' matrices is added to.
    indices, indptr : ndarray of int
        Of the assembled matrix, rows compressed.
    """

    dofs: npt.NDArray[np.intp]
    place: npt.NDArray[np.intp]
    indices: npt.NDArray[np.int32]
    indptr: npt.NDArray[np.int32]

    def add_loads(self, loads: FloatArray) -> FloatArray:
        """Add up the nodal loads of elements, shape (n, 12)."""
        found: FloatArray = np.bincount(self.dofs, loads.ravel(), self.indptr.size - 1).astype(
            np.float64, copy=False
        )
        return found

    def assemble(self, blocks: FloatArray) -> sp.csr_array:
        """Add up element matrices, shape (n, 12, 12); entries that are zero are left out."""
        size = self.indptr.size - 1
        data = np.bincount(self.place, blocks.ravel(), self.indices.size)
        matrix = sp.csr_array((data, self.indices.copy(), self.indptr.copy()), shape=(size, size))
        matrix.eliminate_zeros()
        return matrix


@lru_cache(maxsize=16)
def _pattern(n_nodes: int) -> _Pattern:
    """Return the pattern of a beam of so many nodes."""
    size = 6 * n_nodes
    dofs = 6 * np.arange(n_nodes - 1)[:, None] + np.arange(12)
    number = (dofs[:, :, None] * size + dofs[:, None, :]).ravel()
    stored, place = np.unique(number, return_inverse=True)
    starts = np.searchsorted(stored, size * np.arange(size + 1))
    return _Pattern(
        dofs=dofs.ravel(),
        place=place,
        indices=(stored % size).astype(np.int32),
        indptr=starts.astype(np.int32),
    )
