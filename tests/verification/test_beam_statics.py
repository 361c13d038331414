"""Beam statics against closed forms and against force-based beam theory.

Elements of constant section are exact for loads at nodes, so the tolerance is that of rounding in
the solution (1e-10 relative). A taper is approached in steps: second order in element length.
"""

import numpy as np
import pytest

from turnout.beam.assembly import assemble_beam, point_row
from turnout.beam.material import ElasticMaterial
from turnout.beam.section_record import SectionProperties, interpolate_sections

STEEL = ElasticMaterial(youngs_modulus=2.1e11, poisson_ratio=0.3, density=7850.0)
E, G = STEEL.youngs_modulus, STEEL.shear_modulus
LENGTH = 1.7
EXACT = 1e-10

CENTRED = {
    "area": 6e-3,
    "second_moment_vertical": 1.3e-5,
    "second_moment_lateral": 4e-6,
    "product_moment": 0.0,
    "torsion_constant": 1.1e-6,
    "shear_factor_vertical": 0.4,
    "shear_factor_lateral": 0.6,
    "centroid_y": 0.0,
    "centroid_z": 0.0,
    "shear_centre_y": 0.0,
    "shear_centre_z": 0.0,
}
SKEW = CENTRED | {
    "product_moment": 3e-6,
    "centroid_y": 0.012,
    "centroid_z": 0.06,
    "shear_centre_y": -0.004,
    "shear_centre_z": 0.035,
}
SKEW_TIP = {name: 0.5 * value for name, value in SKEW.items()} | {
    "product_moment": -1e-6,
    "centroid_y": 0.03,
    "shear_centre_z": 0.05,
}
NODES = {"one element": [0.0, LENGTH], "uneven": [0.0, 0.3, 0.35, 1.1, LENGTH]}


def uniform(values, count):
    """Repeat one section over `count` elements."""
    return SectionProperties(**{name: np.full(count, value) for name, value in values.items()})


def tapered(x):
    """Change linearly from SKEW at the clamp to SKEW_TIP at the tip."""
    ends = SectionProperties(**{n: np.array([v, SKEW_TIP[n]]) for n, v in SKEW.items()})
    return interpolate_sections([0.0, LENGTH], ends, x)


def cantilever(values, nodes):
    """Assemble a beam that `deflection` clamps at its first node."""
    return assemble_beam(nodes, uniform(values, len(nodes) - 1), STEEL)


def deflection(beam, load):
    """Solve for all displacements with the first node clamped."""
    displacement = np.zeros(load.size)
    held = beam.stiffness.toarray()[6:, 6:]
    displacement[6:] = np.linalg.solve(held, load[6:])
    return displacement


def tip_compliance(beam):
    """Return the displacements of the last node for unit loads on it, (6, 6)."""
    loads = np.eye(beam.gravity_load.size)[-6:]
    return np.stack([deflection(beam, load)[-6:] for load in loads], axis=1)


def theory_compliance(sections, x, weights):
    """Integrate the complementary energy of a cantilever loaded at its tip.

    A tip wrench gives internal forces at x: N, shear (V_y, V_z), torque about the shear centre
    and bending about the centroid, each times its section flexibility. No shape function enters.
    """
    total = np.zeros((6, 6))
    for i, (at, weight) in enumerate(zip(x, weights, strict=True)):
        s = {name: getattr(sections, name)[i] for name in SKEW}
        arm = LENGTH - at
        # Rows: N, V_y, V_z, T, M_z, -M_y from a tip wrench (Fx, Fy, Fz, Mx, My, Mz) on the line.
        statics = np.zeros((6, 6))
        statics[:3, :3] = np.eye(3)
        statics[3] = [0.0, s["shear_centre_z"], -s["shear_centre_y"], 1.0, 0.0, 0.0]
        statics[4] = [s["centroid_y"], arm, 0.0, 0.0, 0.0, 1.0]
        statics[5] = [s["centroid_z"], 0.0, arm, 0.0, -1.0, 0.0]
        tensor = [
            [s["second_moment_lateral"], s["product_moment"]],
            [s["product_moment"], s["second_moment_vertical"]],
        ]
        flexibility = np.zeros((6, 6))
        flexibility[0, 0] = 1.0 / (E * s["area"])
        flexibility[1, 1] = 1.0 / (G * s["area"] * s["shear_factor_lateral"])
        flexibility[2, 2] = 1.0 / (G * s["area"] * s["shear_factor_vertical"])
        flexibility[3, 3] = 1.0 / (G * s["torsion_constant"])
        flexibility[4:, 4:] = np.linalg.inv(np.array(tensor) * E)
        total += weight * statics.T @ flexibility @ statics
    return total


