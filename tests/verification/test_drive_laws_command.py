"""`turnout validate --drive-laws` on a campaign whose Drive 2 builds up softly, as a command.

Reference: the lag of 0.25 s with which the campaign was made. The bilinear law must be rejected
and the lagging one chosen, its lag within 10 %.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.studies.law_rates import near
from typer.testing import CliRunner, Result

from turnout.calibration.stages import default_plan
from turnout.cli.main import app
from turnout.panel.load import load_panel


def run(*line: object) -> Result:
    return CliRunner().invoke(app, [str(word) for word in line])


@pytest.mark.long
def test_a_soft_build_up_is_reported_by_the_command(tmp_path: Path) -> None:
    folder, panel = tmp_path / "campaign", load_panel("sb1")
    truth = {item.name: item.start for item in default_plan(panel).parameters}
    known = near(truth, np.random.default_rng(1))
    replace(known, panel_hash=panel.hash).save(tmp_path / "calibration.toml")
    small = ["--repeats", "1", "--place", "drive 2", "--place", "sleeper 10", "--size", "10mm"]
    options = [*small, "--soft-build-up", "--format", "csv", "--workers", "1", "-q"]
    made = run("campaign", "virtual", "--panel", "sb1", "--out", folder, *options)
    assert made.exit_code == 0, made.output
    done = run(
        *("validate", folder, "--calibration", tmp_path / "calibration.toml"),
        *("--drive-laws", "2", "--workers", "1", "-q", "--strict"),
    )
    # The plain model does not hold, so the verdict is no.
    assert done.exit_code == 1, (done.output, done.exception)
    assert "NOT VALID" in done.output
    assert "drive 2: the data support the law 'lagging build-up'" in done.output
    assert "the bilinear law is rejected" in done.output
    lag = re.search(r"lagging build-up .* chosen  lag = ([\d.]+)", done.output)
    assert lag is not None
    assert abs(float(lag[1]) - 0.25) < 0.025
