"""An object between two rails; derivation, reference and tolerances in `two_rails`."""

import numpy as np
import pytest
from tests.verification import two_rails as case


def test_force_and_motion_are_those_of_the_closed_forms() -> None:
    for check in case.checks():
        assert check.passed, str(check)


def test_the_object_is_touched_on_the_way() -> None:
    found = case.clamped()
    share = np.mean(found.object > 0)
    assert 0.2 < share < 0.9
    np.testing.assert_array_equal(found.object > 0, found.exact_object > 0)
    assert found.residual < 1e-6


def test_a_rigid_second_rail_would_be_noticed() -> None:
    """The second rail yields so much that leaving it out changes the force by a tenth or more."""
    both = case.influence(case.LONG - case.OBJECT_X, case.LONG - case.OBJECT_X)
    other = case.influence(case.SHORT - case.OTHER_X, case.SHORT - case.OTHER_X)
    assert other > 0.1 * both


def test_the_blow_passes_from_one_rail_to_the_other() -> None:
    found = case.blow()
    after = found.time > 1.0
    assert np.all(found.force[found.time > 1.01] == 0.0)
    swing = case.TIP
    first, second = np.abs(found.tips[after]).max(axis=0)
    # the speed passed on is (1 + cos(omega tau)) / 2 of that before
    passed = 0.5 * (1 + np.cos(case.OMEGA * case.DURATION))
    late = np.argmin(np.abs(found.time - 1.0))
    speed = np.gradient(found.tips, found.time * case.DURATION, axis=0)[late + 5]
    assert speed[1] == pytest.approx(passed * swing * case.OMEGA, rel=0.02)
    assert second > first
    assert found.residual < 1e-6
