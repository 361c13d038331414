"""The plan of a panel, as a figure and as characters: everything stands where the panel says."""

import numpy as np
import pytest
from tests.unit.simulated import sb2_dataset, sb2_panel

from turnout.cli.show import COLUMNS, HEADING, plan_lines
from turnout.figures.plan import EXAGGERATION, TRACK, plot_plan
from turnout.mechanism.rest import rail_line
from turnout.panel.load import load_panel


def line_of(ax, label):  # type: ignore[no-untyped-def]
    (line,) = [line for line in ax.lines if line.get_label() == label]
    return line


@pytest.fixture(scope="module")
def figure():  # type: ignore[no-untyped-def]
    return plot_plan(sb2_panel())


def test_the_exaggeration_is_that_of_the_title(figure) -> None:  # type: ignore[no-untyped-def]
    top, bottom = figure.axes
    figure.canvas.draw()
    box, (left, right), (low, high) = top.get_window_extent(), top.get_xlim(), top.get_ylim()
    scale = (box.height / (high - low)) / (box.width / (right - left))
    assert scale == pytest.approx(EXAGGERATION, rel=1e-6)
    assert f"{EXAGGERATION} times" in figure.get_suptitle()
    # What stands above each other belongs together.
    below = bottom.get_window_extent()
    assert (box.x0, box.x1) == pytest.approx((below.x0, below.x1), abs=2.0)


def test_marks_stand_where_the_panel_says(figure) -> None:  # type: ignore[no-untyped-def]
    panel, top = sb2_panel(), figure.axes[0]
    for label, family in (("Fastening", panel.fastening), ("Stud", panel.stud)):
        np.testing.assert_allclose(
            line_of(top, label).get_xdata(), [item.x for item in family.values()]
        )
    texts = [text.get_text() for text in top.texts]
    for name, drive in panel.drive.items():
        assert f"Drive {name}, {1e3 * drive.stroke:g} mm" in texts
    for name in (*panel.sensor, *panel.sleeper):
        assert name in texts
    assert {"Link", "TKK", "Slide chair"} <= set(top.get_legend_handles_labels()[1])


def test_a_stock_rail_that_bends_is_drawn_with_its_fastenings() -> None:
    panel = load_panel("uic60-760-1-15")
    top = plot_plan(panel).axes[0]
    for name, stock in panel.stock_rail.items():
        places = [
            item.x
            for item in panel.stock_fastening.values()
            if item.rails is None or name in item.rails
        ]
        drawn = [line for line in top.lines if line.get_label() == "_stock fastening"]
        assert any(np.array_equal(line.get_xdata(), places) for line in drawn), stock.faces
    assert top.get_xlim()[0] < min(stock.start for stock in panel.stock_rail.values())


def test_a_stock_rail_reaches_beyond_its_switch_rail() -> None:
    changed = {"stock_rail.curved.end": 20.0}
    panel = load_panel("uic60-760-1-15", overrides=changed)
    (name,) = [stock.faces for stock in panel.stock_rail.values() if stock.end == 20.0]
    top = plot_plan(panel).axes[0]
    (drawn,) = [
        corners
        for corners in (item.get_paths()[0].vertices for item in top.collections)
        if corners[:, 0].max() == pytest.approx(20.0) and np.ptp(corners[:, 0]) > 10.0
    ]
    line = rail_line(panel, name, [20.0])
    last = drawn[np.isclose(drawn[:, 0], 20.0), 1]
    edge = line.stock_edge[0] + 0.5 * line.side * TRACK
    assert np.abs(last - edge).min() == pytest.approx(0.0, abs=1e-9)
    low, high = top.get_ylim()
    assert low < last.min() < last.max() < high


def test_back_drives_are_drawn_from_their_drive_to_the_rails() -> None:
    panel = load_panel("60e1-441-1-12")
    (back,) = panel.back_drive.values()
    top = plot_plan(panel).axes[0]
    rod = line_of(top, "Back drive")
    assert list(rod.get_xdata()) == [panel.drive[back.drive].x] * 2 + [back.x]
    bar = next(line for line in top.lines if list(line.get_xdata()) == [back.x, back.x])
    edges = [
        rail_line(panel, name, [back.x]).closed_edge[0]
        + 0.5 * TRACK * rail_line(panel, name, [back.x]).side
        for name in panel.rail
    ]
    assert sorted(bar.get_ydata()) == pytest.approx(sorted(edges))
    assert "Back drive 1" in [text.get_text() for text in top.texts]


def test_the_open_edge_is_that_of_the_layout(figure) -> None:  # type: ignore[no-untyped-def]
    line = line_of(figure.axes[0], "Running edge open (estimate)")
    expected = rail_line(sb2_panel(), "A", line.get_xdata()).open_edge + 0.5 * TRACK
    np.testing.assert_allclose(line.get_ydata(), expected)


def test_a_throw_gives_the_gap_of_each_rail_when_it_lies_closed() -> None:
    """Rail A is closed at the end, rail B just before the return at 4.4 s."""
    dataset = sb2_dataset()
    ax = plot_plan(sb2_panel(), dataset=dataset).axes[1]
    final_value = dataset["gap"].sel(rail="A").isel(time=-1)
    before = dataset["gap"].sel(rail="B").sel(time=4.399, method="nearest")
    np.testing.assert_allclose(line_of(ax, "rail A").get_ydata(), 1e3 * final_value)
    np.testing.assert_allclose(line_of(ax, "rail B").get_ydata(), 1e3 * before)
    assert "simulated" in ax.get_ylabel()


def test_a_single_rail_without_running_edge_is_drawn() -> None:
    figure = plot_plan(load_panel("sb1"))
    assert "no running edge given" in figure.get_suptitle()
    assert "estimated" in figure.axes[1].get_ylabel()


def test_characters_stand_where_the_panel_says() -> None:
    panel = sb2_panel()
    lines = list(plan_lines(panel))
    assert max(map(len, lines)) <= HEADING + COLUMNS
    (sensors,) = [line for line in lines if line.startswith("TKK")]
    column = sensors.index("TKK1") + 1 - HEADING
    assert column == pytest.approx(3.6 / 18.6 * (COLUMNS - 1), abs=1)
    chairs = [line for line in lines if line.startswith("chairs")]
    assert [line.count("o") for line in chairs] == [len(panel.chair)] * 2
    assert [line.count("#") for line in chairs] == [len(panel.fastening)] * 2
    (links,) = [line for line in lines if line.startswith("link")]
    assert links.count("|") == len(panel.link)


def test_the_instrumented_rail_closes_upwards() -> None:
    order = [line.split()[0] for line in plan_lines(sb2_panel())]
    assert order.index("stock") < order.index("A") < order.index("drive") < order.index("B")
    assert order.index("B") < len(order) - 1 - order[::-1].index("stock")
