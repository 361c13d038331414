"""Machines as files: what is read, what is changed by keys, what is refused and how."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import turnout
import turnout.solver.integration as solver_module
from turnout.cli.machine import app
from turnout.core.errors import FileError, MachineError
from turnout.core.keys import origin_at
from turnout.figures.machine import plot_machine
from turnout.machine.components import MACHINE_KEYS, Command
from turnout.machine.compute import places
from turnout.machine.compute.machine_step import rod_position
from turnout.machine.machine_file import load_machines, machine_names, machine_text
from turnout.machine.motor_kind import MOTOR_KINDS, Motor, PermanentMagnet, Supply
from turnout.machine.rows import angle_at, machine_row, stroke_table
from turnout.machine.steady import slip_point, stall_text
from turnout.solver.outcome import Code
from turnout.throw.machine import throw_one_mass

SHORT = {"throw.duration": 0.3}


def test_library() -> None:
    assert set(machine_names()) >= {"sb3", "jea73", "jea73-drive2", "zd6", "irs"}
    for name in machine_names():
        loaded = load_machines(name)
        assert loaded.pick()[0] == name
        assert loaded.description


def test_keys_short_broad_and_named() -> None:
    base = load_machines("sb3")
    for key in ("motor.voltage", "machine.motor.voltage", "machine.sb3.motor.voltage"):
        changed = base.with_overrides({key: 176.0})
        assert changed.machine["sb3"].motor.voltage == 176.0
    assert base.machine["sb3"].motor.voltage == 220.0
    cranked = base.with_overrides({"hand": {"stiffness": 1.0, "speed": 60.0, "ramp": 0.5}})
    assert cranked.machine["sb3"].hand is not None
    assert cranked.with_overrides({"hand": None}).machine["sb3"].hand is None
    several = base.with_settings(
        ["throw.command=[{time='0.1 s'}, {time='8.6 s', direction='open'}]"]
    )
    assert several.throw is not None
    assert [command.time for command in several.throw.command] == [0.1, 8.6]


def test_temperature_in_degrees() -> None:
    cold = load_machines("sb3").with_settings(["motor.temperature=-25 degC"])
    row = machine_row(cold.machine["sb3"])
    assert row[places.RESISTANCE] == pytest.approx(13 * (1 - 0.0039 * 45), rel=1e-12)


def test_own_file(tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    file.write_text(machine_text("jea73").replace('"220 V"', '"200 V"'))
    loaded = load_machines(file)
    assert loaded.pick()[1].motor.voltage == 200.0
    origin = origin_at(loaded.origins, "machine.jea73.motor.voltage")
    assert origin is not None
    assert origin.kind == "assumption"
    assert throw_one_mass(file, overrides=SHORT).time[-1] == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"motor.inertia": 0.0}, ("machine.sb3.motor.inertia = 0", "more than 0")),
        ({"motor.voltag": 1.0}, ("motor.voltag: matches nothing", "nearest is 'motor.voltage'")),
        ({"clutch.torque": 50.0}, ("would never slip", "50 N m", "lower clutch.torque")),
        ({"motor.kind": "series"}, ("series motor needs field_constant",)),
        ({"gear.efficiency": 1.2}, ("gear.efficiency = 1.2", "at most 1")),
        ({"stroke.kind": "table"}, ("a table needs angle and length",)),
        ({"circuit.holding": "gear"}, ("self-locking", "back_efficiency = 0")),
        ({"circuit.holding": "brake"}, ("needs motor.brake_torque",)),
        ({"throw.step": 3e-4}, ("output_interval must be a multiple",)),
        ({"throw.output_interval": 1e-4, "throw.duration": 500.0}, ("instants are kept",)),
        ({"rail": None, "throw": None}, ("[rail]: is missing", "[throw]: is missing")),
        ({"motor.voltage": -1.0, "rail.mass": 0.0}, ("motor.voltage", "rail.mass", "2 problems")),
        ({"throw.machine": "jea"}, ("no machine is called 'jea'", "there are 'sb3'")),
    ],
)
def test_what_is_refused(overrides: dict[str, object], words: tuple[str, ...]) -> None:
    with pytest.raises(MachineError) as caught:
        throw_one_mass("sb3", overrides=overrides)
    for word in words:
        assert word in str(caught.value)


def test_all_values_that_do_not_go_together_are_named_at_once() -> None:
    """It named the first one only."""
    wrong = {"circuit.holding": "brake", "supply.phase_lost_at": 1.0}
    with pytest.raises(MachineError) as caught:
        load_machines("sb3").with_overrides(wrong)
    for words in (
        "needs motor.brake_torque",
        "phase_lost_at: without effect on a permanent magnet motor, which has no phases",
    ):
        assert words in str(caught.value)


def test_units_are_asked_for_in_texts() -> None:
    with pytest.raises(MachineError, match="write the unit"):
        load_machines("sb3").with_settings(["motor.voltage=176"])
    with pytest.raises(MachineError, match="KEY=VALUE"):
        load_machines("sb3").with_settings(["motor.voltage"])
    with pytest.raises(MachineError, match="is a unit of force"):
        load_machines("sb3").with_settings(["clutch.torque=6 kN"])


def test_unknown_machine() -> None:
    with pytest.raises(FileError, match="no library machine is called 'jea37'; nearest is 'jea73'"):
        load_machines("jea37")


def test_record_needs_rail_and_throw() -> None:
    loaded = load_machines("sb3", overrides=SHORT)
    machine = loaded.machine["sb3"]
    with pytest.raises(MachineError, match="needs a rail and a throw"):
        throw_one_mass(machine)
    thrown = throw_one_mass(machine, loaded.rail, loaded.throw)
    assert np.array_equal(thrown["current"], throw_one_mass(loaded)["current"])


@pytest.mark.parametrize("name", ["sb3", "zd6"])
def test_angle_and_position_are_inverse(name: str) -> None:
    machine = load_machines(name).machine[name]
    row, table = machine_row(machine), stroke_table(machine.stroke)
    for x in (-0.1, -0.05, -0.01):
        assert rod_position(row, table, angle_at(machine, row, x))[0] == pytest.approx(x, abs=1e-12)


@pytest.mark.parametrize("kind", ["screw", "crank", "table"])
def test_derivatives_of_the_stroke(kind: str) -> None:
    changes: dict[str, object] = {}
    if kind == "crank":
        changes = {"stroke": {"kind": "crank", "angle": 650.0, "length": 0.12, "start": -0.117}}
    name = "zd6" if kind == "table" else "sb3"
    machine = load_machines(name, overrides=changes).machine[name]
    row, table = machine_row(machine), stroke_table(machine.stroke)
    for angle in (77.0, 130.0, 300.0, 620.0):
        (low, d_low, _), (high, d_high, _) = (
            rod_position(row, table, angle + step) for step in (-1e-3, 1e-3)
        )
        _, slope, bend = rod_position(row, table, angle)
        assert slope == pytest.approx((high - low) / 2e-3, rel=1e-6, abs=1e-12)
        assert bend == pytest.approx((d_high - d_low) / 2e-3, rel=1e-4, abs=1e-12)


def test_start_in_equilibrium() -> None:
    thrown = throw_one_mass("sb3", overrides=SHORT)
    y = (750e3 * -0.117 + 20e3 * -0.031 + 0.9 * 1500) / (750e3 + 20e3)
    assert thrown["rail_position"][0] == pytest.approx(y, rel=1e-12)
    assert thrown["rail_position"][100] == pytest.approx(y, rel=1e-9)
    far = {"rail.bed_stiffness": 1e9, "rail.bed_rest": -7.0, "throw.duration": 0.05}
    stiff = throw_one_mass("sb3", overrides=far)
    assert stiff["rail_position"][0] == pytest.approx(-7.0, abs=0.01)


def test_where_the_clamp_sits() -> None:
    lead = throw_one_mass("sb3")
    supply = throw_one_mass("sb3", overrides={"circuit.measured_current": "supply"})
    # the short circuit brakes with up to 13 A, which only a clamp on the motor lead sees
    assert lead["current"].min() < -5.0
    assert supply["current"].min() >= -1e-9
    assert np.array_equal(supply["lead_current"], lead["current"])


def test_hand_that_does_not_let_go() -> None:
    hand = {"stiffness": 1.0, "speed": 60.0, "ramp": 0.5}
    cranked = {"throw.duration": 13.0, "throw.step": 1e-3}
    released = throw_one_mass("sb3", overrides=cranked | {"hand": hand})
    held = throw_one_mass("sb3", overrides=cranked | {"hand": hand | {"release": "never"}})
    assert np.abs(released["clutch_slip"]).max() < 1e-9
    # it goes on until the clutch slips against the stock rail
    assert held["clutch_slip"][-1] > 10.0
    assert held.energy_residual <= 1e-6


def test_kernel_without_compilation() -> None:
    machine = load_machines("zd6").machine["zd6"]
    row, table = machine_row(machine), stroke_table(machine.stroke)
    plain = rod_position.py_func(row, table, 400.0)  # type: ignore[attr-defined]
    assert plain == pytest.approx(rod_position(row, table, 400.0), rel=1e-15)


def test_facade() -> None:
    thrown = turnout.throw_one_mass("sb3", overrides=SHORT)
    dataset = turnout.machine_dataset(thrown)
    assert dataset["rod_force"].attrs["units"] == "N"
    assert json.loads(dataset.attrs["overrides"]) == SHORT
    assert list(dataset["event"].values) == ["on"]


def test_figure_shows_the_histories() -> None:
    dataset = turnout.machine_dataset(throw_one_mass("sb3", overrides=SHORT))
    axes = plot_machine(dataset).axes
    drawn = axes[2].lines[0].get_ydata()
    assert np.allclose(drawn, 1e-3 * dataset["rod_force"].values)
    assert [text.get_text() for text in axes[0].texts] == ["on"]


def test_default_command_starts_at_once() -> None:
    assert Command.model_validate({"time": "0.1 s"}).direction == "close"
    base = load_machines("sb3").with_overrides({"throw.command": None})
    assert base.throw is not None
    assert base.throw.command[0].time == 0.0


def test_a_run_that_does_not_converge(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No machine found so far does that: the kernel is kept from it."""
    monkeypatch.setattr(solver_module, "_march", lambda *_: (Code.NOT_CONVERGED, 70))
    out = tmp_path / "run.nc"
    run = CliRunner().invoke(app, ["run", "sb3", "--out", str(out)])
    assert run.exit_code == 3
    assert "not converged at t = 0.0035 s" in run.stderr
    assert not out.exists()


