"""The limit for many panels."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.detection_throws import toy_map, toy_throws
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.core.errors import StudyError
from turnout.detection.limit import bands
from turnout.detection.limit.limit_map import limit_map
from turnout.detection.reference import Conditions, reference_study
from turnout.figures.limit import plot_bands, plot_limit
from turnout.panel.load import library_text

CLOSING = 0.8


def test_panels_that_are_alike_have_the_interval_of_one() -> None:
    found = toy_map()
    band = bands.bands_of(["a", "b", "c"], [found] * 3)
    alone = found.sel(channel="both drives")
    for share in band["share"]:
        at = band.sel(share=share)
        np.testing.assert_allclose(at["a90_band"], alone["a90"])
        np.testing.assert_allclose(at["a90_band_low"], alone["a90_low"])
        np.testing.assert_allclose(at["a90_band_high"], alone["a90_high"])


def test_a_line_that_ends_beyond_what_was_thrown_is_marked_there() -> None:
    found = toy_map()
    band = bands.bands_of(["a", "b"], [found] * 2)
    said = "line ends: beyond what was thrown"
    assert said not in [text.get_text() for text in plot_bands(band).axes[0].get_legend().texts]
    band["a90"][0, 1] = np.nan
    ax = plot_bands(band).axes[0]
    assert said in [text.get_text() for text in ax.get_legend().texts]
    marked = [line for line in ax.get_lines() if line.get_marker() == "^" and len(line.get_xdata())]
    assert len(marked) == 1
    assert marked[0].get_xdata()[0] == band["x"][0]


def test_a_band_whose_end_is_beyond_what_was_thrown_is_drawn_as_far_as_that() -> None:
    band = bands.bands_of(["a", "b"], [toy_map()] * 2)
    band["a90_band"][-1, 1] = np.nan
    ax = plot_bands(band).axes[0]
    assert "90 % of the panels, at least, where lines end" in [
        text.get_text() for text in ax.get_legend().texts
    ]
    (filled,) = (part for part in ax.collections if part.get_facecolor().size)
    corners = filled.get_paths()[0].vertices
    largest = 1e3 * float(band["a90"].max())
    assert np.isfinite(corners).all()
    at = np.isclose(corners[:, 0], float(band["x"][1]))
    assert np.isclose(corners[at, 1], largest).any()


def test_a_place_lies_where_it_is_in_each_panel() -> None:
    found = toy_map()
    x = found["x"].to_numpy()
    moved = found.assign_coords(x=("place", x + np.where(x == x[0], 0.4, 0.0)))
    band = bands.bands_of(["a", "b", "c"], [found, moved, moved])
    first = str(found["place"].to_numpy()[0])
    np.testing.assert_allclose(band["panel_x"].sel(place=first), x[0] + np.array([0.0, 0.4, 0.4]))
    assert float(band["x"].sel(place=first)) == x[0] + 0.4
    drawn = {line.get_label(): line.get_xdata() for line in plot_bands(band).axes[0].get_lines()}
    np.testing.assert_allclose(drawn["a"], np.sort(band["panel_x"].sel(panel="a")))
    np.testing.assert_allclose(drawn["b"], np.sort(band["panel_x"].sel(panel="b")))
    assert {"panel", "panel_hash"}.isdisjoint(band.attrs)
    assert {"panel", "panel_hash"} <= set(found.attrs)


def test_one_drive_is_not_called_both() -> None:
    found = limit_map(toy_throws(drives=1), Conditions(), closing=CLOSING)
    assert "force, its one drive: " in plot_limit(found).get_suptitle()
    found = toy_map()
    assert "force, both drives: " in plot_limit(found).get_suptitle()


def test_the_over_travel_moves_its_population_and_nothing_else() -> None:
    usual, moved = reference_study(count=40), reference_study(count=40, over_travel=0.5e-3)
    name = "drive.1.over_travel_closed"
    values = [moved.scenario(number).inputs[name] for number in range(40)]
    assert min(values) >= 0.0
    assert max(values) <= 1.5e-3
    assert np.ptp(values) > 1e-3
    first, other = usual.scenario(3).inputs, moved.scenario(3).inputs
    changed = {key for key in first if first[key] != other[key]}
    assert changed == {name, "drive.2.over_travel_closed"}


def test_panels_come_from_a_folder_or_from_a_study(tmp_path: Path) -> None:
    for name in ("b", "a"):
        (tmp_path / f"{name}.toml").write_text(library_text("uic60-760-1-15"))
    assert [item.name for item in bands.panels_of(str(tmp_path))] == ["a", "b"]
    assert [item.name for item in bands.panels_of(str(tmp_path), most=1)] == ["a"]
    (tmp_path / "none").mkdir()
    with pytest.raises(StudyError, match="holds no panel file"):
        bands.panels_of(str(tmp_path / "none"))
    found = bands.panels_of("switch-states", most=3)
    assert len(found) == 3
    assert len({item.panel.hash for item in found if item.panel is not None}) == 3


def test_bands_hold_what_the_panels_give(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    made: list[Path] = []

    def throw_all(_: object, folder: Path, **__: object) -> object:
        made.append(folder)
        given = toy_throws()
        return replace(given, change=given.change * (1.0 + 0.2 * len(made)))

    monkeypatch.setattr(bands, "throw_all", throw_all)
    monkeypatch.setattr(bands, "closing_time", lambda _: CLOSING)
    members = bands.over_travels(None)
    found = bands.limit_bands(members, tmp_path, Conditions(), states=20)
    assert made == [tmp_path / item.name for item in members]
    given = toy_throws()
    alone = limit_map(replace(given, change=1.2 * given.change), Conditions(), closing=CLOSING)
    np.testing.assert_allclose(found["a90"][0], alone["a90"].sel(channel="both drives"))
    assert np.all(np.diff(found["a90"], axis=0) <= 0.0)  # more force, less size
    rows = bands.band_rows(found)
    assert rows[0]["a90_low"] < rows[0]["a90_high"]  # type: ignore[operator]
    assert found["a90_band"].attrs["units"] == "m"
    low, high = found["a90_band_low"], found["a90_band_high"]
    assert bool((low <= found["a90_band"]).all())
    assert bool((found["a90_band"] <= high).all())
    ax = plot_bands(found).axes[0]
    assert "over-travel-5" in [text.get_text() for text in ax.get_legend().get_texts()]
    monkeypatch.setattr(bands, "limit_bands", lambda *_, **__: found)
    line = ["limit", "--over-travel", "--folder", str(tmp_path / "kept")]
    shown = CliRunner().invoke(app, [*line, "--plot", str(tmp_path / "bands.png")])
    assert shown.exit_code == 0, shown.exception
    assert "over 6 panels; in brackets the 95 % interval over 60 drawn states" in shown.output
    middle = float(found["a90_band"][1, 0])
    assert f"{1e3 * middle:.1f} ({1e3 * float(low[1, 0]):.1f} ... " in shown.output
    record = json.loads(CliRunner().invoke(app, [*line, "--json"]).stdout)
    assert record["bands"][0]["a90_middle"] == pytest.approx(rows[0]["a90_middle"])
    assert record["bands"][0]["a90_middle_interval_low"] == pytest.approx(float(low[1, 0]))
    assert set(record["units"]) >= {"a90_middle", "a90_low_interval_high"}
    refused = CliRunner().invoke(app, [*line, "--most", "3"])
    assert "--most: chooses among the panels of --panels" in str(refused.exception)
    refused = CliRunner().invoke(app, [*line, "--ends"])
    assert "--ends: of one panel only" in str(refused.exception)
