"""Gauge beside a closed blade against another program, at rest and under a wheel.

Reference: tests/verification/gauge_by_hand.py (beams by their section forces, a convex energy over
the forces of all laws, friction by return mapping in small steps). Tolerance: 0.05 mm at rest,
0.1 mm anywhere under the wheel; friction in steps of 60 mm of the wheel leaves half of that.
"""

from functools import cache

import numpy as np
import pytest
from tests.verification.gauge_by_hand import State, Switch, gauge_of, rolled, thrown

from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.throw.wheel import Course, gauge_under_wheel

AT_REST, UNDER_WHEEL = 0.05e-3, 0.1e-3
PLACES = np.round(np.arange(0.0, 7.21, 0.3), 9)


@cache
def state_of(trapped: bool) -> State:
    panel = load_panel("uic60-760-1-15")
    return thrown(Switch(panel, size=0.013 if trapped else 0.0, at=3.6), trapped=trapped)


def compared(lateral: float, vertical: float, *, trapped: bool, course: Course = "facing") -> None:
    state = state_of(trapped)
    x = state.switch.blades["straight"].x
    item = ForeignObject("13 mm", "sleeper 6") if trapped else None
    found = gauge_under_wheel(
        load_panel("uic60-760-1-15"),
        lateral=lateral,
        vertical=vertical,
        foreign_object=item,
        course=course,
    )
    np.testing.assert_allclose(found["x"], x, atol=1e-9)
    np.testing.assert_allclose(found["gauge_at_rest"], gauge_of(state), rtol=0, atol=AT_REST)
    places = PLACES if course == "facing" else found["wheel"].to_numpy()[::-1]
    theirs = rolled(state, lateral=lateral, vertical=vertical, places=places)
    ours = found["gauge"].isel(load=0).sel(wheel=places, method="nearest")
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=UNDER_WHEEL)


def test_an_object_levers_the_blade_that_a_wheel_presses_and_loads() -> None:
    compared(40e3, 50e3, trapped=True)


@pytest.mark.long
@pytest.mark.parametrize(
    ("lateral", "vertical", "trapped"),
    [(40e3, 0.0, True), (5e3, 112e3, True), (20e3, 50e3, False)],
)
def test_other_loads(lateral: float, vertical: float, *, trapped: bool) -> None:
    compared(lateral, vertical, trapped=trapped)


@pytest.mark.long
def test_a_wheel_from_the_heel() -> None:
    compared(40e3, 50e3, trapped=True, course="trailing")
