"""Quadratic finite elements on an outline, and Neumann problems solved on them.

Torsion and shear of a section are both Neumann problems of the Laplacian, so one factorisation
serves all of them. The triangles are those of a constrained Delaunay triangulation of the densified
outline, each divided into four as often as asked for; even the thinnest web then has elements
across it.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.sparse.linalg import splu
from skfem import Basis, BilinearForm, ElementTriP2, LinearForm, MeshTri
from skfem.helpers import dot, grad

from turnout.errors import MechanicsError
from turnout.section.outline import FloatArray, Outline, densified, polygon_of

# Exact for the squares of the quadratics that Poisson's ratio brings.
_QUADRATURE_ORDER = 4


@dataclass(frozen=True, slots=True, eq=False)
class SectionMesh:
    """A section's finite elements.

    Parameters
    ----------
    basis : skfem.Basis
        Quadratic triangles.
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
    element_length : float
        Longest edge on the boundary before refinement [m].
    refinements : int
        How often each triangle is divided into four, zero or more.

    Returns
    -------
    SectionMesh
    """
    if refinements < 0:
        msg = f"a mesh cannot be refined {refinements} times"
        raise MechanicsError(msg)
    polygon = polygon_of(densified(outline, length=element_length))
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
