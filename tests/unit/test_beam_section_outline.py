"""Outlines as data: what is refused, and what moving one does to its moments."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from turnout.beam.outline import (
    Outline,
    densify,
    make_outline,
    mirror,
    move,
    outline_of,
    polygon_of,
    ring_area,
    rotate,
    scale,
)
from turnout.beam.outline_moments import area_moments, principal_moments
from turnout.core.errors import MechanicsError

SKEW = make_outline([[0, 0], [0.08, 0], [0.07, 0.02], [0.03, 0.03], [0.02, 0.11], [-0.01, 0.12]])
HOLED = make_outline(
    [[0, 0], [0.1, 0], [0.1, 0.2], [0, 0.2]],
    holes=([[0.02, 0.03], [0.06, 0.03], [0.06, 0.1], [0.02, 0.1]],),
)


@pytest.mark.parametrize(
    ("points", "holes", "words"),
    [
        ([[0, 0], [1, 1], [1, 0], [0, 1]], (), "Self-intersection"),
        ([[0, 0], [1, 0]], (), "three or more"),
        ([[0, 0, 0], [1, 0, 0], [1, 1, 0]], (), "three or more"),
        ([[0, 0], [1, np.nan], [1, 1]], (), "point 1 of the outline is not finite"),
        ([[0, 0], [1, 1], [2, 2]], (), "no section"),
        ([[0, 0], [1, 0], [1, 1], [0, 1]], ([[2, 0], [3, 0], [3, 1]],), "lies outside"),
    ],
)
def test_what_is_no_outline_is_refused(
    points: list[list[float]], holes: tuple[list[list[float]], ...], words: str
) -> None:
    with pytest.raises(MechanicsError, match=words):
        make_outline(points, holes=holes)


def test_the_record_wants_its_sense_of_rotation() -> None:
    with pytest.raises(MechanicsError, match="counter-clockwise"):
        Outline(points=np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0]]))


@pytest.mark.parametrize("outline", [SKEW, HOLED], ids=["skew", "holed"])
def test_moments_do_not_depend_on_how_a_boundary_is_given(outline: Outline) -> None:
    backwards = make_outline(
        np.roll(outline.points[::-1], 2, axis=0), holes=tuple(h[::-1] for h in outline.holes)
    )
    for other in (backwards, densify(outline, length=0.007), outline_of(polygon_of(outline))):
        for name in type(area_moments(outline)).__dataclass_fields__:
            wanted = getattr(area_moments(outline), name)
            assert getattr(area_moments(other), name) == pytest.approx(wanted, rel=1e-12), name


def test_hole_is_taken_off() -> None:
    found = area_moments(HOLED)
    assert found.area == pytest.approx(0.02 - 0.0028, rel=1e-14)
    z = (0.02 * 0.1 - 0.0028 * 0.065) / found.area
    assert found.centroid_z == pytest.approx(z, rel=1e-13)
    plate = 0.1 * 0.2**3 / 12 + 0.02 * (0.1 - z) ** 2
    hole = 0.04 * 0.07**3 / 12 + 0.0028 * (0.065 - z) ** 2
    assert found.second_moment_vertical == pytest.approx(plate - hole, rel=1e-13)


def test_densified_edges_are_short_and_on_the_boundary() -> None:
    fine = densify(SKEW, length=0.007)
    edges = np.roll(fine.points, -1, axis=0) - fine.points
    assert np.hypot(*edges.T).max() <= 0.007 * (1 + 1e-9)
    assert ring_area(fine.points) == pytest.approx(ring_area(SKEW.points), rel=1e-13)
    with pytest.raises(MechanicsError, match="must be positive"):
        densify(SKEW, length=0.0)


def test_mirror_turns_the_product_and_the_lateral_position() -> None:
    here, there = area_moments(SKEW), area_moments(mirror(SKEW))
    assert there.product_moment == pytest.approx(-here.product_moment, rel=1e-12)
    assert there.centroid_y == pytest.approx(-here.centroid_y, rel=1e-12)
    assert there.centroid_z == pytest.approx(here.centroid_z, rel=1e-12)
    assert there.second_moment_lateral == pytest.approx(here.second_moment_lateral, rel=1e-12)


@given(
    angle=st.floats(-3.0, 3.0),
    y=st.floats(-10.0, 10.0),
    z=st.floats(-10.0, 10.0),
)
def test_principal_moments_go_with_the_section(angle: float, y: float, z: float) -> None:
    here = principal_moments(area_moments(HOLED))
    there = principal_moments(area_moments(move(rotate(HOLED, angle=angle), y=y, z=z)))
    np.testing.assert_allclose(there[:2], here[:2], rtol=1e-9)
    turn = (there[2] - here[2] - angle) / np.pi
    assert turn == pytest.approx(round(turn), abs=1e-6)


def test_rotation_about_a_point_leaves_it() -> None:
    turned = rotate(SKEW, angle=0.7, about=(0.08, 0.0))
    np.testing.assert_allclose(turned.points[1], [0.08, 0.0], atol=1e-15)


def test_scaling() -> None:
    small, large = area_moments(SKEW), area_moments(scale(SKEW, factor=1000.0))
    assert large.area == pytest.approx(1e6 * small.area, rel=1e-12)
    assert large.product_moment == pytest.approx(1e12 * small.product_moment, rel=1e-12)
    with pytest.raises(MechanicsError, match="must be positive"):
        scale(SKEW, factor=-1.0)
