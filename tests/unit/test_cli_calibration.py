"""`--calibration FILE` means the same wherever a command takes a panel."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.unit.calibrations import calibration
from tests.unit.sweeps import study_file
from typer.testing import CliRunner, Result

from turnout.calibration.load_study import load_study
from turnout.calibration.result import load_calibration
from turnout.cli.main import app
from turnout.core.errors import FileError, PanelError
from turnout.panel.load import load_panel
from turnout.throw.store import open_response


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A calibration of sb1, with friction 0.31 among others."""
    calibration().save(tmp_path / "c.toml")
    return tmp_path / "c.toml"


def run(*line: object) -> Result:
    return CliRunner().invoke(app, [str(word) for word in line])


def calibrated_hash(panel: str = "sb1") -> str:
    return calibration().apply(load_panel(panel)).hash[:12]


@pytest.mark.parametrize(
    "line",
    [
        ["panel", "show", "sb1"],
        ["panel", "show"],
        ["panel", "check", "sb1", "--no-throw"],
        ["sweep", "plan", "STUDY", "--trials", "0"],
    ],
    ids=" ".join,
)
def test_commands_show_the_calibrated_panel(line: list[str], file: Path, tmp_path: Path) -> None:
    study = study_file(tmp_path, count=4)
    words = [study if word == "STUDY" else word for word in line]
    done = run(*words, "--calibration", file)
    assert done.exit_code == 0, (done.output, done.exception)
    own = load_study(study).panel if "STUDY" in line else load_panel("sb1")
    assert calibration().apply(own).hash[:12] in done.output


@pytest.mark.parametrize(
    ("strict", "quiet"), [((), ()), (("--strict",), ("-q",))], ids=["lenient", "strict and quiet"]
)
def test_a_calibration_that_is_not_to_be_trusted_is_written_and_says_so(
    strict: tuple[str, ...], quiet: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    known = replace(calibration(), distrust=("model error 214 N; check the panel",))
    made: list[object] = []
    monkeypatch.setattr("turnout.cli.calibrate.opened_campaign", lambda *_, **__: None)
    monkeypatch.setattr(
        "turnout.calibration.calibrate.calibrate",
        lambda *_, **__: SimpleNamespace(calibration=made[-1], sweeps=(), final=None, ended=""),
    )
    monkeypatch.setattr("turnout.calibration.result_entries.save_signals", lambda *_: None)
    out = tmp_path / "c.toml"
    line = ("calibrate", tmp_path, "--panel", "sb1", "-o", out, "--workers", "1")
    made.append(known)
    done = run(*line, *quiet, *strict)
    assert done.exit_code == (1 if strict else 0), (done.output, done.exception)
    verdict, because = done.output.strip().splitlines()[:2]
    assert verdict.split(maxsplit=1) == ["verdict", "NOT TRUSTWORTHY"]
    assert because.split(maxsplit=1) == ["reason", known.distrust[0]]
    assert load_calibration(out).distrust == known.distrust
    assert "trusted = false" in out.read_text(encoding="utf-8")
    shown = run("panel", "show", "sb1", "--calibration", out)
    assert shown.exit_code == 0
    assert "is not trustworthy: model error 214 N" in shown.stderr
    made.append(calibration())
    good = run(*line, *quiet)
    assert good.exit_code == 0
    assert "TRUSTED" not in good.output
    first = good.output.partition("\n")[0]
    assert first.startswith("verdict     the model follows") is not bool(quiet)
    assert "trusted = true" in out.read_text(encoding="utf-8")


def test_a_throw_takes_the_panel_of_the_calibration_and_what_is_set_goes_on_top(
    file: Path, tmp_path: Path
) -> None:
    out = tmp_path / "run.nc"
    done = run("simulate", "--calibration", file, "--out", out, "--mode", "quick")
    assert done.exit_code == 0, (done.output, done.exception)
    attributes = open_response(out).attrs
    assert attributes["panel"] == "sb1"
    assert attributes["panel_hash"].startswith(calibrated_hash())
    assert json.loads(attributes["overrides"])["chair.friction_coefficient"] == 0.31
    assert "calibration" not in done.stderr  # it is of this panel, so nothing is said of it
    top = ["--set", "chair.friction_coefficient=0.2", "--mode", "quick"]
    done = run("simulate", "--calibration", file, *top, "--out", out)
    assert done.exit_code == 0, (done.output, done.exception)
    changes = json.loads(open_response(out).attrs["overrides"])
    assert changes["chair.friction_coefficient"] == 0.2
    assert changes["drive.1.stiffness"] == 7.6e5


def test_a_virtual_campaign_is_of_the_calibrated_panel(file: Path, tmp_path: Path) -> None:
    small = ["--repeats", "1", "--place", "drive1", "--size", "13mm", "--format", "csv"]
    options = [*small, "--workers", "1", "-q"]
    done = run("campaign", "virtual", "--calibration", file, "--out", tmp_path / "v", *options)
    assert done.exit_code == 0, (done.output, done.exception)
    truth = open_response(tmp_path / "v" / "truth.nc").attrs
    assert truth["panel_hash"].startswith(calibrated_hash())


def test_the_studio_opens_the_calibrated_panel(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    served = []
    monkeypatch.setattr(
        "turnout.web.serve.serve", lambda studio, **_: served.append(studio.opening.panel)
    )
    done = run("studio", "--calibration", file, "--no-browser")
    assert done.exit_code == 0, (done.output, done.exception)
    assert served[0].hash.startswith(calibrated_hash())


def test_another_panel_is_named(file: Path) -> None:
    done = run("panel", "check", "sb2", "--no-throw", "--calibration", file)
    assert done.exit_code == 0
    assert "the calibration is of panel sb1 with hash" in done.stderr
    assert "not of sb2" in done.stderr


def test_a_study_names_its_calibration(file: Path, tmp_path: Path) -> None:
    study = study_file(tmp_path, count=4)
    text = study.read_text(encoding="utf-8")
    study.write_text(text.replace("\npanel =", '\ncalibration = "c.toml"\npanel =', 1))
    loaded, plain = load_study(study), load_study(study, calibration=file)
    assert loaded.digest == plain.digest
    assert loaded.panel.drive["1"].stiffness == 7.6e5
    study.write_text(text)
    assert load_study(study).digest != loaded.digest
    done = run("sweep", "plan", study, "--trials", "0", "--calibration", tmp_path / "none.toml")
    assert isinstance(done.exception, FileError)


def test_a_panel_file_has_to_be_named(tmp_path: Path) -> None:
    replace(calibration(), panel="mine").save(tmp_path / "c.toml")
    done = run("simulate", "--calibration", tmp_path / "c.toml")
    assert isinstance(done.exception, FileError)
    assert "is of panel 'mine'; name the file of that panel" in str(done.exception)


def test_a_panel_that_lacks_a_key_is_refused(file: Path, tmp_path: Path) -> None:
    text = file.read_text(encoding="utf-8").replace("drive.2.stiffness", "drive.9.stiffness")
    (tmp_path / "d.toml").write_text(text, encoding="utf-8")
    done = run("simulate", "--calibration", tmp_path / "d.toml")
    assert isinstance(done.exception, PanelError)
    assert "the calibration is of panel sb1" in str(done.exception)
