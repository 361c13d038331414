"""The integrator without inertia against closed forms, against slow throws, and where it must end.

Tolerances: closed forms 1e-9, since events are located exactly; slow throws 2 % of the peak, the
ripple that inertia leaves at a quarter of the speed.
"""

import numpy as np
import pytest
from benchmarks.studies import inertia
from tests.verification.friction_block import LIMIT, SERIES, STICK, block, drive_force
from tests.verification.hand_made import energy_residual, hand_made, linear_spring

from turnout.core.scheme import Scheme
from turnout.law.table import LawTableBuilder
from turnout.panel.load import LoadedPanel, load_panel
from turnout.solver.integration import History, integrate
from turnout.solver.outcome import Code
from turnout.throw.simulate import simulate

STATIC = Scheme.of("quasi-static")


def there_and_back(step: float) -> History:
    """Push the block to four times its reach and pull it back as far."""
    reach = 4 * LIMIT / SERIES
    scheme = Scheme.of("quasi-static", step=step)

    def marker(time: np.ndarray) -> np.ndarray:
        return reach * (1.0 - np.abs(1.0 - time))[np.newaxis]

    return integrate(block(), scheme, inputs=marker, end=2.0)


@pytest.mark.parametrize("step", [0.1, 0.01])
def test_a_block_follows_the_bilinear_loop_whatever_the_pieces(step: float) -> None:
    history = there_and_back(step)
    assert history.outcome.complete
    push = history.inputs[:, 0]
    there = np.minimum(SERIES * push, LIMIT)
    back = np.maximum(LIMIT - SERIES * (push.max() - push), -LIMIT)
    exact = np.where(history.time <= 1.0, there, back)
    np.testing.assert_allclose(drive_force(history), exact, atol=1e-9 * LIMIT)
    assert energy_residual(history) < 1e-12
    slipped = 2 * 4 * LIMIT / SERIES - 3 * LIMIT / SERIES
    assert history.ledger[-1, 1] == pytest.approx(LIMIT * slipped, rel=1e-9)
    assert history.ledger[-1, 5] == pytest.approx(0.0, abs=1e-12)


def test_an_object_that_goes_while_it_is_pressed_leaves_the_books_closed() -> None:
    """Rails snap to another equilibrium; what the snap loses is booked, and what was switched."""
    laws = LawTableBuilder()
    spring, stiffness, size = 2e5, 5e4, 0.013
    linear_spring(laws, 0, spring, input_index=0)
    laws.add_contact(0, stiffness=stiffness, clearance=-size, appears=0.5, disappears=1.25)
    history = integrate(
        hand_made(laws, mass=[1.0], damping=np.array([[300.0]])),
        STATIC,
        inputs=lambda t: 0.004 * np.sin(2.2 * t)[np.newaxis],
        end=2.0,
    )
    assert history.outcome.complete
    away = 0.004 * np.sin(2.2 * 1.25)
    pressed = (spring * away - stiffness * size) / (spring + stiffness)
    gone = np.searchsorted(history.time, 1.255)
    assert history.g[gone - 2, 0] == pytest.approx(pressed, abs=1e-4)
    assert history.g[gone, 0] == pytest.approx(history.inputs[gone, 0], rel=1e-9)
    assert history.ledger[-1, 5] > 0.1  # two snaps lose energy
    assert energy_residual(history) < 1e-12


def self_locking(mode: str) -> History:
    """Push a block that rises when pushed: once it moves, nothing holds it back.

    Slip forward takes ``coupling`` of normal force a metre off; ``mu coupling`` exceeds what spring
    and support gain, so that pushing harder would need a block further back.
    """
    laws = LawTableBuilder()
    linear_spring(laws, 0, 5e4, input_index=0)
    normal = laws.add_contact(1, stiffness=1e10, clearance=0.0, base_closed=True)
    laws.add_friction(0, normal=normal, friction_coefficient=0.5, stick_stiffness=STICK)
    coupling = 1e6
    mechanism = hand_made(
        laws,
        mass=[1.0, 1.0],
        stiffness=np.array([[1e5, coupling], [coupling, 1e8]]),
        damping=np.diag([300.0, 3e4]),
        load=[0.0, 200.0],
    )
    scheme = Scheme.of(mode, cutoff_frequency=1e9)
    return integrate(
        mechanism, scheme, inputs=lambda t: 0.02 * np.minimum(t, 1.0)[np.newaxis], end=1.2
    )


def test_where_a_foot_can_neither_stick_nor_slip_the_outcome_says_so() -> None:
    outcome = self_locking("quasi-static").outcome
    assert outcome.code is Code.NO_STATIC_CONTINUATION
    assert 0.0 < outcome.time < 1.0
    assert "friction foot 0" in outcome.contacts
    assert "no static continuation at t = " in outcome.message()
    assert "take a scheme with inertia" in outcome.message()


def test_with_inertia_the_same_foot_lets_go() -> None:
    history = self_locking("waveform")
    stuck_until = self_locking("quasi-static").outcome.time
    assert history.outcome.complete
    speed = np.diff(history.g[:, 0]) / np.diff(history.time)
    jump = history.time[int(np.argmax(speed))]
    assert jump == pytest.approx(stuck_until, abs=0.05)


@pytest.mark.parametrize("name", ["sb1", "sb2"])
def test_a_slow_throw_comes_near_what_is_left_without_inertia(name: str) -> None:
    panel = load_panel(name)
    static = simulate(panel, scheme=STATIC)
    assert static.attrs["mode"] == "quasi-static"
    assert static.attrs["outcome"] == "complete"
    assert np.abs(static["energy_kinetic"]).max() == 0.0
    slow = slowed(panel, 4.0)
    moved = simulate(slow, scheme=Scheme.of("quick"))
    for drive in static["drive"].values:
        force = static["drive_force"].sel(drive=drive)
        end = float(force[-1]), float(moved["drive_force"].sel(drive=drive)[-1])
        peak = float(np.abs(force).max())
        assert end[0] == pytest.approx(end[1], abs=0.02 * peak)


def slowed(panel: LoadedPanel, factor: float) -> LoadedPanel:
    """Return the panel with every movement so many times as long."""
    starts = {"sb1": (1.0, 5.0, 3.0, 9.0), "sb2": (0.2, 4.4, 3.2, 8.5)}[panel.name]
    throw, back, duration, end = (factor * value for value in starts)
    return panel.with_overrides(
        {
            "movement.throw.start": throw,
            "movement.return.start": back,
            "movement.throw.duration": duration,
            "movement.return.duration": duration,
            "movement.return.extra_time": {"2": factor * 0.2},
            "schedule.end": end,
        }
    )


def test_the_default_panel_differs_by_what_inertia_does_and_no_more() -> None:
    for drive, unlocking, moving, held in (("1", 200, 5, 40), ("2", 500, 15, 130)):
        assert abs(inertia.difference(drive, "unlocking, opening").largest) < unlocking
        assert abs(inertia.difference(drive, "moving").mean) < moving
        assert abs(inertia.difference(drive, "held after the return").mean) < held
    static, moved = inertia.throws()
    assert inertia.chairs_at_limit(static, 4.3) > 2 * inertia.chairs_at_limit(moved, 4.3)
    for run in (static, moved):
        assert inertia.least_heel_friction(run) > 50.0
