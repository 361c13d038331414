"""The energy residual close to 1e-6 of their scale, and a wrong entry in any of them shows.

Reference: the identity of the energy balance over a step (turnout.solver.energy). The scale is
the largest sum of work and stored energy of the run. The mechanism is made so that every term takes
part: two masses and a rocker on springs of the linear system, a bilinear bushing, feet that slip,
lift and return, a dashpot matrix, weight, an object that comes and goes, and one that dents.
"""

from collections.abc import Callable

import numpy as np
import pytest
from tests.verification.hand_made import (
    LEDGER,
    STORED,
    curve_of,
    energy_residual,
    energy_scale,
    hand_made,
    linear_spring,
    obstruction,
    run,
)

from turnout.law.table import LawTableBuilder
from turnout.mechanism.mechanism import Mechanism
from turnout.solver import energy, march
from turnout.solver import integration as run_module
from turnout.solver.integration import History

CLOSED = 1e-6
MISSED = 1e-5
"""A term that is left out opens the energy balance by more than this, ten times what is allowed."""


def everything() -> Mechanism:
    laws = LawTableBuilder()
    laws.add_piecewise(
        0,
        breakpoints=np.array([-0.004, 0.004]),
        slopes=np.array([1e4, 2e5, 1e4]),
        input_index=0,
        base_segment=1,
    )
    feet = [laws.add_contact(row, stiffness=2e6, clearance=0.0, base_closed=True) for row in (1, 2)]
    linear_spring(laws, 4, 2e4, input_index=1)
    laws.add_contact(3, stiffness=4e5, clearance=-0.003, appears=0.6, disappears=1.1)
    wood = curve_of("wood", size=0.01, area=1e-6, strength=5e6, contact=1e6)
    trapped = laws.add_piecewise(
        3, breakpoints=wood.breakpoints, slopes=wood.slopes, offset=0.002, waits=True
    )
    for normal in feet:
        laws.add_friction(5, normal=normal, friction_coefficient=0.3, stick_stiffness=1e6)
    # x, z, roll of a body and x of a second one; feet at 0.1 m to both sides, 0.1 m below
    rows = [
        [1.0, 0.0, -0.05, 0.0],
        [0.0, -1.0, -0.1, 0.0],
        [0.0, -1.0, 0.1, 0.0],
        [0.0, 0.0, 0.0, 1.0],
        [0.0, 1.0, 0.02, 0.0],
        [1.0, 0.0, 0.1, 0.0],
    ]
    stiffness = np.diag([5e3, 1e3, 50.0, 2e4])
    stiffness[np.ix_([0, 3], [0, 3])] += 3e4 * np.array([[1, -1], [-1, 1]])
    damping = np.diag([40.0, 200.0, 1.0, 60.0])
    damping[0, 3] = damping[3, 0] = -20.0
    return hand_made(
        laws,
        mass=[20.0, 20.0, 0.15, 10.0],
        rows=rows,
        stiffness=stiffness,
        damping=damping,
        load=[0.0, -20.0 * 9.81, 0.3, 30.0],
        obstructions=obstruction(trapped, wood, size=0.01),
    )


def drive(t: np.ndarray) -> np.ndarray:
    return 0.03 * np.sin(4.0 * t)


def lift(t: np.ndarray) -> np.ndarray:
    return 0.011 * np.sin(11.0 * t) ** 2


def throw(*, end: float = 2.0, **options: float) -> History:
    return run(everything(), drive, lift, end=end, **options)


@pytest.fixture(scope="module")
def history() -> History:
    return throw()


