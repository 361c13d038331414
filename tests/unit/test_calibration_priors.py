"""Parameters with priors, and zeros and clock of the recorder, on movements that were made up."""

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.test_calibration_fit import PARAMETERS, TRUE, misfit, movement, response

from turnout.calibration import sensors
from turnout.calibration.comparison import predicted, prediction
from turnout.calibration.covariance import spread_of
from turnout.calibration.fit import Fit, fit
from turnout.calibration.measured_movements import MeasuredMovement
from turnout.calibration.misfit import Misfit, shared_estimates
from turnout.calibration.sensors import (
    FoundSensor,
    Stated,
    found_sensors,
    prior_reasons,
    sensor_reasons,
    stated_unknowns,
)
from turnout.calibration.shared import SensorColumn
from turnout.calibration.stages import Parameter, default_plan
from turnout.panel.load import load_panel

FREE = PARAMETERS[1]


def stated(prior: float, *, start: float) -> tuple[Parameter, ...]:
    return PARAMETERS[0], replace(FREE, start=start, prior=prior)


def with_parameters(whole: Misfit, parameters: tuple[Parameter, ...]) -> Misfit:
    return replace(whole, parameters=parameters, base={p.name: p.start for p in parameters})


def alike(count: int) -> Misfit:
    return misfit([movement(f"m{n}", rng=np.random.default_rng(n)) for n in range(count)])


def test_what_movements_do_not_show_is_known_as_it_was_stated() -> None:
    """The object is met at 1.5 s, so that movements of 1.4 s say nothing of the stiffness."""
    whole = misfit([replace(item, length=1.4) for item in alike(4).movements])
    parameters = stated(0.1, start=800e3)
    found = fit(with_parameters(whole, parameters), parameters, {**TRUE, "k": 950e3})
    assert found.values["k"] == pytest.approx(800e3, rel=2e-3)
    spread = spread_of(found)
    assert spread.states == ("fitted", "fitted")
    low, high = spread.intervals[1]
    assert np.log(high / low) / 2 == pytest.approx(1.96 * 0.1, rel=0.02)


def test_a_prior_does_not_hold_what_movements_show() -> None:
    parameters = stated(0.1, start=800e3)
    found = fit(with_parameters(alike(4), parameters), parameters, {**TRUE, "k": 800e3})
    assert found.values["k"] == pytest.approx(TRUE["k"], rel=5e-3)


def test_a_prior_weighs_as_a_measurement() -> None:
    """Inverse variances add up."""
    whole = alike(2)
    alone = spread_of(fit(whole, PARAMETERS, TRUE)).coordinate_covariance[1, 1]
    parameters = stated(float(np.sqrt(alone)), start=TRUE["k"])
    both = spread_of(fit(with_parameters(whole, parameters), parameters, TRUE))
    assert both.coordinate_covariance[1, 1] == pytest.approx(alone / 2, rel=0.05)


def recorded(*, clock: float = 0.0, zero: float = 0.0) -> Fit:
    """Fit to movements of a recorder with short seconds, or of an amplifier with a zero."""
    made: list[MeasuredMovement] = []
    for number in range(6):
        rng = np.random.default_rng(number)
        item = replace(movement(f"m{number}", rng=rng), clocked=True)
        (signal,) = item.signals
        stretched = replace(signal, time=signal.time / (1.0 + clock))
        clean = predicted(response(TRUE), item, stretched, np.arange(signal.time.size))
        values = clean + zero + 2.0 * rng.standard_normal(clean.size)
        made.append(replace(item, signals=(replace(signal, values=values),)))
    whole = misfit(made)
    known = replace(
        whole.comparison, gains={("drive_force", "1"): 1e-4}, common_zero=10.0, clock=1e-3
    )
    return fit(replace(whole, comparison=known), PARAMETERS, TRUE)


@pytest.fixture(scope="module")
def right() -> Fit:
    """A fit to movements of a recorder with nothing off."""
    return recorded()


def sensor(found: Fit, kind: str) -> FoundSensor:
    return next(item for item in found_sensors(found) if item.column.kind == kind)


def test_small_deviations_are_printed_with_a_digit() -> None:
    """A clock was "-0.00 ± 0.00 %"."""
    column = SensorColumn(kind="clock", stated=1e-3)
    found = FoundSensor(column=column, value=-4e-7, deviation=3e-5)
    assert found.text == "clock of the recorder +0.000 ± 0.003 % (stated ± 0.1 %)"


def test_a_clock_that_is_off_is_found_with_a_warning() -> None:
    """Ten deviations off: onsets and stiffness imitate a part of it, so not all of it is found."""
    clock = sensor(recorded(clock=0.01), "clock")
    assert 2e-3 < clock.value < 0.012
    assert clock.leaves
    assert clock.cause == "timing"
    assert "sampling rate" in clock.warning


