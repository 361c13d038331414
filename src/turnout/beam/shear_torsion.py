r"""Torsion and shear of a section by quadratic finite elements.

Torsion and shear of a section are both Neumann problems of the Laplacian, so one factorisation
serves all of them. The triangles are those of a constrained Delaunay triangulation of the densified
outline, each divided into four as often as requested; even the thinnest web then has elements
across it.

**Torsion** (Saint-Venant) gives the torsion constant, the shear centre and the warping constant. A
bar twisted at the rate :math:`\vartheta'` about its centroid warps by
:math:`\vartheta' \omega(y, z)` and carries the shear stress :math:`G \vartheta' \boldsymbol t`,

.. math::

    \boldsymbol t = \nabla \omega + (-z, y), \qquad
    \int \boldsymbol t \cdot \nabla v\,dA = 0 \ \text{for all } v, \qquad
    J = \int \boldsymbol t \cdot \boldsymbol t\,dA.

Finite elements approach J from above. The shear centre S is that of Trefftz: a force through it
does no work on the twist, so shear and torsion share no energy. It does not depend on Poisson's
ratio, and it is the centre of twist, about which the warping :math:`\omega_S` is orthogonal to
bending:

.. math::

    \omega_S = \omega - z_S\,y + y_S\,z, \qquad
    \int \omega_S\,y\,dA = \int \omega_S\,z\,dA = 0, \qquad
    \Gamma = \int \omega_S^2\,dA,

with y, z and S measured from the centroid and :math:`\omega` of zero mean. The beam element holds
this Gamma to be of no account: it matters within :math:`\sqrt{E \Gamma / G J}` of a clamped end,
14 cm for a 60E1.

**Shear** gives the shear factors. A shear force (V_y, V_z) makes the bending stress grow along the
bar by the linear function s(y, z) with :math:`\int y s\,dA = V_y` and
:math:`\int z s\,dA = V_z`. Saint-Venant's flexure gives

.. math::

    \boldsymbol\tau = \nabla \varphi - c\,\boldsymbol d, \quad
    \int \boldsymbol\tau \cdot \nabla v\,dA = \int s v\,dA \ \text{for all } v, \quad
    c = \frac{\nu}{2 (1 + \nu)}, \quad
    \boldsymbol d = \begin{pmatrix} \tfrac{1}{2} a (y^2 - z^2) + b\,y z \\
    a\,y z + \tfrac{1}{2} b (z^2 - y^2) \end{pmatrix}, \quad s = a y + b z.

The vector d is the sideways contraction of the stretched and compressed fibres; with Poisson's
ratio zero it is absent. To make the force pass through the shear centre,
the multiple of the torsion stress **t** is added that makes
:math:`\int \boldsymbol\tau \cdot \boldsymbol t\,dA = 0`. The shear factors are then defined by
energy,

.. math::

    \frac{1}{\kappa_y} = A \int \boldsymbol\tau_y \cdot \boldsymbol\tau_y\,dA, \qquad
    \frac{1}{\kappa_z} = A \int \boldsymbol\tau_z \cdot \boldsymbol\tau_z\,dA,

for unit forces along y and z. That is the definition of W. D. Pilkey (Analysis and Design of
Elastic Beams, Wiley 2002, doi:10.1002/9780470172667), but for the added torsion, which he leaves
out: it is nil for symmetric sections and for Poisson's ratio zero, and changes a rail's factors by
0.4 % at the most. They are not Cowper's factors, which weigh displacements instead.

An unsymmetric section also has a mixed term, A times the integral of
:math:`\boldsymbol\tau_y \cdot \boldsymbol\tau_z`; the beam element leaves it out, and
`Shear.coupling` says how large it is.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.sparse.linalg import splu
from skfem import Basis, BilinearForm, ElementTriP2, LinearForm, MeshTri
from skfem.helpers import dot, grad

from turnout.beam.outline import FloatArray, Outline, densify, polygon_of
from turnout.core.errors import MechanicsError

# Exact for the squares of the quadratics that Poisson's ratio brings.
_QUADRATURE_ORDER = 4


@dataclass(frozen=True, slots=True, eq=False)
class SectionMesh:
    """A section's finite elements.

    Parameters
    ----------
    basis : skfem.Basis
        Quadratic triangles with quadrature of order 4.
    y, z : ndarray, shape (n_elements, n_points)
        Quadrature points, from the section's centroid [m].
    weight : ndarray, shape (n_elements, n_points)
        Area that each point stands for [m^2]; their sum is the area.
    """

    basis: Basis
    y: FloatArray
    z: FloatArray
    weight: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """A function on a section.

    Parameters
    ----------
    value : ndarray, shape (n_elements, n_points)
        Values at the quadrature points; their mean over the section is zero.
    gradient : ndarray, shape (2, n_elements, n_points)
        Derivatives by y and z.
    """

    value: FloatArray
    gradient: FloatArray


def mesh_outline(outline: Outline, *, element_length: float, refinements: int) -> SectionMesh:
    """Divide an outline into quadratic triangles.

    Parameters
    ----------
    outline : Outline
        In any frame [m].
    element_length : float
        Longest edge on the boundary before refinement [m].
    refinements : int
        How often each triangle is divided into four, zero or more.

    Returns
    -------
    SectionMesh
        Positions from the centroid.
    """
    if refinements < 0:
        msg = f"a mesh cannot be refined {refinements} times"
        raise MechanicsError(msg)
    polygon = polygon_of(densify(outline, length=element_length))
    triangles = shapely.constrained_delaunay_triangles(polygon).geoms
    corners = shapely.get_coordinates(triangles).reshape(len(triangles), 4, 2)[:, :3]
    vertices, index = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    mesh = MeshTri(
        np.ascontiguousarray(vertices.T), np.ascontiguousarray(index.reshape(-1, 3).T)
    ).refined(refinements)
    basis = Basis(mesh, ElementTriP2(), intorder=_QUADRATURE_ORDER)
    weight = np.asarray(basis.dx)
    y, z = np.asarray(basis.global_coordinates())
    area = weight.sum()
    return SectionMesh(
        basis=basis,
        y=y - np.sum(weight * y) / area,
        z=z - np.sum(weight * z) / area,
        weight=weight,
    )


def solve_neumann(
    mesh: SectionMesh, *, sources: list[FloatArray], fluxes: list[FloatArray]
) -> list[Field]:
    r"""Solve Neumann problems of the Laplacian, all on one factorisation.

    Each asks for the u of zero mean with, for every v,

    .. math:: \int \nabla u \cdot \nabla v\,dA = \int s v + f \cdot \nabla v\,dA.

    Parameters
    ----------
    mesh : SectionMesh
    sources : list of ndarray, each of shape (n_elements, n_points)
        s at the quadrature points; its integral over the section must vanish.
    fluxes : list of ndarray, each of shape (2, n_elements, n_points)
        f at the quadrature points.

    Returns
    -------
    list of Field
    """
    stiffness = BilinearForm(lambda u, v, _: dot(grad(u), grad(v))).assemble(mesh.basis)
    loads = [
        LinearForm(lambda v, _, s=s, f=f: s * v + dot(f, grad(v))).assemble(mesh.basis)
        for s, f in zip(sources, fluxes, strict=True)
    ]
    # Held at the first node; what that takes from u is a constant.
    factor = splu(stiffness[1:, 1:].tocsc())
    return [_field(mesh, np.concatenate([[0.0], factor.solve(load[1:])])) for load in loads]


def integral(mesh: SectionMesh, values: FloatArray) -> float:
    """Integrate values at the quadrature points over the section."""
    return float(np.sum(mesh.weight * values))


def _field(mesh: SectionMesh, nodal: FloatArray) -> Field:
    at_points = mesh.basis.interpolate(nodal)
    value = np.array(at_points)
    mean = np.sum(mesh.weight * value) / np.sum(mesh.weight)
    return Field(value=value - mean, gradient=np.asarray(at_points.grad))


@dataclass(frozen=True, slots=True)
class Torsion:
    """Torsion properties of a section.

    Parameters
    ----------
    torsion_constant : float
        J [m^4].
    shear_centre_y, shear_centre_z : float
        Position of the shear centre **from the centroid** [m].
    warping_constant : float
        Gamma about the shear centre [m^6].
    """

    torsion_constant: float
    shear_centre_y: float
    shear_centre_z: float
    warping_constant: float


def torsion_flux(mesh: SectionMesh) -> FloatArray:
    """Return the flux that drives the warping, (z, -y), shape (2, n_elements, n_points)."""
    return np.stack([mesh.z, -mesh.y])


def solve_torsion(mesh: SectionMesh, *, warping: Field) -> Torsion:
    """Evaluate torsion from the warping function about the centroid.

    Parameters
    ----------
    mesh : SectionMesh
        That of the solution.
    warping : Field
        The solution for the flux `torsion_flux` [m^2].

    Returns
    -------
    Torsion
    """
    stress = warping.gradient - torsion_flux(mesh)
    y, z, omega = mesh.y, mesh.z, warping.value
    products = [[y * y, y * z], [y * z, z * z]]
    second_moments = np.array([[integral(mesh, term) for term in row] for row in products])
    linear = [integral(mesh, omega * y), integral(mesh, omega * z)]
    shear_centre_z, minus_shear_centre_y = np.linalg.solve(second_moments, linear)
    about_shear_centre = omega - shear_centre_z * y - minus_shear_centre_y * z
    return Torsion(
        torsion_constant=integral(mesh, np.sum(stress**2, axis=0)),
        shear_centre_y=-float(minus_shear_centre_y),
        shear_centre_z=float(shear_centre_z),
        warping_constant=integral(mesh, about_shear_centre**2),
    )


@dataclass(frozen=True, slots=True)
class Shear:
    """Shear properties of a section.

    Parameters
    ----------
    factor_lateral, factor_vertical : float
        Shear area over area for forces along y and z [-].
    coupling : float
        A times the integral of tau_y tau_z [-]; beside 1/factor it says how far shear along y
        bends into z.
    """

    factor_lateral: float
    factor_vertical: float
    coupling: float


def shear_loads(
    mesh: SectionMesh, *, poisson_ratio: float
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Form the sources s and the fluxes c d of unit shear forces along y and z.

    Parameters
    ----------
    mesh : SectionMesh
        With n_elements elements of n_points points.
    poisson_ratio : float
        Above -1, at most 0.5 [-].

    Returns
    -------
    sources : list of two ndarray, shape (n_elements, n_points)
        s for a force along y and one along z, per unit force [1/m^3].
    fluxes : list of two ndarray, shape (2, n_elements, n_points)
        c d likewise [1/m^2].
    """
    y, z = mesh.y, mesh.z
    product = integral(mesh, y * z)
    second_moments = [[integral(mesh, y * y), product], [product, integral(mesh, z * z)]]
    contraction = 0.5 * poisson_ratio / (1.0 + poisson_ratio)
    difference = 0.5 * (y * y - z * z)
    sources, fluxes = [], []
    for a, b in np.linalg.inv(second_moments).T:
        sources.append(a * y + b * z)
        flux = [a * difference + b * y * z, a * y * z - b * difference]
        fluxes.append(contraction * np.stack(flux))
    return sources, fluxes


