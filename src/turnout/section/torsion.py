r"""Saint-Venant torsion: warping function, torsion constant, shear centre, warping constant.

A bar twisted at the rate :math:`\vartheta'` about its centroid warps by
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
"""

from dataclasses import dataclass

import numpy as np

from turnout.section.mesh import Field, SectionMesh, integral
from turnout.section.outline import FloatArray


@dataclass(frozen=True, slots=True)
class Torsion:
    """What torsion makes of a section.

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
