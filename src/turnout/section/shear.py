r"""Shear stress of a bending bar, and the shear factors that store its energy.

A shear force (V_y, V_z) makes the bending stress grow along the bar by the linear function s(y, z)
with :math:`\int y s\,dA = V_y` and :math:`\int z s\,dA = V_z`. Saint-Venant's flexure answers with

.. math::

    \boldsymbol\tau = \nabla \varphi - c\,\boldsymbol d, \quad
    \int \boldsymbol\tau \cdot \nabla v\,dA = \int s v\,dA \ \text{for all } v, \quad
    c = \frac{\nu}{2 (1 + \nu)}, \quad
    \boldsymbol d = \begin{pmatrix} \tfrac12 a (y^2 - z^2) + b\,y z \\
    a\,y z + \tfrac12 b (z^2 - y^2) \end{pmatrix}, \quad s = a y + b z.

The vector d is the sideways contraction of the stretched and compressed fibres; with Poisson's
ratio zero it is absent. To make the force pass through the shear centre of
`turnout.section.torsion`, the multiple of the torsion stress **t** is added that makes
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

from turnout.section.mesh import Field, SectionMesh, integral
from turnout.section.outline import FloatArray
from turnout.section.torsion import torsion_flux


@dataclass(frozen=True, slots=True)
class Shear:
    """What shear forces make of a section.

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
    poisson_ratio : float
        Above -1, at most 0.5 [-].

    Returns
    -------
    sources : list of two ndarray, shape (n_elements, n_points)
    fluxes : list of two ndarray, shape (2, n_elements, n_points)
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
    warping : Field
        Warping function about the centroid.
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
