"""Solid sections against closed forms, with the order at which the mesh approaches them.

Energies converge at twice the order of the quadratic elements' gradients: order 4 where the
solution is smooth. A polygon for a circle errs at order 2 in its corners. At a re-entrant right
angle the stress grows as r^(-1/3), and whatever the elements the order is 4/3.
"""

import numpy as np
import pytest
from tests.verification.section_shapes import (
    circle_shear_factor,
    rectangle,
    rectangle_shear_factor,
    rectangle_torsion,
    ring,
)

from turnout.beam.outline import Outline, make_outline
from turnout.beam.section_analysis import SectionAnalysis, analyse_outline

SIDE = 0.1


def analyses(outline: Outline, *, levels: range, poisson_ratio: float) -> list[SectionAnalysis]:
    """Refine the same coarse triangles again and again."""
    return [
        analyse_outline(
            outline, element_length=SIDE, refinements=level, poisson_ratio=poisson_ratio
        )
        for level in levels
    ]


def observed(errors: np.ndarray) -> np.ndarray:
    """Return the orders between successive halvings."""
    return np.log2(errors[:-1] / errors[1:])


class TestTriangleTorsion:
    """The warping of an equilateral triangle is a cubic: smooth, and not exact in quadratics."""

    rate, eps = 4.0, 0.1
    outline = make_outline([[0, 0], [SIDE, 0], [0.5 * SIDE, 0.75**0.5 * SIDE]])
    exact = 3**0.5 * SIDE**4 / 80

    def test_order(self) -> None:
        runs = analyses(self.outline, levels=range(1, 6), poisson_ratio=0.3)
        values = np.array([run.properties.torsion_constant[0] for run in runs])
        errors = values / self.exact - 1
        assert np.all(errors > 0.0), "from above"
        np.testing.assert_allclose(observed(errors), self.rate, atol=self.eps)
        assert errors[-1] < 1e-6


class TestRectangleShear:
    """Without Poisson's ratio the stress is a parabola over the depth: 5/6, however wide."""

    rate, eps = 4.0, 0.1
    outline = rectangle(2 * SIDE, SIDE)
    exact = 5 / 6

    def test_order(self) -> None:
        runs = analyses(self.outline, levels=range(1, 5), poisson_ratio=0.0)
        for name in ("shear_factor_vertical", "shear_factor_lateral"):
            errors = np.array([getattr(r.properties, name)[0] for r in runs]) / self.exact - 1
            np.testing.assert_allclose(observed(errors), self.rate, atol=self.eps)


class TestCircle:
    """A polygon of n corners inside the circle, on a mesh fine enough not to matter."""

    rate, eps = 2.0, 0.1
    corners = (16, 32, 64, 128)

    def test_order(self) -> None:
        runs = [
            analyse_outline(make_outline(ring(SIDE, count)), refinements=3)
            for count in self.corners
        ]
        torsion = np.array([run.properties.torsion_constant[0] for run in runs])
        errors = 1 - torsion / (0.5 * np.pi * SIDE**4)
        np.testing.assert_allclose(observed(errors), self.rate, atol=self.eps)
        assert errors[-1] < 2e-3

    @pytest.mark.parametrize("poisson_ratio", [0.0, 0.3, 0.5])
    def test_shear_factor(self, poisson_ratio: float) -> None:
        run = analyse_outline(make_outline(ring(SIDE, 128)), poisson_ratio=poisson_ratio)
        wanted = circle_shear_factor(poisson_ratio)
        # 128 corners leave 2e-4 of the factor.
        assert run.properties.shear_factor_vertical[0] == pytest.approx(wanted, rel=5e-4)
        assert run.properties.shear_factor_lateral[0] == pytest.approx(wanted, rel=5e-4)
        assert run.warping_constant[0] < 1e-6 * SIDE**6


class TestReentrantCorner:
    """An L of three squares; no closed form, so the steps between levels must shrink in order."""

    rate, eps = 4 / 3, 0.1
    outline = make_outline(
        SIDE * np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], dtype=float)
    )

    def test_order(self) -> None:
        runs = analyses(self.outline, levels=range(3, 7), poisson_ratio=0.3)
        torsion = np.array([run.properties.torsion_constant[0] for run in runs])
        assert observed(-np.diff(torsion))[-1] == pytest.approx(self.rate, abs=self.eps)

    def test_error_estimate_is_no_less_than_the_error(self) -> None:
        coarse, fine = analyses(self.outline, levels=range(2, 7, 4), poisson_ratio=0.3)
        errors = {
            "error_torsion": "torsion_constant",
            "error_shear_factor": "shear_factor_vertical",
        }
        for estimate, name in errors.items():
            exact = getattr(fine.properties, name)[0]
            error = abs(getattr(coarse.properties, name)[0] / exact - 1)
            assert error < getattr(coarse, estimate)[0] < 20 * error


@pytest.mark.parametrize("poisson_ratio", [0.0, 0.3, 0.5])
@pytest.mark.parametrize(("width", "height"), [(1.0, 1.0), (1.0, 2.0), (3.0, 1.0)])
def test_rectangle(width: float, height: float, poisson_ratio: float) -> None:
    run = analyse_outline(
        rectangle(width * SIDE, height * SIDE), poisson_ratio=poisson_ratio, refinements=3
    )
    long, short = max(width, height) * SIDE, min(width, height) * SIDE
    found = run.properties
    # Three refinements leave up to 1e-4: the squares' warping has r^2 log r in its corners.
    assert found.torsion_constant[0] == pytest.approx(rectangle_torsion(long, short), rel=2e-4)
    vertical = rectangle_shear_factor(height, width, poisson_ratio)
    lateral = rectangle_shear_factor(width, height, poisson_ratio)
    assert found.shear_factor_vertical[0] == pytest.approx(vertical, rel=1e-4)
    assert found.shear_factor_lateral[0] == pytest.approx(lateral, rel=1e-4)
    assert abs(found.shear_centre_y[0]) + abs(found.shear_centre_z[0]) < 1e-6 * SIDE
    assert abs(run.shear_coupling[0]) < 1e-6


def test_rectangle_second_moments_are_exact() -> None:
    found = analyse_outline(rectangle(0.3, 0.2)).properties
    assert found.area[0] == pytest.approx(0.06, rel=1e-14)
    assert found.second_moment_vertical[0] == pytest.approx(0.3 * 0.2**3 / 12, rel=1e-14)
    assert found.second_moment_lateral[0] == pytest.approx(0.2 * 0.3**3 / 12, rel=1e-14)
