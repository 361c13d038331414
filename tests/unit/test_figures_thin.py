"""Thinned curves: every peak and every tear of them."""

import numpy as np

from turnout.figures.sheet import thinned


def test_a_spike_survives_thinning() -> None:
    time = np.arange(1_000_000) / 1000
    values = np.sin(time)
    values[654_321] = 50.0
    values[1000:200_000] = np.nan
    shown_time, shown = thinned(time, values, most=2000)
    assert shown.size <= 2000
    assert np.all(np.diff(shown_time) >= 0)
    assert shown_time[np.nanargmax(shown)] == time[654_321]
    assert np.nanmax(shown) == 50.0
    assert np.isnan(shown[(shown_time > 3) & (shown_time < 198)]).all()


def test_a_tear_of_one_point_survives_thinning() -> None:
    time = np.arange(10_000.0)
    values = np.sin(time / 500)
    values[4_321] = np.nan
    shown_time, shown = thinned(time, values, most=600)
    assert shown_time[np.isnan(shown)].tolist() == [4_321.0]
    assert (shown_time[0], shown_time[-1]) == (0.0, 9_999.0)


def test_a_short_curve_stays_as_it_is() -> None:
    values = np.array([1.0, np.nan, 3.0])
    np.testing.assert_array_equal(thinned(np.arange(3.0), values, most=5)[1], values)
