"""Steps that do not settle are halved and recover, or end the run with names; nothing is lost.

Reference: the same run with as many iterations as it wants. Tolerance for a run with halved steps:
1 % of the peak, since halving only refines. Failure is forced by allowing too few iterations.
"""

import numpy as np
import pytest
from tests.verification.hand_made import ALL_MODES, energy_residual, hand_made, linear_spring, run

from turnout.core.scheme import Scheme
from turnout.law.table import LawTableBuilder
from turnout.mechanism.mechanism import Mechanism
from turnout.solver.integration import History, integrate
from turnout.solver.outcome import Code

N_FEET = 8


def chain() -> Mechanism:
    """Return blocks on feet of their own, coupled by springs; the first one is driven."""
    laws = LawTableBuilder()
    linear_spring(laws, 0, 2e5, input_index=0)
    for k in range(N_FEET):
        normal = laws.add_contact(N_FEET + k, stiffness=1e6, clearance=0.0, base_closed=True)
        laws.add_friction(k, normal=normal, friction_coefficient=0.25, stick_stiffness=2e6)
    laws.add_contact(N_FEET - 1, stiffness=5e6, clearance=0.004)
    stiffness = np.zeros((2 * N_FEET, 2 * N_FEET))
    for k in range(N_FEET - 1):
        stiffness[np.ix_([k, k + 1], [k, k + 1])] += 1e5 * np.array([[1, -1], [-1, 1]])
    stiffness[np.arange(N_FEET, 2 * N_FEET), np.arange(N_FEET, 2 * N_FEET)] += 1e3
    # each block presses down a little more when it moves, so that normal forces change in a slide
    for k in range(N_FEET):
        stiffness[k, k] += 2e3
        stiffness[k, N_FEET + k] = stiffness[N_FEET + k, k] = 1e3
    rows = np.eye(2 * N_FEET)
    rows[N_FEET:] *= -1.0
    damping = np.diag([20.0] * N_FEET + [400.0] * N_FEET)
    load = np.array([0.0] * N_FEET + [-100.0] * N_FEET)
    return hand_made(
        laws, mass=[5.0] * 2 * N_FEET, rows=rows, stiffness=stiffness, damping=damping, load=load
    )


def marker(t: np.ndarray) -> np.ndarray:
    return 0.015 * (1 - np.cos(3.0 * t)) * np.cos(0.7 * t)


def attempt(end: float = 2.0, report: object = None, **options: float) -> History:
    """Run the chain with coarse steps; the outcome may be anything."""
    scheme = Scheme(
        **{"step": 4e-3, "output_interval": 4e-3, "cutoff_frequency": ALL_MODES} | options
    )
    return integrate(chain(), scheme, inputs=lambda t: marker(t)[None, :], end=end, report=report)


def test_halved_steps_recover_and_the_books_still_close() -> None:
    free = run(chain(), marker, end=6.0, step=4e-3)
    tight = attempt(end=6.0, iterations=2, halvings=12)
    assert tight.outcome.complete, tight.outcome.message()
    assert tight.halved >= 2
    assert free.halved == 0
    assert free.flips > 100
    for name in ("g", "law_force"):
        want = getattr(free, name)
        peak = np.abs(want).max(axis=0)
        np.testing.assert_array_less(
            np.sqrt(np.mean((getattr(tight, name) - want) ** 2, axis=0)), 0.03 * peak + 1e-12
        )
    assert energy_residual(tight) < 1e-6
    assert tight.outcome.residual < 1e-10


def test_halved_steps_come_nearer_to_a_fine_solution_not_further() -> None:
    fine = run(chain(), marker, end=2.0, step=2.5e-4, every=16)
    free = run(chain(), marker, end=2.0, step=4e-3)
    tight = attempt(iterations=2, halvings=12)

    def error(history: History) -> float:
        return float(np.sqrt(np.mean((history.g[:, :N_FEET] - fine.g[:, :N_FEET]) ** 2)))

    assert error(tight) < 1.1 * error(free)


def test_a_run_that_cannot_settle_ends_with_time_names_and_partial_history() -> None:
    history = attempt(iterations=1, halvings=1, follow_path=False)
    outcome = history.outcome
    assert outcome.code is Code.NOT_CONVERGED
    assert 0.0 <= outcome.time < 2.0
    assert history.time.size == outcome.step + 1
    assert history.time[-1] == pytest.approx(outcome.time)
    free = attempt()
    kept = history.time.size
    assert kept >= 2
    np.testing.assert_allclose(history.g, free.g[:kept], rtol=0, atol=1e-9)
    assert np.all(np.isfinite(history.stored))
    assert energy_residual(history) < 1e-6
    assert 0 < len(outcome.contacts) < 2 * N_FEET + 2, "some laws are named, not all"
    assert all(n.startswith(("law", "friction foot")) for n in outcome.contacts)
    assert "unconverged" in outcome.message()


def test_progress_is_reported_to_the_end() -> None:
    calls = []
    attempt(report=lambda done, total: calls.append((done, total)), end=3.0)
    done, totals = zip(*calls, strict=True)
    assert list(done) == sorted(set(done))
    assert done[-1] == totals[-1] == 750


@pytest.mark.parametrize("options", [{}, {"iterations": 2, "halvings": 12}], ids=str)
def test_a_run_repeats_to_the_last_bit(options: dict[str, float]) -> None:
    first, second = attempt(**options), attempt(**options)
    for name in ("g", "q", "law_force", "friction_force", "stored", "ledger"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    assert first.flips == second.flips


def test_a_blow_up_is_an_outcome() -> None:
    scheme = Scheme(step=4e-3, output_interval=4e-3, cutoff_frequency=ALL_MODES)

    def inputs(t: np.ndarray) -> np.ndarray:
        return np.where(t > 0.5, np.nan, marker(t))[None, :]

    history = integrate(chain(), scheme, inputs=inputs, end=2.0)
    assert history.outcome.code is Code.NOT_FINITE
    assert history.outcome.time == pytest.approx(0.5, abs=5e-3)
    assert np.all(np.isfinite(history.g))
    assert "no longer finite" in history.outcome.message()


def test_a_step_that_does_not_settle_is_walked_event_by_event() -> None:
    """One iteration a step settles nothing with an event in it: the path does all of them."""
    walked, free = attempt(iterations=1, halvings=1), attempt()
    assert walked.outcome.complete, walked.outcome.message()
    assert walked.halved > 20
    peak = np.abs(free.g).max()
    assert np.sqrt(np.mean((walked.g - free.g) ** 2)) < 0.01 * peak
    assert energy_residual(walked) < 1e-6
