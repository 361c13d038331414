"""Values beyond sense are named with key, value and usual range, and never refused."""

import pytest
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.panel.load import library_names, load_panel
from turnout.panel.model import PANEL_KEYS
from turnout.panel.unusual import USUAL, unusual_values

FAR = [
    ("material.density", 1e6, "material.density = 1e+06 kg/m^3: usual is 1000 to 30000 kg/m^3"),
    ("gravity", 1000.0, "gravity = 1000 m/s^2: usual is 0 to 30 m/s^2"),
    ("chair.friction_coefficient", 1.5, "chair.friction_coefficient = 1.5: usual is 0 to 1"),
    ("drive.2.saturation_force", 6.0, "drive.2.saturation_force = 6 N: usual is 100 to 100000 N"),
    ("movement.duration", 1e-3, "movement.duration = 0.001 s: usual is 0.1 to 60 s"),
    (
        "damping.frequencies",
        [2.0, 5e4],
        "damping.frequencies = 50000 Hz: usual is 0.01 to 10000 Hz",
    ),
]


def texts(changes: dict[str, object]) -> list[str]:
    return [item.text for item in unusual_values(load_panel("sb1").with_overrides(changes))]


@pytest.mark.parametrize("name", library_names())
def test_the_library_has_none(name: str) -> None:
    assert unusual_values(load_panel(name)) == []


@pytest.mark.parametrize("key", USUAL)
def test_every_key_of_the_table_is_one_of_panels(key: str) -> None:
    least, most = USUAL[key]
    assert PANEL_KEYS.find(key) is not None
    assert least < most


@pytest.mark.parametrize(("key", "value", "text"), FAR, ids=[key for key, _, _ in FAR])
def test_a_value_beyond_sense_is_named(key: str, value: object, text: str) -> None:
    assert texts({key: value}) == [text]


def test_members_are_named_where_a_family_does_not_agree() -> None:
    assert texts({"chair.3.normal_stiffness": 1.0}) == [
        "chair.3.normal_stiffness = 1 N/m: usual is 10000 to 1e+11 N/m"
    ]


def test_the_commands_warn_and_do_not_refuse() -> None:
    settings = ["--set", "material.density=1e6 kg/m^3", "--set", "gravity=1000 m/s^2"]
    check = ["panel", "check", "sb1", "--no-throw", *settings]
    checked = CliRunner().invoke(app, check)
    assert checked.exit_code == 0, checked.output
    warnings = [line for line in checked.stdout.splitlines() if line.startswith("warning: ")]
    assert len(warnings) == 2
    assert "gravity = 1000 m/s^2: usual is 0 to 30 m/s^2" in warnings[0]
    assert CliRunner().invoke(app, [*check, "--strict"]).exit_code == 1
    shown = CliRunner().invoke(app, ["panel", "show", "sb1", *settings])
    assert shown.exit_code == 0, shown.output
    assert "UNUSUAL VALUES" in shown.stdout
    assert "material.density = 1e+06 kg/m^3: usual is 1000 to 30000 kg/m^3" in shown.stdout
    assert "UNUSUAL" not in CliRunner().invoke(app, ["panel", "show", "sb1"]).stdout
