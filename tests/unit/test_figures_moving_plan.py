"""What the page draws is where the run puts the rails."""

import json

import numpy as np
import pytest
from tests.unit.simulated import sb1_dataset, sb1_panel, sb2_dataset, sb2_panel

from turnout.figures.moving_plan import motion_record, plan_record
from turnout.mechanism.rest import rail_line
from turnout.panel.load import library_names, load_panel


@pytest.mark.parametrize("name", library_names())
def test_every_library_panel_has_a_plan(name: str) -> None:
    panel = load_panel(name)
    record = json.loads(json.dumps(plan_record(panel), allow_nan=False))
    assert [rail["name"] for rail in record["rails"]] == list(panel.rail)
    assert [drive["x"] for drive in record["drives"]] == [d.x for d in panel.drive.values()]


def test_gaps_are_those_of_the_run() -> None:
    run = sb2_dataset()
    record = json.loads(json.dumps(motion_record(sb2_panel(), run, frames=5), allow_nan=False))
    at = record["at"]
    assert len(at) == 5
    assert at[-1] == run.sizes["time"] - 1
    for name in run["rail"].values:
        own = record["rails"][str(name)]
        expected = run["gap"].sel(rail=name).isel(time=at).transpose("time", "x").values
        places = np.isin(np.round(run["x"].values, 4), own["x"])
        found = np.array(own["gap"])[:, :-1]
        np.testing.assert_allclose(found, expected[:, places], rtol=0, atol=1e-6)


def test_a_closed_rail_lies_on_its_line() -> None:
    panel, run = sb2_panel(), sb2_dataset()
    name = panel.instrumented_rail
    own = motion_record(panel, run, frames=2)["rails"][name]
    line = rail_line(panel, name, own["x"])
    np.testing.assert_allclose(own["edge"][0], line.closed_edge, rtol=0, atol=1e-4)


def test_a_rail_without_a_stock_rail_moves_by_its_displacement() -> None:
    run = sb1_dataset()
    record = motion_record(sb1_panel(), run, frames=50)
    (own,) = record["rails"].values()
    moved = run["lateral_displacement"].isel(rail=0, time=record["at"]).transpose("time", "x")
    edge = np.array(own["edge"])
    np.testing.assert_allclose(
        edge[:, 0] - edge[0, 0], moved.values[:, 0] - moved.values[0, 0], rtol=0, atol=2e-6
    )
    assert np.ptp(edge[:, 0]) > 0.01
