"""What an induction motor has no use for, and what is shown of its throw."""

import json

import pytest
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.core.errors import FileError, MachineError
from turnout.machine.machine_file import load_machines


def shown(*words: str) -> str:
    result = CliRunner().invoke(app, ["machine", *words])
    assert result.exit_code == 0, result.output
    return result.output


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("circuit.snub_resistance", 5.0),
        ("circuit.measured_current", "supply"),
        ("motor.contact_resistance", 4.0),
    ],
)
def test_values_without_effect_are_refused(key: str, value: object) -> None:
    with pytest.raises(MachineError, match=key.rpartition(".")[2]):
        load_machines("s700k", overrides={key: value})
    assert load_machines("jea73", overrides={key: value})


def test_a_motor_based_on_one_of_direct_current_has_open_windings_after_the_cutoff() -> None:
    found = load_machines("s700k", overrides={"circuit.after_cutoff": "short circuit"})
    assert found.machine["s700k"].motor.kind == "induction"


def test_defaults_of_other_motors_are_not_shown() -> None:
    text = shown("show", "s700k")
    for key in ("snub_resistance", "measured_current", "brush_drop", "contact_resistance"):
        assert key not in text
    assert "after_cutoff" in text  # given in the file
    assert "snub_resistance" in shown("show", "jea73")


def test_a_template_takes_no_changes() -> None:
    words = ["machine", "show", "s700k", "--toml", "--set", "motor.voltage=-1 V"]
    result = CliRunner().invoke(app, words)
    assert isinstance(result.exception, FileError)
    assert "leave out --set" in str(result.exception)


def test_the_throw_of_a_three_phase_machine_in_its_own_words() -> None:
    words = ("run", "s700k", "--set", "supply.phase_lost_at=500 s")
    text = shown(*words)
    assert "A rms at" in text
    assert "active power    mean" in text
    assert "current cannot show load: use power" in text
    assert "supply.phase_lost_at = 500 s is after the end: no effect" in text
    energies = next(line for line in text.splitlines() if line.startswith("energy, J"))
    assert "iron " in energies
    assert "arc " in energies
    assert "field" not in energies
    assert "snub" not in energies
    found = json.loads(shown(*words, "--json"))
    assert found["power_mean"] == pytest.approx(
        found["energies"]["energy_supply"] / found["energised_time"], rel=0.01
    )
    assert found["current_mean"] == pytest.approx(1.77, abs=0.2)
    direct = shown("run", "sb3")
    assert "rms" not in direct
    assert "field" not in next(line for line in direct.splitlines() if line.startswith("energy, J"))
