"""Orders of the whole chain in element length and step; reference and tolerances in `orders`."""

import numpy as np
import pytest
from tests.verification import orders as case


class TestElementLength:
    """Lateral frequencies of the panel SB1 against the exact Timoshenko beam on springs."""

    rate = 2.0
    eps = 0.1

    def test_order(self) -> None:
        np.testing.assert_allclose(case.element_rates(), self.rate, atol=self.eps)

    def test_the_rail_itself_is_exact_to_a_hundredth_of_a_permille(self) -> None:
        errors = case.frequency_errors(case.ELEMENT_LENGTHS[1], case.SHEAR)
        assert np.all(errors > 0.0)  # elements are never too soft
        assert errors.max() < 1e-5


@pytest.mark.parametrize("spectral_radius", case.RADII)
class TestStep:
    """Force of Drive 2 on the way, where no law changes its segment."""

    rate = 2.0
    eps = 0.1

    def test_order(self, spectral_radius: float) -> None:
        rates = case.step_rates(spectral_radius)
        np.testing.assert_allclose(rates, self.rate, atol=self.eps)
        error = case.force_error(case.STEPS[0], spectral_radius)
        assert abs(error) < 1e-4 * case.exact_force()


def test_the_page_shows_what_is_asserted_here() -> None:
    for check in case.checks():
        assert check.passed, str(check)
