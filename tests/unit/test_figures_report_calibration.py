"""The page about a calibration, from a record made by hand."""

import re
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from tests.unit.calibrations import calibration, fitted
from typer.testing import CliRunner

from turnout.calibration.comparison import Noise
from turnout.calibration.result_entries import signals_path
from turnout.cli.calibrate import result_lines
from turnout.cli.main import app
from turnout.core.channels import SCHEMA_VERSION
from turnout.core.errors import FileError
from turnout.figures.report.calibration import (
    _noise,
    calibration_findings,
    calibration_page,
    interval_sheet,
    sweep_sheet,
)
from turnout.figures.report.page import page_html
from turnout.figures.sheet import sheet_record
from turnout.panel.load import load_panel
from turnout.throw.store import save_response


def test_findings_tell_values_with_units_and_doubts() -> None:
    verdict, first, friction, one, two = calibration_findings(calibration())
    assert (verdict.level, verdict.answer) == ("good", "the model follows the measurement")
    assert (first.level, first.answer) == ("look", "2 of 3 parameters")
    assert friction.answer == "0.31"
    assert (one.answer, one.detail) == ("760 kN/m", "744.8 ... 775.2 kN/m (95 % interval)")
    assert (two.level, two.detail) == ("look", "at its bound")
    certain = replace(calibration(), warnings=(), parameters=calibration().parameters[:2])
    assert calibration_findings(certain)[1].level == "good"


def test_the_verdict_comes_first_with_its_reasons_and_causes() -> None:
    doubted = replace(calibration(), distrust=("drive_force of drive 1: misses 40 N",))
    verdict = calibration_findings(doubted)[0]
    assert (verdict.level, verdict.answer) == ("bad", "not trustworthy")
    assert verdict.detail == "drive_force of drive 1: misses 40 N"
    lines = ("clutch: slips elsewhere", "clutch: of drive 2", "sections: softer", "gain: 2 %")
    caused = replace(calibration(), causes=lines)
    assert calibration_findings(caused)[0].detail.endswith("its cause: clutch, sections, gain")


def test_each_channel_has_a_table_of_its_movements() -> None:
    effects = {
        "m1": {"onset": 0.0021, "mu": -0.013, "zero object_force": 2.5, "gain object_force": 1e-3},
        "m2": {"onset": 0.0, "mu": 0.01},
    }
    sections = calibration_page(replace(calibration(), effects=effects), suffixes=()).sections
    tables = next(item.tables for item in sections if item.heading == "Sensors and movements")
    common, channel = tables
    assert common.columns == ("Movement", "Onset [ms]", "mu [%]")
    assert common.rows[0] == ("m1", "2.10", "-1.30")
    assert channel.rows == [("m1", "2.50", "0.10", "-")]


def test_parameters_that_cannot_be_distinguished_are_framed() -> None:
    (heat,) = calibration_page(calibration(), suffixes=()).sections[0].heats
    assert heat.values[0][1] == pytest.approx(0.95)
    assert heat.framed == [[False, True], [True, False]]


def test_values_are_in_the_units_of_engineers_everywhere() -> None:
    """Stiffnesses above a million and moduli were printed as kN/mm and Pa, beside kN/m."""
    modulus = fitted("material.youngs_modulus", 2.101e11, unit="N/m^2")
    stiff = fitted("drive.1.stiffness", 1.25e6, unit="N/m")
    known = replace(calibration(), parameters=(stiff, modulus))
    for text in (page_html(calibration_page(known, suffixes=())), "\n".join(result_lines(known))):
        assert "1250 kN/m" in text
        assert "210.1 GPa" in text
        assert not re.search(r"kN/mm|\bPa\b|N/m\^2|e\+", text.split("<script>")[0])


def test_intervals_are_drawn_about_their_values() -> None:
    sheet = interval_sheet(calibration())
    assert [line.label for line in sheet.rows[0].lines] == [
        "1 chair.friction_coefficient",
        "2 drive.1.stiffness",
    ]
    np.testing.assert_allclose(sheet.rows[0].lines[1].y, [-2.0, 2.0])
    assert sheet_record(sheet)["counted"]


def test_movements_to_measure_next_have_a_part_of_their_own() -> None:
    line = "next: closing, no object: leaves 50 % of the standard deviation of mu, adds 1.0 bits"
    page = calibration_page(replace(calibration(), findings=(line, "other")), suffixes=())
    parts = {item.heading: item for item in page.sections}
    (row,) = parts["What to measure next"].tables[0].rows
    assert row[0] == "closing, no object"
    assert parts["Findings and warnings"].tables[0].rows == [("other",)]
    plain = calibration_page(calibration(), suffixes=())
    assert (
        "--advise" in {item.heading: item for item in plain.sections}["What to measure next"].text
    )


def test_measured_and_fitted_forces_beside_the_record_are_drawn(tmp_path: Path) -> None:
    file, out = tmp_path / "c.toml", tmp_path / "c.html"
    calibration().save(file)
    dims, ones = ("movement", "channel", "time"), np.ones((1, 1, 3))
    link = {"data_hash": "def", "panel_hash": calibration().panel_hash, "written": ""}
    signals = xr.Dataset(
        {name: (dims, 1e3 * ones) for name in ("measured", "fitted", "residual")},
        {"movement": ["a"], "channel": ["Drive 1"], "time": [0.0, 0.02, 0.04]},
        {"texts": ["a (closing)"], "kind": "fitted forces", "schema_version": SCHEMA_VERSION},
    )
    save_response(signals.assign_attrs(link), signals_path(file))
    line = ["report", str(file), "-o", str(out)]
    assert CliRunner().invoke(app, line).exit_code == 0
    assert "Measured against fitted" in out.read_text(encoding="utf-8")
    save_response(signals.assign_attrs(link, data_hash="of another"), signals_path(file))
    assert CliRunner().invoke(app, line).exit_code == 0
    assert "Measured against fitted" not in out.read_text(encoding="utf-8")


def test_a_sweep_is_drawn_over_what_it_swept() -> None:
    stage = calibration().stages[0]
    sheet = sweep_sheet(stage, calibration())
    assert sheet.x_label == "chair.friction_coefficient [-]"
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
    assert len(list(figures.iterdir())) == 6
    done = CliRunner().invoke(app, [*line, "--panel", "sb2"])
    assert isinstance(done.exception, FileError)
    assert "is not the panel of" in str(done.exception)


def test_the_table_of_noise_has_each_of_its_parts() -> None:
    sizes = asdict(Noise(white=1.0, slow=2.0, missed=3.0, left=4.0))
    known: Any = SimpleNamespace(noise={"drive_force of drive 1": sizes}, scatter={})
    (table,) = _noise(known)
    assert table.rows == [("drive_force of drive 1", *(f"{size:.3g}" for size in sizes.values()))]