def gauss(count):
    """Place Gauss points on the beam."""
    points, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 * LENGTH * (points + 1.0), 0.5 * LENGTH * weights


@pytest.mark.parametrize("nodes", NODES.values(), ids=NODES.keys())
@pytest.mark.parametrize(
    ("direction", "inertia", "factor"),
    [
        ("uz", "second_moment_vertical", "shear_factor_vertical"),
        ("uy", "second_moment_lateral", "shear_factor_lateral"),
    ],
)
def test_cantilever_bends_and_shears(nodes, direction, inertia, factor):
    """Tip deflection P L^3 / 3 E I + P L / k G A in each plane, and nothing else moves."""
    beam = cantilever(CENTRED, nodes)
    row = point_row(beam, LENGTH, direction)
    moved = deflection(beam, 1000.0 * row)
    expected = 1000.0 * LENGTH**3 / (3.0 * E * CENTRED[inertia])
    expected += 1000.0 * LENGTH / (CENTRED[factor] * G * CENTRED["area"])
    assert row @ moved == pytest.approx(expected, rel=EXACT)
    across = point_row(beam, LENGTH, "uy" if direction == "uz" else "uz")
    assert abs(across @ moved) < EXACT * expected


@pytest.mark.parametrize(
    ("direction", "rigidity"),
    [("ux", E * CENTRED["area"]), ("rx", G * CENTRED["torsion_constant"])],
)
def test_cantilever_stretches_and_twists(direction, rigidity):
    """N L / E A and T L / G J."""
    beam = cantilever(CENTRED, NODES["uneven"])
    row = point_row(beam, LENGTH, direction)
    assert row @ deflection(beam, row) == pytest.approx(LENGTH / rigidity, rel=EXACT)


def test_end_rotations_follow_the_right_hand():
    """A load up turns the tip about -y, one to the left about +z: P L^2 / 2 E I."""
    beam = cantilever(CENTRED, NODES["uneven"])
    for force, turn, sign, inertia in [
        ("uz", "ry", -1.0, CENTRED["second_moment_vertical"]),
        ("uy", "rz", 1.0, CENTRED["second_moment_lateral"]),
    ]:
        moved = deflection(beam, point_row(beam, LENGTH, force))
        angle = point_row(beam, LENGTH, turn) @ moved
        assert angle == pytest.approx(sign * LENGTH**2 / (2.0 * E * inertia), rel=EXACT)


def test_unsymmetric_section_deflects_across_the_load():
    """A vertical load also moves the tip by -I_yz P L^3 / 3 E (I_y I_z - I_yz^2) sideways."""
    values = CENTRED | {"product_moment": 3e-6}
    i_y, i_z, i_yz = 1.3e-5, 4e-6, 3e-6
    beam = cantilever(values, NODES["uneven"])
    moved = deflection(beam, point_row(beam, LENGTH, "uz"))
    bending = LENGTH**3 / (3.0 * E * (i_y * i_z - i_yz**2))
    shear = LENGTH / (0.4 * G * 6e-3)
    assert moved[-5] == pytest.approx(-i_yz * bending, rel=EXACT)
    assert moved[-4] == pytest.approx(i_z * bending + shear, rel=EXACT)


def test_foot_load_is_shear_centre_load_and_torque():
    """A lateral force below the shear centre bends as if in it and twists by its torque."""
    values = SKEW | {"product_moment": 0.0}
    foot, centre = -0.05, SKEW["shear_centre_z"]
    beam = cantilever(values, NODES["uneven"])
    at_foot = point_row(beam, LENGTH, "uy", z=foot)
    at_centre = point_row(beam, LENGTH, "uy", z=centre)
    torque = point_row(beam, LENGTH, "rx")
    moved = deflection(beam, at_foot)
    np.testing.assert_allclose(
        moved, deflection(beam, at_centre + (centre - foot) * torque), rtol=1e-9, atol=1e-20
    )
    twist = LENGTH / (G * values["torsion_constant"])
    bending = LENGTH**3 / (3.0 * E * values["second_moment_lateral"])
    bending += LENGTH / (values["shear_factor_lateral"] * G * values["area"])
    assert torque @ moved == pytest.approx((centre - foot) * twist, rel=EXACT)
    assert at_centre @ moved == pytest.approx(bending, rel=EXACT)
    assert at_foot @ moved == pytest.approx(bending + (centre - foot) ** 2 * twist, rel=EXACT)


