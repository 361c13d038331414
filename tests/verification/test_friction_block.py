"""Coulomb block on a spring: stick, breakaway, steady slip, reversal, loops, varying normal force.

Reference: rate-independent friction with an elastic stick spring (Jenkins element; several in
parallel make Iwan's model with Masing's loops), all in closed form in the displacement of the
block. Tolerance: 1e-9 where the block's own path enters (the law has no step error as long as the
path is monotone between turning points), else 1e-3 for the inertia of a block moved slowly.
"""

import numpy as np
import pytest
from tests.verification.hand_made import (
    energy_residual,
    hand_made,
    linear_spring,
    run,
    smooth_ramp,
)

from turnout.integrate.run import History
from turnout.law.table import LawTableBuilder
from turnout.mechanism.mechanism import Mechanism

NORMAL, DRIVE, STICK = 200.0, 1e5, 1e6
MU = 0.3
LIMIT = MU * NORMAL
SERIES = DRIVE * STICK / (DRIVE + STICK)
EXACT, SLOW, BOOKS = 1e-9, 1e-3, 1e-6


def block(
    *,
    drive: float = DRIVE,
    feet: tuple[tuple[float, float], ...] = ((MU, STICK),),
    lifter: float = 0.0,
    mass: float = 0.1,
    damping: float = 20.0,
) -> Mechanism:
    """Return a block (x) on a contact spring (z down); marker 0 pushes, marker 1 lifts."""
    laws = LawTableBuilder()
    linear_spring(laws, 0, drive, input_index=0)
    normal = laws.add_contact(1, stiffness=1e6, clearance=0.0, base_closed=True)
    if lifter:
        linear_spring(laws, 1, lifter, input_index=1)
    for coefficient, stiffness in feet:
        laws.add_friction(
            0, normal=normal, friction_coefficient=coefficient, stick_stiffness=stiffness
        )
    return hand_made(
        laws, mass=[mass, mass], damping=np.diag([damping, 10 * damping]), load=[0.0, NORMAL]
    )


def drive_force(history: History) -> np.ndarray:
    """Force of the drive on the block, positive in the direction of the push."""
    return -history.law_force[:, 0]


def test_a_push_below_the_limit_sticks_elastically() -> None:
    reach = 0.95 * LIMIT / SERIES
    history = run(block(), lambda t: reach * smooth_ramp(t, start=0.1, end=2.0), end=3.0)
    held = reach * DRIVE / (DRIVE + STICK)
    assert history.g[-1, 0] == pytest.approx(held, rel=1e-6)
    assert drive_force(history)[-1] == pytest.approx(0.95 * LIMIT, rel=1e-6)
    assert history.ledger[-1, 1] == 0.0  # nothing slipped
    assert energy_residual(history) < BOOKS


def test_the_block_breaks_away_at_the_limit_and_slips_steadily() -> None:
    reach = 5 * LIMIT / SERIES
    # no damper: a slow push, so that inertia is all that is left of the tolerance
    history = run(
        block(damping=0.0), lambda t: reach * smooth_ramp(t, start=0.1, end=20.0), end=20.0
    )
    force, marker = drive_force(history), history.inputs[:, 0]
    before = marker < 0.98 * LIMIT / SERIES
    np.testing.assert_allclose(force[before], SERIES * marker[before], atol=SLOW * LIMIT)
    slipping = (marker > 1.02 * LIMIT / SERIES) & (history.time < 18.0)
    np.testing.assert_allclose(force[slipping], LIMIT, rtol=5 * SLOW)
    assert history.friction_force.max() == pytest.approx(LIMIT, rel=EXACT)
    friction_work = LIMIT * (history.g[-1, 0] - history.friction_force[-1, 0] / STICK)
    assert history.ledger[-1, 1] == pytest.approx(friction_work, rel=1e-6)
    assert energy_residual(history) < BOOKS


FEET = ((0.1, 2e6), (0.25, 1e6), (0.4, 4e5))


def virgin(x: np.ndarray) -> np.ndarray:
    """Force of the parallel feet on first loading to `x` >= 0."""
    return sum(np.minimum(kt * x, mu * NORMAL) for mu, kt in FEET)


def test_reversal_follows_masing_loops_twice_the_virgin_curve() -> None:
    amplitude = 4e-4

    def marker(t: np.ndarray) -> np.ndarray:
        return amplitude * (
            smooth_ramp(t, start=0.0, end=1.0)
            - 1.7 * smooth_ramp(t, start=1.0, end=2.0)
            + 1.4 * smooth_ramp(t, start=2.0, end=3.0)
        )

    mechanism = block(drive=1e9, feet=FEET, damping=2000.0)
    history = run(mechanism, marker, end=3.0)
    x, force = history.g[:, 0], history.friction_force.sum(axis=1)
    first, second, third = (
        (history.time >= a) & (history.time <= a + 1.0) for a in (0.0, 1.0, 2.0)
    )
    scale = virgin(np.array([1.0]))[0]
    np.testing.assert_allclose(force[first], virgin(x[first]), rtol=0, atol=1e-6 * scale)
    top, bottom = np.argmax(x), np.argmin(x)
    down = force[top] - 2 * virgin((x[top] - x[second]) / 2)
    np.testing.assert_allclose(force[second], down, rtol=0, atol=1e-6 * scale)
    up = force[bottom] + 2 * virgin((x[third] - x[bottom]) / 2)
    np.testing.assert_allclose(force[third], up, rtol=0, atol=1e-6 * scale)
    assert energy_residual(history) < BOOKS


