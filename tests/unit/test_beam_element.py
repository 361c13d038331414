"""The element against the textbook, and the names of an assembled beam's DOFs.

Reference matrices: Friedman and Kosmatka, Computers & Structures 47(3), 1993, for one plane;
written out here, so that the general element is checked against numbers it was not made from.
"""

from dataclasses import fields

import numpy as np
import pytest

from turnout.beam.assembly import DOF, assemble_beam, dof_index, point_row
from turnout.beam.element import element_matrices
from turnout.beam.material import ElasticMaterial
from turnout.beam.section_record import SectionProperties, mirror_sections
from turnout.core.errors import MechanicsError

STEEL = ElasticMaterial(youngs_modulus=2.1e11, poisson_ratio=0.3, density=7850.0)
E, G, RHO = STEEL.youngs_modulus, STEEL.shear_modulus, STEEL.density
LENGTH = 0.4
NAMES = [field.name for field in fields(SectionProperties)]
CENTRED = [6e-3, 1.3e-5, 4e-6, 0.0, 1.1e-6, 0.4, 0.6, 0.0, 0.0, 0.0, 0.0]
SKEW = [6e-3, 1.3e-5, 4e-6, 3e-6, 1.1e-6, 0.4, 0.6, 0.012, 0.06, -0.004, 0.035]
LATERAL = [1, 5, 7, 11]
VERTICAL = [2, 4, 8, 10]
FLIP = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])


def uniform(values, count=1):
    """Repeat one section."""
    return SectionProperties(*[np.full(count, value) for value in values])


def plane_matrices(*, second_moment, shear_factor):
    """Write out the 4x4 matrices of a Timoshenko element with DOFs (w, slope) at both ends."""
    area, span = CENTRED[0], LENGTH
    phi = 12.0 * E * second_moment / (shear_factor * G * area * span**2)
    stiffness = np.array(
        [
            [12.0, 6.0 * span, -12.0, 6.0 * span],
            [6.0 * span, (4.0 + phi) * span**2, -6.0 * span, (2.0 - phi) * span**2],
            [-12.0, -6.0 * span, 12.0, -6.0 * span],
            [6.0 * span, (2.0 - phi) * span**2, -6.0 * span, (4.0 + phi) * span**2],
        ]
    ) * (E * second_moment / (span**3 * (1.0 + phi)))
    a = 13.0 / 35.0 + 7.0 * phi / 10.0 + phi**2 / 3.0
    b = (11.0 / 210.0 + 11.0 * phi / 120.0 + phi**2 / 24.0) * span
    c = 9.0 / 70.0 + 3.0 * phi / 10.0 + phi**2 / 6.0
    d = (13.0 / 420.0 + 3.0 * phi / 40.0 + phi**2 / 24.0) * span
    e = (1.0 / 105.0 + phi / 60.0 + phi**2 / 120.0) * span**2
    f = (1.0 / 140.0 + phi / 60.0 + phi**2 / 120.0) * span**2
    translation = np.array([[a, b, c, -d], [b, e, d, -f], [c, d, a, -b], [-d, -f, -b, e]])
    g = (0.1 - 0.5 * phi) * span
    h = (2.0 / 15.0 + phi / 6.0 + phi**2 / 3.0) * span**2
    k = (-1.0 / 30.0 - phi / 6.0 + phi**2 / 6.0) * span**2
    rotation = np.array([[1.2, g, -1.2, g], [g, h, -g, k], [-1.2, -g, 1.2, -g], [g, k, -g, h]])
    mass = RHO * area * span * translation + RHO * second_moment / span * rotation
    return stiffness, mass / (1.0 + phi) ** 2


def textbook_element():
    """Write out the 12x12 matrices of a doubly symmetric element."""
    stiffness, mass = np.zeros((12, 12)), np.zeros((12, 12))
    rod = np.array([[1.0, -1.0], [-1.0, 1.0]]) / LENGTH
    line = np.array([[2.0, 1.0], [1.0, 2.0]]) * RHO * LENGTH / 6.0
    area, i_y, i_z, _, torsion, factor_z, factor_y = CENTRED[:7]
    for dofs, rigidity, inertia in [
        ([0, 6], E * area, area),
        ([3, 9], G * torsion, i_y + i_z),
    ]:
        stiffness[np.ix_(dofs, dofs)] = rigidity * rod
        mass[np.ix_(dofs, dofs)] = inertia * line
    turned = np.array([1.0, -1.0, 1.0, -1.0])  # the slope of uz is -ry
    for dofs, second_moment, factor, signs in [
        (LATERAL, i_z, factor_y, np.ones(4)),
        (VERTICAL, i_y, factor_z, turned),
    ]:
        plane = plane_matrices(second_moment=second_moment, shear_factor=factor)
        stiffness[np.ix_(dofs, dofs)] = plane[0] * np.outer(signs, signs)
        mass[np.ix_(dofs, dofs)] = plane[1] * np.outer(signs, signs)
    return stiffness, mass


