"""Instants between the steps: order four for motion, laws that hold, energy that balances."""

import numpy as np
import pytest
from tests.verification.hand_made import energy_residual, hand_made, linear_spring

from turnout.core.scheme import Scheme
from turnout.law.table import LawTableBuilder
from turnout.mechanism.mechanism import Mechanism
from turnout.solver.integration import History, integrate
from turnout.solver.record import interpolate_record
from turnout.solver.state import StepRecord

STIFFNESS, MASS, STOP = 1e4, 28.0, 1.2e-3


def sprung() -> Mechanism:
    """Return a mass that a marker pulls by a spring, against a stop."""
    laws = LawTableBuilder()
    linear_spring(laws, 0, STIFFNESS, input_index=0)
    laws.add_contact(0, stiffness=3e4, clearance=STOP)
    return hand_made(laws, mass=[MASS])


def thrown(step: float, interval: float) -> History:
    scheme = Scheme(step=step, output_interval=interval, cutoff_frequency=1e9)

    def marker(time: np.ndarray) -> np.ndarray:
        return 1e-3 * (1.0 - np.cos(9.0 * time))[np.newaxis]

    history = integrate(sprung(), scheme, inputs=marker, end=1.0)
    assert history.outcome.complete
    return history


def test_motion_between_the_steps_is_of_fourth_order() -> None:
    laws, errors = sprung().laws, []
    for step in (0.02, 0.01):
        at = step * np.arange(round(1.0 / step) + 1)
        q, v = np.sin(7.0 * at)[:, None], 7.0 * np.cos(7.0 * at)[:, None]
        nothing = np.zeros((at.size, 2))
        record = StepRecord(q, q.copy(), nothing[:, :0], nothing, nothing, nothing, at, v)
        instants = np.linspace(0.0, 1.0, 173)
        filled = interpolate_record(
            record,
            step=step,
            instants=instants,
            inputs=np.zeros((instants.size, 1)),
            modes=np.eye(1),
            laws=laws,
        )
        np.testing.assert_array_equal(filled.q, filled.g)
        errors.append(np.abs(filled.q[:, 0] - np.sin(7.0 * instants)).max())
    assert errors[1] == pytest.approx(errors[0] / 16, rel=0.1)


def test_at_the_steps_nothing_changes() -> None:
    steps, between = thrown(2e-3, 2e-3), thrown(2e-3, 1e-3)
    assert between.time.size == 2 * steps.time.size - 1
    for name in ("q", "g", "law_force", "stored", "ledger", "inputs"):
        here = getattr(between, name)[::2]
        np.testing.assert_allclose(here, getattr(steps, name), rtol=0, atol=1e-9)


def test_laws_hold_between_the_steps_and_the_books_stay_closed() -> None:
    history = thrown(3e-3, 7e-4)
    stop = np.maximum(3e4 * (history.g[:, 0] - STOP), 0.0)
    assert stop.max() > 1.0
    np.testing.assert_allclose(history.law_force[:, 1], stop, atol=1e-9)
    spring = STIFFNESS * (history.g[:, 0] - history.inputs[:, 0])
    np.testing.assert_allclose(history.law_force[:, 0], spring, atol=1e-9)
    assert energy_residual(history) < 1e-9


def test_the_last_instant_is_the_one_nearest_to_the_end() -> None:
    assert thrown(3e-3, 7e-4).time[-1] == pytest.approx(1429 * 7e-4)
    assert thrown(4e-3, 0.3).time.tolist() == pytest.approx([0.0, 0.3, 0.6, 0.9])
