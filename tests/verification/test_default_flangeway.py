"""The flangeway of the default panel: 58 mm, as Bane NOR TRV asks for, after both movements.

It follows from the strokes: 5 mm less at Drive 2 leave too little, and then everybody who looks at
the panel is reported.
"""

import numpy as np
import pytest
import xarray as xr
from tests.verification.facts import flangeways
from tests.verification.runs import DEFAULT, throw

from turnout.metric.panel_check import concerns
from turnout.metric.summary import summary
from turnout.panel.load import load_panel

LIMIT = 0.058
MOST = 0.065


@pytest.fixture(scope="module")
def alone() -> xr.Dataset:
    return throw(DEFAULT)


def test_each_open_rail_keeps_it(alone: xr.Dataset) -> None:
    found = flangeways(alone, load_panel(DEFAULT))
    assert set(found) == {"open", "closed"}
    for least in found.values():
        assert LIMIT < least < MOST


def test_the_label_is_the_least_of_both(alone: xr.Dataset) -> None:
    """The label looks at every node, at the end of a movement; these gaps just before the next."""
    found = flangeways(alone, load_panel(DEFAULT))
    to = min(found, key=lambda name: found[name])
    opened = {"open": "straight", "closed": "curved"}[to]
    assert str(alone["least_flangeway_rail"].values) == opened
    assert float(alone["least_flangeway"]) == pytest.approx(found[to], abs=1e-3)
    assert float(alone["least_flangeway"]) <= found[to] + 1e-5


def test_a_limit_that_is_missed_is_reported(alone: xr.Dataset) -> None:
    limit = load_panel(DEFAULT).flangeway
    assert limit is not None
    assert limit.limit == pytest.approx(LIMIT)
    assert "; at least 58 mm required" in dict(summary(alone))["least flangeway"]
    assert concerns(alone) == []
    short = throw(DEFAULT, overrides=(("drive.2.stroke", 0.075),))
    assert float(short["least_flangeway"]) < LIMIT
    assert np.isfinite(float(short["least_flangeway_x"]))
    assert "TOO NARROW: at least 58 mm required" in dict(summary(short))["least flangeway"]
    assert [item for item in concerns(short) if item.what == "flangeway below its limit"]
