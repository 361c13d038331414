"""Table and figures of each movement of a fit, on movements that were made up."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.calibrations import calibration
from tests.unit.test_calibration_fit import PARAMETERS, TRUE, misfit, movement

from turnout.calibration.covariance import drift_finding
from turnout.calibration.fit import Fit, fit
from turnout.calibration.result import load_calibration
from turnout.calibration.result_entries import fitted_signals, movement_rows
from turnout.core.errors import ResponseError
from turnout.figures.calibration import plot_fit

LATE, OWN = 0.03, 0.05


@pytest.fixture(scope="module")
def found() -> Fit:
    own = [0.0, 0.0, 0.0, OWN]
    late = [0.0, LATE, 0.0, 0.0]
    made = [
        movement(f"m{n}", rng=np.random.default_rng(n), late=late[n], own=own[n]) for n in range(4)
    ]
    signal = replace(made[2].signals[0], values=made[2].signals[0].values + 15.0)
    made[2] = replace(made[2], signals=(signal,))
    return fit(misfit(made), PARAMETERS, TRUE)


def test_each_movement_has_what_is_its_own(found: Fit) -> None:
    rows = movement_rows(found)
    assert rows["m1"]["onset"] == pytest.approx(LATE, abs=3e-3)
    assert rows["m0"]["onset"] == pytest.approx(0.0, abs=3e-3)
    assert rows["m3"]["mu"] - rows["m0"]["mu"] == pytest.approx(OWN, abs=0.02)
    assert rows["m2"]["zero drive_force.1"] - rows["m0"]["zero drive_force.1"] > 8.0
    # What is left is the noise, of 2 N.
    for row in rows.values():
        assert row["residual drive_force.1"] == pytest.approx(2.0, rel=0.25)


def test_signals_are_fitted_plus_residual(found: Fit) -> None:
    signals = fitted_signals(found)
    known = signals["measured"].notnull()
    total = (signals["fitted"] + signals["residual"]).values[known.values]
    np.testing.assert_allclose(total, signals["measured"].values[known.values])
    assert signals["time"].values[0] > 0.0
    assert list(signals["channel"].values) == ["Drive 1"]


def test_a_movement_is_drawn_with_its_residual(found: Fit) -> None:
    signals = fitted_signals(found)
    axes = plot_fit(signals, "m1").axes
    assert [ax.get_ylabel() for ax in axes] == ["Drive 1 [kN]", "Residual [N]"]
    wide, thin = axes[0].lines[:2]
    assert wide.get_linewidth() > 3.0 * thin.get_linewidth()  # so that both are to be seen
    assert wide.get_color() != thin.get_color()
    assert axes[1].lines[0].get_label() == "RMS 1.9 N"
    measured, fitted = (line.get_ydata() for line in axes[0].lines[:2])
    rest = np.asarray(axes[1].lines[0].get_ydata(), dtype=float)
    off = 1e3 * (np.asarray(measured, dtype=float) - np.asarray(fitted, dtype=float))
    np.testing.assert_allclose(off, rest, atol=1e-9)
    with pytest.raises(ResponseError, match="nothing to draw"):
        plot_fit(signals.where(signals["time"] < 0.0), "m1")


def test_the_table_is_kept_in_the_file(found: Fit, tmp_path: Path) -> None:
    rows = movement_rows(found)
    known = replace(calibration(), effects=rows, sensors=("load cell +0.1 %",))
    known.save(tmp_path / "c.toml")
    read = load_calibration(tmp_path / "c.toml")
    assert read.effects == rows
    assert read.sensors == ("load cell +0.1 %",)


def test_friction_that_drifts_over_the_campaign_is_named_with_its_slope() -> None:
    rng = np.random.default_rng(5)
    steady = [0.01, -0.02, 0.005, 0.015, -0.01, 0.0, 0.02, -0.015]
    for owns, drifts in (([0.01 * n for n in range(8)], True), (steady, False)):
        measured = [movement(f"m{n}", rng=rng, own=own) for n, own in enumerate(owns)]
        found = fit(misfit(measured[::-1]), PARAMETERS, TRUE, refined=False)
        lines = drift_finding(found, [item.name for item in measured])
        assert [text.startswith("mu rises by 1 ±") for text in lines] == [True] * drifts
