"""The report of a sequence of throws: verdicts first, then the course and the table."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import turnout.api.accessor  # noqa: F401 - registers dataset.turnout
from turnout.cli.main import app
from turnout.core.errors import ResponseError
from turnout.detection.detector.throws_of_dataset import throws_of_dataset
from turnout.figures.report.sequence import sequence_page
from turnout.figures.throw import plot_throw
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.throw.drift import Drift
from turnout.throw.sequence import simulate_sequence
from turnout.throw.store import save_response

PANEL = load_panel("uic60-760-1-15")


def test_the_page_of_a_sequence(tmp_path: Path) -> None:
    stone = ForeignObject("10 mm", "drive 1", kind="stone")
    ice = ForeignObject("10 mm", "sleeper 6", kind="ice", length="1 m")
    drift = Drift(ice_growth="4 mm")
    made = simulate_sequence(PANEL, throws=3, foreign_object=[stone, ice], drift=drift)
    page = sequence_page(made)
    first, second, note = page.findings
    assert (first.level, first.question, first.answer) == ("bad", "Undetected object", "33.3 %")
    assert second.question == "Detected by TKK"
    assert second.detail == "2 of 3 throws, first throw 2, last throw 3"
    assert note.detail.endswith("may depend on step and mode (from throw 1 on)")  # of the stone
    course, throws, _ = page.sections
    sizes = course.pictures[0].sheet.rows[0].lines
    np.testing.assert_allclose(sizes[0].y, [10.0, 0.0, 0.0])
    np.testing.assert_allclose(sizes[1].y, [10.0, 14.0, 18.0], atol=0.2)
    assert throws.tables[0].rows[0][-2] == "undetected object"
    assert repr(made.turnout.summary()).splitlines()[1].startswith("  ✗ Undetected object 33.3 %")
    assert "<img" in made.turnout._repr_html_()
    assert len(made.turnout.plot().axes) == 3
    with pytest.raises(ResponseError, match="throw by throw"):
        plot_throw(made)
    judged = throws_of_dataset(made, name="many")
    assert [item.name for item in judged] == ["many#1", "many#2", "many#3"]
    assert not any(item.fault for item in judged)
    save_response(made, tmp_path / "many.nc")
    given = ["report", str(tmp_path / "many.nc"), "-o", str(tmp_path / "many.html")]
    assert CliRunner().invoke(app, given).exit_code == 0
    assert "From throw to throw" in (tmp_path / "many.html").read_text(encoding="utf-8")


def test_a_single_throw_without_objects_has_a_page_too() -> None:
    page = sequence_page(simulate_sequence(load_panel("sb1"), throws=1))
    assert not any(section.pictures for section in page.sections)
    assert len(page.findings) == 1
