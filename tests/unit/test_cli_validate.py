"""`turnout validate` on a small campaign: what it says, what it writes, and its exit code."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from tests.faults.test_cli_validate import CALIBRATION, validate
from tests.unit.campaigns import copied

from turnout.throw.store import open_response


def test_a_true_calibration_is_valid_and_a_wrong_one_is_not(tmp_path: Path) -> None:
    folder, report = copied(tmp_path), tmp_path / "report"
    good, bad = tmp_path / "good.toml", tmp_path / "bad.toml"
    CALIBRATION.save(good)
    parameter = replace(CALIBRATION.parameters[0], value=0.3, state="fixed")
    replace(CALIBRATION, parameters=(parameter,), covariance=np.zeros((0, 0))).save(bad)

    result = validate(folder, "--calibration", good, "-o", report, "--workers", 1)
    assert result.exit_code == 0, result.output
    assert "VALID: all 3 channels of 8 movements" in result.output
    assert "the calibration is of panel sb2 with hash another" in result.stderr
    names = {path.name for path in report.iterdir()}
    assert names == {
        "validation.md",
        "movements.csv",
        "validation.nc",
        "errors.png",
        "comparison.png",
    }
    stored = open_response(report / "validation.nc")
    assert stored["used"].values.sum() == 1
    assert stored["cover"].mean() > 0.8
    # The last instant of a movement is predicted too.
    assert (stored["predicted"].notnull() | stored["measured"].isnull()).all()
    assert (stored["high"].notnull() | stored["measured"].isnull()).all()
    assert "**VALID" in (report / "validation.md").read_text(encoding="utf-8")

    result = validate(folder, "--calibration", bad, "--workers", 1, "-q", "--strict")
    assert result.exit_code == 1
    assert "NOT VALID: drive 1" in result.stdout
