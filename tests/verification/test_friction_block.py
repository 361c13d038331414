"""Coulomb block on a spring: stick, breakaway, steady slip, reversal, loops, varying normal force.

Reference: rate-independent friction with an elastic stick spring (Jenkins element; several in
parallel make Iwan's model with Masing's loops), all in closed form in the displacement of the
block. Tolerance: 1e-9 where the block's own path enters (the law has no step error as long as the
path is monotone between turning points), else 1e-3 for the inertia of a block moved slowly.
"""

import numpy as np
import pytest
from tests.verification import friction_block
from tests.verification.friction_block import (
    DRIVE,
    FEET,
    LIMIT,
    MU,
    NORMAL,
    SERIES,
    STICK,
    block,
    drive_force,
)
from tests.verification.hand_made import energy_residual, run, smooth_ramp

EXACT, SLOW, BOOKS = 1e-9, 1e-3, 1e-6


def test_a_push_below_the_limit_sticks_elastically() -> None:
    reach = 0.95 * LIMIT / SERIES
    history = run(block(), lambda t: reach * smooth_ramp(t, start=0.1, end=2.0), end=3.0)
    held = reach * DRIVE / (DRIVE + STICK)
    assert history.g[-1, 0] == pytest.approx(held, rel=1e-6)
    assert drive_force(history)[-1] == pytest.approx(0.95 * LIMIT, rel=1e-6)
    assert history.ledger[-1, 1] == 0.0  # nothing slipped
    assert energy_residual(history) < BOOKS


def test_the_block_breaks_away_at_the_limit_and_slips_steadily() -> None:
    loop = friction_block.broken_away()
    history, force, marker = loop.history, loop.found, loop.at
    before = marker < 0.98 * LIMIT / SERIES
    np.testing.assert_allclose(force[before], loop.exact[before], atol=SLOW * LIMIT)
    slipping = marker > 1.02 * LIMIT / SERIES
    np.testing.assert_allclose(force[slipping], loop.exact[slipping], rtol=5 * SLOW)
    assert history.friction_force.max() == pytest.approx(LIMIT, rel=EXACT)
    friction_work = LIMIT * (history.g[-1, 0] - history.friction_force[-1, 0] / STICK)
    assert history.ledger[-1, 1] == pytest.approx(friction_work, rel=1e-6)
    assert energy_residual(history) < BOOKS


def test_reversal_follows_masing_loops_twice_the_virgin_curve() -> None:
    loop = friction_block.masing()
    np.testing.assert_allclose(loop.found, loop.exact, rtol=0, atol=1e-6 * loop.exact.max())
    turns = np.sum(np.abs(np.diff(np.sign(np.diff(loop.at)))) > 1)
    assert turns >= 2
    assert energy_residual(loop.history) < BOOKS


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
    loop = friction_block.changing_normal()
    history = loop.history
    slipping = history.time > 0.8
    normal = loop.exact[slipping] / MU
    assert normal.max() / normal.min() > 1.6
    np.testing.assert_allclose(history.law_force[slipping, 1], normal, rtol=5e-3)
    forces = history.friction_force[slipping, 0]
    np.testing.assert_allclose(forces, MU * history.law_force[slipping, 1], rtol=EXACT)
    inertia = 0.02 * np.sqrt(DRIVE * 0.1) + 2.0 * 0.02
    np.testing.assert_allclose(loop.found[slipping], MU * normal, rtol=5e-3, atol=2 * inertia)
    assert energy_residual(history) < BOOKS


def test_a_held_push_lets_go_when_the_normal_force_falls_to_its_limit() -> None:
    """A push P held while N falls slips at mu N = P, and the drive then relaxes with mu N."""
    loop = friction_block.let_go()
    history = loop.history
    late = history.time > 1.2
    np.testing.assert_allclose(loop.found[late], loop.exact[late], atol=3e-3 * LIMIT)
    bound = MU * history.law_force[:, 1]
    first_slip = history.time[np.flatnonzero(history.ledger[:, 1] > 1e-12)[0]]
    at_slip = bound[np.argmin(np.abs(history.time - first_slip))]
    assert at_slip == pytest.approx(0.8 * LIMIT, rel=3e-3)
    assert energy_residual(history) < BOOKS


def test_the_page_shows_what_is_asserted_here() -> None:
    for check in friction_block.checks():
        assert check.passed, str(check)


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
