"""The time scheme: what it refuses, its order, its damping of what a step cannot resolve."""

from typing import Any

import numpy as np
import pytest
from tests.verification.hand_made import energy_residual, hand_made, linear_spring, run

from turnout.core.errors import SolverError
from turnout.core.scheme import AlphaCoefficients, Scheme
from turnout.law.table import LawTableBuilder
from turnout.solver.integration import History, integrate
from turnout.solver.outcome import ADVICE, Code, NotConverged, Outcome


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"step": 0.0}, "step = 0 s"),
        ({"step": 0.2, "output_interval": 0.2}, "step = 0.2 s"),
        ({"step": float("nan")}, "step = nan s"),
        ({"cutoff_frequency": 0.0}, "cutoff_frequency = 0 Hz"),
        ({"cutoff_frequency": float("nan")}, "cutoff_frequency = nan Hz"),
        ({"spectral_radius": 1.1}, r"spectral_radius = 1.1"),
        ({"spectral_radius": -0.1}, r"spectral_radius = -0.1"),
        ({"output_interval": -1e-3}, "output_interval = -0.001 s: must be positive"),
        ({"output_interval": float("inf")}, "output_interval = inf s: must be positive"),
        ({"iterations": 0}, "iterations must be at least 1"),
        ({"halvings": -1}, "halvings at least 0"),
        ({"mode": "fast"}, "mode = 'fast': allowed are waveform, quick, quasi"),
        ({"step": "1 ms", "cutoff_frequency": None}, "step = .1 ms.: must be .*; cutoff_frequency"),
        ({"step": -1.0, "cutoff_frequency": -1.0, "spectral_radius": 3.0},
         "step = -1 s.*cutoff_frequency.*spectral_radius"),
    ],
)  # fmt: skip
def test_a_scheme_that_cannot_work_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(SolverError, match=message):
        (Scheme.of if "mode" in options else Scheme)(**options)


@pytest.mark.parametrize(
    ("step", "interval", "stride"),
    [
        # about every millisecond, unless an interval is given
        (2.5e-4, None, 4), (3e-4, None, 4), (1e-3, None, 1), (2e-3, None, 1), (4e-3, 8e-3, 2),
        # instants between the steps have no stride
        (4e-4, 1e-3, 0), (4e-3, 1e-3, 0), (4e-3, 0.01, 0),
    ],
)  # fmt: skip
def test_steps_that_are_stored(step: float, interval: float | None, stride: int) -> None:
    given = {} if interval is None else {"output_interval": interval}
    scheme = Scheme(step=step, **given)
    assert scheme.stride == stride
    assert scheme.output_interval == pytest.approx(interval or stride * step)


def test_a_mode_chooses_and_is_reported_back() -> None:
    assert Scheme().mode == "waveform"
    assert Scheme.of("quick").mode == "quick"
    assert Scheme.of("quick").step > Scheme().step
    assert Scheme.of("quick", step=2e-3).mode == "own"
    assert Scheme.of("quick", output_interval=1e-3).mode == "quick"
    static = Scheme.of("quasi-static")
    assert static.mode == "quasi-static"
    assert static.describe().startswith("quasi-static")
    text = Scheme(step=4e-3, cutoff_frequency=100.0).describe()
    for part in ("generalised-alpha", "0.5", "4 ms", "100 Hz"):
        assert part in text


def oscillator(**options: float) -> History:
    """Run the damped oscillator of `TestOrder` that a marker drives from rest."""
    laws = LawTableBuilder()
    linear_spring(laws, 0, TestOrder.spring, input_index=0)
    mechanism = hand_made(laws, mass=[TestOrder.mass], damping=np.array([[TestOrder.dashpot]]))
    return run(mechanism, lambda t: 1 - np.cos(TestOrder.drive * t), end=1.0, **options)


def test_whole_numbers_are_as_good_as_any() -> None:
    whole = oscillator(gap_tolerance=0, force_tolerance=1)
    np.testing.assert_array_equal(whole.g, oscillator(gap_tolerance=0.0, force_tolerance=1.0).g)


