"""One case of a study as a panel, and lists of cases that are checked case by case."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

import turnout
from turnout.calibration.load_study import load_panel_or_case, study_from_file
from turnout.cli.main import app
from turnout.core.errors import FileError, StudyError
from turnout.core.toml import parse_toml

BEYOND = """
schema_version = 1
name = "beyond"
panel = "uic60-760-1-15"

[[together]]
keys = ["drive.2.over_travel_closed", "drive.2.saturation_force"]
rows = [["3.7 mm", "6.85 kN"], ["12 mm", "14 kN"]]
"""


def test_a_case_is_a_panel_that_can_be_changed_as_a_file(tmp_path: Path) -> None:
    path = tmp_path / "beyond.toml"
    path.write_text(BEYOND, encoding="utf-8")
    panel = turnout.load_panel(f"{path}:1", overrides={"drive.1.stiffness": "700 kN/m"})
    assert panel.drive["2"].over_travel_closed == pytest.approx(0.012)
    assert panel.drive["1"].stiffness == pytest.approx(700e3)
    assert panel.origins["drive.2.saturation_force"].kind == "override"
    assert set(panel.overrides) == {
        "drive.1.stiffness", "drive.2.over_travel_closed", "drive.2.saturation_force"
    }  # fmt: skip
    soft = load_panel_or_case(f"{path}:1").with_overrides({"drive.2.stiffness": 8e6})
    assert soft.drive["2"].stiffness == 8e6  # as a file's may be, though the drive slips at rest


@pytest.mark.parametrize(
    ("name", "error", "words"),
    [
        ("plausible-panels:1000", StudyError, "there is no case 1000; there are 0 to "),
        ("sleeper-6:3", StudyError, "more than a panel, they have object"),
        ("plausible-panel:3", FileError, "nearest is 'plausible-panels'"),
        ("plausible-panels:-1", StudyError, "'-1' is no number of a case; name one"),
        ("plausible-panels", StudyError, "it is a study, not a panel; name one"),
    ],
)
def test_what_is_no_case_is_refused(name: str, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        load_panel_or_case(name)


def test_commands_take_a_case() -> None:
    done = CliRunner().invoke(app, ["panel", "check", "plausible-panels:17", "--no-throw"])
    assert done.exit_code == 0, done.output
    assert "plausible-panels:17: OK (uic60-760-1-15" in done.output
    shown = CliRunner().invoke(app, ["panel", "show", "plausible-panels:17"])
    assert shown.output.startswith("plausible-panels:17, a case of uic60-760-1-15  (hash ")
    loads = ["--lateral", "5 kN", "--vertical", "50 kN"]
    gauge = CliRunner().invoke(app, ["gauge", "plausible-panels:17", *loads])
    assert gauge.exit_code == 0, gauge.output
    assert "plausible-panels:17, a case of uic60-760-1-15, rail straight closed" in gauge.output


@pytest.mark.parametrize(
    "words",
    [
        ["gauge", "--lateral", "5 kN", "--vertical", "50 kN"],
        ["panel", "show"],
        ["simulate", "--mode", "quick"],
        ["simulate", "--throws", "1"],
    ],
    ids=" ".join,
)
def test_records_say_the_case(words: list[str]) -> None:
    for name, case in (("plausible-panels:17", "plausible-panels:17"), ("uic60-760-1-15", None)):
        done = CliRunner().invoke(app, [*words, name, "--json"])
        found = json.loads(done.stdout)
        assert (found["case"], found["panel"]) == (case, "uic60-760-1-15")


def test_values_that_change_together_are_tried_together() -> None:
    """12 mm alone would make the drive slip at rest; a slip level of 14 kN goes with it."""
    assert study_from_file(parse_toml(BEYOND, source="beyond")).count == 2
    alone = BEYOND.replace('"14 kN"', '"6.85 kN"')
    with pytest.raises(StudyError, match="together, row 2 .*presses rail"):
        study_from_file(parse_toml(alone, source="beyond"))


OBJECTS = """
schema_version = 1
name = "objects"
panel = "uic60-760-1-15"

[[together]]
keys = ["object.x", "object.size"]
rows = [["3.6 m", "31 mm"], ["PLACE m", "SMALL mm"]]
"""


def test_an_object_of_a_list_must_have_room_at_its_own_place() -> None:
    text = OBJECTS.replace("PLACE", "12.5")
    assert study_from_file(parse_toml(text.replace("SMALL", "2"), source="objects")).count == 2
    with pytest.raises(StudyError, match="does not fit|at most"):
        study_from_file(parse_toml(text.replace("SMALL", "200"), source="objects"))
