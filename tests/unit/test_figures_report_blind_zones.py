"""The report page about what can be seen."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from tests.unit.detection_throws import toy_throws
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.detection.limit.known_place_map import known_place_map
from turnout.detection.limit.limit_map import limit_map
from turnout.detection.reference import Conditions
from turnout.figures.report.blind_zones import blind_zone_page
from turnout.throw.store import response_bytes

CLOSING = 0.8


def test_the_worst_place_is_the_headline_and_unseen_places_are_marked() -> None:
    throws = toy_throws()
    change = throws.change.copy()
    change[:, 0] = 0.0  # nothing shows at the drive
    dataset = limit_map(replace(throws, change=change), Conditions(), closing=CLOSING)
    page = blind_zone_page(dataset)
    assert page.findings[0].answer == "drive 1"
    assert page.findings[0].level == "bad"
    assert "beyond what was thrown" in page.findings[0].detail
    table = page.sections[1].tables[0]
    assert table.marked == frozenset({0})
    heat = page.sections[0].heats[0]
    assert np.isnan(heat.values[-1][0])  # 20 mm were not thrown
    assert heat.framed[0] == [False, True]  # 1 mm lies below the floor at the sleeper


def test_a_map_file_becomes_a_page(tmp_path: Path) -> None:
    throws = toy_throws()
    dataset = limit_map(throws, Conditions(), closing=CLOSING)
    known = known_place_map(throws, Conditions(), closing=CLOSING, draws=1000)
    dataset = dataset.merge(known, combine_attrs="no_conflicts")
    file, out, folder = (tmp_path / name for name in ("limit.nc", "page.html", "figures"))
    file.write_bytes(response_bytes(dataset))
    found = CliRunner().invoke(app, ["report", str(file), "-o", str(out), "--figures", str(folder)])
    assert found.exit_code == 0, found.exception
    text = out.read_text(encoding="utf-8")
    assert "blind zone" in text
    assert "a90, place known [mm]" in text
    forms = (".pdf", ".png", ".svg")
    assert {path.name for path in folder.iterdir()} == {f"blind-zones{form}" for form in forms}
