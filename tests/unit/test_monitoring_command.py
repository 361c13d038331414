"""Monitoring systems on the command line and in virtual campaigns, and the files they leave."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from turnout.api.campaign import load_campaign
from turnout.api.machine import fit_three_phase
from turnout.calibration.machine_estimates.current_fit import Estimate, NotIdentified
from turnout.cli.main import app
from turnout.core.errors import MeasurementError, TurnoutError
from turnout.core.scheme import Scheme
from turnout.core.toml import parse_toml
from turnout.machine.steady import steady_point
from turnout.measurement.chain.apply import apply_chain, parse_channel_map
from turnout.measurement.chain.monitoring import monitoring_of
from turnout.measurement.chain.skeleton import skeleton
from turnout.measurement.formats.file_format import read_recording
from turnout.panel.load import load_panel
from turnout.study.virtual.campaign_plan import CampaignPlan, check_plan
from turnout.study.virtual.make_campaign import make_virtual_campaign
from turnout.study.virtual.record_throw import Window
from turnout.throw.machine import machine_dataset, throw_one_mass
from turnout.throw.simulate import simulate
from turnout.throw.store import save_response

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
        *("Current switch", "Active power switch", "Apparent power switch", "Voltage switch")
    ]
    current = recording.channel("Current switch")
    assert (current.unit, current.rate) == ("A", pytest.approx(25.0))
    assert current.start == pytest.approx(0.036)
    assert np.round(current.values, 2) == pytest.approx(current.values, abs=1e-9)
    with xr.open_dataset(machine_file) as run:
        first, second = run["drive_current"].values
    count = current.values.size * 10  # quick mode stores every 4 ms
    alternating, direct = (row[:count].reshape(-1, 10) for row in (first, second))
    seen = np.sqrt((alternating**2 + direct**2).mean(axis=1))
    assert current.values == pytest.approx(seen, abs=0.00501)
    assert seen.max() > 1.0


@pytest.mark.parametrize("suffix", [".csv", ".h5", ".mat"])
def test_a_coarse_power_comes_back_as_that_of_a_drive(tmp_path: Path, suffix: str) -> None:
    """Times within a sample and the energy within 2 %, in steps of 5 kW / 255."""
    throw = throw_one_mass("s700k", overrides={"throw.duration": 2.0})
    file, out = tmp_path / "run.nc", tmp_path / f"stored{suffix}"
    save_response(machine_dataset(throw), file)
    code, text = call("machine", "monitor", file, "--out", out, "--rate", "zyj7")
    assert code == 0, text
    suggested = skeleton(read_recording(out))
    dataset = apply_chain(read_recording(out), parse_channel_map(parse_toml(suggested, source="")))
    power = dataset["drive_power"].values[0]
    assert np.allclose(power * 255 / 5e3, np.round(power * 255 / 5e3), atol=1e-6)
    time, true = throw["time"], throw["power"]
    assert dataset["time"].values[-1] == pytest.approx(time[-1], abs=1.0 / 25.0)
    energy = float(np.sum(power) / 25.0)
    assert energy == pytest.approx(float(np.trapezoid(true, time)), rel=0.02)
    # The inrush begins in the first sample, and the run ends within one of its true end.
    last, stored = np.flatnonzero(true > 100.0)[-1], np.flatnonzero(power > 100.0)[-1]
    assert dataset["time"].values[stored] == pytest.approx(time[last], abs=1.0 / 25.0)


def test_the_throw_of_one_machine(tmp_path: Path) -> None:
    for machine, count in (("s700k", 4), ("sb3", 3)):
        throw = throw_one_mass(machine, overrides={"throw.duration": 0.5})
        file, out = tmp_path / f"{machine}.nc", tmp_path / f"{machine}.csv"
        save_response(machine_dataset(throw), file)
        code, text = call("machine", "monitor", file, "--out", out, "--rate", "25 Hz")
        assert code == 0, text
        recording = read_recording(out)
        assert len(recording.channels) == count
        seen = np.sqrt((throw["current"][:40] ** 2).mean())
        assert recording.channel(f"Current {machine}").values[0] == pytest.approx(seen, abs=0.00501)


@pytest.mark.parametrize(
    ("file", "words", "text"),
    [
        ("machine_file", ["--rate", "25 A"], "--rate '25 A'"),
        ("machine_file", ["--rate", "0.1 Hz"], "must be 1 to 1000 Hz"),
        ("machine_file", ["--together", "1,2"], "write NAME=DRIVE,DRIVE"),
        ("machine_file", ["--together", "a=1,7"], "drive 7 is not there"),
        ("machine_file", ["--current-step", "-1 A"], "must be 0 to 100 A"),
        ("machine_file", ["--current-step", "1e300 A"], "must be 0 to 100 A"),
        ("run_file", [], "take a throw whose drives are machines"),
    ],
)
def test_bad_input(
    request: pytest.FixtureRequest, tmp_path: Path, file: str, words: list[str], text: str
) -> None:
    out = tmp_path / "stored.csv"
    run = request.getfixturevalue(file)
    code, output = call("machine", "monitor", run, "--out", out, *words)
    assert code == 2
    assert text in output
    assert not out.exists()


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
        assert set(stored.channels) == {"Current 1", "Current 2", "Active power 1", "Voltage 1"}
        current, power = stored.channel("Current 1").values, stored.channel("Active power 1").values
        running = (power > 0.0) & (current < 1.4)  # without inrush and braking
        assert running.sum() > 50
        assert power[running] == pytest.approx(220.0 * current[running], abs=2.5)


def test_a_virtual_campaign_tells_resistance_and_slopes(tmp_path: Path) -> None:
    """12 ohm of line and stator; the steady circuit's slopes, of supplies that differ by 1 %."""
    panel = load_panel("uic60-760-1-15").with_overrides({"drive.1.machine": "three-phase"})
    system = monitoring_of(rate="switchmonitor")
    plan = CampaignPlan(places=(), object_free=15, monitoring=system, scheme=Scheme.of("quick"))
    make_virtual_campaign(panel, tmp_path / "made", plan=plan)
    made = load_campaign(tmp_path / "made" / "monitoring").dataset
    assert np.ptp(made["drive_voltage"].sel(drive="1").max("time").values) > 8.0
    fit, marker = fit_three_phase(made, rated_voltage=380.0)
    assert marker.verdict == "only I recorded; nothing to fit"
    machine = panel.machine["three-phase"]

    def current(voltage: float, power: float) -> float:
        supply = machine.supply.model_copy(update={"voltage": voltage})
        own = machine.model_copy(update={"supply": supply})
        points = [steady_point(own, torque=torque) for torque in np.linspace(0.0, 1.5, 9)]
        return float(np.interp(power, [p.power for p in points], [p.current for p in points]))

    u, p = fit.voltage, fit.power
    truths = {
        "resistance": 12.0,
        "per_volt": (current(u + 2.0, p) - current(u - 2.0, p)) / 4.0,
        "per_watt": (current(u, p + 20.0) - current(u, p - 20.0)) / 40.0,
        "current": current(380.0, p),
    }
    for name, truth in truths.items():
        value = getattr(fit, name)
        assert isinstance(value, Estimate), name
        assert value.low < truth < value.high, (name, truth, value)
        assert value.value == pytest.approx(truth, rel=0.05)
    assert isinstance(fit.loss, NotIdentified)
    assert isinstance(fit.rotor, NotIdentified)