def test_eccentric_pull_bends_the_beam():
    """A pull e above the centroid lowers the tip by F e L^2 / 2 E I; one in it does not."""
    values = CENTRED | {"centroid_z": 0.06}
    beam = cantilever(values, NODES["uneven"])
    height = 0.1
    moved = deflection(beam, point_row(beam, LENGTH, "ux", z=height))
    bow = (height - 0.06) * LENGTH**2 / (2.0 * E * values["second_moment_vertical"])
    assert moved[-4] == pytest.approx(-bow, rel=EXACT)
    centred = deflection(beam, point_row(beam, LENGTH, "ux", z=0.06))
    assert abs(centred[-4]) < EXACT * bow
    stretch = point_row(beam, LENGTH, "ux", z=0.06) @ centred
    assert stretch == pytest.approx(LENGTH / (E * values["area"]), rel=EXACT)


@pytest.mark.parametrize("nodes", NODES.values(), ids=NODES.keys())
def test_skew_offset_cantilever_agrees_with_beam_theory(nodes):
    """All 36 tip compliances of an unsymmetric, eccentric section."""
    theory = theory_compliance(uniform(SKEW, 8), *gauss(8))
    scale = np.sqrt(np.outer(np.diag(theory), np.diag(theory)))
    difference = (tip_compliance(cantilever(SKEW, nodes)) - theory) / scale
    assert np.abs(difference).max() < EXACT


class TestTaper:
    """All 36 tip compliances of a rail whose every property and offset varies along it."""

    rate = 2.0
    eps = 0.1
    counts = (16, 32, 64)

    def error(self, count):
        """Largest relative error with `count` elements."""
        nodes = np.linspace(0.0, LENGTH, count + 1)
        beam = assemble_beam(nodes, tapered(0.5 * (nodes[1:] + nodes[:-1])), STEEL)
        points, weights = gauss(40)
        theory = theory_compliance(tapered(points), points, weights)
        scale = np.sqrt(np.outer(np.diag(theory), np.diag(theory)))
        return np.abs((tip_compliance(beam) - theory) / scale).max()

    def test_order(self):
        errors = np.array([self.error(count) for count in self.counts])
        rates = np.log2(errors[:-1] / errors[1:])
        np.testing.assert_allclose(rates, self.rate, atol=self.eps)
        assert errors[-1] < 1e-4


class TestGravity:
    """Own weight: consistent loads are exact at the nodes."""

    beam = cantilever(SKEW | {"product_moment": 0.0}, NODES["uneven"])
    line_weight = STEEL.density * 9.81 * SKEW["area"]

    def test_tip_of_a_cantilever(self):
        """The shear centre sinks by q L^4 / 8 E I + q L^2 / 2 k G A."""
        moved = deflection(self.beam, self.beam.gravity_load)
        row = point_row(self.beam, LENGTH, "uz", y=SKEW["shear_centre_y"])
        sag = LENGTH**4 / (8.0 * E * SKEW["second_moment_vertical"])
        sag += LENGTH**2 / (2.0 * SKEW["shear_factor_vertical"] * G * SKEW["area"])
        assert row @ moved == pytest.approx(-self.line_weight * sag, rel=EXACT)

    def test_weight_beside_the_shear_centre_twists(self):
        """The tip turns by -q (y_C - y_S) L^2 / 2 G J."""
        moved = deflection(self.beam, self.beam.gravity_load)
        arm = SKEW["centroid_y"] - SKEW["shear_centre_y"]
        twist = -self.line_weight * arm * LENGTH**2 / (2.0 * G * SKEW["torsion_constant"])
        assert moved[-3] == pytest.approx(twist, rel=EXACT)

    def test_resultant_acts_at_the_centre_of_mass(self):
        """Forces and moments about the origin are those of the weight at the centroid's middle."""
        nodal = self.beam.gravity_load.reshape(-1, 6)
        weight = self.line_weight * LENGTH
        expected = [0.0, 0.0, -weight, -weight * SKEW["centroid_y"], weight * LENGTH / 2.0, 0.0]
        total = nodal.sum(axis=0)
        total[4] -= self.beam.x @ nodal[:, 2]
        np.testing.assert_allclose(total, expected, rtol=EXACT, atol=EXACT * weight)

    def test_gravity_scales_the_load(self):
        nodes = NODES["uneven"]
        double = assemble_beam(nodes, uniform(SKEW, 4), STEEL, gravity=2 * 9.81).gravity_load
        single = assemble_beam(nodes, uniform(SKEW, 4), STEEL).gravity_load
        np.testing.assert_allclose(double, 2.0 * single, rtol=1e-14)
