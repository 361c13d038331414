"""What is said of the vibrations of a panel in motion."""

import numpy as np
import pytest

from turnout.core.errors import ResponseError
from turnout.metric.stability import (
    FrictionStability,
    SlidingCase,
    friction_stability,
    sliding_places,
)
from turnout.panel.load import load_panel

NAN = float("nan")


def case(growth: float, *, share: float = 0.5, frequency: float = 120.0) -> SlidingCase:
    return SlidingCase("return", "closed", share, True, frequency, -growth / 750.0, growth)


def test_places_lie_between_the_ends_of_each_movement() -> None:
    panel = load_panel("uic60-760-1-15")
    opening, closing = sliding_places(panel, shares=(0.5,))
    assert (opening.to, opening.sense, closing.sense) == ("open", -1.0, 1.0)
    # half-way between over-travel closed and over-travel open, from 27 % of the strokes
    half = np.array([0.5 * (4.0 - 117.0) + 0.27 * 115.0, 0.5 * (3.8 - 87.0) + 0.27 * 80.0]) / 1e3
    assert opening.inputs == pytest.approx(half)
    assert closing.inputs == pytest.approx(half)


def test_worst_case_is_the_one_that_grows_fastest() -> None:
    found = FrictionStability(1.0, (case(-3.0), case(2.0, share=0.7), case(1.0)), 600.0)
    assert not found.stable
    assert found.worst.share == 0.7
    assert "70 % of movement 'return': 120.0 Hz, damping -0.27 % of critical" in str(found)


def test_a_stable_panel_is_said_to_be_so() -> None:
    found = FrictionStability(1.25, (case(-3.0),), 600.0)
    assert found.stable
    assert "decay" in str(found)


def test_growth_without_swing_is_called_divergence() -> None:
    assert "run away" in str(FrictionStability(1.0, (case(1.0, frequency=0.0),), 600.0))


def test_a_place_without_steady_sliding_is_not_called_stable() -> None:
    lost = SlidingCase("throw", "open", 0.1, False, NAN, NAN, NAN)
    found = FrictionStability(1.0, (lost, case(-3.0)), 600.0)
    assert not found.stable
    assert found.worst.growth_rate == -3.0
    assert "no steady sliding was found in 1 of 2" in str(found)


@pytest.mark.parametrize("factor", [0.0, -1.0, NAN, float("inf")])
def test_factor_must_be_positive(factor: float) -> None:
    with pytest.raises(ResponseError, match="friction_factor"):
        friction_stability(load_panel("sb1"), friction_factor=factor)
