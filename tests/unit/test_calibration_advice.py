"""Systematic errors absorbed by parameters, on made-up movements."""

from dataclasses import replace
from functools import cache

import numpy as np
from tests.unit.test_calibration_fit import PARAMETERS, TRUE, MadeUp, alike, misfit, movement

from turnout.calibration.advice import (
    SHARE,
    Candidate,
    _candidates,
    _systematic_error,
    covariance_with,
    next_lines,
    panel_doubt_lines,
)
from turnout.calibration.comparison import Uncertainty
from turnout.calibration.covariance import spread_of
from turnout.calibration.fit import Fit, fit
from turnout.calibration.misfit import plain_gain_column
from turnout.calibration.stages import prior_information
from turnout.panel.load import load_panel


@cache
def fitted(count: int) -> Fit:
    return fit(misfit(alike(count, seed=1)), PARAMETERS, TRUE)


def test_an_error_that_a_parameter_imitates_is_reported_in_its_words() -> None:
    found = fitted(1)
    # One per cent of friction, as an error that is not friction.
    text = _systematic_error(found, "1 % more weight", -0.01 * found.jacobian[:, 0])
    assert text == (
        "1 % more weight would change mu by +1 %, and these movements would not show it "
        "(0.0 standard deviations)"
    )


def test_an_error_that_nothing_imitates_is_seen() -> None:
    found = fitted(1)
    wave = 10.0 * np.sin(np.arange(found.residuals.size))
    assert "but the misfit would show it" in _systematic_error(found, "a wave", wave)


def test_gauges_that_read_too_much_are_seen_where_a_slip_level_is_known() -> None:
    found = fitted(3)
    column = SHARE * plain_gain_column(found.frame, ("drive_force", "1"))
    assert "but the misfit would show it" in _systematic_error(found, "1 % more", column)


def test_the_best_come_first_and_few() -> None:
    many = [
        Candidate(text=f"m{n}", gain=1.0 - 0.1 * n, parameter="k", remaining=0.5) for n in range(5)
    ]
    lines = next_lines(many)
    assert len(lines) == 3
    assert lines[0].startswith("next: m0: leaves 50 % of the standard deviation of k")


def test_an_error_that_a_free_gain_takes_up_is_not_said_to_be_seen() -> None:
    key = ("drive_force", "1")
    whole = misfit(alike(3, seed=1))
    free = replace(whole, comparison=replace(whole.comparison, gains={key: 0.01}))
    found = fit(free, PARAMETERS, TRUE)
    text = _systematic_error(found, "1 % more", SHARE * plain_gain_column(found.frame, key))
    # "Would change no value" stood beside intervals of several per cent.
    assert "would change no value by more than 0.00" in text
    assert "the fit takes it for gauges of drive 1 +" in text
    assert "and the misfit stays low" in text


def test_small_changes_are_not_listed_and_none_has_a_size() -> None:
    """A tenth of the error of 1 % is; of nothing at all it is said how little could be."""
    found = fitted(1)
    text = _systematic_error(found, "x", -found.jacobian @ np.array([2e-3, 9e-4]))
    assert text.startswith("x would change mu by +0.2 %, and")
    nothing = _systematic_error(found, "x", 0.0 * found.residuals)
    assert nothing.startswith("x would change no value by more than 0.001 %, and")
    # Of what is stated of a panel a hundredth of a per cent is said.
    columns = {"gravity": -found.jacobian @ np.array([3e-4, 5e-5])}
    (line,) = panel_doubt_lines(found, columns, {"gravity": 0.01})
    assert line == "gravity known to ± 1 %: moves mu by 0.03 %"


def test_objects_as_in_the_published_test_and_twice_as_thick_are_advised() -> None:
    whole = misfit(alike(1, seed=1))
    whole.evaluator = MadeUp(load_panel("sb1"))
    names = [item.name for item in _candidates(fit(whole, PARAMETERS, TRUE))]
    assert names[0] == "closing, no object"
    assert names[1:3] == ["closing, 13 mm at drive 1", "closing, 26 mm at drive 1"]


def test_what_is_lost_among_all_residuals_is_no_misfit_that_shows() -> None:
    found = fitted(1)
    wave = np.sin(np.arange(found.residuals.size))
    wave *= 4.0 / np.linalg.norm(wave)
    assert "only a fit with it as an unknown would show it (4 st" in _systematic_error(
        found, "a wave", wave
    )


def test_a_further_movement_narrows_no_gain_that_all_have_alike() -> None:
    """Friction is known as the gauges are, 1 %, however often it is measured."""
    left = {}
    for gain in (0.01, 0.0):
        measured = [
            replace(movement(f"m{n}", rng=np.random.default_rng(n)), length=1.4) for n in range(4)
        ]
        whole = misfit(measured)
        known = replace(
            whole.comparison,
            gains={("drive_force", "1"): gain},
            scatter={"mu": 0.001},
            uncertainty=Uncertainty(zero=0.01, gain=1e-5),
        )
        found = fit(replace(whole, comparison=known), PARAMETERS, TRUE)
        after = covariance_with(found, spread_of(found), found.local, found.frame)
        left[gain] = float(np.sqrt(after[0, 0]))
    assert left[0.01] > 0.0099
    assert left[0.0] < 0.0006


def test_as_many_movements_again_are_worth_as_much() -> None:
    measured = [movement(f"m{n}", rng=np.random.default_rng(n)) for n in range(4)]
    found = fit(misfit(measured), PARAMETERS, TRUE)
    spread = spread_of(found)
    statistical = np.linalg.inv(
        found.jacobian.T @ found.jacobian + np.diag(prior_information(PARAMETERS))
    )
    kept = spread.coordinate_covariance - statistical
    after = covariance_with(found, spread, found.local, found.frame)
    np.testing.assert_allclose(after - kept, statistical / 2.0, rtol=1e-2)