def test_commands_of_the_program(tmp_path: Path) -> None:
    runner = CliRunner()
    listed = runner.invoke(app, ["list"])
    assert listed.exit_code == 0
    assert "jea73-drive2" in listed.stdout
    shown = runner.invoke(app, ["show", "jea73"])
    assert "assumption: four" not in shown.stdout
    assert "750000 N/m" in " ".join(shown.stdout.split())
    assert "paper: bushing of Drive 1" in shown.stdout
    slip = slip_point(load_machines("jea73").machine["jea73"])
    assert f"{slip.current:.4f} A" in shown.stdout
    text = runner.invoke(app, ["show", "zd6", "--toml"])
    assert text.stdout == machine_text("zd6")
    out = tmp_path / "run.nc"
    settings = ["--set", "throw.duration=0.5 s"]
    run = runner.invoke(app, ["run", "sb3", *settings, "--out", str(out), "--json"])
    assert run.exit_code == 0
    found = json.loads(run.stdout)
    assert found["current_peak"] == pytest.approx(10.272, abs=1e-3)
    assert found["outcome"] == "moving"
    with xr.open_dataset(out) as dataset:
        assert dataset.attrs["machine"] == "sb3"
        assert dataset["current"].max() == pytest.approx(found["current_peak"])
    figure = tmp_path / "run.png"
    reported = runner.invoke(
        app, ["run", "sb3", *settings, "--out", str(out), "--plot", str(figure)]
    )
    assert reported.stdout.count("written") == 2
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert "energy residual" in reported.stdout


