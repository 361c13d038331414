"""A rail dragged over a friction bed; derivation, reference and tolerances in `friction_bed`."""

import numpy as np
import pytest
from tests.verification import friction_bed as case


def test_the_closed_form_satisfies_beam_and_bed() -> None:
    """Its pieces join with slope, moment and shear, and the end carries the force alone."""
    force = 0.5 * (1 + case.REACH) * case.STRENGTH / case.BETA
    length = float(case.slip_length(force))
    assert length == pytest.approx(case.REACH / case.BETA, rel=1e-12)
    assert case.validity() > case.REACH
    assert case.shape(force, np.array([length]))[0] == pytest.approx(case.YIELD, rel=1e-12)
    end = case.shape(force, np.zeros(1))[0]
    assert end == pytest.approx(float(case.end_displacement(force)), rel=1e-12)
    x = np.linspace(0.0, 20.0, 200001)
    w = case.shape(force, x)
    bed = np.where(x < length, case.STRENGTH, case.BED * w)
    assert np.trapezoid(bed, x) == pytest.approx(force, rel=1e-4)
    assert abs(np.trapezoid(bed * x, x)) < 1e-4 * force / case.BETA
    assert np.all(np.abs(w[x > length]) <= case.YIELD)
    h = 0.01
    at = length + np.array([-2, -1, 0, 1, 2]) * h
    value = case.shape(force, at) / case.YIELD
    left, right = value[2] - 2 * value[1] + value[0], value[4] - 2 * value[3] + value[2]
    assert left == pytest.approx(right, rel=0.05)


def test_slip_length_and_end_follow_the_closed_form() -> None:
    for check in case.checks():
        assert check.passed, str(check)


class TestSpacing:
    """Chairs at the middle of equal cells stand for the bed like the midpoint rule."""

    rate = 2.0
    eps = 0.1

    def test_order(self) -> None:
        np.testing.assert_allclose(case.rates(), self.rate, atol=self.eps)


def test_the_shape_is_that_of_the_closed_form() -> None:
    found = case.dragged(case.SPACINGS[-1])
    exact = case.shape(found.force[-1], found.x)
    np.testing.assert_allclose(found.shape, exact, rtol=0, atol=2e-3 * exact.max())
    assert found.shape.min() < -0.5 * case.YIELD  # beyond the front it is pushed back
    assert found.residual < 1e-6


def test_a_bed_of_half_the_strength_does_not_pass() -> None:
    found = case.dragged(case.SPACINGS[-1])
    wrong = 2 * found.force[-1] / (0.5 * case.STRENGTH) - 1 / case.BETA
    assert abs(found.slip_length[-1] / wrong - 1) > 0.1
