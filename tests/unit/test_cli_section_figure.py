"""The figure of a panel's sections: its own outlines with the marks that its beams have."""

from functools import cache

import numpy as np
from matplotlib.figure import Figure

from turnout.cli.panel import section_figure
from turnout.figures.sections import ROWS
from turnout.mechanism.rail_sections import section_outlines, station_columns
from turnout.panel.load import load_panel

DEFAULT = "uic60-760-1-15"


@cache
def figure_of(rail: str) -> Figure:
    """Return the figure of a rail, which no test may change."""
    return section_figure(load_panel(DEFAULT), rail)


def test_every_station_is_drawn_with_its_stock_rail_and_marks() -> None:
    panel = load_panel(DEFAULT)
    section = panel.rail["straight"].section
    columns, pairs = station_columns(panel, section), section_outlines(panel, section)
    panels = [ax for ax in figure_of("straight").axes if ax.patches]
    assert len(panels) == len(pairs) == len(panel.planed_section[section].running_edge_offset)
    for row, (ax, (outline, stock)) in enumerate(zip(panels, pairs, strict=True)):
        beside, own = ax.patches
        assert stock is not None
        assert len(beside.get_path().vertices) == len(stock.points) + 1
        np.testing.assert_allclose(own.get_path().vertices[:-1], 1e3 * outline.points)
        marks = {line.get_label(): line.get_xydata()[0] for line in ax.lines}
        assert marks["running edge"][0] == 0.0
        for label, name in (("centroid", "centroid"), ("shear centre", "shear_centre")):
            place = (-columns[f"{name}_offset"][row], columns[f"{name}_height"][row])
            np.testing.assert_allclose(marks[label], 1e3 * np.array(place))


def test_stations_are_named_by_offset_and_place() -> None:
    """Twenty millimetres of offset are reached where (x + 2.1 m)^2 = 2 R w."""
    panels = figure_of("curved").axes
    x = np.sqrt(2 * 760.7 * 0.02) - 2.1
    assert f"w = 20 mm, x = {x:.2f} m" in [ax.get_title() for ax in panels]


def test_planing_is_that_of_the_panel() -> None:
    """With more clearance less is left of the blade."""
    wide = load_panel(DEFAULT).with_settings(["planed_section.tongue.clearance=4 mm"])
    areas = []
    for figure in (figure_of("straight"), section_figure(wide, "straight")):
        (_, own) = figure.axes[6].patches
        y, z = own.get_path().vertices.T
        areas.append(0.5 * abs(np.sum(y[:-1] * z[1:] - y[1:] * z[:-1])))
    assert areas[1] < areas[0] - 100.0


def test_a_table_has_no_outline_and_is_drawn_along_the_rail() -> None:
    figure = section_figure(load_panel("sb2"), "A")
    assert len(figure.axes) == len(ROWS)
    assert "rail A" in figure.get_suptitle()


def test_one_outline_all_along() -> None:
    panel = load_panel(DEFAULT)
    rail = panel.rail["straight"].model_copy(update={"section": "stock"})
    changed = panel.model_copy(update={"rail": {"straight": rail}})
    (ax,) = section_figure(changed, "straight").axes
    assert ax.get_title() == "all along"
    assert len(ax.patches) == 1


def test_the_title_names_panel_section_and_rail() -> None:
    for name in ("straight", "curved"):
        title = figure_of(name).get_suptitle()
        assert title.startswith(f"{DEFAULT}: section 'tongue' of rail {name}, y positive away")
