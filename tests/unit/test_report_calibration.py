"""The page about a calibration, from a record made by hand."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.calibrations import calibration
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.errors import FileError
from turnout.panel.load import load_panel
from turnout.report.calibration import calibration_findings, calibration_page, sweep_sheet
from turnout.report.page import page_html


def test_findings_tell_values_with_units_and_doubts() -> None:
    first, friction, one, two = calibration_findings(calibration())
    assert (first.level, first.answer) == ("look", "2 of 3 parameters")
    assert friction.answer == "0.31"
    assert (one.answer, one.detail) == ("760 kN/m", "between 744.8 kN/m and 775.2 kN/m (95 %)")
    assert (two.level, two.detail) == ("look", "at its bound")
    certain = replace(calibration(), warnings=(), parameters=calibration().parameters[:2])
    assert calibration_findings(certain)[0].level == "good"


def test_parameters_that_cannot_be_distinguished_are_framed() -> None:
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
