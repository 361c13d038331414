"""Figures as data, and the same on paper: what they hold is what the dataset holds."""

import json

import numpy as np
import pytest
from tests.unit.simulated import sb1_dataset, sb2_dataset

from turnout.core.errors import ResponseError
from turnout.figures.along_rail_sheet import chair_sheet, gap_sheet, shade_of, shape_sheet
from turnout.figures.draw import draw_sheet
from turnout.figures.over_time_sheet import energy_sheet, throw_sheet
from turnout.figures.sheet import Level, Line, Row, Sheet, sheet_record


def line_of(sheet: Sheet, row: int, label: str) -> Line:
    return next(line for line in sheet.rows[row].lines if line.label == label)


def test_forces_over_time_keep_their_peaks_on_a_page() -> None:
    dataset = sb2_dataset()
    sheet = throw_sheet(dataset)
    assert [row.label.split("\n")[0] for row in sheet.rows] == [
        *("Object force", "Drive force", "Marker", "Gap to stock")
    ]
    record = sheet_record(sheet, most=300)
    peak = float(dataset["drive_force"].sel(drive="2").max()) / 1e3
    drawn = record["rows"][1]["lines"][1]
    assert len(drawn["y"]) <= 300 < dataset.sizes["time"]
    assert max(drawn["y"]) == pytest.approx(peak, abs=1e-4)
    assert sheet.moments[0].at == float(dataset["contact_time"])
    json.dumps(record, allow_nan=False)


def test_a_closed_rail_is_drawn_above_with_object_and_limits() -> None:
    dataset = sb2_dataset()
    sheet = shape_sheet(dataset, compare=dataset)
    assert "closed" in sheet.rows[0].label
    gap = 1e3 * dataset["gap"].sel(rail=dataset.attrs["instrumented_rail"]).isel(time=-1)
    np.testing.assert_array_equal(sheet.rows[0].lines[0].y, gap)
    assert sheet.rows[0].lines[1].label.endswith("to compare")
    assert line_of(sheet, 0, "object").y.tolist() == [13.0]
    assert [moment.text for moment in sheet.moments] == ["Drive 1", "Drive 2"]


def test_a_gauge_that_was_kept_is_drawn_below_with_its_limit() -> None:
    dataset = sb2_dataset()
    gauge = (("x", "time"), np.full((dataset.sizes["x"], dataset.sizes["time"]), 1.4221))
    known = dataset.assign(gauge=gauge).assign_attrs(gauge_nominal=1.435, gauge_limit=1.427)
    *above, row = shape_sheet(known).rows
    assert len(above) == len(shape_sheet(dataset).rows)
    np.testing.assert_allclose(row.lines[0].y, -12.9)
    assert row.levels[0].at == pytest.approx(-8.0)


def test_the_gap_shrinks_from_line_to_line() -> None:
    lines = [line for line in gap_sheet(sb2_dataset()).rows[0].lines if line.style == "line"]
    toes = [float(line.y[0]) for line in lines]
    assert toes[0] > 50
    assert toes == sorted(toes, reverse=True)


def test_chairs_that_lift_off_are_counted() -> None:
    dataset = sb2_dataset()
    largest, _, lifted = chair_sheet(dataset).rows
    spans = json.loads(dataset.attrs["movements"])[-1]
    part = dataset.sel(time=slice(spans["start"], spans["end"]))
    load = part["chair_normal_force"].isel(rail=0)
    np.testing.assert_allclose(largest.lines[0].y, load.max("time") / 1e3)
    np.testing.assert_allclose(lifted.lines[0].y, 100 * (load < 1).mean("time"))


@pytest.mark.parametrize("count", [2, 150, 1500])
def test_a_run_that_ended_early_is_drawn_as_far_as_it_came(count: int) -> None:
    dataset = sb1_dataset().isel(time=slice(0, count))
    end = float(dataset["time"][-1])
    (row,) = gap_sheet(dataset).rows
    assert row.lines[7].label == f"t = {end:.2f} s"
    for sheet in (chair_sheet(dataset), shape_sheet(dataset)):
        assert all(np.isfinite(line.y).all() for row in sheet.rows for line in row.lines)


def test_energies_are_those_of_the_books() -> None:
    dataset = sb2_dataset()
    large, small = energy_sheet(dataset).rows
    np.testing.assert_array_equal(large.lines[0].y, dataset["work_markers"])
    np.testing.assert_allclose(small.lines[1].y, 1e3 * dataset["energy_residual"])


def test_paper_shows_every_line_level_and_mark() -> None:
    x = np.arange(3.0)
    lines = (
        Line(label="force", x=x, y=x),
        Line(label="slip", x=x[:1], y=x[:1], style="marks", symbol="triangle down", colour=1),
        Line(label="share", x=x, y=x, style="bars", width=0.5),
    )
    rows = (Row("F [kN]", lines, (Level(6.0, "slips"),)),)
    (ax,) = draw_sheet(Sheet(name="f", title="t", caption="", x_label="x", rows=rows)).axes
    drawn = {line.get_label(): line for line in ax.lines}
    np.testing.assert_array_equal(drawn["force"].get_ydata(), x)
    assert drawn["slip"].get_marker() == "v"
    assert [patch.get_height() for patch in ax.patches] == [0.0, 1.0, 2.0]
    assert [text.get_text() for text in ax.texts] == ["slips"]


def test_an_empty_sheet_is_refused() -> None:
    with pytest.raises(ResponseError, match="nothing to draw: forces has no line"):
        draw_sheet(Sheet(name="f", title="forces", caption="", x_label="x", rows=(Row("F", ()),)))


def test_later_shades_are_darker() -> None:
    light = [sum(bytes.fromhex(shade_of(share)[1:])) for share in np.linspace(0, 1, 9)]
    assert light == sorted(light, reverse=True)
