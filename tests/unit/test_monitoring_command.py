"""Monitoring systems on the command line and in virtual campaigns, and the files they leave."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.errors import MeasurementError, TurnoutError
from turnout.measurement.chain.monitoring import monitoring_of
from turnout.measurement.formats.file_format import read_recording
from turnout.panel.load import load_panel
from turnout.response.simulate import simulate
from turnout.response.store import save_response
from turnout.scheme import Scheme
from turnout.virtual.campaign_plan import CampaignPlan
from turnout.virtual.make_campaign import make_virtual_campaign

MACHINES = {"drive.1.machine": "s700k", "drive.2.machine": "jea73-drive2"}


@pytest.fixture(scope="module")
def run_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "run.nc"
    save_response(simulate(load_panel("sb2", overrides={}), scheme=Scheme.of("quick")), path)
    return path


@pytest.fixture(scope="module")
def machine_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "machines.nc"
    panel = load_panel("uic60-760-1-15", overrides={}).with_overrides(MACHINES)
    save_response(simulate(panel, scheme=Scheme.of("quick")), path)
    return path


def call(*words: object) -> tuple[int, str]:
    """Return exit code and output; an error of turnout is 2 and its message, as in `main`."""
    result = CliRunner().invoke(app, [str(word) for word in words])
    if isinstance(result.exception, TurnoutError):
        return 2, str(result.exception)
    return result.exit_code, result.output


def test_a_throw_on_the_command_line(machine_file: Path, tmp_path: Path) -> None:
    out = tmp_path / "stored.csv"
    code, text = call(
        *("machine", "monitor", machine_file, "--rate", "25 Hz", "--together", "switch=1,2"),
        *("--out", out, "--json"),
    )
    assert code == 0, text
    found = json.loads(text)
    assert found["rate"] == 25.0
    recording = read_recording(out)
    assert list(recording.channels) == [
        *("Current switch", "Active power switch", "Apparent power switch")
    ]
    current = recording.channel("Current switch")
    assert (current.unit, current.rate) == ("A", pytest.approx(25.0))
    assert current.start == pytest.approx(0.036)
    assert np.round(current.values, 2) == pytest.approx(current.values, abs=1e-9)
    assert current.values.max() > 1.0


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--rate", "25 A"], "--rate '25 A'"),
        (["--rate", "0.1 Hz"], "must be 1 to 1000 Hz"),
        (["--together", "1,2"], "write NAME=DRIVE,DRIVE"),
        (["--together", "a=1,7"], "drive 7 is not there"),
        (["--current-step", "-1 A"], "must be at least 0 A"),
    ],
)
def test_bad_input(machine_file: Path, tmp_path: Path, words: list[str], text: str) -> None:
    out = tmp_path / "stored.csv"
    code, output = call("machine", "monitor", machine_file, "--out", out, *words)
    assert code == 2
    assert text in output
    assert not out.exists()


def test_a_throw_of_markers(run_file: Path, tmp_path: Path) -> None:
    code, output = call("machine", "monitor", run_file, "--out", tmp_path / "stored.csv")
    assert code == 2
    assert "only drives that are machines have a current" in output


def test_all_problems_at_once() -> None:
    with pytest.raises(MeasurementError, match="rate") as raised:
        monitoring_of(rate="x", together=["a"], current_step="y")
    assert len(raised.value.problems) == 3


def test_a_virtual_campaign(tmp_path: Path) -> None:
    panel = load_panel("uic60-760-1-15").with_overrides({"drive.1.machine": "jea73"})
    plan = CampaignPlan(
        places=(),
        object_free=1,
        monitoring=monitoring_of(rate="25 Hz"),
        scheme=Scheme.of("quick"),
    )
    made = make_virtual_campaign(panel, tmp_path / "made", plan=plan)
    for item in made.thrown:
        stored = read_recording(tmp_path / "made" / "monitoring" / f"{item.case.name}.csv")
        assert set(stored.channels) == {"Current 1", "Current 2", "Active power 1"}
        current, power = stored.channel("Current 1").values, stored.channel("Active power 1").values
        running = (power > 0.0) & (current < 1.4)  # without inrush and braking
        assert running.sum() > 50
        assert power[running] == pytest.approx(220.0 * current[running], abs=2.5)


def test_a_campaign_refuses_together_without_a_rate(tmp_path: Path) -> None:
    code, output = call(
        "campaign", "virtual", "--out", tmp_path / "made", "--together", "switch=1,2"
    )
    assert code == 2
    assert "--monitoring '25 Hz'" in output
    assert not (tmp_path / "made").exists()
