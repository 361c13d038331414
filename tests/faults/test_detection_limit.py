"""Bad input of `turnout limit`: one message, exit code 2, nothing thrown."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from turnout.cli.limit import conditions_of_options
from turnout.cli.main import app
from turnout.core.errors import TurnoutError
from turnout.detection.detector import train_detector


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--far", "0"], "--far 0: must be more than 0"),
        (["--kind", "ise"], '--kind = "ise": there is no such kind; there are '),
        (["--discrepancy", "1.5"], "--discrepancy 1.5: must be from 0 to below 1"),
        (["--discrepancy", "nan"], "--discrepancy nan: must be"),
        (["--rate", "0"], "--rate 0 Hz: must be more than 0"),
        (["--machine-discrepancy", "-1"], "--machine-discrepancy -1: must be from 0"),
        (["--history", "-1"], "--history -1: must be a number of throws"),
        (["--channels", "current"], "no channel is left, since no drive of panel uic60-760-1-15"),
        (["--channels", "speed"], 'channels = "speed": allowed are'),
        (["--set", "drive.1.machine=jea37"], "there is no such machine"),
        (["--kernel", "cubic"], '--kernel "cubic": allowed are exponential, matern 3/2'),
        (["--what-if", "more force"], 'what-if "more force": is none of'),
        (["-o", "map.txt"], "the name must end in .nc"),
    ],
)
def test_bad_input_is_refused_before_anything_is_thrown(
    options: list[str], words: str, tmp_path: Path
) -> None:
    folder = tmp_path / "throws"
    found = CliRunner().invoke(app, ["limit", *options, "--folder", str(folder)])
    assert isinstance(found.exception, TurnoutError)
    assert words in str(found.exception)
    assert not str(found.exception).startswith("study:")
    assert not folder.exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--discrepancy", "2"], "--discrepancy 2: must be from 0 to below 1"),
        (["-o", "plan.txt"], "the name must end in .csv"),
        (["no-such-panel"], "no-such-panel"),
    ],
)
def test_a_plan_that_cannot_be_made_is_refused(options: list[str], words: str) -> None:
    found = CliRunner().invoke(app, ["plan-test", *options])
    assert isinstance(found.exception, TurnoutError)
    assert words in str(found.exception)


def test_a_panel_that_no_detector_judges_is_refused_before_it_is_thrown(tmp_path: Path) -> None:
    folder = tmp_path / "throws"
    out = ["-o", str(tmp_path / "switch.detector")]
    found = CliRunner().invoke(app, ["detect", "train", "sb1", *out, "--folder", str(folder)])
    assert "a detector needs one closing" in " ".join(str(found.exception).split())
    assert not folder.exists()


@pytest.mark.parametrize("line", [["limit"], ["limit", "--over-travel"], ["detect", "train"]])
@pytest.mark.parametrize("inside", [False, True])
def test_a_file_in_place_of_the_folder_is_refused_before_throws_are_planned(
    line: list[str], inside: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(train_detector, "training_plans", pytest.fail)
    file = tmp_path / "file"
    file.write_text("mine")
    out = ["-o", str(tmp_path / "switch.detector")] if line[0] == "detect" else []
    folder = file / "throws" if inside else file
    found = CliRunner().invoke(app, [*line, *out, "-q", "--folder", str(folder)])
    assert isinstance(found.exception, TurnoutError)
    assert str(file) in str(found.exception)
    assert "name a" in str(found.exception)
    assert file.read_text() == "mine"


def test_an_exact_model_is_warned_of(capsys: pytest.CaptureFixture[str]) -> None:
    assert conditions_of_options(discrepancy=0.05).discrepancy == 0.05
    assert not capsys.readouterr().err
    assert conditions_of_options(discrepancy=0.0).discrepancy == 0.0
    assert "--discrepancy 0: no model is exact" in capsys.readouterr().err
