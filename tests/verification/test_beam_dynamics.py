"""Beam inertia against rigid-body mechanics, and frequencies against Timoshenko's equations.

Theory of the orders: the shape functions hold the shear force constant along an element. Where
shear matters the eigenvalue error is of second order, where it does not (slender beam) of fourth.
"""

import numpy as np
import pytest
import scipy.linalg
from scipy.optimize import brentq

from turnout.beam.assembly import assemble_beam
from turnout.beam.material import ElasticMaterial
from turnout.beam.section_record import SectionProperties

STEEL = ElasticMaterial(youngs_modulus=2.1e11, poisson_ratio=0.3, density=7850.0)
E, G, RHO = STEEL.youngs_modulus, STEEL.shear_modulus, STEEL.density

SKEW = {
    "area": 6e-3,
    "second_moment_vertical": 1.3e-5,
    "second_moment_lateral": 4e-6,
    "product_moment": 3e-6,
    "torsion_constant": 1.1e-6,
    "shear_factor_vertical": 0.4,
    "shear_factor_lateral": 0.6,
    "centroid_y": 0.012,
    "centroid_z": 0.06,
    "shear_centre_y": -0.004,
    "shear_centre_z": 0.035,
}
OFFSETS = ("product_moment", "centroid_y", "centroid_z", "shear_centre_y", "shear_centre_z")
CENTRED = SKEW | dict.fromkeys(OFFSETS, 0.0)


def make_beam(values, nodes, *, growth=0.0):
    """Assemble a beam whose section grows from element to element."""
    factors = 1.0 + growth * np.arange(len(nodes) - 1)
    sections = SectionProperties(**{name: value * factors for name, value in values.items()})
    return assemble_beam(nodes, sections, STEEL), sections


def rigid_motions(x):
    """Return the six rigid motions of a beam about its origin, (6 n, 6)."""
    motions = np.tile(np.eye(6), (x.size, 1))
    motions[1::6, 5] = x
    motions[2::6, 4] = -x
    return motions


def vertical_frequencies(values, length, count, *, held):
    """Solve for the angular frequencies in the vertical plane; `held` maps ends to DOF numbers."""
    beam, _ = make_beam(values, np.linspace(0.0, length, count + 1))
    plane = np.ravel([[6 * i + 2, 6 * i + 4] for i in range(count + 1)])
    last = 6 * count
    fixed = [*held["start"], *(last + dof for dof in held["end"])]
    free = np.setdiff1d(plane, fixed)
    stiffness, mass = beam.stiffness.toarray(), beam.mass.toarray()
    values = scipy.linalg.eigvalsh(stiffness[np.ix_(free, free)], mass[np.ix_(free, free)])
    return np.sqrt(values)


def pinned_frequency(values, length, mode):
    """Return the exact lower frequency of a pinned Timoshenko beam with sinusoidal shape."""
    wave = mode * np.pi / length
    shear = values["shear_factor_vertical"] * G * values["area"]
    bending = E * values["second_moment_vertical"]
    stiffness = [[shear * wave**2, -shear * wave], [-shear * wave, bending * wave**2 + shear]]
    mass = RHO * np.diag([values["area"], values["second_moment_vertical"]])
    return np.sqrt(scipy.linalg.eigh(stiffness, mass, eigvals_only=True)[0])


def clamped_residual(omega, values, length):
    """Return the determinant that vanishes at a cantilever's frequency, by transfer matrix."""
    shear = values["shear_factor_vertical"] * G * values["area"]
    bending = E * values["second_moment_vertical"]
    inertia = RHO * values["second_moment_vertical"] * omega**2
    line_mass = RHO * values["area"] * omega**2
    # States: deflection w, slope, moment M, shear force V.
    field = np.array(
        [
            [0.0, 1.0, 0.0, 1.0 / shear],
            [0.0, 0.0, 1.0 / bending, 0.0],
            [0.0, -inertia, 0.0, -1.0],
            [-line_mass, 0.0, 0.0, 0.0],
        ]
    )
    scale = np.diag([1.0, 1.0, bending, bending])
    transfer = scipy.linalg.expm(np.linalg.inv(scale) @ field @ scale * length)
    return np.linalg.det(transfer[2:, 2:])


@pytest.mark.parametrize("growth", [0.0, 0.2], ids=["uniform", "stepped"])
def test_rigid_motions_store_no_energy(growth):
    """Six motions without force, and no seventh, with all offsets."""
    beam, _ = make_beam(SKEW, [0.0, 0.3, 0.35, 1.1, 1.7], growth=growth)
    stiffness = beam.stiffness.toarray()
    scale = np.sqrt(np.diag(stiffness))
    forces = stiffness @ rigid_motions(beam.x) / scale[:, None]
    assert np.abs(forces).max() < 1e-12 * scale.max()
    spectrum = np.linalg.eigvalsh(stiffness / scale[:, None] / scale)
    assert np.abs(spectrum[:6]).max() < 1e-13
    assert spectrum[6] > 1e-6