@pytest.mark.parametrize(
    ("changes", "chosen", "words"),
    [
        ({}, {"rate": "400 Hz"}, "400 1/s: what it samples has 200 1/s only"),
        ({}, {"together": ["1=2"]}, "write NAME=DRIVE,DRIVE"),
        ({"drive.2.machine": "zdj9"}, {"together": ["1=1,2"]}, None),
        (
            {"drive.2.machine": "zdj9", "machine.zdj9.motor.frequency": 60.0},
            {"together": ["switch=1,2"]},
            "50 and 60 Hz",
        ),
        (
            {"machine.s700k.supply.phase_lost_at": 100.0},
            {"together": ["switch=1,2"]},
            "drive 1 loses a phase at 100 s",
        ),
    ],
)
def test_a_campaign_refuses_before_it_throws(
    tmp_path: Path, changes: dict[str, object], chosen: dict[str, object], words: str | None
) -> None:
    panel = load_panel("uic60-760-1-15").with_overrides({"drive.1.machine": "s700k"})
    panel = panel.with_overrides({k: v for k, v in changes.items() if k.startswith("drive")})
    panel = panel.with_overrides({k: v for k, v in changes.items() if k.startswith("machine")})

    def plan() -> CampaignPlan:
        return CampaignPlan(
            places=(),
            window=Window(rate=200.0),
            monitoring=monitoring_of(**{"rate": "25 Hz"} | chosen),
        )

    if words is None:
        check_plan(plan(), panel)
        return
    with pytest.raises(MeasurementError, match=words):
        make_virtual_campaign(panel, tmp_path / "made", plan=plan())
    assert not (tmp_path / "made").exists()


def test_a_campaign_refuses_together_without_a_rate(tmp_path: Path) -> None:
    code, output = call(
        "campaign", "virtual", "--out", tmp_path / "made", "--together", "switch=1,2"
    )
    assert code == 2
    assert "--monitoring '25 Hz'" in output
    assert not (tmp_path / "made").exists()
