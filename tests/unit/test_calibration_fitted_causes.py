"""Predictions have the causes that a calibration has fitted."""

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.calibrations import calibration, fitted
from tests.unit.test_calibration_fit import TRUE, response

from turnout.calibration.result import (
    fitted_causes,
    overrides_with,
    shaped,
)
from turnout.panel.load import load_panel


def test_a_soft_bushing_that_was_fitted_is_in_the_calibrated_panel() -> None:
    panel, plain = load_panel("sb1"), calibration()
    sizes = {"drive.1.soft_travel": 2e-3, "drive.1.soft_travel.softness": np.log(4.0)}
    causes = tuple(replace(fitted(name, value, unit="m"), keys=()) for name, value in sizes.items())
    found = replace(plain, parameters=(*plain.parameters, *causes)).apply(panel).drive["1"]
    assert found.extension is not None
    assert found.force is not None
    stiffness = plain.values["drive.1.stiffness"]
    assert np.interp(2e-3, found.extension, found.force) == pytest.approx(0.25 * stiffness * 2e-3)
    assert plain.apply(panel).drive["1"].extension is None


def test_a_recorder_that_averages_is_in_predictions_but_not_in_the_panel() -> None:
    panel, plain = load_panel("sb1"), calibration()
    recorder = replace(fitted("recorder.average", 0.2, unit="s"), keys=())
    known = replace(plain, parameters=(*plain.parameters, recorder))
    causes = fitted_causes(panel, known.parameters)
    assert [item.name for item in causes] == ["recorder filter"]
    assert overrides_with(causes, known.parameters, known.values) == plain.overrides
    made = response(TRUE)
    late = shaped(causes, made, known.values).drive_force["1"]
    assert np.abs(late - made.drive_force["1"]).max() > 100.0
    assert fitted_causes(panel, plain.parameters) == ()


def test_cross_talk_is_of_the_forces_without_it_and_may_be_one_way() -> None:
    panel, plain = load_panel("sb1"), calibration()
    sizes = {"cross_talk.1.2": 0.03, "cross_talk.2.1": 0.0}
    talks = tuple(replace(fitted(name, value, unit="1"), keys=()) for name, value in sizes.items())
    known = replace(plain, parameters=(*plain.parameters, *talks))
    (cause,) = fitted_causes(panel, known.parameters)
    made = response(TRUE)
    both = replace(made, drive_force={"1": made.drive_force["1"], "2": -2.0 * made.object_force})
    seen = shaped((cause,), both, known.values).drive_force
    expected = both.drive_force["1"] + 0.03 * both.drive_force["2"]
    np.testing.assert_allclose(seen["1"], expected)
    np.testing.assert_array_equal(seen["2"], both.drive_force["2"])
    assert cause.text(cause.sizes_in(known.values)) == (
        "3 % of the force of drive 2 in the gauges of drive 1 and "
        "0 % of the force of drive 1 in the gauges of drive 2"
    )
