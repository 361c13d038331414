"""Unilateral spring: free fall and bounce, half-sine contact, lift-off and return, objects.

References: closed forms of ballistic and harmonic motion; for the shaken mass an explicit
Runge-Kutta solution with rtol 1e-10 and located events. Tolerances beside the assertions;
energy balances close to 1e-6 in every run.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.verification.hand_made import energy_residual, hand_made, linear_spring, run

from turnout.law.table import LawTableBuilder
from turnout.solver.integration import History

MASS, GRAVITY, CONTACT = 3.0, 9.81, 3e6
BOOKS = 1e-6
OMEGA = np.sqrt(CONTACT / MASS)


def dropped(height: float, *, step: float, end: float, **options: float) -> History:
    """Let go, at t = 0, of a mass that a spring holds `height` above a contact; x points down."""
    laws = LawTableBuilder()
    linear_spring(laws, 0, 1e6, disappears=0.0)
    laws.add_contact(0, stiffness=CONTACT, clearance=height)
    mechanism = hand_made(laws, mass=[MASS], load=[MASS * GRAVITY])
    return run(mechanism, end=end, step=step, **options)


def test_a_dropped_mass_bounces_as_ballistics_and_a_half_sine_say() -> None:
    height = 0.05
    static = MASS * GRAVITY / 1e6
    history = dropped(height, step=2e-5, end=0.35, spectral_radius=1.0)
    fall = height - static
    speed = np.sqrt(2 * GRAVITY * fall)
    force = history.law_force[:, 1]
    touching = np.flatnonzero(force > 0)
    bounds = np.flatnonzero(np.diff(touching) > 1)
    first = touching[: bounds[0] + 1]
    assert history.time[first[0]] == pytest.approx(np.sqrt(2 * fall / GRAVITY), abs=5e-5)
    weight = GRAVITY / OMEGA**2
    duration = 2 * (np.pi - np.arctan(speed * OMEGA / GRAVITY)) / OMEGA
    assert first.size * 2e-5 == pytest.approx(duration, abs=5e-5)
    peak = CONTACT * (weight + np.hypot(weight, speed / OMEGA))
    assert force[first].max() == pytest.approx(peak, rel=2e-3)
    flight = slice(first[-1] + 1, touching[bounds[0] + 1])
    assert history.g[flight, 0].min() == pytest.approx(static, abs=2e-3 * height)
    assert energy_residual(history) < BOOKS


@pytest.mark.parametrize("speed", [0.05, 1.2])
def test_an_impact_lasts_half_a_period_whatever_its_speed(speed: float) -> None:
    """Contact time pi sqrt(m / k), peak force v sqrt(k m), impulse 2 m v; no gravity."""
    spring, reach = 1e3, 0.02
    laws = LawTableBuilder()
    # a load, held until the release, shoots the mass at the contact
    clearance = 0.5 * reach
    linear_spring(laws, 0, spring)
    linear_spring(laws, 0, 1e9, disappears=0.0)
    laws.add_contact(0, stiffness=CONTACT, clearance=clearance)
    omega = np.sqrt(spring / MASS)
    # released at 0 under a load L it reaches the clearance c with v^2 = 2 c L / m - c^2 omega^2
    load = (speed**2 + (clearance * omega) ** 2) * MASS / (2 * clearance)
    history = run(
        hand_made(laws, mass=[MASS], load=[load]), end=0.6, step=1e-5, spectral_radius=1.0
    )
    force = history.law_force[:, 2]
    touching = np.flatnonzero(force > 0)
    gaps = np.flatnonzero(np.diff(touching) > 1)
    first = touching[: gaps[0] + 1] if gaps.size else touching
    push = load - spring * clearance  # what still presses during the contact
    rest = push / CONTACT
    swing = np.hypot(rest, speed / OMEGA)
    assert force.max() == pytest.approx(CONTACT * (rest + swing), rel=2e-3)
    duration = (np.pi + 2 * np.arctan2(push, speed * np.sqrt(CONTACT * MASS))) / OMEGA
    assert first.size * 1e-5 == pytest.approx(duration, abs=2.5e-5)
    assert energy_residual(history) < BOOKS


def test_a_shaken_mass_lifts_off_and_returns_without_a_dashpot() -> None:
    spring, contact, amplitude, rate = 4e3, 2e5, 0.02, 9.0

    def marker(t: float | np.ndarray) -> float | np.ndarray:
        return amplitude * (1 - np.cos(rate * t))

    laws = LawTableBuilder()
    linear_spring(laws, 0, spring, input_index=0)
    laws.add_contact(1, stiffness=contact, clearance=0.0, base_closed=True)
    end = 2.0
    static = -MASS * GRAVITY / (spring + contact)

    def motion(t: float, y: np.ndarray) -> list[float]:
        pull = spring * (marker(t) - y[0])
        return [y[1], (pull + contact * max(-y[0], 0.0)) / MASS - GRAVITY]

    errors = []
    for step in (1e-3, 2.5e-4):
        history = run(
            hand_made(laws, mass=[MASS], rows=[[1.0], [-1.0]], load=[-MASS * GRAVITY]),
            marker,
            end=end,
            step=step,
            spectral_radius=0.8,
        )
        reference = solve_ivp(
            motion,
            (0, end),
            [static, 0.0],
            t_eval=history.time,
            rtol=1e-10,
            atol=1e-13,
            max_step=5e-4,
        ).y[0]
        errors.append(np.max(np.abs(history.g[:, 0] - reference)) / np.ptp(reference))
        open_contact = history.law_force[:, 1] == 0.0
        assert np.sum(np.diff(open_contact.astype(int)) == 1) >= 3
        assert energy_residual(history) < BOOKS
    assert errors[0] < 4e-2
    assert errors[1] < errors[0] / 8


def test_an_object_is_booked_when_it_appears_and_disappears() -> None:
    """The energy switched is that stored in the object's spring at that instant, k e^2 / 2."""
    laws = LawTableBuilder()
    spring, stiffness, size = 2e5, 5e4, 0.013
    linear_spring(laws, 0, spring, input_index=0)
    laws.add_contact(0, stiffness=stiffness, clearance=-size, appears=0.5, disappears=1.25)
    history = run(
        hand_made(laws, mass=[1.0], damping=np.array([[300.0]])),
        lambda t: 0.004 * np.sin(2.2 * t),
        end=2.0,
    )
    switched = history.ledger[:, 3]
    jumps = np.flatnonzero(np.diff(switched))
    np.testing.assert_allclose(history.time[jumps + 1], [0.5, 1.251], atol=1e-9)
    before, after = jumps
    placed = 0.5 * stiffness * (history.g[before, 0] + size) ** 2
    removed = 0.5 * stiffness * (history.g[after, 0] + size) ** 2
    assert switched[before + 1] == pytest.approx(placed, rel=1e-12)
    assert switched[-1] == pytest.approx(placed - removed, rel=1e-9)
    assert placed > 2.0
    assert history.stored[after, 2] > removed  # it was in the balance as contact energy
    absent = (history.time < 0.4995) | (history.time > 1.2505)
    assert np.all(history.law_force[absent, 1] == 0.0)
    assert np.all(history.law_force[~absent, 1] > 0.0)
    assert history.law_first[1] == pytest.approx(0.5)
    assert energy_residual(history) < BOOKS


def test_friction_vanishes_with_the_normal_law_that_it_names() -> None:
    """A foot whose support is taken away while it slips must not be braked by it any longer."""
    laws = LawTableBuilder()
    linear_spring(laws, 0, 1e5, input_index=0)
    linear_spring(laws, 1, 1e5)
    normal = laws.add_contact(1, stiffness=1e6, clearance=0.0, disappears=0.5)
    laws.add_friction(0, normal=normal, friction_coefficient=0.3, stick_stiffness=1e6)
    history = run(
        hand_made(laws, mass=[1.0, 1.0], damping=np.diag([300.0, 300.0]), load=[0.0, 1100.0]),
        lambda t: 0.01 * t,
        end=1.0,
    )
    slipping = (history.time > 0.45) & (history.time <= 0.5)
    np.testing.assert_allclose(history.friction_force[slipping, 0], 300.0, rtol=1e-6)
    gone = history.time > 0.5005
    assert np.all(history.friction_force[gone, 0] == 0.0)
    late = history.time > 0.9
    np.testing.assert_allclose(-history.law_force[late, 0], 3.0, rtol=1e-3)  # the dashpot's
    assert energy_residual(history) < BOOKS
