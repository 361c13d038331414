"""The touch floor from gaps."""

import numpy as np

from turnout.detection.floor import touch_floor, touched


def test_the_floor_touches_in_nine_of_ten_states() -> None:
    gap = np.random.default_rng(2).uniform(0.0, 0.01, (1000, 3))
    floor = touch_floor(gap)
    np.testing.assert_allclose((floor > gap).mean(axis=0), 0.9, atol=2e-3)


def test_a_closed_place_has_no_floor_and_throws_that_failed_do_not_count() -> None:
    gap = np.array([[-1e-5, 2e-3], [-2e-5, np.nan], [-1e-5, 2e-3]])
    np.testing.assert_allclose(touch_floor(gap), [0.0, 2e-3])


def test_touch_is_a_force_at_any_time() -> None:
    assert touched([0.0, 5.0, 5.5]).tolist() == [False, False, True]
