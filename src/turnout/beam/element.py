r"""Two-node, three-dimensional Timoshenko element with eccentric, unsymmetric cross-section.

Nodes lie on a straight reference line along x; z is up, y lateral, the frame right-handed. A node
has the DOFs ``ux, uy, uz, rx, ry, rz``. A section moves as a rigid body, so with centroid C and
shear centre S

.. math::

    u_C = u_x + r_y z_C - r_z y_C, \quad v_S = u_y - r_x z_S, \quad w_S = u_z + r_x y_S

and with the deflection :math:`d = (v_S, w_S)` and the slope :math:`\psi = (r_z, -r_y)` the strain
energy U is

.. math::

    2U = \int E A u_C'^2 + G J r_x'^2 + \psi'^T \mathbf{EI} \psi'
    + (d'-\psi)^T \mathbf{GA} (d'-\psi)\, dx, \quad
    \mathbf{EI} = E \begin{pmatrix} I_z & I_{yz} \\ I_{yz} & I_y \end{pmatrix}.

Axial force thus acts at the centroid, shear force at the shear centre. The shape functions solve
the homogeneous equations, so an element of constant section is exact for loads at its nodes. Shear
flexibility is diagonal in y and z (no cross term), torsion is Saint-Venant's (no warping). For a
doubly symmetric section the matrices are, in each plane, those of Friedman and Kosmatka, Computers
& Structures 47(3), 1993, doi:10.1016/0045-7949(93)90243-7; coupled planes follow here from the same
equations.

Arrays: one leading axis over elements; the 12 DOFs are those of the first, then the second node.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from turnout.beam.material import ElasticMaterial
from turnout.beam.section_record import SectionProperties

FloatArray = npt.NDArray[np.float64]

# Rows pick quantities out of the 12 section DOFs (u_C, v_S, w_S, rx, ry, rz) of both nodes.
_EYE = np.eye(12)
_AXIAL = _EYE[[0, 6]]
_TWIST = _EYE[[3, 9]]
_DEFLECTION = (_EYE[[1, 2]], _EYE[[7, 8]])
_SLOPE = (_EYE[[5, 4]] * [[1.0], [-1.0]], _EYE[[11, 10]] * [[1.0], [-1.0]])
_RELATIVE = (_SLOPE[1] - _SLOPE[0])[None]
_GAUSS_POINTS, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(4)  # exact to degree 7


def offset_transformation(sections: SectionProperties) -> FloatArray:
    """Form the matrices that take DOFs on the reference line to those of centroid and shear centre.

    Parameters
    ----------
    sections : SectionProperties, shape (n,)
        Positions of centroid and shear centre from the reference line [m].

    Returns
    -------
    ndarray, shape (n, 12, 12)
        Maps (ux, uy, uz, rx, ry, rz) to (u_C, v_S, w_S, rx, ry, rz), for both nodes.
    """
    node = np.tile(np.eye(6), (sections.area.size, 1, 1))
    node[:, 0, 4] = sections.centroid_z
    node[:, 0, 5] = -sections.centroid_y
    node[:, 1, 3] = -sections.shear_centre_z
    node[:, 2, 3] = sections.shear_centre_y
    transformation = np.zeros((sections.area.size, 12, 12))
    transformation[:, :6, :6] = node
    transformation[:, 6:, 6:] = node
    return transformation


def element_matrices(
    length: npt.ArrayLike,
    sections: SectionProperties,
    material: ElasticMaterial,
    *,
    gravity: float = 9.81,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Form stiffness, consistent mass and consistent load of elements on the reference line.

    Translational inertia acts at the centroid; rotary inertia (I_y, I_z, I_yz and the polar sum
    about x) is included. Mass and load have the displacements of the stiffness, shear included.

    Parameters
    ----------
    length : array_like, shape (n,)
        Element lengths [m].
    sections : SectionProperties, shape (n,)
        Constant over each element.
    material : Material
        Of all elements.
    gravity : float
        Acceleration of the elements' own weight [m/s2].

    Returns
    -------
    stiffness : ndarray, shape (n, 12, 12)
        Symmetric, with six rigid-body modes each [N/m, N, N m].
    mass : ndarray, shape (n, 12, 12)
        Symmetric, positive definite [kg, kg m, kg m^2].
    load : ndarray, shape (n, 12)
        Nodal forces and moments of the weight [N, N m].

    Examples
    --------
    >>> steel = ElasticMaterial(youngs_modulus=2e11, poisson_ratio=0.25, density=7850.0)
    >>> one, nil = np.ones(1), np.zeros(1)
    >>> section = SectionProperties(1e-2 * one, *[1e-5 * one] * 2, nil, *[one] * 3, *[nil] * 4)
    >>> float(element_matrices([2.0], section, steel)[0][0, 0, 0]) / 1e9  # E A / L
    1.0
    """
    span = np.asarray(length, dtype=float)[:, None, None]
    flexure = _flexure(span, sections, material)
    offsets = offset_transformation(sections)
    shapes = _shape_functions(span, sections, flexure)
    return (
        _symmetrise(_congruence(offsets, _stiffness(span, sections, material, flexure))),
        _symmetrise(_congruence(offsets, _mass(span, sections, material, shapes))),
        _gravity_load(span, sections, material.density * gravity, shapes, offsets),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Flexure:
    """Bending of elements: their shear force, constant along each, and the quantities from it.

    `bending` (n, 2, 2) is the rigidity, `bow` (n, 2, 12) the change of curvature; `sheared`
    (n, 2, 12) the slope due to shear; `force` (n, 2, 12) the shear force of the section DOFs and
    `shear` (n, 2, 12) its work-conjugate deformation, end deflection less mean slope times length.
    """

    bending: FloatArray
    bow: FloatArray
    sheared: FloatArray
    force: FloatArray
    shear: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class _Shape:
    """Shape functions at a point of integration, as rows over the section DOFs.

    axial : (1, 1, 12) u_C; deflection : (n, 2, 12) of the centroid; slope : (n, 2, 12) psi;
    twist : (1, 1, 12) rx.
    """

    axial: FloatArray
    deflection: FloatArray
    slope: FloatArray
    twist: FloatArray


def _stiffness(
    span: FloatArray, sections: SectionProperties, material: ElasticMaterial, flexure: _Flexure
) -> FloatArray:
    """Form stiffness matrices, (n, 12, 12), over the section DOFs."""
    axial = (_AXIAL[1] - _AXIAL[0])[None, None, :]
    twist = (_TWIST[1] - _TWIST[0])[None, None, :]
    axial_rigidity = material.youngs_modulus * sections.area[:, None, None]
    torsion_rigidity = material.shear_modulus * sections.torsion_constant[:, None, None]
    stiffness: FloatArray = (
        (axial_rigidity / span) * (_transpose(axial) @ axial)
        + (torsion_rigidity / span) * (_transpose(twist) @ twist)
        + _congruence(_RELATIVE, flexure.bending / span)
        + _transpose(flexure.shear) @ flexure.force
    )
    return stiffness


def _mass(
    span: FloatArray,
    sections: SectionProperties,
    material: ElasticMaterial,
    shapes: tuple[_Shape, ...],
) -> FloatArray:
    """Form mass matrices, (n, 12, 12), over the section DOFs: sums over points of integration."""
    count = span.size
    inertia = material.density * _second_moments(sections)
    line_mass = (material.density * sections.area)[:, None, None]
    polar = np.trace(inertia, axis1=1, axis2=2)[:, None, None]
    rows = np.empty((count, len(shapes), 6, 12))
    weighted = np.empty_like(rows)
    for number, (shape, weight) in enumerate(zip(shapes, _GAUSS_WEIGHTS, strict=True)):
        part, heavy = rows[:, number], weighted[:, number]
        part[:, :1], part[:, 1:3] = shape.axial, shape.deflection
        part[:, 3:5], part[:, 5:] = shape.slope, shape.twist
        share = 0.5 * weight * span
        heavy[:, :3] = (share * line_mass) * part[:, :3]
        heavy[:, 3:5] = share * (inertia @ part[:, 3:5])
        heavy[:, 5:] = (share * polar) * part[:, 5:]
    stacked = (count, 6 * len(shapes), 12)
    mass: FloatArray = _transpose(rows.reshape(stacked)) @ weighted.reshape(stacked)
    return mass


def _gravity_load(
    span: FloatArray,
    sections: SectionProperties,
    weight_density: float,
    shapes: tuple[_Shape, ...],
    offsets: FloatArray,
) -> FloatArray:
    """Form nodal loads, (n, 12), of a weight density [N/m^3] along -z."""
    down = np.zeros((span.size, 12))
    for shape, weight in zip(shapes, _GAUSS_WEIGHTS, strict=True):
        down -= 0.5 * weight * span[:, :, 0] * shape.deflection[:, 1, :]
    load = weight_density * sections.area[:, None] * down
    nodal: FloatArray = (load[:, None, :] @ offsets)[:, 0]
    return nodal


def _second_moments(sections: SectionProperties) -> FloatArray:
    """Stack the tensors of second moments, (n, 2, 2), that act on slopes psi = (rz, -ry)."""
    product = sections.product_moment
    rows = [[sections.second_moment_lateral, product], [product, sections.second_moment_vertical]]
    return np.moveaxis(np.array(rows), 2, 0)


def _shear_flexibility(sections: SectionProperties, material: ElasticMaterial) -> FloatArray:
    """Stack the shear flexibilities, (n, 2, 2), of forces along y and z."""
    flexibility = np.zeros((sections.area.size, 2, 2))
    rigidity = material.shear_modulus * sections.area
    flexibility[:, 0, 0] = 1.0 / (rigidity * sections.shear_factor_lateral)
    flexibility[:, 1, 1] = 1.0 / (rigidity * sections.shear_factor_vertical)
    return flexibility


def _flexure(span: FloatArray, sections: SectionProperties, material: ElasticMaterial) -> _Flexure:
    """Solve elements for their shear force."""
    bending = material.youngs_modulus * _second_moments(sections)
    shear_flexibility = _shear_flexibility(sections, material)
    yielding = np.linalg.inv(bending)
    shear = _DEFLECTION[1] - _DEFLECTION[0] - 0.5 * span * (_SLOPE[0] + _SLOPE[1])
    force = np.linalg.inv(span**3 / 12.0 * yielding + span * shear_flexibility) @ shear
    return _Flexure(bending, yielding @ force, shear_flexibility @ force, force, shear)


def _shape_functions(
    span: FloatArray, sections: SectionProperties, flexure: _Flexure
) -> tuple[_Shape, ...]:
    """Evaluate the shape functions at the points of integration along each element."""
    slope_middle = 0.5 * (_SLOPE[0] + _SLOPE[1]) + flexure.bow * (span**2 / 8.0)
    arm_y = sections.centroid_y - sections.shear_centre_y
    arm_z = sections.centroid_z - sections.shear_centre_z
    arm = np.stack([-arm_z, arm_y], axis=1)[:, :, None]
    found = []
    for point in _GAUSS_POINTS:
        s = 0.5 * point * span
        ends = np.array([0.5 * (1.0 - point), 0.5 * (1.0 + point)])
        twist = (ends @ _TWIST)[None, None, :]
        deflection = (
            0.5 * (_DEFLECTION[0] + _DEFLECTION[1])
            + (slope_middle + flexure.sheared) * s
            + _RELATIVE * ((s**2 / span - span / 4.0) / 2.0)
            - flexure.bow * (s**3 / 6.0)
            + arm * twist
        )
        slope = slope_middle + _RELATIVE * (s / span) - flexure.bow * (s**2 / 2.0)
        found.append(_Shape((ends @ _AXIAL)[None, None, :], deflection, slope, twist))
    return tuple(found)


def _transpose(stack: FloatArray) -> FloatArray:
    return np.swapaxes(stack, 1, 2)


def _congruence(rows: FloatArray, weight: FloatArray) -> FloatArray:
    """Form rows^T weight rows for every element."""
    return _transpose(rows) @ weight @ rows


def _symmetrise(stack: FloatArray) -> FloatArray:
    return 0.5 * (stack + _transpose(stack))
