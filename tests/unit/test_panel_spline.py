"""Cubic splines, held against those of SciPy and against a cubic itself."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from turnout.panel.profile import cubic_spline

KNOTS = [0.0, 0.7, 1.9, 2.2, 4.0]


@pytest.mark.parametrize(
    ("count", "ends"),
    [
        (2, ("natural", "clamped")),
        (3, ("natural", "clamped")),
        (3, ("not-a-knot", "not-a-knot")),
        (5, ("natural", "clamped")),
        (5, ("clamped", "natural")),
        (5, ("not-a-knot", "not-a-knot")),
        (5, ("not-a-knot", "natural")),
    ],
)
def test_values_and_slopes_are_those_of_another_program(count: int, ends: tuple[str, str]) -> None:
    knots = np.array(KNOTS[:count])
    values = np.random.default_rng(count).normal(size=(count, 3))
    ours, theirs = cubic_spline(knots, values, ends=ends), CubicSpline(knots, values, bc_type=ends)
    places = np.linspace(knots[0] - 0.5, knots[-1] + 0.5, 41)
    np.testing.assert_allclose(ours(places), theirs(places), rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(ours.slopes, theirs(knots, 1), rtol=1e-12, atol=1e-12)


def test_a_cubic_comes_back_whole() -> None:
    cube = np.polynomial.Polynomial([1.0, -2.0, 0.5, 3.0])
    spline = cubic_spline(KNOTS, cube(np.array(KNOTS)), ends=("not-a-knot", "not-a-knot"))
    assert float(spline(3.1)) == pytest.approx(cube(3.1), rel=1e-13)
