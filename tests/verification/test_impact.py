"""A rail against a stop; derivation, reference and tolerances in `impact`."""

import numpy as np
import pytest
from tests.verification import impact as case


def test_contact_time_force_and_momentum_are_those_of_the_closed_forms() -> None:
    for check in case.checks():
        assert check.passed, str(check)


class TestRestitution:
    """What an impact loses with the default scheme goes with the square of the step."""

    rate = 2.0
    eps = 0.1

    def test_order(self) -> None:
        np.testing.assert_allclose(case.restitution_rates(), self.rate, atol=self.eps)

    @pytest.mark.parametrize("divisions", case.DIVISIONS)
    def test_a_lossless_scheme_scatters_about_one(self, divisions: int) -> None:
        lost = case.lost_restitution(divisions, 1.0)
        scatter = case.scatter(divisions)
        assert abs(lost.mean()) < 0.05 * scatter
        assert np.sqrt(np.mean(lost**2)) == pytest.approx(scatter, rel=0.05)

    def test_the_default_scheme_loses_more_than_it_gains(self) -> None:
        lost = case.lost_restitution(case.DIVISIONS[0])
        assert lost.mean() > 0.0
        assert np.abs(lost).max() < 5e-3


def test_the_closed_form_of_the_rod_keeps_momentum_in_the_limit_of_a_hard_stop() -> None:
    """A stop that is hard against the rod takes 2 M v, and the force is Z v all the time."""
    time = np.linspace(0.0, case.rod_duration(), 20001)
    force = case.rod_force(time)
    assert force[-1] == pytest.approx(0.0, abs=1e-3 * force.max())
    assert force.max() < case.IMPEDANCE * case.SPEED
    brought = case.LINE_MASS * case.ROD * case.SPEED
    assert 1.9 * brought < np.trapezoid(force, time) < 2.0 * brought


def test_the_books_close() -> None:
    assert case.single_mode().residual < 1e-6
    assert case.rod().impact.residual < 1e-6