class TestOrder:
    """A damped oscillator driven by 1 - cos(p t) from rest, in closed form."""

    mass, spring, dashpot, drive = 2.0, 800.0, 10.0, 7.0
    rate = 2.0
    eps = 0.1

    def exact(self, t: np.ndarray) -> np.ndarray:
        omega2, two_delta = self.spring / self.mass, self.dashpot / self.mass
        a, b = omega2 - self.drive**2, two_delta * self.drive
        cosine, sine = -omega2 * a / (a**2 + b**2), -omega2 * b / (a**2 + b**2)
        delta = two_delta / 2
        nu = np.sqrt(omega2 - delta**2)
        c = -(1 + cosine)
        d = (delta * c - self.drive * sine) / nu
        steady = 1 + cosine * np.cos(self.drive * t) + sine * np.sin(self.drive * t)
        return steady + np.exp(-delta * t) * (c * np.cos(nu * t) + d * np.sin(nu * t))

    @pytest.mark.parametrize("spectral_radius", [0.0, 0.5, 0.9, 1.0])
    def test_order(self, spectral_radius: float) -> None:
        steps = np.array([4e-3, 2e-3, 1e-3])
        errors = []
        for step in steps:
            history = oscillator(step=step, spectral_radius=spectral_radius)
            errors.append(np.max(np.abs(history.g[:, 0] - self.exact(history.time))))
        rates = -np.diff(np.log(errors)) / np.log(2)
        assert np.all(np.abs(rates - self.rate) < self.eps), rates
        assert errors[-1] < 1e-3


@pytest.mark.parametrize("radius", [0.0, 0.3, 0.5, 0.8, 1.0])
def test_coefficients_have_the_radius_asked_for_and_second_order(radius: float) -> None:
    c = AlphaCoefficients.from_spectral_radius(radius)
    assert c.gamma == pytest.approx(0.5 - c.alpha_m + c.alpha_f, abs=1e-15)
    assert c.beta >= 0.25 + 0.5 * (c.alpha_f - c.alpha_m) - 1e-15  # unconditionally stable
    # amplification of (q, h v, h^2 a) without load at w h = 1e6: acceleration -(w h)^2 q
    square = 1e12
    left = np.array(
        [[1, 0, -c.beta], [0, 1, -c.gamma], [(1 - c.alpha_f) * square, 0, 1 - c.alpha_m]]
    )
    right = np.array(
        [[1, 1, 0.5 - c.beta], [0, 1, 1 - c.gamma], [-c.alpha_f * square, 0, -c.alpha_m]]
    )
    measured = np.abs(np.linalg.eigvals(np.linalg.solve(left, right))).max()
    assert measured == pytest.approx(radius, abs=1e-2)  # a multiple root, so the tolerance


@pytest.mark.parametrize("radius", [0.5, 0.8])
def test_a_run_damps_stiff_motion_by_the_spectral_radius(radius: float) -> None:
    """After a jump of the marker the error of a stiff mass obeys (E - c1)(E - c2)(E - c3) x = 0."""
    laws = LawTableBuilder()
    linear_spring(laws, 0, 1e12, input_index=0)
    history = run(
        hand_made(laws, mass=[1.0]),
        lambda t: np.where(t > 0, 1.0, 0.0),
        end=0.03,
        spectral_radius=radius,
    )
    x = history.g[1:, 0] - 1.0
    table = np.lib.stride_tricks.sliding_window_view(x[:12], 4)
    coefficients = np.linalg.lstsq(table[:, :3], -table[:, 3], rcond=None)[0]
    roots = np.roots(np.concatenate(([1.0], coefficients[::-1])))
    assert np.abs(roots).max() == pytest.approx(radius, abs=2e-2)
    assert abs(x[-1]) < 1e3 * radius**29
    assert energy_residual(history) < 1e-6


def test_a_run_shorter_than_an_interval_is_refused() -> None:
    laws = LawTableBuilder()
    linear_spring(laws, 0, 1e3)
    mechanism = hand_made(laws, mass=[1.0])
    with pytest.raises(SolverError, match="shorter than one output interval"):
        integrate(mechanism, Scheme(), inputs=lambda t: np.zeros((0, t.size)), end=1e-4)


def test_outcome_messages_say_what_where_and_what_to_do() -> None:
    assert Outcome(Code.COMPLETE, 1.0, 1000, 0.0).message() == "complete"
    names = tuple(f"chair {i}" for i in range(9))
    outcome = Outcome(Code.NOT_CONVERGED, 1.2345, 1234, 3e-9, names)
    text = outcome.message()
    for part in ("not converged", "1.2345 s", "step 1234", "3.0e-09 m", "chair 0", "3 more"):
        assert part in text
    assert ADVICE[Code.NOT_CONVERGED] in text
    assert "chair 6" not in text
    assert not outcome.complete
    with pytest.raises(NotConverged, match="smaller step") as caught:
        raise NotConverged(outcome, partial="what there is")
    assert caught.value.outcome is outcome
    assert caught.value.partial == "what there is"
    assert isinstance(caught.value, SolverError)


@pytest.mark.parametrize("code", [c for c in Code if c is not Code.COMPLETE])
def test_every_failure_gives_advice(code: Code) -> None:
    assert len(ADVICE[code]) > 20
    assert ADVICE[code] in Outcome(code, 0.5, 500, 1e-12).message()