def test_symmetric_section_gives_the_textbook_element():
    found_all = element_matrices([LENGTH], uniform(CENTRED), STEEL)
    for (found,), expected in zip(found_all[:2], textbook_element(), strict=True):
        scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        np.testing.assert_allclose(found / scale, expected / scale, rtol=0.0, atol=1e-14)


def test_textbook_gravity_load():
    """Half the weight at each end, and end moments q L^2 / 12 that bend it back."""
    load = element_matrices([LENGTH], uniform(CENTRED), STEEL, gravity=10.0)[2][0]
    weight = RHO * CENTRED[0] * 10.0 * LENGTH
    expected = np.zeros(12)
    expected[[2, 8]] = -weight / 2.0
    expected[[4, 10]] = weight * LENGTH / 12.0, -weight * LENGTH / 12.0
    np.testing.assert_allclose(load, expected, rtol=1e-13, atol=1e-12)


@pytest.mark.parametrize(("which", "smallest"), [(0, -1e-12), (1, 1e-6)])
def test_matrices_are_symmetric_and_not_negative(which, smallest):
    matrix = element_matrices([LENGTH], uniform(SKEW), STEEL)[which][0]
    np.testing.assert_array_equal(matrix, matrix.T)
    scale = np.sqrt(np.diag(matrix))
    least = np.linalg.eigvalsh(matrix / scale[:, None] / scale)[0]
    assert least > smallest


@pytest.mark.parametrize("which", range(3))
def test_elements_are_formed_one_by_one(which):
    """Each of several elements is as if it were alone."""
    lengths = np.array([0.1, 0.4, 0.7])
    sections = SectionProperties(*[value * np.array([1.0, 1.5, 0.6]) for value in SKEW])
    together = element_matrices(lengths, sections, STEEL)[which]
    for i, length in enumerate(lengths):
        one = SectionProperties(*[getattr(sections, name)[i : i + 1] for name in NAMES])
        alone = element_matrices([length], one, STEEL)[which][0]
        np.testing.assert_allclose(together[i], alone, rtol=1e-13)


@pytest.mark.parametrize("which", range(3))
def test_mirrored_section_gives_the_mirrored_element(which):
    """Mirroring in y = 0 turns uy, rx and rz round."""
    flip = np.tile(FLIP, 2)
    here = element_matrices([LENGTH], uniform(SKEW), STEEL)[which][0]
    there = element_matrices([LENGTH], mirror_sections(uniform(SKEW)), STEEL)[which][0]
    both = np.outer(flip, flip) if here.ndim == 2 else flip
    np.testing.assert_allclose(there, both * here, rtol=1e-12, atol=1e-12 * np.abs(here).max())
    assert np.abs(there - here).max() > 1e-3 * np.abs(here).max()


def assembled(x, *, count):
    return assemble_beam(x, uniform(SKEW, count), STEEL, name="left switch rail")


class TestAssembly:
    """DOFs are addressed by position and name."""

    x = (0.0, 0.3, 0.7, 1.5)
    beam = assembled(x, count=3)

    @pytest.mark.parametrize("component", range(6))
    def test_dof_is_found_by_position_and_name(self, component):
        assert dof_index(self.beam, 0.7 + 5e-7, DOF[component]) == 12 + component

    @pytest.mark.parametrize(
        ("ask", "words"),
        [
            (lambda beam: dof_index(beam, 0.45, "uy"), r"left .* x = 0\.45 m.* at 0\.3 m"),
            (lambda beam: dof_index(beam, float("nan"), "uy"), "no node at x = nan"),
            (lambda beam: point_row(beam, 0.3, "v"), "'v'; allowed are ux, uy, uz, rx, ry, rz"),
            (lambda _: assembled([0.0, 0.3, 0.7, 1.5], count=2), "3 .* as many sections, not 2"),
            (lambda _: assembled([0.0], count=1), "two or more and increase"),
            (lambda _: assembled([0.0, 0.0], count=2), "two or more and increase"),
            (lambda _: assembled([1.0, 0.5], count=2), "two or more and increase"),
        ],
    )
    def test_what_is_not_there_is_refused(self, ask, words):
        with pytest.raises(MechanicsError, match=words):
            ask(self.beam)

    def test_point_moves_with_its_section(self):
        """A point's displacement is u + theta x r, its rotation that of the section."""
        moved = np.random.default_rng(3).standard_normal(24)
        offset = np.array([0.0, -0.06, 0.11])
        shift, turn = moved[6:9], moved[9:12]
        expected = np.concatenate([shift + np.cross(turn, offset), turn])
        rows = [point_row(self.beam, 0.3, name, y=-0.06, z=0.11) for name in DOF]
        np.testing.assert_allclose(rows @ moved, expected, rtol=1e-14)

    def test_neighbours_share_a_node(self):
        """The assembled matrix is the sum of the elements' blocks."""
        expected = np.zeros((24, 24))
        blocks = element_matrices(np.diff(self.x), uniform(SKEW, 3), STEEL)[0]
        for i, block in enumerate(blocks):
            expected[6 * i : 6 * i + 12, 6 * i : 6 * i + 12] += block
        np.testing.assert_allclose(self.beam.stiffness.toarray(), expected, rtol=1e-13)
