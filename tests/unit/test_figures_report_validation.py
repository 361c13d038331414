"""The page about a validation, from one made by hand."""

import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.unit.test_study_validation import hand_made, unpredicted_object
from typer.testing import CliRunner

from turnout.calibration.validation.acceptance import judge
from turnout.cli.main import app
from turnout.figures.report.page import page_html
from turnout.figures.report.validation import validation_findings, validation_page
from turnout.figures.validation import compared_movements, comparison_sheet
from turnout.throw.store import save_response


def test_findings_begin_with_the_verdict() -> None:
    good = validation_findings(hand_made(), judge(hand_made()))
    assert (good[0].level, good[0].answer) == ("good", "Valid")
    assert good[0].detail.startswith("all 3 channels of 4 movements")
    bad = hand_made(off=120.0, band=500.0)
    found = validation_findings(bad, judge(bad))
    assert (found[0].level, found[0].answer) == ("bad", "Not valid")
    # Error and band of each channel in turn.
    assert [item.level for item in found[2:8]] == ["good", "good", "bad", "good", "good", "good"]
    used = hand_made(used=6)
    assert validation_findings(used, judge(used))[0].answer == "Not validated"


def test_a_channel_that_is_never_predicted_is_shown_as_bad() -> None:
    made = unpredicted_object()
    found = [item for item in validation_findings(made, judge(made)) if "object" in item.question]
    assert [(item.level, item.answer) for item in found] == [
        ("bad", "not known"),
        ("bad", "0 % inside"),
    ]
    page = validation_page(made, suffixes=())
    assert "nan" not in str((page.findings, [section.tables for section in page.sections]))


def test_what_was_left_out_is_to_be_looked_at() -> None:
    reported = hand_made().assign_attrs(left_out='["a was left out: no room"]')
    last = validation_findings(reported, judge(reported))[-1]
    assert (last.level, last.detail) == ("look", "a was left out: no room")


def test_the_page_shows_errors_by_place_and_marks_what_is_off() -> None:
    validation = hand_made(off=120.0, used=3)
    page = validation_page(validation, suffixes=())
    heats = {heat.heading: heat for heat in page.sections[1].heats}
    heat = heats["Drive 2, over 30 N of repeats"]
    assert heat.rows == ["no object", "sleeper 6", "drive 2"]
    assert heat.columns == ["0 mm", "13 mm", "29 mm"]
    rms = validation["rms"].values[1]
    assert heat.values[1][1] == pytest.approx(rms[2] / 30.0)
    assert heat.framed[1] == [False, True, False]
    table = next(s for s in page.sections if s.heading == "Movements").tables[0]
    assert len(table.rows) == 6
    judged = {n for n in range(3, 6) if (validation["rms"].values[:, n] > 90.0).any()}
    assert judged
    assert table.marked == judged
    html = page_html(page)
    assert set(re.findall(r"https?://[\w.-]+", html)) <= {"http://www.w3.org"}


def test_places_that_were_left_out_are_judged_not_only_fitted() -> None:
    """Of a validation by place the page said of each movement "used for the fit, so not judged"."""
    whole = hand_made(used=6)
    validation = whole.assign(left_out=("movement", np.ones(6, dtype=bool)))
    page = validation_page(validation, suffixes=())
    assert "not judged" not in page.sections[1].text
    assert not np.any([heat.framed for heat in page.sections[1].heats])
    table = next(s for s in page.sections if s.heading == "Movements").tables[0]
    assert {row[3] for row in table.rows} == {"judged"}
    assert "each predicted without its place" in page.sections[0].text
    labels = [line.label for line in comparison_sheet(validation, place="sleeper 6").rows[0].lines]
    assert not any("used for the fit" in label for label in labels)
    seen = comparison_sheet(whole, place="sleeper 6").rows[0].lines
    assert any("used for the fit" in line.label for line in seen)


def test_a_sheet_holds_the_band_and_what_was_measured() -> None:
    validation = hand_made()
    sheet = comparison_sheet(validation, place="sleeper 6")
    assert len(sheet.rows) == 6
    lines = {line.label: line for line in sheet.rows[2].lines}
    np.testing.assert_allclose(lines["measured, 29 mm"].y, validation["measured"][1, 3] / 1e3)
    np.testing.assert_allclose(lines["band, 13 mm: low"].y, validation["low"][1, 2] / 1e3)
    apart = {line.label: line for line in sheet.rows[3].lines}
    expected = (validation["measured"] - validation["predicted"])[1, 3] / 1e3
    np.testing.assert_allclose(apart["29 mm"].y, expected)


def test_the_published_sizes_are_compared_or_the_nearest_to_them() -> None:
    validation = hand_made()

    def sizes(dataset: xr.Dataset, place: str) -> list[float]:
        return list(compared_movements(dataset, place=place)["size"].values.tolist())

    assert sizes(validation, "sleeper 6") == [0.013, 0.029]
    other = validation.assign_coords(size=("movement", [0.0, 0.0, 0.008, 0.013, 0.013, 0.02]))
    assert sizes(other, "sleeper 6") == [0.008, 0.013]
    assert sizes(other, "drive 2") == [0.013, 0.02]


def test_the_command_takes_a_validation_or_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("turnout.cli.report.FORMS", (".svg",))  # of a limit it writes all
    stored = hand_made().assign_attrs(kind="validation", schema_version=1)
    save_response(stored, tmp_path / "validation.nc")
    figures = tmp_path / "figures"
    for source in (tmp_path, tmp_path / "validation.nc"):
        out = tmp_path / "v.html"
        done = CliRunner().invoke(
            app, ["report", str(source), "-o", str(out), "--figures", str(figures)]
        )
        assert done.exit_code == 0, (done.output, done.exception)
        assert "Does the calibration hold?" in out.read_text(encoding="utf-8")
    names = {path.name for path in figures.iterdir()}
    assert {"errors.svg", "compared-sleeper-6.svg", "compared-drive-2.svg"} == names
