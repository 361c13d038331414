"""Thermal length of a switch rail: how far the gap changes as its planed face moves along.

Reference: the numbers of docs/theory/mechanism.md, which the page calls negligible; closed form.
"""

import numpy as np
import pytest

from turnout.panel.load import load_panel

EXPANSION = 1.15e-5


@pytest.mark.parametrize(
    ("warmer", "fixed", "most", "toe"),
    [
        (40.0, 15.0, 0.044e-3, 6.9e-3),
        (40.0, 18.6, 0.065e-3, 8.6e-3),
        (60.0, 15.0, 0.066e-3, 10.4e-3),
        (60.0, 18.6, 0.097e-3, 12.8e-3),
    ],
)
def test_the_gap_changes_by_less_than_a_tenth_of_a_millimetre(
    warmer: float, fixed: float, most: float, toe: float
) -> None:
    edge = load_panel("uic60-760-1-15").rail["curved"].running_edge
    assert edge is not None
    x = np.linspace(0.0, fixed, 2001)
    along = EXPANSION * warmer * (fixed - x)
    gap = (x + edge.lead) / edge.radius * along
    assert gap.max() == pytest.approx(most, rel=0.01)
    assert 6.0 < x[gap.argmax()] < 8.5
    assert along[0] == pytest.approx(toe, rel=0.01)
