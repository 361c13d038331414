"""Panels of other shapes give datasets too: fewer parts, more drives, another start."""

import re

import numpy as np
import pytest
import xarray as xr
from tests.unit.simulated import OBJECT, sb1_panel, sb2_panel

from turnout.core.channels import schema_problems
from turnout.core.errors import ResponseError
from turnout.core.toml import parse_toml
from turnout.figures.throw import plot_throw
from turnout.metric.summary import summary
from turnout.panel.load import LoadedPanel, library_text, panel_from_file
from turnout.panel.markers import marker_offsets
from turnout.throw.save import Save
from turnout.throw.simulate import simulate

TIMES = {key: value for key, value in sb1_panel().overrides.items() if "return" not in key}
NO_RETURN = (r"\[movement\.return\].*?\n\n", "")
NO_DRIVE_2 = (r"\[drive\.2\].*?\n\n", "")


def variant(*changes: tuple[str, str]) -> LoadedPanel:
    """SB1 with pieces of its file replaced, thrown to closed only."""
    text = library_text("sb1")
    for pattern, replacement in (NO_RETURN, *changes):
        text, count = re.subn(pattern, replacement, text, flags=re.DOTALL)
        assert count == 1, pattern
    return panel_from_file(parse_toml(text, source="variant")).with_overrides(TIMES)


def looked_at(panel: LoadedPanel) -> xr.Dataset:
    """Simulate, and put the dataset through everything that reads it."""
    dataset = simulate(panel, save=Save(interval=0.01))
    assert schema_problems(dataset) == []
    assert len(summary(dataset)) > 5
    assert len(plot_throw(dataset).axes) >= 3
    return dataset


def test_one_drive() -> None:
    dataset = looked_at(variant(NO_DRIVE_2))
    assert dataset["drive"].values.tolist() == ["1"]
    assert np.isnan(float(dataset["force_margin"].sel(direction="opening", drive="1")))


def test_six_drives() -> None:
    more = "".join(
        f'[drive.{n}]  # assumption: test\nx = "{n - 1}.2 m"\nstroke = "{80 - 5 * n} mm"\n'
        f'stiffness = "700 kN/m"\n\n'
        for n in range(3, 7)
    )
    dataset = looked_at(variant((r"\[sensor\.TKK1\]", more + "[sensor.TKK1]")))
    assert dataset["drive_force"].sizes["drive"] == 6


def test_no_stock_rail_means_no_gaps() -> None:
    """Nor are there any after a throw of the same panel with a stock rail, whose rows are kept."""
    looked_at(variant())
    without = (r"\[rail\.switch\.stock_rail_gap\].*?\n\n", "")
    dataset = looked_at(variant(without))
    assert np.isnan(dataset["drive_gap"]).all()
    assert np.isnan(dataset["stop_force"]).all()
    assert not dataset["in_control"].any()
    assert dataset["lateral_displacement"].notnull().all()


def test_neither_chairs_nor_stops_nor_sensors() -> None:
    dataset = looked_at(
        variant(
            (r"\[chair\].*?\n\n", ""),
            (r"\[stop\].*?\n\n", ""),
            (r"\[sensor\.TKK1\].*?\n\n", ""),
        )
    )
    assert not {"chair_normal_force", "stop_force", "sensor_gap", "in_control"} & set(dataset)
    assert dataset["x"].values.tolist() == [0.3, 6.9]


def test_studs_are_reported_from_stops() -> None:
    stud = '[stud.1]  # assumption: test\nx = "9 m"\nheight = "0 m"\nstiffness = "1e8 N/m"\n\n'
    dataset = looked_at(variant((r"\[sensor\.TKK1\]", stud + "[sensor.TKK1]")))
    assert dataset["stop"].values.tolist() == [*(str(n) for n in range(1, 17)), "stud 1"]
    assert float(dataset["stop_x"].sel(stop="stud 1")) == 9.0


def test_a_rail_that_does_not_start_stress_free_is_held_there_by_its_drives() -> None:
    """Rail A is stress-free open: bushings bend it to where the markers' own zero is."""
    opened = sb2_panel().rail["B"].stock_rail_gap
    profile = opened.model_dump() if opened is not None else {}  # type: ignore[union-attr]
    panel = sb2_panel().with_overrides(
        {"rail.A.stress_free": "open", "rail.A.stock_rail_gap": profile, "schedule.end": 8.0}
    )
    start = simulate(panel, save=Save(interval=0.5)).isel(time=0)
    np.testing.assert_array_equal(start["drive_displacement"], [0.0, 0.0])
    np.testing.assert_allclose(marker_offsets(panel), [0.115, 0.075])
    np.testing.assert_allclose(start["drive_gap"], [0.0, 0.0], atol=2e-3)
    assert float(start["drive_force"].sel(drive="2")) > 500.0


def test_an_object_on_the_other_rail_is_trapped_by_the_opening_throw() -> None:
    other = type(OBJECT)("13 mm", "sleeper 6", rail="B")
    dataset = simulate(sb2_panel(), foreign_object=other, save=Save(interval=0.01))
    assert 2.5 < float(dataset["contact_time"]) < 3.4
    held = dataset["gap"].sel(rail="B", x=3.6, time=4.0, method=None)
    assert float(held) == pytest.approx(0.013, abs=1e-4)


def test_a_name_is_no_panel() -> None:
    with pytest.raises(ResponseError, match="takes a panel from load_panel"):
        simulate("sb2")  # type: ignore[arg-type]
