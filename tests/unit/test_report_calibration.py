"""The page about a calibration, from a record made by hand."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.errors import FileError
from turnout.panel.load import load_panel
from turnout.report.calibration import calibration_findings, calibration_page, sweep_sheet
from turnout.report.page import page_html
from turnout.study.calibration.record import Calibration, Fitted, StageLog


def parameter(name: str, value: float, *, unit: str, state: str = "fitted") -> Fitted:
    return Fitted(
        name=name,
        keys=(name,),
        unit=unit,
        value=value,
        deviation=0.01 * value if state == "fitted" else float("nan"),
        lower=0.1 * value,
        upper=10 * value,
        interval=(0.98 * value, 1.02 * value),
        start=1.1 * value,
        state=state,
    )


def calibration() -> Calibration:
    return Calibration(
        parameters=(
            parameter("chair.friction_coefficient", 0.31, unit="1"),
            parameter("drive.1.stiffness", 7.6e5, unit="N/m"),
            parameter("drive.2.stiffness", 8.1e5, unit="N/m", state="at its bound"),
            parameter("drive.1.saturation_force", 6e3, unit="N", state="fixed"),
        ),
        covariance=np.array([[1e-6, 9.5e-1], [9.5e-1, 1e6]]),
        panel="sb1",
        panel_hash=load_panel("sb1").hash,
        data="Autumn <1>",
        data_hash="def",
        movements=("a", "b"),
        stages=(
            StageLog(
                name="friction",
                method="sweep and fit",
                movements=("a",),
                values={"chair.friction_coefficient": 0.3},
                misfit=1.2,
                evaluations=7,
                iterations=2,
                message="converged",
                sweep={"value": (0.1, 0.3, 0.5), "misfit": (0.5, 0.1, 0.4)},
            ),
        ),
        warnings=("Drive 2 is at its bound",),
        findings=("forces tell the friction",),
        noise={"drive_force of drive 1": {"white": 1.5}},
        scatter={"chair.friction_coefficient": 0.02},
        about={"version": "0.1.0"},
    )


def test_findings_tell_values_with_units_and_doubts() -> None:
    first, friction, one, two = calibration_findings(calibration())
    assert (first.level, first.answer) == ("look", "2 of 3 parameters")
    assert friction.answer == "0.31"
    assert (one.answer, one.detail) == ("760 kN/m", "between 744.8 kN/m and 775.2 kN/m (95 %)")
    assert (two.level, two.detail) == ("look", "at its bound")
    certain = replace(calibration(), warnings=(), parameters=calibration().parameters[:2])
    assert calibration_findings(certain)[0].level == "good"


def test_parameters_that_cannot_be_told_apart_are_framed() -> None:
    (heat,) = calibration_page(calibration(), suffixes=()).sections[0].heats
    assert heat.values[0][1] == pytest.approx(0.95)
    assert heat.framed == [[False, True], [True, False]]


def test_a_sweep_is_drawn_over_what_it_swept() -> None:
    stage = calibration().stages[0]
    sheet = sweep_sheet(stage, calibration())
    assert sheet.x_label == "chair.friction_coefficient [1]"
    np.testing.assert_allclose(sheet.rows[0].lines[0].y, [50, 10, 40])
    assert [moment.at for moment in sheet.moments] == [0.31]


def test_the_page_names_no_address_and_lists_inputs() -> None:
    html = page_html(calibration_page(calibration(), panel=load_panel("sb1")))
    assert "Autumn &lt;1&gt;" in html
    assert "benchmark SB1" in html
    assert set(re.findall(r"https?://[\w.-]+", html)) <= {"http://www.w3.org"}
    other = page_html(calibration_page(calibration(), panel=load_panel("sb2")))
    assert "not at hand" in other


def test_the_command_takes_a_calibration(tmp_path: Path) -> None:
    file, out, figures = tmp_path / "c.toml", tmp_path / "c.html", tmp_path / "figures"
    calibration().save(file)
    line = ["report", str(file), "-o", str(out), "--figures", str(figures)]
    done = CliRunner().invoke(app, line)
    assert done.exit_code == 0, done.output
    assert "2 of 3 parameters" in out.read_text(encoding="utf-8")
    assert len(list(figures.iterdir())) == 3
    done = CliRunner().invoke(app, [*line, "--panel", "sb2"])
    assert isinstance(done.exception, FileError)
    assert "is not the panel of" in str(done.exception)
