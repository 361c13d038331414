"""What the page says of facts f and d beyond the facts themselves."""

import numpy as np
import pytest
from tests.verification.fact_scans import STIFFNESSES, least_size, slopes
from tests.verification.facts import FRICTIONS


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_size_seen_grows_with_friction_where_drive_2_is_not_pressed_home(share: float) -> None:
    found = [least_size(share, friction) for friction in FRICTIONS]
    sizes = [item.size for item in found]
    assert np.all(np.diff(sizes) >= 0)
    assert sizes[-1] >= sizes[0] + 3


def test_it_does_not_where_the_closing_force_presses_drive_2_home() -> None:
    """At 0.1 and 0.2 the rail lies on its stock rail at Drive 2, which then shares the force."""
    found = [least_size(1.0, friction) for friction in FRICTIONS]
    assert [item.gap < 0.05 for item in found] == [True, True, False, False, False]
    sizes = [item.size for item in found]
    assert sizes[1] > sizes[2]
    assert np.all(np.diff(sizes[2:]) > 0)


def test_only_the_filtered_slope_can_be_the_papers() -> None:
    """A slip level of 6 kN, averaged over 0.1 s, rises by 60 kN/s at most."""
    stiff, paper = 7500e3, STIFFNESSES[7500e3]
    feature, plain = slopes(stiff)
    assert feature == pytest.approx(paper, rel=0.3)
    assert plain > 2.5 * paper
    assert feature < 60.0
