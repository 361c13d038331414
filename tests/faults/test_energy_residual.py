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
OPEN = {"sb1": 1e10, "uic60-760-1-15": 1e8}
"""Gravity at which the balance stays open [m/s2]."""


def share(dataset: Any) -> float:
    scale = max(float(dataset.attrs["energy_scale"]), LEAST_SCALE)
    return float(np.abs(dataset["energy_residual"]).max()) / scale


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", OPEN)
def test_an_open_balance_is_never_complete(name: str, mode: str) -> None:
    panel = load_panel(name).with_overrides({"gravity": OPEN[name]})
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


@pytest.mark.parametrize(
    ("command", "words"),
    [
        *(
            (f"simulate sb1 --mode {mode} --out OUT",
             ("INACCURATE", "turnout: inaccurate", "allowed is 1e-06"))
            for mode in MODES
        ),
        ("panel check sb1", ("throw is inaccurate", "energy residual", "gravity = 1e+10 m/s^2")),
        ("panel show sb1 --throw", ("THROW INACCURATE",)),
    ],
)  # fmt: skip
def test_commands_say_so_and_end_with_3(
    command: str, words: tuple[str, ...], tmp_path: Path
) -> None:
    out = tmp_path / "throw.nc"
    line = [str(out) if word == "OUT" else word for word in command.split()]
    result = CliRunner().invoke(app, [*line, "--set", HEAVY])
    assert result.exit_code == 3, result.output
    assert [word for word in words if word not in result.output] == []
    assert out.exists() == ("OUT" in command), "what was computed is kept"


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