class Doubled(PermanentMagnet):
    """A toy kind: twice the constant of a permanent magnet, and no snubbing."""

    without_effect = ("circuit.snub_resistance",)
    no_effect_since = "which is a toy"
    stall = "toy standstill"

    def places(self, motor: Motor, supply: Supply) -> dict[int, float]:
        """Return k [V s/rad]."""
        own = super().places(motor, supply)
        return own | {places.MOTOR_CONSTANT: 2.0 * own[places.MOTOR_CONSTANT]}


def test_a_kind_of_motor_is_one_class(monkeypatch: pytest.MonkeyPatch) -> None:
    """What it is called, refuses, computes, draws and says follows from its row alone."""
    constant = load_machines("sb3").machine["sb3"].motor.constant
    assert constant is not None
    usual = throw_one_mass("sb3", overrides={**SHORT, "circuit.snub_resistance": 0.0})
    toy = {"motor.kind": "toy", "motor.constant": 0.5 * constant, "circuit.snub_resistance": 0.0}
    with pytest.raises(MachineError, match="motor.kind = \"toy\": must be 'permanent magnet'"):
        load_machines("sb3", overrides=toy)
    monkeypatch.setitem(MOTOR_KINDS, "toy", Doubled())
    thrown = throw_one_mass("sb3", overrides={**SHORT, **toy})
    assert np.array_equal(thrown["current"], usual["current"])
    loaded = load_machines("sb3", overrides=toy)
    point = slip_point(loaded.machine["sb3"])
    assert point == slip_point(load_machines("sb3").machine["sb3"])
    weak = loaded.with_overrides({"supply.voltage": 20.0}).machine["sb3"]
    assert "(toy standstill " in stall_text(weak)
    with pytest.raises(MachineError, match="snub_resistance: without effect on a toy motor, which"):
        load_machines("sb3", overrides=toy | {"circuit.snub_resistance": 1.0})
    key = MACHINE_KEYS.find("motor.kind")
    assert key is not None
    assert '"toy"' in key.allowed
