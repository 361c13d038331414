"""What steady tables say of motors that stall, that lose a phase, and whose current is blind."""

import json

import pytest

from turnout.cli.machine import throw_summary
from turnout.core.errors import MachineError
from turnout.core.scheme import Scheme
from turnout.machine.components import Machine
from turnout.machine.machine_file import load_machines
from turnout.machine.motor_kind import motor_row
from turnout.machine.steady import blind_text, load_range, slip_point, stall_text, steady_lines
from turnout.metric.panel_check import blind_concerns, supply_concerns
from turnout.metric.summary import summary
from turnout.panel.load import load_panel
from turnout.throw.machine import throw_one_mass
from turnout.throw.simulate import simulate


def machine_of(name: str, **changes: object) -> Machine:
    overrides = {key.replace("__", "."): value for key, value in changes.items()}
    return load_machines(name, overrides=overrides).machine[name]


def test_a_motor_that_stalls_before_its_clutch_slips() -> None:
    """380 V to 100 V: breakdown by (100/380)^2, or a little more, below the clutch's 2.1 N m."""
    weak = machine_of("s700k", supply__voltage=100.0)
    most, rated = (
        one.motor.of_kind.stall_torque(motor_row(one.motor, one.supply))
        for one in (weak, machine_of("s700k"))
    )
    assert 1.0 <= most / (rated * (100.0 / 380.0) ** 2) < 1.02  # the main branch saturates less
    assert f"breakdown {most:.3g} N m, clutch 2.1 N m" in stall_text(weak)
    assert slip_point(weak).stalled
    assert load_range(weak) is None
    assert not blind_text(weak)
    lines = steady_lines(weak)
    assert sum("stalls, at" in line for line in lines) == 2
    assert "the motor stalls before the clutch slips" in lines[-1]
    assert not any("the clutch slips at" in line for line in lines)


def test_a_weak_direct_current_motor_stalls_too() -> None:
    weak = machine_of("jea73", supply__voltage=30.0, supply__line_resistance=54.0)
    assert "standstill" in stall_text(weak)
    assert not stall_text(machine_of("jea73"))


def test_a_motor_that_stalls_when_hot_alone_is_warned_of() -> None:
    hot = machine_of("s700k", motor__temperature=373.15, clutch__torque=12.2)
    assert "breakdown 9.9" in stall_text(hot)
    with pytest.raises(MachineError, match="the motor stalls at 13"):
        machine_of("s700k", motor__temperature=373.15, clutch__torque=14.0)


def test_a_lost_phase_has_no_steady_points_of_three() -> None:
    lost = machine_of("s700k", supply__phase_lost_at=0.0)
    assert load_range(lost) is None
    assert steady_lines(lost) == [
        "  none: one phase is lost from the start (supply.phase_lost_at = 0 s)"
    ]
    later = steady_lines(machine_of("s700k", supply__phase_lost_at=3.0))
    assert later[-1] == "  all with three phases; one is lost at 3 s"


@pytest.mark.parametrize(
    ("name", "torque", "words"),
    [
        ("s700k", 2.1, "current cannot show load: use power"),
        ("s700k", 0.01, "neither current nor power show load"),
        ("jea73", 0.05, "neither current nor power show load"),
        ("jea73", 1.0, ""),
    ],
)
def test_power_is_named_only_where_it_shows_more(name: str, torque: float, words: str) -> None:
    found = blind_text(machine_of(name, clutch__torque=torque))
    assert found.startswith(words)
    assert bool(found) == bool(words)
    panel = load_panel("sb1", overrides={"drive.1.machine": name})
    panel = panel.with_overrides({f"machine.{name}.clutch.torque": torque})
    texts = [concern.text for concern in blind_concerns(panel)]
    assert texts == ([f"blind current: drive 1: {name}: {found}"] if words else [])


def test_the_check_names_weak_motors_and_late_phases() -> None:
    panel = load_panel("sb1", overrides={"drive.1.machine": "s700k"})
    assert supply_concerns(panel) == []
    weak = panel.with_overrides({"machine.s700k.supply.voltage": 100.0})
    (concern,) = supply_concerns(weak)
    assert concern.what == "motor too weak"
    late = panel.with_overrides({"machine.s700k.supply.phase_lost_at": 500.0})
    (concern,) = supply_concerns(late)
    assert "supply.phase_lost_at = 500 s is after the end" in concern.text


@pytest.mark.parametrize("lost", [0.0, 500.0])
def test_a_lost_phase_is_in_summary_and_records(lost: float) -> None:
    panel = load_panel("sb1", overrides={"drive.1.machine": "s700k"})
    panel = panel.with_overrides({"machine.s700k.supply.phase_lost_at": lost})
    run = simulate(panel, scheme=Scheme.of("quick"))
    (first, *_) = json.loads(run.attrs["machine_throws"])
    text = "\n".join(line for _, line in summary(run))
    if lost == 0.0:
        assert first["phase_lost"] == 0.0
        assert "ONE PHASE LOST at t = 0.000 s" in text
        assert "blind_currents" not in run.attrs
    else:
        assert first["phase_lost"] is None
        assert "PHASE LOST" not in text
        assert "drive 1: its phase would be lost at 500 s, after the end: no effect" in text


@pytest.mark.parametrize("name", ["s700k", "zdj9"])
def test_the_gear_of_a_three_phase_machine_states_how_it_is_driven_back(name: str) -> None:
    """The same loss both ways: X'F (1/eta - 1) = X'F (1 - eta_b)."""
    gear = load_machines(name).machine[name].gear
    assert gear.back_efficiency == pytest.approx(2.0 - 1.0 / gear.efficiency, abs=5e-4)


def test_json_of_a_three_phase_throw_names_its_iron_loss() -> None:
    def names(machine: str) -> set[str]:
        throw = throw_one_mass(machine, overrides={"throw.duration": 0.3})
        return set(throw_summary(throw)["energies"])

    direct, three_phase = names("sb3"), names("s700k")
    assert direct - three_phase == {"energy_field", "energy_snub"}
    assert three_phase - direct == {"energy_iron", "energy_arc"}
