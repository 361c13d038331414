"""Where rails lie in plan, against the geometry they are drawn from."""

import numpy as np
import pytest

from turnout.mechanism.rest import rail_line, resting_gap
from turnout.panel.layout import extent, stands_at
from turnout.panel.load import LoadedPanel, load_panel
from turnout.panel.profile import stock_rail_gap

X = np.linspace(0.0, 14.4, 25)


@pytest.fixture(scope="module")
def panel() -> LoadedPanel:
    return load_panel("sb2")


def test_the_route_set_at_the_start_is_straight(panel: LoadedPanel) -> None:
    """The closed rail's running edge is a line, its stock rail the circle of 760.7 m."""
    line = rail_line(panel, "A", X)
    np.testing.assert_allclose(line.closed_edge, 0.0, atol=1e-12)
    circle = np.maximum((X + 2.1) ** 2 / (2 * 760.7), 2.9e-3)
    np.testing.assert_allclose(line.stock_edge, circle, rtol=1e-9)


def test_the_other_rail_curves_along_a_straight_stock_rail(panel: LoadedPanel) -> None:
    line = rail_line(panel, "B", X)
    np.testing.assert_array_equal(line.stock_edge, 0.0)
    assert line.closed_edge[-1] == pytest.approx(16.5**2 / (2 * 760.7), abs=0.006)
    assert (line.open_edge >= line.closed_edge).all()


def test_an_open_rail_stands_away_from_its_stock_rail(panel: LoadedPanel) -> None:
    for name, rail in panel.rail.items():
        line = rail_line(panel, name, X[:12])
        assert (line.side * (line.closed_edge - line.open_edge) > 0.05).all()
        assert line.side == (1.0 if rail.closes == "+y" else -1.0)


def test_gaps_at_the_drives_are_the_strokes() -> None:
    panel = load_panel("uic60-760-1-15")
    drives = list(panel.drive.values())
    opened = resting_gap(panel, "straight", [drive.x for drive in drives], closed=False)
    assert opened is not None
    travel = [drive.stroke + drive.over_travel_open for drive in drives]
    np.testing.assert_allclose(opened, travel, rtol=1e-9)


def test_a_rail_that_is_stress_free_open_has_the_gap_of_its_table(panel: LoadedPanel) -> None:
    opened = resting_gap(panel, "B", X, closed=False)
    np.testing.assert_allclose(opened, stock_rail_gap(panel.rail["B"], X), atol=1e-12)


def test_the_head_is_as_wide_as_the_planing_left_it(panel: LoadedPanel) -> None:
    width = rail_line(panel, "A", X).width
    assert width[0] == pytest.approx(2.9e-3)
    assert width[-1] == panel.rail["A"].head_width


def test_a_chair_may_belong_to_one_rail(panel: LoadedPanel) -> None:
    chair = panel.chair["1"].model_copy(update={"rails": ["A"]})
    assert stands_at(chair, "A")
    assert not stands_at(chair, "B")
    assert stands_at(panel.chair["2"], "B")


def test_extent_takes_stock_rails_in(panel: LoadedPanel) -> None:
    from turnout.panel.records import StockRail

    stock = StockRail(faces="A", start="-3 m", end="19 m", section="tongue")
    assert extent(panel.model_copy(update={"stock_rail": {"S": stock}})) == (-3.0, 19.0)
