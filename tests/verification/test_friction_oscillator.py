"""Oscillator with an elastic-plastic foot, stick-slip and ring-down.

Reference: between events the motion is harmonic, in closed form; events (stick to slip, slip to
stick) are found with brentq to 1e-14 s and phases are joined. Ring-down without stick spring: the
amplitude falls by 4 mu N / k a cycle (Lorenz 1924). On a moving base with one coefficient for stick
and slip the amplitude of the steady swing is v / omega at a stiff foot.
Tolerance: 0.5 % of the amplitude at 100 steps a period, falling with the step at order 1 or better.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import brentq
from tests.verification.hand_made import energy_residual, hand_made, linear_spring, run

from turnout.integrate.run import History
from turnout.law.table import LawTableBuilder

MASS, SPRING, STICK, LIMIT = 2.0, 8e3, 1e7, 30.0
OMEGA = np.sqrt(SPRING / MASS)
PERIOD = 2 * np.pi / OMEGA


@dataclass
class Phase:
    """Harmonic motion from `start`: x = offset + drift s + a cos(w s) + b sin(w s)."""

    start: float
    omega: float
    offset: float
    drift: float
    a: float
    b: float

    def x(self, t: float | np.ndarray) -> float | np.ndarray:
        s = t - self.start
        return (
            self.offset
            + self.drift * s
            + self.a * np.cos(self.omega * s)
            + self.b * np.sin(self.omega * s)
        )

    def v(self, t: float) -> float:
        s = self.omega * (t - self.start)
        return self.drift + self.omega * (self.b * np.cos(s) - self.a * np.sin(s))


def first_root(function: Callable[[float], float], start: float, end: float) -> float | None:
    """Return the first upward crossing of zero after `start`."""
    grid = np.linspace(start, end, 20001)[1:]
    values = np.array([function(t) for t in grid])
    up = np.flatnonzero((values[:-1] <= 0) & (values[1:] > 0))
    return brentq(function, grid[up[0]], grid[up[0] + 1], xtol=1e-14) if up.size else None


def exact(x: float, *, u0: float, speed: float, end: float, stick: float) -> list[Phase]:
    """Join closed-form phases of a mass at rest at `x`, pulled from u0 + speed t; foot at rest."""
    beyond = LIMIT * (1 + 1e-9)  # a swing that only grazes the limit stays stuck
    t, v, anchor, branch, phases = 0.0, 0.0, x, 0, []
    while t < end:
        total = SPRING + (stick if branch == 0 else 0.0)
        foot = stick * anchor if branch == 0 else -branch * LIMIT
        omega = np.sqrt(total / MASS)
        offset = (SPRING * (u0 + speed * t) + foot) / total
        drift = SPRING * speed / total
        phase = Phase(t, omega, offset, drift, x - offset, (v - drift) / omega)
        phases.append(phase)
        if branch == 0:  # stuck until the limit
            event = first_root(
                lambda s, p=phase, a=anchor: abs(stick * (p.x(s) - a)) - beyond, t, end
            )
        else:  # slipping until the velocity turns round
            event = first_root(lambda s, p=phase, d=branch: -d * p.v(s), t, end)
        if event is None:
            return phases
        x, v, t = phase.x(event), phase.v(event), event
        if branch == 0:
            branch = int(np.sign(x - anchor))
        else:
            anchor, branch = x - branch * LIMIT / stick, 0
    return phases


def exact_path(phases: list[Phase], time: np.ndarray) -> np.ndarray:
    starts = np.array([p.start for p in phases])
    which = np.searchsorted(starts, time, side="right") - 1
    return np.array([phases[k].x(t) for k, t in zip(which, time, strict=True)])


def simulate(
    marker: Callable[[np.ndarray], np.ndarray], *, end: float, step: float, stick: float = STICK
) -> History:
    laws = LawTableBuilder()
    linear_spring(laws, 0, SPRING, input_index=0)
    normal = laws.add_contact(1, stiffness=1e7, clearance=0.0, base_closed=True)
    laws.add_friction(0, normal=normal, friction_coefficient=0.3, stick_stiffness=stick)
    mechanism = hand_made(laws, mass=[MASS, MASS], load=[0.0, LIMIT / 0.3])
    return run(mechanism, marker, end=end, step=step, spectral_radius=0.9)


def jump(amplitude: float) -> Callable[[np.ndarray], np.ndarray]:
    """Marker that jumps at once from 0 to `amplitude`."""
    return lambda t: np.where(t > 0, amplitude, 0.0)


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
    amplitude, end = 0.02, 4 * PERIOD
    phases = exact(0.0, u0=amplitude, speed=0.0, end=end, stick=stick)
    assert len(phases) > 5
    errors = []
    for steps in (100, 400):
        history = simulate(jump(amplitude), end=end, step=PERIOD / steps, stick=stick)
        # a marker that jumps within the first step is, on average, half a step late
        reference = exact_path(phases, np.maximum(history.time - 0.5 * PERIOD / steps, 0.0))
        errors.append(np.max(np.abs(history.g[:, 0] - reference)) / amplitude)
        assert energy_residual(history) < 1e-6
    assert errors[0] < 5e-3
    assert errors[1] < errors[0] / 8


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