def test_a_clock_that_is_off_is_warped_exactly() -> None:
    """Not as a straight line about none: 1 % is 15 ms where the object is met."""
    (item,) = alike(1).movements
    (signal,) = item.signals
    bins = np.arange(signal.time.size)
    ahead = prediction(response(TRUE), item, [(signal, bins)])
    stretched = replace(signal, time=signal.time / 1.01)
    np.testing.assert_allclose(
        ahead.row(0.0, 0.01), predicted(response(TRUE), item, stretched, bins), rtol=1e-12
    )
    found = recorded(clock=0.01)
    sizes = shared_estimates(found.local, found.frame)
    at = [column.kind for column in found.frame.shared.sensors].index("clock")
    assert found.frame.alignments[0].rate == pytest.approx(1e-3 * sizes[at], abs=2e-5)


def test_a_zero_that_all_movements_share_is_found() -> None:
    zero = sensor(recorded(zero=25.0), "zero")
    # Each movement has a zero of its own, of 20 N; six of them hold the common one to 8 N.
    assert 5.0 < zero.value < 25.0
    assert zero.deviation < 10.0
    assert "zero of the gauges of drive 1" in zero.text


def test_a_right_chain_is_no_cause_and_no_reason(right: Fit) -> None:
    for item in found_sensors(right):
        assert not item.leaves, item.text
        assert not item.cause, item.text
    assert not sensor_reasons(right)
    assert not prior_reasons(right, ["recorder filter"])


def test_a_zero_that_no_one_would_believe_is_a_reason_against_the_fit() -> None:
    (reason,) = sensor_reasons(recorded(zero=300.0))
    assert "zero of the gauges of drive 1" in reason


def test_a_sensor_that_leaves_its_prior_beside_a_cause_is_a_reason_against_the_cause() -> None:
    """A filter was fitted to a switch of another length, with a gain 3.8 deviations off."""
    off = recorded(zero=63.0)
    assert 3.3 < sensor(off, "zero").value / 10.0 < 4.0
    assert not sensor_reasons(off)
    assert not prior_reasons(off, [])
    (reason,) = prior_reasons(off, ["recorder filter", "clutch"])
    assert "although recorder filter and clutch were fitted: zero of the gauges of drive" in reason
    assert "so recorder filter and clutch are not the cause" in reason
    assert "clock" not in reason


@pytest.mark.parametrize(
    ("away", "words"),
    [
        (10 * [1.7], "fitted: all 10 together, of which n0, 1.7 standard deviations away; n1"),
        ([9.0, *9 * [0.1]], "fitted: n0, 9.0 standard deviations away; chance does this in less "),
        (10 * [1.4], ""),
    ],
)
def test_a_reason_says_whether_one_value_or_all_are_too_far_off(
    away: list[float], words: str, right: Fit, monkeypatch: pytest.MonkeyPatch
) -> None:
    unknowns = [Stated(text=f"n{number}", away=size) for number, size in enumerate(away)]
    monkeypatch.setattr(sensors, "stated_unknowns", lambda _: unknowns)
    found = prior_reasons(right, ["clutch"])
    assert [words in text for text in found] == ([True] if words else [])


def test_a_state_of_the_panel_that_leaves_its_prior_beside_a_cause_is_one_too() -> None:
    whole = alike(4)
    for start, leaves in ((0.5, True), (0.85, False)):
        parameters = stated(0.1, start=start * TRUE["k"])
        found = fit(with_parameters(whole, parameters), parameters, TRUE)
        assert bool(prior_reasons(found, ["sections"])) is leaves
    # The size of a cause may be any.
    kept = replace(found, parameters=(PARAMETERS[0], replace(parameters[1], keys=())))
    assert stated_unknowns(kept) == []


def test_gains_alike_are_no_reason_where_the_rails_are_fitted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The scale of the model is then doubted, and the intervals say so."""
    whole = alike(4)
    # Forces that are 4 % too small are gains of 4 % too much where stiffness is known.
    known = replace(whole.comparison, gains={("drive_force", "1"): 0.01})
    less = tuple(
        replace(item, signals=(replace(item.signals[0], values=1.04 * item.signals[0].values),))
        for item in whole.movements
    )
    found = fit(replace(whole, movements=less, comparison=known), PARAMETERS, TRUE)
    (reason,) = prior_reasons(found, ["recorder filter"])
    assert "gauges of drive 1 +" in reason
    monkeypatch.setattr("turnout.calibration.sensors.MODULUS", "k")
    assert not prior_reasons(found, ["sections"])


def test_over_travel_and_fit_are_fitted_with_priors_where_a_panel_has_them() -> None:
    plan = default_plan(load_panel("60e1-300-1-9"))
    uncertain = {item.name: item.prior for item in plan.parameters if item.prior}
    assert uncertain == {
        "drive.1.over_travel_closed": 1e-3,
        "rail.straight.stress_free": 0.05,
        "rail.straight.fit_gap": 1e-3,
    }
    # They are in the joint stage alone.
    assert set(uncertain) <= set(plan.stages[-1].parameters)
    assert not set(uncertain) & {name for stage in plan.stages[:-1] for name in stage.parameters}
    fixed = default_plan(load_panel("60e1-300-1-9"), fixed=["rail.straight.fit_gap"])
    assert "rail.straight.fit_gap" not in [p.name for p in fixed.parameters if p.vary]