def solve_shear(
    mesh: SectionMesh, *, warping: Field, potentials: list[Field], fluxes: list[FloatArray]
) -> Shear:
    """Evaluate the shear factors from the shear potentials.

    Parameters
    ----------
    mesh : SectionMesh
        That of the solutions.
    warping : Field
        Warping function about the centroid [m^2].
    potentials : list of two Field
        The solutions for `shear_loads`, for unit forces along y and z.
    fluxes : list of two ndarray, shape (2, n_elements, n_points)
        The fluxes of `shear_loads`.

    Returns
    -------
    Shear
    """
    torsion = warping.gradient - torsion_flux(mesh)
    torsion_constant = integral(mesh, np.sum(torsion**2, axis=0))
    stresses = []
    for potential, flux in zip(potentials, fluxes, strict=True):
        stress = potential.gradient - flux
        shared = integral(mesh, np.sum(stress * torsion, axis=0))
        stresses.append(stress - shared / torsion_constant * torsion)
    area = float(np.sum(mesh.weight))
    lateral, vertical = stresses
    return Shear(
        factor_lateral=1.0 / (area * integral(mesh, np.sum(lateral**2, axis=0))),
        factor_vertical=1.0 / (area * integral(mesh, np.sum(vertical**2, axis=0))),
        coupling=area * integral(mesh, np.sum(lateral * vertical, axis=0)),
    )
