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

import numpy as np
import numpy.typing as npt

from turnout.beam.material import Material
from turnout.section.properties import SectionProperties

FloatArray = npt.NDArray[np.float64]

# Rows pick quantities out of the 12 section DOFs (u_C, v_S, w_S, rx, ry, rz) of both nodes.
_EYE = np.eye(12)
_AXIAL = _EYE[[0, 6]]
_TWIST = _EYE[[3, 9]]
_DEFLECTION = (_EYE[[1, 2]], _EYE[[7, 8]])
_SLOPE = (_EYE[[5, 4]] * [[1.0], [-1.0]], _EYE[[11, 10]] * [[1.0], [-1.0]])
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


def element_stiffness(
    length: npt.ArrayLike, sections: SectionProperties, material: Material
) -> FloatArray:
    """Form element stiffness matrices on the reference line.

    Parameters
    ----------
    length : array_like, shape (n,)
        Element lengths [m].
    sections : SectionProperties, shape (n,)
        Constant over each element.
    material : Material
        Of all elements.

    Returns
    -------
    ndarray, shape (n, 12, 12)
        Symmetric, with six rigid-body modes each [N/m, N, N m].

    Examples
    --------
    >>> steel = Material(youngs_modulus=2e11, poisson_ratio=0.25, density=7850.0)
    >>> one, nil = np.ones(1), np.zeros(1)
    >>> section = SectionProperties(1e-2 * one, *[1e-5 * one] * 2, nil, *[one] * 3, *[nil] * 4)
    >>> float(element_stiffness([2.0], section, steel)[0, 0, 0]) / 1e9  # E A / L
    1.0
    """
    span = np.asarray(length, dtype=float)[:, None, None]
    bending, _, force, shear, relative = _flexure(span, sections, material)
    axial = (_AXIAL[1] - _AXIAL[0])[None, None, :]
    twist = (_TWIST[1] - _TWIST[0])[None, None, :]
    axial_rigidity = material.youngs_modulus * sections.area[:, None, None]
    torsion_rigidity = material.shear_modulus * sections.torsion_constant[:, None, None]
    stiffness = (
        _congruence(axial, axial_rigidity / span)
        + _congruence(twist, torsion_rigidity / span)
        + _congruence(relative, bending / span)
        + _transpose(shear) @ force
    )
    return _symmetrise(_congruence(offset_transformation(sections), stiffness))


def element_mass(
    length: npt.ArrayLike, sections: SectionProperties, material: Material
) -> FloatArray:
    """Form consistent element mass matrices on the reference line.

    Translational inertia acts at the centroid; rotary inertia (I_y, I_z, I_yz and the polar sum
    about x) is included. The displacements are those of `element_stiffness`, shear included.

    Parameters
    ----------
    length : array_like, shape (n,)
        Element lengths [m].
    sections : SectionProperties, shape (n,)
        Constant over each element.
    material : Material
        Of all elements.

    Returns
    -------
    ndarray, shape (n, 12, 12)
        Symmetric, positive definite [kg, kg m, kg m^2].
    """
    span = np.asarray(length, dtype=float)[:, None, None]
    inertia = material.density * _second_moments(sections)
    line_mass = material.density * sections.area[:, None, None]
    polar = np.trace(inertia, axis1=1, axis2=2)[:, None, None]
    mass = np.zeros((span.size, 12, 12))
    for point, weight in zip(_GAUSS_POINTS, _GAUSS_WEIGHTS, strict=True):
        axial, deflection, slope, twist = _displacements(point, span, sections, material)
        density = (
            _congruence(axial, line_mass)
            + _congruence(deflection, line_mass * np.eye(2))
            + _congruence(slope, inertia)
            + _congruence(twist, polar)
        )
        mass += 0.5 * weight * span * density
    return _symmetrise(_congruence(offset_transformation(sections), mass))


