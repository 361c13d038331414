"""Oscillator with an elastic-plastic foot, stick-slip and ring-down.

Reference: between events the motion is harmonic, in closed form; events (stick to slip, slip to
stick) are found with brentq to 1e-14 s and phases are joined. Ring-down without stick spring: the
amplitude falls by 4 mu N / k a cycle (Lorenz 1924). On a moving base with one coefficient for stick
and slip the amplitude of the steady swing is v / omega at a stiff foot.
Tolerance: 0.5 % of the amplitude at 100 steps a period, falling with the step at order 1 or better.
"""

import numpy as np
import pytest
from tests.verification import stick_slip
from tests.verification.hand_made import energy_residual
from tests.verification.stick_slip import (
    LIMIT,
    OMEGA,
    PERIOD,
    SPRING,
    STICK,
    exact,
    exact_path,
    jump,
    simulate,
)


def test_ring_down_loses_four_mu_n_over_k_a_cycle_and_stops() -> None:
    amplitude = 0.06
    history = simulate(jump(amplitude), end=1.0, step=PERIOD / 400)
    swing = history.g[:, 0] - amplitude
    inner = (np.abs(swing[1:-1]) >= np.abs(swing[:-2])) & (np.abs(swing[1:-1]) > np.abs(swing[2:]))
    slow = 2 * LIMIT / SPRING
    peaks = np.abs(swing[1:-1][inner])[:6]
    expected = amplitude - slow * np.arange(1, 7)
    np.testing.assert_allclose(peaks, expected, atol=2e-3 * amplitude)
    times = history.time[1:-1][inner][:6]
    np.testing.assert_allclose(times, np.arange(1, 7) * PERIOD / 2, rtol=0, atol=0.02 * PERIOD)
    # it stops in the first turning point from which the spring cannot move it
    stops = amplitude - slow * np.ceil((amplitude - LIMIT / SPRING) / slow)
    assert abs(swing[-1]) == pytest.approx(abs(stops), abs=4e-3 * amplitude)
    assert abs(swing[-1]) * SPRING < LIMIT
    assert energy_residual(history) < 1e-6


@pytest.mark.parametrize("stick", [2e4, 2e5])
def test_the_path_with_an_elastic_foot_equals_joined_harmonics(stick: float) -> None:
    assert len(exact(0.0, u0=0.02, speed=0.0, end=4 * PERIOD, stick=stick)) > 5
    coarse, fine = (stick_slip.released(stick, steps=steps) for steps in (100, 400))
    assert coarse.error < 5e-3
    assert fine.error < coarse.error / 8
    assert max(coarse.residual, fine.residual) < 1e-6


def test_a_block_on_a_belt_sticks_and_slips_as_the_closed_form_says() -> None:
    coarse, fine = (stick_slip.on_a_belt(steps=steps) for steps in (100, 400))
    assert coarse.error < 2e-2
    assert fine.error < coarse.error / 8
    assert max(coarse.residual, fine.residual) < 1e-6
    speed = np.gradient(fine.found, fine.time)
    assert speed.max() > stick_slip.BELT_SPEED  # carried along
    assert speed.min() < -0.5 * stick_slip.BELT_SPEED  # and slipping back


def test_the_page_shows_what_is_asserted_here() -> None:
    for check in stick_slip.checks():
        assert check.passed, str(check)


def test_on_a_moving_base_the_swing_has_the_period_and_amplitude_of_the_closed_form() -> None:
    speed = 0.05
    end = 6 * PERIOD
    phases = exact(0.0, u0=0.0, speed=speed, end=end, stick=STICK)
    history = simulate(lambda t: speed * t, end=end, step=PERIOD / 400)
    reference = exact_path(phases, history.time)
    amplitude = speed / OMEGA
    assert np.max(np.abs(history.g[:, 0] - reference)) < 0.02 * amplitude
    # once away the spring's stretch swings about mu N / k by v / omega
    away = history.time > LIMIT / (SPRING * speed) + 0.1 * PERIOD
    stretch = history.inputs[away, 0] - history.g[away, 0]
    assert np.ptp(stretch) / 2 == pytest.approx(amplitude, rel=0.02)
    assert 0.5 * (stretch.max() + stretch.min()) == pytest.approx(LIMIT / SPRING, rel=5e-3)
    middle = stretch - LIMIT / SPRING
    up = np.flatnonzero((middle[:-1] < 0) & (middle[1:] >= 0))
    crossing = history.time[away][up] - middle[up] / np.diff(middle)[up] * np.diff(history.time)[0]
    np.testing.assert_allclose(np.diff(crossing), PERIOD, rtol=5e-3)
    assert energy_residual(history) < 1e-6
