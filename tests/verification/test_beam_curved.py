r"""A bar curved in plan: bending and torsion share a load that hangs off the chord.

Reference, by Castigliano's theorem: an arc of radius R over the angle alpha, clamped at one end,
with a vertical force P at the other. At the angle t from the force the bending moment is
:math:`P R \sin t` and the torque :math:`P R (1 - \cos t)`, so it sinks by

.. math:: \frac{P R^3}{E I} \left(\frac{\alpha}{2} - \frac{\sin 2\alpha}{4}\right)
          + \frac{P R^3}{G J} \left(\frac{3\alpha}{2} - 2 \sin\alpha + \frac{\sin 2\alpha}{4}\right)
          + \frac{P R \alpha}{\kappa G A} .

Tolerance: order 2 in the element length within 0.05; 1e-4 with 64 elements.
"""

import numpy as np
import pytest
import scipy.sparse.linalg as spla

from turnout.beam.assembly import assemble_beam, dof_index
from turnout.beam.material import ElasticMaterial
from turnout.beam.section_record import SectionProperties

STEEL = ElasticMaterial(youngs_modulus=210e9, poisson_ratio=0.3, density=7850.0)
AREA, SECOND, TORSION, SHEAR = 4e-4, 1.3e-8, 2.2e-8, 0.8
RADIUS, ANGLE = 1.5, np.pi / 3


def sections(count: int) -> SectionProperties:
    one, nil = np.ones(count), np.zeros(count)
    return SectionProperties(
        AREA * one, *[SECOND * one] * 2, nil, TORSION * one, *[SHEAR * one] * 2, *[nil] * 4
    )


def sinking(count: int, *, side: float = 1.0) -> float:
    """Return how far the free end sinks under a unit force [m/N]."""
    heading = np.linspace(0.0, ANGLE, count + 1)
    x, y = RADIUS * np.sin(heading), side * RADIUS * (1.0 - np.cos(heading))
    beam = assemble_beam(x, sections(count), STEEL, y=y)
    load = np.zeros(beam.gravity_load.size)
    at = dof_index(beam, float(x[-1]), "uz")
    load[at] = 1.0
    moved = spla.spsolve(beam.stiffness[6:, 6:].tocsc(), load[6:])
    return float(moved[at - 6])


def exact() -> float:
    bending = ANGLE / 2 - np.sin(2 * ANGLE) / 4
    torsion = 3 * ANGLE / 2 - 2 * np.sin(ANGLE) + np.sin(2 * ANGLE) / 4
    shear_modulus = STEEL.shear_modulus
    return RADIUS**3 * (
        bending / (STEEL.youngs_modulus * SECOND) + torsion / (shear_modulus * TORSION)
    ) + RADIUS * ANGLE / (SHEAR * shear_modulus * AREA)


def test_the_tip_of_an_arc_sinks_as_castigliano_says_with_order_two():
    errors = [abs(sinking(count) / exact() - 1) for count in (16, 32, 64)]
    assert errors[-1] < 1e-4
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.05)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2.0, abs=0.05)


def test_either_side_sinks_alike():
    assert sinking(16, side=-1.0) == pytest.approx(sinking(16), rel=1e-12)


def test_the_mass_is_that_of_the_arc():
    heading = np.linspace(0.0, ANGLE, 65)
    beam = assemble_beam(
        RADIUS * np.sin(heading),
        sections(64),
        STEEL,
        y=RADIUS * (1 - np.cos(heading)),
        gravity=9.81,
    )
    weight = STEEL.density * AREA * RADIUS * ANGLE * 9.81
    assert -beam.gravity_load[2::6].sum() == pytest.approx(weight, rel=1e-4)
    lift = np.zeros(beam.gravity_load.size)
    lift[1::6] = 1.0
    assert lift @ (beam.mass @ lift) == pytest.approx(weight / 9.81, rel=1e-4)
    assert np.abs(beam.stiffness @ lift).max() < 1e-6 * beam.stiffness.diagonal().max()