def element_gravity_load(
    length: npt.ArrayLike,
    sections: SectionProperties,
    material: Material,
    *,
    gravity: float = 9.81,
) -> FloatArray:
    """Form consistent nodal loads of the elements' own weight.

    Parameters
    ----------
    length : array_like, shape (n,)
        Element lengths [m].
    sections : SectionProperties, shape (n,)
        Constant over each element.
    material : Material
        Of all elements.
    gravity : float
        Acceleration [m/s^2]; a positive value pulls along -z. The weight acts at the centroid, so a
        lateral offset of it gives a torque.

    Returns
    -------
    ndarray, shape (n, 12)
        Forces [N] and moments [N m] on the nodes.
    """
    span = np.asarray(length, dtype=float)[:, None, None]
    line_weight = material.density * gravity * sections.area[:, None]
    load = np.zeros((span.size, 12))
    for point, weight in zip(_GAUSS_POINTS, _GAUSS_WEIGHTS, strict=True):
        _, deflection, _, _ = _displacements(point, span, sections, material)
        load -= 0.5 * weight * span[:, :, 0] * line_weight * deflection[:, 1, :]
    nodal: FloatArray = np.einsum("nij,ni->nj", offset_transformation(sections), load)
    return nodal


def _second_moments(sections: SectionProperties) -> FloatArray:
    """Stack the tensors of second moments, (n, 2, 2), that act on slopes psi = (rz, -ry)."""
    product = sections.product_moment
    rows = [[sections.second_moment_lateral, product], [product, sections.second_moment_vertical]]
    return np.moveaxis(np.array(rows), 2, 0)


def _shear_flexibility(sections: SectionProperties, material: Material) -> FloatArray:
    """Stack the shear flexibilities, (n, 2, 2), of forces along y and z."""
    flexibility = np.zeros((sections.area.size, 2, 2))
    rigidity = material.shear_modulus * sections.area
    flexibility[:, 0, 0] = 1.0 / (rigidity * sections.shear_factor_lateral)
    flexibility[:, 1, 1] = 1.0 / (rigidity * sections.shear_factor_vertical)
    return flexibility


def _flexure(
    span: FloatArray, sections: SectionProperties, material: Material
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Solve one element for its shear force, which is constant along it.

    Returns
    -------
    bending : (n, 2, 2) bending rigidity; shear_flexibility : (n, 2, 2);
    force : (n, 2, 12) shear force of the section DOFs; shear : (n, 2, 12) its work-conjugate
    deformation, end deflection less mean slope times length; relative : (1, 2, 12) end slope.
    """
    bending = material.youngs_modulus * _second_moments(sections)
    shear_flexibility = _shear_flexibility(sections, material)
    flexibility = span**3 / 12.0 * np.linalg.inv(bending) + span * shear_flexibility
    shear = _DEFLECTION[1] - _DEFLECTION[0] - 0.5 * span * (_SLOPE[0] + _SLOPE[1])
    force = np.asarray(np.linalg.solve(flexibility, shear), dtype=np.float64)
    relative = (_SLOPE[1] - _SLOPE[0])[None]
    return bending, shear_flexibility, force, shear, relative


def _displacements(
    point: float, span: FloatArray, sections: SectionProperties, material: Material
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Evaluate the shape functions at `point` in [-1, 1] along each element.

    Returns
    -------
    axial : (1, 1, 12) u_C; deflection : (n, 2, 12) of the centroid; slope : (n, 2, 12) psi;
    twist : (1, 1, 12) rx; each as rows over the section DOFs.
    """
    bending, shear_flexibility, force, _, relative = _flexure(span, sections, material)
    s = 0.5 * point * span
    ends = np.array([0.5 * (1.0 - point), 0.5 * (1.0 + point)])
    axial = (ends @ _AXIAL)[None, None, :]
    twist = (ends @ _TWIST)[None, None, :]
    bow = np.linalg.solve(bending, force)
    slope_middle = 0.5 * (_SLOPE[0] + _SLOPE[1]) + bow * span**2 / 8.0
    slope = slope_middle + relative * s / span - bow * s**2 / 2.0
    deflection = (
        0.5 * (_DEFLECTION[0] + _DEFLECTION[1])
        + slope_middle * s
        + relative * (s**2 / span - span / 4.0) / 2.0
        - bow * s**3 / 6.0
        + shear_flexibility @ force * s
    )
    arm_y = sections.centroid_y - sections.shear_centre_y
    arm_z = sections.centroid_z - sections.shear_centre_z
    arm = np.stack([-arm_z, arm_y], axis=1)[:, :, None]
    return axial, deflection + arm * twist, slope, twist


def _transpose(stack: FloatArray) -> FloatArray:
    return np.swapaxes(stack, 1, 2)


def _congruence(rows: FloatArray, weight: FloatArray) -> FloatArray:
    """Form rows^T weight rows for every element."""
    return _transpose(rows) @ weight @ rows


def _symmetrise(stack: FloatArray) -> FloatArray:
    return 0.5 * (stack + _transpose(stack))
