"""A run whose energy balance stays open is `inaccurate`, in every mode and on every face.

The balances below are open by 1e-6 to 1e-2 of their scale, all by rounding: a rail that weighs or
is pressed 1e9 times too much leaves its energies as small differences of large terms.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit.sweeps import small_study
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.core.scheme import Scheme
from turnout.metric.summary import numerical_share, numerical_warning
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.solver.outcome import CLOSES, LEAST_SCALE, NotConverged
from turnout.study.sweep.batch import batch_variables
from turnout.study.sweep.row import throw_scenarios
from turnout.throw.simulate import simulate

MODES = ("waveform", "quick", "quasi-static")
HEAVY = "gravity=1e10 m/s^2"
# Chairs of 1e12 N/m a metre below the rail are no case: 4e-7 to 4e-6 of the scale, by processor.
OPEN: dict[str, tuple[str, dict[str, Any], tuple[str, ...]]] = {
    "gravity": ("sb1", {"gravity": 1e10}, MODES),
    "heavy rails": ("uic60-760-1-15", {"gravity": 1e8}, MODES),
}
CASES = [(name, mode) for name, (_, _, modes) in OPEN.items() for mode in modes]


def share(dataset: Any) -> float:
    scale = max(float(dataset.attrs["energy_scale"]), LEAST_SCALE)
    return float(np.abs(dataset["energy_residual"]).max()) / scale


@pytest.mark.parametrize(("case", "mode"), CASES)
def test_an_open_balance_is_never_complete(case: str, mode: str) -> None:
    name, changes, _ = OPEN[case]
    panel = load_panel(name).with_overrides(changes)
    dataset = simulate(panel, scheme=Scheme.of(mode), throw=False)
    assert share(dataset) > CLOSES
    assert dataset.attrs["outcome"] == "inaccurate"
    assert not dataset.attrs["complete"]
    assert "energy residual" in dataset.attrs["outcome_message"]


@pytest.mark.parametrize("mode", MODES)
def test_heavy_but_closed_is_complete(mode: str) -> None:
    """Density and gravity beyond sense whose balance closes: a warning, not called inaccurate."""
    changes = {"material.density": 1e6, "gravity": 1000.0}
    panel = load_panel("sb1").with_overrides(changes)
    dataset = simulate(panel, scheme=Scheme.of(mode))
    assert share(dataset) < CLOSES


def test_python_raises_with_the_partial_dataset() -> None:
    panel = load_panel("sb1").with_overrides({"gravity": 1e10})
    with pytest.raises(NotConverged, match="inaccurate") as caught:
        simulate(panel, scheme=Scheme.of("quick"))
    assert caught.value.outcome.energy_residual > CLOSES * caught.value.outcome.energy_scale
    assert caught.value.partial.sizes["time"] > 1


@pytest.mark.parametrize("mode", MODES)
def test_the_command_ends_with_3(mode: str, tmp_path: Path) -> None:
    out = tmp_path / "throw.nc"
    arguments = ["simulate", "sb1", "--set", HEAVY, "--mode", mode, "--out", str(out)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 3, result.output
    assert "INACCURATE" in result.stdout
    assert "turnout: inaccurate" in result.stderr
    assert "allowed is 1e-06" in result.stderr
    assert out.exists(), "what was computed is kept"


def test_panel_check_says_so_and_ends_with_3() -> None:
    result = CliRunner().invoke(app, ["panel", "check", "sb1", "--set", HEAVY])
    assert result.exit_code == 3, result.output
    reported = [line for line in result.stdout.splitlines() if line.startswith("warning: ")]
    assert any("throw is inaccurate" in line and "energy residual" in line for line in reported)
    assert any("gravity = 1e+10 m/s^2" in line for line in reported)


def test_panel_show_with_a_throw_says_so_and_ends_with_3() -> None:
    result = CliRunner().invoke(app, ["panel", "show", "sb1", "--throw", "--set", HEAVY])
    assert result.exit_code == 3, result.output
    assert "THROW INACCURATE" in result.stdout


def test_a_sweep_stores_it_with_its_outcome(tmp_path: Path) -> None:
    study = small_study(tmp_path, count=1)
    heavy = replace(study.scenario(0), overrides={"gravity": 1e10})
    (row,) = throw_scenarios(study, [heavy])
    assert (row.outcome, row.attempts) == ("inaccurate", 2)
    assert "energy residual" in row.reason
    stored = batch_variables(study, [row])
    assert str(stored["outcome"].values[0]) == "inaccurate"
    assert "drive_force" not in stored, "numbers that are not reliable are not stored"


def test_a_step_that_makes_energy_is_warned_of() -> None:
    """An object of 13 mm at x = 3.6 m: steps of 4 ms make a sixth of the energy in the blow.

    The balance closes all the same, as it counts what the scheme makes; with smaller steps of the
    same scheme that falls below what is worth a warning, so it is the step's and not the model's.
    """
    panel = load_panel("sb1")
    trapped = ForeignObject("13 mm", "x = 3.6 m")

    def thrown(scheme: Scheme) -> Any:
        return simulate(panel, foreign_object=trapped, scheme=scheme)

    usual = Scheme.of("quick", spectral_radius=0.5)
    coarse, fine = thrown(usual), thrown(replace(usual, step=5e-4, output_interval=5e-4))
    assert share(coarse) < CLOSES
    assert numerical_share(coarse) == pytest.approx(0.17, abs=0.02)
    assert "the time stepping itself MADE 17" in (numerical_warning(coarse) or "")
    assert "smaller step" in (numerical_warning(coarse) or "")
    assert numerical_share(fine) < 0.01
    assert numerical_warning(fine) is None
    # What is decided and measured does not hang on it here.
    assert bool(coarse["locked"][-1]) == bool(fine["locked"][-1])
    for name in ("drive_force", "object_force"):
        peak = float(abs(fine[name]).max())
        assert float(abs(coarse[name]).max()) == pytest.approx(peak, rel=0.02)
