"""Bad input of `turnout machine`: one message, exit code 2, no traceback, no file left."""

from pathlib import Path

import pytest
from tests.faults.terminal import run_here


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run", "sb4"), ("no library machine is called 'sb4'", "nearest is 'sb3'")),
        (("run", "none.toml"), ("none.toml", "no such file")),
        (("run", "sb3", "--set", "motor.voltage=220"), ("motor.voltage", "write the unit")),
        (("run", "sb3", "--set", "motor.inertia=0 kg m^2"), ("motor.inertia", "more than 0")),
        (("run", "sb3", "--set", "clutch.torque=20 N m"), ("never slip",)),
        (("run", "sb3", "--set", "clutch.tork=1 N m"), ("nearest is 'clutch.torque'",)),
        (("run", "sb3", "--out", "run.csv"), ("must end in .nc",)),
        (("show", "jea7", "--toml"), ("nearest is 'jea73'",)),
        (("run", "zd6", "--set", "throw.start=-200 mm"), ("goes from -165 to 0 mm",)),
        (("run", "zd6", "--set", "circuit.limit_closing=5 mm"), ("circuit.limit_closing = 5 mm",)),
        (("run", "sb3", "--set", "rail.object_size=200 mm"), ("does not fit", "-117 mm")),
    ],
)
def test_one_message(tmp_path: Path, arguments: tuple[str, ...], words: tuple[str, ...]) -> None:
    code, errors = run_here("machine", *arguments, folder=tmp_path)
    assert code == 2
    assert "Traceback" not in errors
    for word in words:
        assert word in errors
    assert list(tmp_path.iterdir()) == []


def test_all_that_is_wrong_with_a_file(tmp_path: Path) -> None:
    text = """
schema_version = 1
name = "bad"
[machine.a.motor]
voltage = 220
resistence = "13 ohm"
inductance = "0.15 mm"
inertia = "-1 kg m^2"
"""
    (tmp_path / "bad.toml").write_text(text)
    code, errors = run_here("machine", "run", "bad.toml", folder=tmp_path)
    assert code == 2
    for word in (
        "motor.voltage = 220: has no unit",
        "motor.resistence: unknown key; nearest is 'resistance'",
        '"mm" is a unit of length',
        "motor.inertia",
        "machine.a.clutch: is missing",
        "machine.a.rod: is missing",
    ):
        assert word in errors


def test_a_value_of_the_file_is_no_default(tmp_path: Path) -> None:
    from turnout.machine.machine_file import load_machines, machine_text

    text = machine_text("sb3").replace('mass = "600 kg"', 'mass = "601 kg"')
    lines = [line.partition("#")[0].rstrip() for line in text.splitlines()]
    (tmp_path / "own.toml").write_text("\n".join(lines))
    own = load_machines(tmp_path / "own.toml")
    assert own.origin_text("rail.mass") == "not stated in the file"
    assert own.origin_text("rail.object_stiffness") == "not stated in the file"
    assert own.origin_text("machine.sb3.clutch.worn") == "default"
    assert load_machines("jea73").origin_text("rail.object_stiffness") == "paper: foreign object"