@pytest.mark.parametrize("amplitude", [3.0, 8.0])
def test_a_cycle_dissipates_the_area_of_its_parallelogram(amplitude: float) -> None:
    """Per cycle 4 mu N (A - mu N / k) with k of drive and stick spring in series."""
    reach = amplitude * LIMIT / SERIES
    history = run(block(damping=0.0), lambda t: reach * np.sin(np.pi * t), end=4.5)
    instants = [int(np.argmin(np.abs(history.time - t))) for t in (0.5, 2.5, 4.5)]
    lost = np.diff(history.ledger[instants, 1])
    expected = 4 * LIMIT * (reach - LIMIT / SERIES)
    np.testing.assert_allclose(lost, expected, rtol=3e-3)
    put_in = np.diff(history.ledger[instants, 0])
    np.testing.assert_allclose(put_in, expected, rtol=1e-2)  # and what little is still moving
    assert energy_residual(history) < BOOKS


def test_no_friction_leaves_nothing_to_slip_against() -> None:
    mechanism = block(feet=((0.0, STICK),))
    history = run(mechanism, lambda t: 1e-3 * np.sin(9 * t), end=2.0)
    assert np.all(history.friction_force == 0.0)
    assert history.ledger[-1, 1] == 0.0
    np.testing.assert_allclose(history.g[:, 0], history.inputs[:, 0], rtol=0, atol=1e-5)


def test_slip_follows_a_normal_force_that_changes() -> None:
    """While the block slips one way the drive force is mu N(t), with N set by a second spring."""
    lifter, lift = 1e4, 0.008
    contact_share = 1e6 / (1e6 + lifter)

    def lifted(t: np.ndarray) -> np.ndarray:
        return -lift * 0.5 * (1 - np.cos(2 * np.pi * t))

    # the lifter is at rest where the block stands, so it carries some of the weight
    history = run(block(lifter=lifter, damping=2.0), lambda t: 0.02 * t, lifted, end=3.0, step=5e-4)
    normal = (NORMAL + lifter * lifted(history.time)) * contact_share
    assert normal.max() / normal.min() > 1.6
    np.testing.assert_allclose(history.law_force[:, 1], normal, rtol=5e-3)
    slipping = history.time > 0.4
    forces = history.friction_force[slipping, 0]
    np.testing.assert_allclose(forces, MU * history.law_force[slipping, 1], rtol=EXACT)
    inertia = 0.02 * np.sqrt(DRIVE * 0.1) + 2.0 * 0.02
    np.testing.assert_allclose(
        drive_force(history)[slipping], MU * normal[slipping], rtol=5e-3, atol=2 * inertia
    )
    assert energy_residual(history) < BOOKS


def test_a_held_push_lets_go_when_the_normal_force_falls_to_its_limit() -> None:
    """A push P held while N falls slips at mu N = P, and the drive then relaxes with mu N."""
    lifter = 1e4
    push = 0.8 * LIMIT

    def lifted(t: np.ndarray) -> np.ndarray:
        return -0.012 * smooth_ramp(t, start=2.0, end=12.0)

    history = run(
        block(lifter=lifter, damping=2.0),
        lambda t: push / SERIES * smooth_ramp(t, start=0.0, end=1.0),
        lifted,
        end=12.0,
    )
    bound = MU * history.law_force[:, 1]
    expected = np.minimum(push, np.minimum.accumulate(bound))
    late = history.time > 1.2
    np.testing.assert_allclose(drive_force(history)[late], expected[late], atol=3e-3 * LIMIT)
    first_slip = history.time[np.flatnonzero(history.ledger[:, 1] > 1e-12)[0]]
    assert bound[np.argmin(np.abs(history.time - first_slip))] == pytest.approx(push, rel=3e-3)
    assert energy_residual(history) < BOOKS


def test_a_foot_that_lifts_carries_no_friction_and_takes_hold_again() -> None:
    """The normal force goes to zero and back while the block is dragged to and fro."""
    history = run(
        block(lifter=1e6, damping=20.0),
        lambda t: 2e-3 * np.sin(5 * t),
        lambda t: -4e-4 * np.sin(3 * t) ** 2,
        end=4.0,
    )
    normal, friction = history.law_force[:, 1], history.friction_force[:, 0]
    open_foot = normal == 0.0
    assert 0.05 < open_foot.mean() < 0.9
    assert np.all(friction[open_foot] == 0.0)
    assert np.all(np.abs(friction) <= MU * normal + 1e-6)
    lifts = np.sum(np.diff(open_foot.astype(int)) == 1)
    assert lifts >= 2
    again = history.time > history.time[np.argmax(open_foot)]
    slipping = np.abs(friction) > 0.999 * MU * normal
    assert np.sum(again & slipping & (normal > 0.5 * NORMAL / 2)) > 100
    assert energy_residual(history) < BOOKS


def test_a_held_load_does_not_creep() -> None:
    """Between 40 s and 60 s of a hold the block moves less than 1 nm."""

    def marker(t: np.ndarray) -> np.ndarray:
        there = 3 * LIMIT / SERIES * smooth_ramp(t, start=0.0, end=1.0)
        return there - 1.3 * LIMIT / SERIES * smooth_ramp(t, start=1.0, end=2.0)

    mechanism = block(feet=FEET, damping=2.0)
    history = run(mechanism, marker, end=60.0, every=100)
    held = history.time >= 40.0
    assert np.ptp(history.g[held, 0]) < 1e-9
    assert np.all(np.abs(drive_force(history)[held]) > 0.2 * LIMIT)
    np.testing.assert_allclose(drive_force(history)[held], drive_force(history)[-1], rtol=1e-9)
    assert energy_residual(history) < BOOKS
