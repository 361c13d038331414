"""The least coverage of a band, from drawn campaigns of a right model."""

import numpy as np
import pytest
from scipy.stats import binom

from turnout.calibration.validation.prediction_bands import (
    ENOUGH,
    Floats,
    ThrowScatter,
    coverage_limits,
)

Parts = tuple[Floats, Floats, ThrowScatter]


def parts(
    *,
    movements: int,
    instants: int,
    own: float = 0.0,
    common: float = 0.0,
    decay: float = 0.0,
    freedom: float = 1e6,
) -> Parts:
    """A channel whose forces differ by unit noise, by friction of each throw and by a value."""
    shape = (1, movements, instants)
    total = np.sqrt(1.0 + own**2 + common**2)
    scatter = ThrowScatter(
        own=np.full((1, *shape), own),
        sizes=np.ones(1),
        freedom=np.array([freedom]),
        rest=np.ones(1),
        decay=np.array([decay]),
    )
    return np.full(shape, 1.959964 * total), np.full((1, *shape), common), scatter


def test_independent_instants_count_one_each() -> None:
    """With n of them the binomial distribution gives the limit."""
    limit, samples = coverage_limits(*parts(movements=5, instants=8))
    assert samples[0] == pytest.approx(40.0, rel=0.25)
    assert limit[0] == pytest.approx(binom.ppf(0.05, 40, 0.95) / 40, abs=1 / 40)


def test_what_a_throw_has_of_its_own_makes_its_instants_one() -> None:
    """Friction a hundred times the noise: in or out with the whole movement."""
    limit, samples = coverage_limits(*parts(movements=10, instants=200, own=100.0))
    assert samples[0] == pytest.approx(10.0, rel=0.25)
    assert 0.75 < limit[0] < 0.88


def test_what_all_movements_share_makes_them_one() -> None:
    _, samples = coverage_limits(*parts(movements=10, instants=200, common=100.0))
    assert samples[0] < 2.0


def test_a_rest_that_decays_slowly_is_worth_less() -> None:
    quick = coverage_limits(*parts(movements=4, instants=250))[1][0]
    slow = coverage_limits(*parts(movements=4, instants=250, decay=20.0))[1][0]
    # An exponential correlation leaves n / (2 decay) of n instants, for the band somewhat more.
    assert 1000.0 / 40.0 < slow < 0.15 * quick


def test_few_repeats_leave_the_size_of_the_scatter_open() -> None:
    known = parts(movements=10, instants=100, own=5.0)
    few = parts(movements=10, instants=100, own=5.0, freedom=1.0)
    assert coverage_limits(*few)[0][0] < coverage_limits(*known)[0][0] - 0.05


def test_nine_tenths_are_enough_and_what_was_not_measured_has_no_limit() -> None:
    made = parts(movements=60, instants=100)
    assert coverage_limits(*made)[0][0] == ENOUGH
    made[0][:] = np.nan
    limit, samples = coverage_limits(*made)
    assert np.isnan(limit[0])
    assert np.isnan(samples[0])
