"""Bad input to `turnout validate` is one message with the remedy and exit code 2."""

from pathlib import Path

import numpy as np
from tests.unit.campaigns import copied
from typer.testing import CliRunner, Result

from turnout.calibration.result import Calibration
from turnout.calibration.stages import Fitted
from turnout.cli.main import app
from turnout.core.errors import TurnoutError

CALIBRATION = Calibration(
    parameters=(
        Fitted(
            name="chair.friction_coefficient",
            keys=("chair.friction_coefficient",),
            unit="1",
            value=0.4,
            deviation=0.004,
            lower=0.1,
            upper=0.8,
            interval=(0.392, 0.408),
            start=0.3,
        ),
    ),
    covariance=np.array([[1.6e-5]]),
    panel="sb2",
    panel_hash="another",
    data="small",
    data_hash="",
    movements=("none_closing_1",),
    stages=(),
)


def validate(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["validate", *map(str, arguments)])


def saved(folder: Path) -> Path:
    path = folder / "calibration.toml"
    CALIBRATION.save(path)
    return path


def message(result: Result) -> str:
    """Return the message of an error, which `main` shows with exit code 2."""
    assert isinstance(result.exception, TurnoutError)
    return str(result.exception)


def test_a_file_that_is_no_calibration_is_named(tmp_path: Path) -> None:
    path = tmp_path / "other.toml"
    path.write_text("name = 1\n", encoding="utf-8")
    assert "`turnout calibrate CAMPAIGN -o FILE` writes one" in message(
        validate(tmp_path, "--calibration", path)
    )
    assert "no such file" in message(validate(tmp_path, "--calibration", tmp_path / "none.toml"))


def test_a_report_that_cannot_be_written_is_refused_first(tmp_path: Path) -> None:
    result = validate(
        tmp_path / "none", "--calibration", saved(tmp_path), "-o", tmp_path / "a" / "b"
    )
    assert f"there is no folder {tmp_path / 'a'}" in message(result)


def test_a_campaign_of_other_drives_is_refused(tmp_path: Path) -> None:
    folder = copied(tmp_path)
    text = (folder / "channels.toml").read_text(encoding="utf-8")
    (folder / "channels.toml").write_text(
        text.replace("drive_force.2", "drive_force.3").replace("current.2", "current.3"),
        encoding="utf-8",
    )
    found = message(validate(folder, "--calibration", saved(tmp_path), "-q"))
    assert "drive 3: not in panel sb2" in found or "drive '3'" in found


def test_a_place_that_is_not_there_is_refused_before_throwing(tmp_path: Path) -> None:
    folder, report = copied(tmp_path), tmp_path / "report"
    line = ("--calibration", saved(tmp_path), "-o", report, "--place", "sleeper 9", "-q")
    said = message(validate(folder, *line))
    assert "no closing movement with an object at 'sleeper 9'" in said
    assert not (report / "validation.nc").exists()
    assert not (folder / ".turnout" / "throws").exists()
