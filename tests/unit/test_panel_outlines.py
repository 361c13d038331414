"""Sections drawn as outlines in a panel file: the library's, a user's own, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from turnout.beam.rail_outlines import planed_rail
from turnout.beam.section_analysis import analyse_outlines
from turnout.core.errors import MechanicsError, PanelError
from turnout.mechanism.build import build_mechanism
from turnout.mechanism.build_rails import rail_feet, stock_rail_data, switch_rail_data
from turnout.mechanism.rail_sections import foot_spans, section_values, station_columns
from turnout.panel.load import LoadedPanel, library_text, load_panel

DEFAULT = load_panel("uic60-760-1-15")
# A trapezium of 60 mm on top and 100 mm below, 120 mm high, planed beside a bar of 60 mm.
OWN = """
[outline.wedge]
points = { unit = "mm", values = [[0, 0], [50, 0], [30, 120], [0, 120]] }
symmetric = true
running_edge = "30 mm"

[outline.bar]
points = { unit = "cm", values = [[-3, 0], [3, 0], [3, 12], [-3, 12]] }
running_edge = "3 cm"

[planed_section.blade]
outline = "wedge"
stock_outline = "bar"
running_edge_offset = ["20 mm", "40 mm", "90 mm"]
seat_height = "0 m"

[outline_section.block]
outline = "bar"
"""


BAR = "[[-3, 0], [3, 0], [3, 12], [-3, 12]]"
STATIONS = '["20 mm", "40 mm", "90 mm"]'
SEAT = 'seat_height = "0 m"'


def own_panel(folder: Path, *changes: tuple[str, str]) -> LoadedPanel:
    text = library_text("uic60-760-1-15") + OWN
    for old, new in (('section = "tongue"', 'section = "blade"'), *changes):
        assert old in text
        text = text.replace(old, new, 1)
    path = folder / "own.toml"
    path.write_text(text, encoding="utf-8")
    return load_panel(path)


def test_library_outlines_become_part_of_the_panel() -> None:
    assert list(DEFAULT.outline) == ["60E1", "60E1A1"]
    assert DEFAULT.outline["60E1"].symmetric
    assert DEFAULT.outline["60E1"].running_edge == pytest.approx(0.036)
    assert DEFAULT.origins["outline.60E1A1.points"].kind == "assumption"
    moved = DEFAULT.with_overrides({"outline.60E1.running_edge": 0.037})
    assert moved.hash != DEFAULT.hash
    assert moved.outline["60E1"].running_edge == 0.037


def test_columns_are_the_planed_outlines_with_y_turned_towards_the_stock_rail() -> None:
    columns = station_columns(DEFAULT, "tongue")
    offsets = DEFAULT.planed_section["tongue"].running_edge_offset
    cuts = planed_rail("60E1A1", running_edge_offsets=offsets)
    found = analyse_outlines([cut.outline for cut in cuts]).properties
    np.testing.assert_allclose(columns["area"], found.area, rtol=1e-9)
    np.testing.assert_allclose(columns["product_moment"], -found.product_moment, rtol=1e-9)
    np.testing.assert_allclose(columns["centroid_offset"], -found.centroid_y, rtol=1e-9)
    np.testing.assert_allclose(columns["shear_centre_offset"], -found.shear_centre_y, rtol=1e-9)
    assert np.all(columns["product_moment"] > 0)


def test_the_other_rail_is_the_mirror_image() -> None:
    straight, curved = (switch_rail_data(DEFAULT, n, (), ()).sections for n in DEFAULT.rail)
    np.testing.assert_array_equal(straight.area, curved.area)
    for name in ("centroid_y", "shear_centre_y", "product_moment"):
        np.testing.assert_array_equal(getattr(straight, name), -getattr(curved, name))
    # The straight rail closes towards +y: its stock rail, and its steel, lie on that side.
    assert np.all(straight.centroid_y > 0)


def test_feet_follow_the_underside_and_narrow_towards_the_toe() -> None:
    widths = []
    for chair in DEFAULT.chair.values():
        near, far = rail_feet(DEFAULT, "straight", {"": chair})[""]
        assert far.y == pytest.approx(-0.0438, abs=1e-4)
        widths.append(near.y - far.y)
    assert widths[0] == pytest.approx(0.0713, abs=2e-4)
    assert widths[-1] == pytest.approx(0.1397, abs=2e-4)
    assert np.all(np.diff(widths) >= 0)
    mirrored = rail_feet(DEFAULT, "curved", {"": DEFAULT.chair["1"]})[""]
    assert [p.y for p in mirrored] == [
        -p.y for p in rail_feet(DEFAULT, "straight", {"": DEFAULT.chair["1"]})[""]
    ]


def test_given_feet_stay_as_given_and_a_table_has_one_foot() -> None:
    own = DEFAULT.with_overrides({"chair.foot_offsets": [0.01, -0.03]})
    assert [p.y for p in rail_feet(own, "straight", {"": own.chair["3"]})[""]] == [0.01, -0.03]
    assert [p.y for p in rail_feet(own, "curved", {"": own.chair["3"]})[""]] == [-0.01, 0.03]
    table = load_panel("sb1")
    assert [p.y for p in rail_feet(table, "switch", {"": table.chair["3"]})[""]] == [0.0]


def test_fastenings_act_in_the_middle_of_the_underside() -> None:
    spans = foot_spans(DEFAULT, "straight", [15.0])
    assert spans is not None
    middle = 0.5 * sum(spans[0])
    supports = switch_rail_data(DEFAULT, "straight", (), ()).supports
    fastened = [s.point.y for s in supports if s.point.x >= 15.0]
    np.testing.assert_allclose(fastened, middle, rtol=1e-12)
    moved = DEFAULT.with_overrides({"fastening.offset": 0.02, "stock_fastening.offset": 0.03})
    assert {s.point.y for s in switch_rail_data(moved, "curved", (), ()).supports} == {-0.02}
    assert {s.point.y for s in stock_rail_data(moved, "curved", ()).supports} == {0.03}
    assert {s.point.y for s in stock_rail_data(DEFAULT, "curved", ()).supports} == {0.0}


def test_any_rail_a_user_draws_works(tmp_path: Path) -> None:
    panel = own_panel(tmp_path)
    columns = station_columns(panel, "blade")
    # 20 mm from edge to edge: of the trapezium stays what lies right of the bar, a triangle's worth
    # more below; at 80 mm the whole of it.
    left = 0.5 * 0.12 * (0.020 + 0.040)
    np.testing.assert_allclose(columns["area"][[0, 2]], [left, 0.12 * 0.08], rtol=1e-6)
    np.testing.assert_allclose(columns["foot_edge_stock"][[0, 2]], [0.020, 0.080], atol=1e-4)
    np.testing.assert_allclose(columns["foot_edge_track"], -0.020, atol=1e-4)
    assert build_mechanism(panel).rows.shape[0] > 100
    block = own_panel(
        tmp_path,
        ('section = "blade"', 'section = "block"'),
        ('section = "stock"', 'section = "block"'),
    )
    values = section_values(block, "curved", [0.0, 9.0])
    np.testing.assert_allclose(values["area"], 0.06 * 0.12, rtol=1e-9)
    np.testing.assert_allclose(values["foot_edge_stock"], 0.03, atol=1e-12)
    assert stock_rail_data(block, "curved", ()).sections.area[0] == pytest.approx(0.0072)


def test_planing_can_be_set_by_key(tmp_path: Path) -> None:
    panel = own_panel(tmp_path)
    before = station_columns(panel, "blade")["area"]
    shaved = panel.with_settings(["planed_section.blade.clearance=2 mm"])
    np.testing.assert_allclose(
        before - station_columns(shaved, "blade")["area"],
        [0.12 * 0.002, 0.12 * 0.002, 0],
        atol=2e-9,
    )
    other = DEFAULT.with_settings(["planed_section.clearance=2 mm"])
    assert np.all(
        station_columns(other, "tongue")["area"][:10]
        < station_columns(DEFAULT, "tongue")["area"][:10]
    )
    points = (
        'outline.bar.points={ unit = "mm", values = [[-30, 0], [30, 0], [30, 100], [-30, 100]] }'
    )
    assert panel.with_settings([points]).outline["bar"].points[2] == (0.03, 0.1)
    in_metres = panel.with_overrides({"outline.bar.points": [[-0.03, 0], [0.03, 0], [0.0, 0.1]]})
    assert in_metres.outline["bar"].points[2] == (0.0, 0.1)


def test_nothing_left_of_a_rail_names_its_section(tmp_path: Path) -> None:
    panel = own_panel(tmp_path, (STATIONS, '["0 mm", "90 mm"]'))
    shaved = panel.with_overrides({"planed_section.blade.clearance": 0.03})
    with pytest.raises(
        MechanicsError, match=r"planed_section\.blade: .* nothing .* is left|nothing"
    ):
        station_columns(shaved, "blade")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'outline = "wedge"',
            'outline = "60E1A2"',
            r'outline = "60E1A2": there is no such .*60E1A1',
        ),
        ('outline = "bar"', 'outline = "baar"', r"stock_outline.*nearest is 'bar'"),
        (BAR, "[[-3, 0], [3, 0], [-3, 12], [3, 12]]", "itself near y = 0 mm, z = 60 mm"),
        (
            "[[0, 0], [50, 0], [30, 120], [0, 120]]",
            "[[0, 0], [50, 0], [-30, 120]]",
            "point 3 has y < 0",
        ),
        (BAR, "[[-3, 0], [3, 0]]", "needs 3 points or more, has 2"),
        (BAR, "[[-3, 0], [3, 0], [3, 0], [3, 12], [-3, 12]]", "point 3 repeats point 2"),
        (
            'unit = "cm", values = [[-3',
            'unit = "m", values = [[-3',
            r"6000 mm along y.*check its unit",
        ),
        ('unit = "cm", values = [[-3', 'unit = "µm", values = [[-3', r"0\.006 mm along y"),
        (BAR, "[[-3, 1], [3, 1], [3, 12], [-3, 12]]", r"lowest .* z = 10 mm.* shift .* by -10 mm"),
        ("[3, 12], [-3, 12]]", "[3], [-3, 12]]", r"points.*point 3 of 4 must be a pair"),
        ('{ unit = "cm", values = [[-3, 0]', '{ unit = "kg", values = [[-3, 0]', "points.*kg"),
        ('running_edge = "3 cm"\n', "", "stock_outline = .bar.: that outline lacks running_edge"),
        (STATIONS, '["20 mm", "10 mm"]', "running_edge_offset: must rise"),
        (STATIONS, '["-2 mm", "10 mm"]', "running_edge_offset: must be at least 0"),
        (
            SEAT,
            SEAT + '\nlowering = ["1 mm", "0 mm"]',
            "lowering: has 2 entries, lowering_offset 1",
        ),
        (SEAT, SEAT + '\nlowering = ["-1 mm"]', "lowering: must be at least 0"),
        (SEAT, SEAT + '\nlowering = ["1 m"]', "lowering: must be less than .* mm, the height of"),
        (SEAT, SEAT + '\nclearance = "-1 mm"', "clearance"),
        ("[outline_section.block]", "[outline_section.blade]", "outline_section has this name"),
        ('section = "stock"', 'section = "blade"', "stock_rail.section.* is a planed_section"),
        ('section = "stock"', 'section = "stok"', "no such section; nearest is 'stock'"),
    ],
)
def test_what_cannot_be_a_section_is_refused(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    with pytest.raises(PanelError, match=message):
        own_panel(tmp_path, (old, new))


def test_all_problems_come_at_once(tmp_path: Path) -> None:
    with pytest.raises(PanelError) as caught:
        own_panel(
            tmp_path,
            ("[3, 12], [-3, 12]]", "[-3, 12], [3, 12]]"),
            (STATIONS, '["20 mm", "10 mm"]'),
            ('section = "stock"', 'section = "stok"'),
        )
    text = str(caught.value)
    assert all(part in text for part in ("crosses itself", "must rise", "nearest is 'stock'"))


def test_a_planed_section_needs_a_running_edge_of_the_rail(tmp_path: Path) -> None:
    text = library_text("uic60-760-1-15")
    start, end = text.index("[rail.running_edge]"), text.index("[rail.straight]")
    path = tmp_path / "bare.toml"
    path.write_text(text[:start] + text[end:], encoding="utf-8")
    with pytest.raises(PanelError, match="running_edge: is missing"):
        load_panel(path)


def test_a_rod_holds_the_rail_against_roll_and_only_its_own() -> None:
    stiff = DEFAULT.with_overrides({"drive.1.roll_stiffness": 40e3, "drive.2.roll_stiffness": 0.0})
    found = [s for s in switch_rail_data(stiff, "straight", (), ()).supports if s.point.x < 15.0]
    assert [(s.point.x, s.point.direction, s.stiffness) for s in found] == [(0.3, "rx", 40e3)]
    assert all(s.point.x >= 15.0 for s in switch_rail_data(stiff, "curved", (), ()).supports)


def test_curved_rails_bend_away_from_what_they_face() -> None:
    curve = {"rail.curved.curve_radius": 760.7, "stock_rail.curved.curve_radius": 760.7}
    panel = DEFAULT.with_overrides(curve)
    curved = switch_rail_data(panel, "curved", (), ())
    # It closes towards -y, where its stock rail lies; 2.1 m before the toe it is tangent.
    assert curved.plan is not None
    np.testing.assert_allclose(curved.plan, (curved.x + 2.1) ** 2 / (2 * 760.7), rtol=1e-12)
    stock = stock_rail_data(panel, "curved", ())
    assert stock.plan is not None
    np.testing.assert_allclose(stock.plan[-1], 20.7**2 / (2 * 760.7), rtol=1e-12)
    assert stock.plan[0] == 0.0
    assert switch_rail_data(panel, "straight", (), ()).plan is None
