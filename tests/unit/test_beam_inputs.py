"""Sections, material and mesh: what goes into a beam, and what is refused."""

from dataclasses import fields

import numpy as np
import pytest

from turnout.beam.material import ElasticMaterial
from turnout.beam.mesh import MERGE_DISTANCE, mesh_nodes
from turnout.beam.section_record import SectionProperties, interpolate_sections, mirror_sections
from turnout.core.errors import MechanicsError

NAMES = [field.name for field in fields(SectionProperties)]
ODD = {"product_moment", "centroid_y", "shear_centre_y"}


def sections(count=2, **changes):
    """Make `count` sections with distinct values; field k of section i is (k + 1)(i + 1)."""
    values = {name: (k + 1.0) * (np.arange(count) + 1.0) for k, name in enumerate(NAMES)}
    values["product_moment"] = 0.5 * (np.arange(count) + 1.0)
    return SectionProperties(**(values | changes))


def test_interpolation_is_linear_and_held_at_the_ends():
    found = interpolate_sections([1.0, 3.0], sections(), [0.0, 1.0, 1.5, 3.0, 9.0])
    for name in NAMES:
        first, second = getattr(sections(), name)
        expected = [first, first, 0.75 * first + 0.25 * second, second, second]
        np.testing.assert_allclose(getattr(found, name), expected, rtol=1e-15)


def test_repeated_station_is_a_step():
    found = interpolate_sections([0.0, 1.0, 1.0], sections(3), [1.0 - 1e-9, 1.0 + 1e-9])
    np.testing.assert_allclose(found.area, [2.0, 3.0], rtol=1e-8)


def test_mirroring_flips_what_is_odd_in_y_only():
    there = mirror_sections(sections())
    for name in NAMES:
        sign = -1.0 if name in ODD else 1.0
        np.testing.assert_array_equal(getattr(there, name), sign * getattr(sections(), name))


def material(**changes):
    values = {"youngs_modulus": 2.6e11, "poisson_ratio": 0.3, "density": 7850.0}
    return ElasticMaterial(**(values | changes))


def test_shear_modulus():
    assert material().shear_modulus == pytest.approx(1e11, rel=1e-15)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: interpolate_sections([1.0, 0.0], sections(), [0.5]), "must not decrease"),
        (
            lambda: interpolate_sections([0.0, 1.0, 2.0], sections(), [0.5]),
            "3 stations were given for 2 sections",
        ),
        (lambda: sections(centroid_y=np.zeros(3)), "one length"),
        # All problems at once.
        (
            lambda: sections(area=np.array([1.0, -2.0]), centroid_z=np.array([0.0, np.nan])),
            "centroid_z is not finite; area must be positive",
        ),
        (lambda: sections(product_moment=np.array([1e3, 0.0])), "product_moment"),
        (lambda: material(youngs_modulus=-1.0), "youngs_modulus is -1.0"),
        (lambda: material(poisson_ratio=0.5), "poisson_ratio is 0.5"),
        (lambda: material(density=float("nan")), "density is nan"),
        (lambda: meshed(5.0, forced=[5.1, 2.0]), r"\[5\.1\] m lie off the rail"),
        (lambda: meshed(5.0, forced=[float("nan")]), "nan"),
        (lambda: meshed(0.0), "no length"),
        (lambda: meshed(1.0, element_length=0.0), "allowed is above 0"),
    ],
)
def test_what_cannot_be_is_refused(make, text):
    with pytest.raises(MechanicsError, match=text):
        make()


def meshed(end, *, element_length=0.25, forced=()):
    return mesh_nodes(0.0, end, element_length=element_length, forced=forced)


class TestMesh:
    """Forced nodes are exact, elements are no longer than allowed."""

    forced = (0.6, 1.0 / 3.0, 4.123456789, 0.61)

    def test_forced_positions_are_nodes_exactly(self):
        x = mesh_nodes(-0.2, 5.0, element_length=0.25, forced=self.forced)
        assert set(self.forced) | {-0.2, 5.0} <= set(x.tolist())

    def test_elements_are_short_enough_and_not_more_than_needed(self):
        x = mesh_nodes(-0.2, 5.0, element_length=0.25, forced=self.forced)
        assert np.all(np.diff(x) > 0.0)
        assert np.diff(x).max() <= 0.25
        ends = np.sort([-0.2, 5.0, *self.forced])
        assert x.size == 1 + sum(np.ceil(np.diff(ends) / 0.25))

    def test_even_division_is_not_upset_by_rounding(self):
        length = 0.1 + 0.2
        assert length / 0.1 > 3.0
        assert mesh_nodes(0.0, length, element_length=0.1).size == 4

    def test_elements_between_forced_nodes_are_equal(self):
        x = mesh_nodes(0.0, 1.0, element_length=0.3, forced=[0.1])
        np.testing.assert_allclose(np.diff(x), [0.1, 0.3, 0.3, 0.3], rtol=1e-12)

    def test_close_positions_become_one_node(self):
        close = [0.5, 0.5 + 0.5 * MERGE_DISTANCE, 0.5 * MERGE_DISTANCE, 1.0 - 0.5 * MERGE_DISTANCE]
        x = mesh_nodes(0.0, 1.0, element_length=1.0, forced=close)
        assert x.tolist() == [0.0, 0.5, 1.0]

    def test_positions_just_apart_stay_apart(self):
        x = mesh_nodes(0.0, 1.0, element_length=1.0, forced=[0.5, 0.5 + 2.0 * MERGE_DISTANCE])
        assert x.size == 4

    def test_every_forced_position_lies_at_a_node(self):
        chain = 0.5 + 0.4 * MERGE_DISTANCE * np.arange(9)
        x = mesh_nodes(0.0, 1.0, element_length=1.0, forced=chain)
        distance = np.abs(chain[:, None] - x).min(axis=1)
        assert distance.max() < MERGE_DISTANCE