@pytest.mark.parametrize("growth", [0.0, 0.2], ids=["uniform", "stepped"])
def test_rigid_motions_have_exact_inertia(growth):
    """Mass, centre of mass and inertia tensor about the origin, summed over the elements."""
    beam, sections = make_beam(SKEW, [0.0, 0.3, 0.35, 1.1, 1.7], growth=growth)
    motions = rigid_motions(beam.x)
    expected = np.zeros((6, 6))
    for i, length in enumerate(np.diff(beam.x)):
        mass = RHO * sections.area[i] * length
        y, z = sections.centroid_y[i], sections.centroid_z[i]
        x = 0.5 * (beam.x[i] + beam.x[i + 1])
        i_y, i_z, i_yz = (
            RHO * length * getattr(sections, name)[i]
            for name in ("second_moment_vertical", "second_moment_lateral", "product_moment")
        )
        i_x = mass * length**2 / 12.0
        cross = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
        own = np.array([[i_y + i_z, 0, 0], [0, i_x + i_y, -i_yz], [0, -i_yz, i_x + i_z]])
        expected[:3, :3] += mass * np.eye(3)
        expected[:3, 3:] += mass * cross
        expected[3:, :3] += mass * cross.T
        expected[3:, 3:] += mass * cross.T @ cross + own
    found = motions.T @ (beam.mass @ motions)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12 * expected.max())


CANTILEVER = {"start": [2, 4], "end": []}


def slender_errors(count):
    """Euler-Bernoulli roots beta L of cos cosh = -1; shear stiff and rotary inertia negligible."""
    values = CENTRED | {"second_moment_vertical": 1e-11, "shear_factor_vertical": 1e3}
    roots = np.array([1.875104068711961, 4.694091132974174])
    rigidity = E * values["second_moment_vertical"] / (RHO * values["area"])
    found = vertical_frequencies(values, 1.0, count, held=CANTILEVER)[:2]
    return found / (roots**2 * np.sqrt(rigidity)) - 1.0


def pinned_errors(count):
    """Timoshenko beam on two pins, length five times its depth: shear matters."""
    found = vertical_frequencies(CENTRED, 0.8, count, held={"start": [2], "end": [2]})[:3]
    return found / [pinned_frequency(CENTRED, 0.8, mode) for mode in (1, 2, 3)] - 1.0


def stout_errors(count):
    """Timoshenko cantilever against its transfer matrix."""
    found = vertical_frequencies(CENTRED, 0.8, count, held=CANTILEVER)[:3]
    exact = [
        brentq(clamped_residual, 0.9 * own, 1.02 * own, args=(CENTRED, 0.8), xtol=1e-9 * own)
        for own in found
    ]
    return found / exact - 1.0


def rod_errors(count):
    """Free rod in tension and torsion: omega = n pi c / L, consistent mass."""
    beam, _ = make_beam(CENTRED, np.linspace(0.0, 1.0, count + 1))
    speeds = {0: np.sqrt(E / RHO), 3: np.sqrt(G * 1.1e-6 / (RHO * (1.3e-5 + 4e-6)))}
    errors = []
    for dof, speed in speeds.items():
        stiffness = beam.stiffness.toarray()[dof::6, dof::6]
        mass = beam.mass.toarray()[dof::6, dof::6]
        found = np.sqrt(scipy.linalg.eigvalsh(stiffness, mass)[1:3])
        errors.append(found / (np.pi * speed * np.array([1.0, 2.0])) - 1.0)
    return np.ravel(errors)


@pytest.mark.parametrize(
    ("errors_of", "counts", "rate", "settled", "most"),
    [
        (slender_errors, (3, 6, 12), 4.0, 1, 2e-5),
        (pinned_errors, (16, 32, 64), 2.0, 0, 1e-3),
        (stout_errors, (16, 32, 64), 2.0, 0, 1e-3),
        (rod_errors, (10, 20, 40), 2.0, 0, 2e-3),
    ],
)
def test_order(errors_of, counts, rate, settled, most):
    """Relative errors of frequencies: their order from a refinement on, and their size."""
    errors = np.array([errors_of(count) for count in counts])
    rates = np.log2(errors[:-1] / errors[1:])
    np.testing.assert_allclose(rates[settled:], rate, atol=0.1)
    assert errors[-1].min() > 0.0
    assert errors[-1].max() < most