def test_the_run_is_rich_enough_to_prove_something(history: History) -> None:
    normals = history.law_force[:, 1:3]
    assert np.any(normals == 0.0)
    assert np.sum(np.abs(np.diff((normals == 0.0).astype(int), axis=0))) >= 8
    assert np.abs(history.inputs[:, 0] - history.g[:, 0]).max() > 0.004
    assert history.flips > 50
    scale = energy_scale(history)
    for name, column in zip(LEDGER, history.ledger.T, strict=True):
        assert np.abs(column).max() > MISSED * scale, name
    for name, column in zip(STORED, history.stored.T, strict=True):
        assert np.ptp(column) > MISSED * scale, name


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"spectral_radius": 0.0},
        {"spectral_radius": 1.0},
        {"step": 2.5e-4},
        {"step": 4e-3},
        {"cutoff_frequency": 40.0},
        {"cutoff_frequency": 75.0},
    ],
    ids=str,
)
def test_the_books_close(options: dict[str, float]) -> None:
    assert energy_residual(throw(**options)) < CLOSED


def test_the_books_close_over_a_thousand_flips_and_rebuilds() -> None:
    history = throw(end=40.0, step=2e-3)
    assert history.flips > 1000
    assert history.outcome.residual < 1e-12
    assert energy_residual(history) < CLOSED


def test_the_loss_of_the_scheme_shrinks_with_the_step() -> None:
    lost = []
    for step in (2e-3, 5e-4, 1.25e-4):
        history = throw(step=step)
        numerical = history.ledger[-1, 4] + history.ledger[-1, 5]
        lost.append(abs(numerical) / energy_scale(history))
    assert lost[0] > lost[1] > lost[2]
    assert lost[2] < lost[0] / 8
    assert lost[2] < 5e-3


@pytest.mark.parametrize("term", LEDGER + STORED)
def test_a_term_that_is_left_out_is_missed(history: History, term: str) -> None:
    assert energy_residual(history) < CLOSED
    assert energy_residual(history, without=term) > MISSED


def plain_march(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let runs go through the plain functions of the loop, where a kernel can be replaced."""
    for name in ("step", "_advance", "_try_step"):
        monkeypatch.setattr(march, name, getattr(march, name).py_func)
    monkeypatch.setattr(run_module, "march", march.march.py_func)


def test_the_plain_loop_gives_the_run_of_the_compiled_one(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = throw(end=0.8)
    plain_march(monkeypatch)
    plain = throw(end=0.8)
    assert plain.flips == compiled.flips
    np.testing.assert_allclose(plain.g, compiled.g, rtol=0, atol=1e-12)
    np.testing.assert_allclose(plain.ledger, compiled.ledger, rtol=0, atol=1e-9)


def no_damping(kernel: Callable[..., None]) -> Callable[..., None]:
    def tampered(run, state, *rest):
        before = state.ledger[energy.DAMPING]
        kernel(run, state, *rest)
        state.ledger[energy.DAMPING] = before

    return tampered


def end_force_instead_of_mean(kernel: Callable[..., None]) -> Callable[..., None]:
    def tampered(run, state):
        anchor, ledger = state.anchor.copy(), state.ledger[energy.FRICTION]
        kernel(run, state)
        lost = state.friction_force @ (state.anchor - anchor)
        state.ledger[energy.FRICTION] = ledger + lost

    return tampered


def wrong_sign_of_markers(kernel: Callable[..., None]) -> Callable[..., None]:
    def tampered(run, state, *rest):
        before = state.ledger[energy.MARKERS]
        kernel(run, state, *rest)
        state.ledger[energy.MARKERS] = 2 * before - state.ledger[energy.MARKERS]

    return tampered


@pytest.mark.parametrize(
    ("name", "tamper"),
    [
        ("correct", no_damping),
        ("account_friction", end_force_instead_of_mean),
        ("account_laws", wrong_sign_of_markers),
    ],
)
def test_an_error_planted_in_the_books_is_seen(
    monkeypatch: pytest.MonkeyPatch, name: str, tamper: Callable[..., Callable[..., None]]
) -> None:
    plain_march(monkeypatch)
    assert energy_residual(throw(end=0.5)) < CLOSED
    monkeypatch.setattr(march, name, tamper(getattr(march, name)))
    with pytest.raises(AssertionError, match="inaccurate.*the energy balance does not close"):
        throw(end=0.5)  # the run itself refuses, and `throw` asks for a complete one
