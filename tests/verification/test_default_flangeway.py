"""The flangeway of the default panel, which stays below the 58 mm that Bane NOR TRV asks for.

The strokes were chosen for 57.6 mm of a frictionless rail at rest. Friction and the stretch of the
bushings take some of it in a throw: 50.9 mm were found by an independent program without
over-travel of the drives, 56.5 mm with it. So a throw must leave more than 50 and less than 58 mm,
the limit must be missed, and everybody who looks at the panel must be told.
"""

import numpy as np
import pytest
import xarray as xr
from tests.verification.runs import DEFAULT, throw

from turnout.analysis.panel_check import concerns
from turnout.metric.slip import settled
from turnout.metric.summary import summary
from turnout.panel.load import load_panel

MOST_AT_REST = 0.0576


@pytest.fixture(scope="module")
def alone() -> xr.Dataset:
    return throw(DEFAULT)


def flangeways(dataset: xr.Dataset) -> dict[str, float]:
    """Return the least of each rail when it stands open, from its gaps and the running edges."""
    panel, found = load_panel(DEFAULT), {}
    x = dataset["x"].values
    for name, rail in panel.rail.items():
        open_to = "open" if rail.closes == "+y" else "closed"
        gap = settled(dataset, to=open_to)["gap"].sel(rail=name).values
        edge = rail.running_edge
        assert edge is not None
        assert rail.head_width is not None
        beyond = (x + edge.lead) ** 2 / (2 * edge.radius) - rail.head_width
        found[name] = float(np.min(gap + np.maximum(beyond, 0.0)))
    return found


def test_each_open_rail_keeps_most_of_it(alone: xr.Dataset) -> None:
    found = flangeways(alone)
    assert set(found) == {"straight", "curved"}
    for least in found.values():
        assert 0.050 < least < MOST_AT_REST


def test_the_label_is_the_least_of_both(alone: xr.Dataset) -> None:
    """The label looks at every node, at the end of a movement; these gaps just before the next."""
    found = flangeways(alone)
    rail = str(alone["least_flangeway_rail"].values)
    assert rail == min(found, key=lambda name: found[name])
    assert float(alone["least_flangeway"]) == pytest.approx(found[rail], abs=1e-3)
    assert float(alone["least_flangeway"]) <= found[rail] + 1e-5


def test_the_limit_is_missed_and_that_is_told(alone: xr.Dataset) -> None:
    limit = load_panel(DEFAULT).flangeway
    assert limit is not None
    assert limit.limit == pytest.approx(0.058)
    text = dict(summary(alone))["least flangeway"]
    assert "BELOW the limit of 58 mm" in text
    assert [item for item in concerns(alone) if item.what == "flangeway below its limit"]
