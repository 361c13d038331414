"""Wrong values in a panel file: each is reported with its key, its value and what is allowed."""

from pathlib import Path

import pytest

from turnout.core.errors import PanelError
from turnout.core.toml import parse_toml
from turnout.panel.load import library_text, load_panel, panel_from_file


def problems(name: str, *changes: tuple[str, str]) -> tuple[str, ...]:
    """Load a library panel with changed text and give what is wrong with it."""
    text = library_text(name)
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    with pytest.raises(PanelError) as caught:
        panel_from_file(parse_toml(text, source="panel.toml"))
    assert str(caught.value).startswith("panel.toml: ")
    assert "pydantic" not in str(caught.value)
    assert "Traceback" not in str(caught.value)
    return caught.value.problems


# One change, one problem: the text changed, what it becomes, the problem.
SINGLE = [
    # unknown keys
    ("rule =", "rules =", "lock.rules: unknown key; nearest is 'rule'; allowed are"),
    ('closes = "+y"', 'closes = "+y"\nwieght = 3', "rail.switch.wieght: unknown key; allowed are"),
    ("[lock]", "[locc]\n[lock]", "locc: unknown key; nearest is 'lock'; allowed are"),
    (
        "[drive.1]",
        '[drive.1]\nsaturation = "6 kN"',
        "drive.1.saturation: unknown key; nearest is 'sat",
    ),
    (
        "interpolation =",
        "interpolate =",
        "rail.switch.stock_rail_gap.interpolate: unknown key; near",
    ),
    # units and dimensions
    (
        '"750 kN/m"',
        '"750 kN"',
        'drive.1.stiffness = "750 kN": "kN" is a unit of force; needs one of',
    ),
    (
        '"750 kN/m"',
        '"750 furlong"',
        'drive.1.stiffness = "750 furlong": "furlong" is a unit of length; needs',
    ),
    ('"750 kN/m"', '"750 kNm/"', 'drive.1.stiffness = "750 kNm/": "kNm/" is not a unit'),
    ('"750 kN/m"', "750", "drive.1.stiffness = 750: has no unit, 750 would be 750 N/m; write the"),
    ('"750 kN/m"', '"750"', 'drive.1.stiffness = "750": has no unit, 750 would be 750 N/m; write'),
    ('"750 kN/m"', "true", "drive.1.stiffness = true: must be text with a number and a unit of"),
    (
        '"210 GPa"',
        '"210 mm"',
        'material.youngs_modulus = "210 mm": "mm" is a unit of length; needs',
    ),
    ("friction_coefficient = 0.4", 'friction_coefficient = "0.4"', "chair.friction_coefficient = "),
    (
        "friction_coefficient = 0.4",
        "friction_coefficient = true",
        "chair.friction_coefficient = true",
    ),
    # bounds
    ('"750 kN/m"', '"-750 kN/m"', "drive.1.stiffness = -750000: must be more than 0"),
    ('"7850 kg/m^3"', '"-1 kg/m^3"', "material.density = -1: must be more than 0"),
    (
        "poisson_ratio = 0.3",
        "poisson_ratio = 0.5",
        "material.poisson_ratio = 0.5: must be less than 0",
    ),
    (
        "friction_coefficient = 0.4",
        "friction_coefficient = 3",
        "chair.friction_coefficient = 3: must",
    ),
    ("ratio = 0.02", "ratio = -1", "damping.ratio = -1: must be at least 0"),
    ("schema_version = 1", "schema_version = 2", "schema_version = 2: must be 1"),
    (
        "shear_factor_vertical = 0.45",
        "shear_factor_vertical = 0",
        "section.prismatic.shear_factor_ver",
    ),
    ('area = "9.3e-3 m^2"', 'area = "-1 m^2"', "section.prismatic.area: must be more than 0"),
    # not finite
    (
        "poisson_ratio = 0.3",
        "poisson_ratio = nan",
        "material.poisson_ratio = nan: must be a finite",
    ),
    (
        "friction_coefficient = 0.4",
        "friction_coefficient = inf",
        "chair.friction_coefficient = inf:",
    ),
    ('"750 kN/m"', "inf", "drive.1.stiffness = inf: must be a finite number"),
    ('"750 kN/m"', '"nan kN/m"', 'drive.1.stiffness = "nan kN/m": must be a finite number'),
    (
        "shear_factor_lateral = 0.6",
        "shear_factor_lateral = [inf]",
        "section.prismatic.shear_factor_l",
    ),
    # places
    ('x = "6.9 m"', 'x = "14.5 m"', "drive.2.x = 14.5 m: is off rail 'switch', 0 ... 14 m"),
    ('x = "6.9 m"', 'x = "-1 mm"', "drive.2.x = -0.001 m: is off rail 'switch', 0 ... 14 m"),
    (
        'x = "6.9 m"',
        'x = "0.3 m"',
        "drive.2.x = 0.3 m: drive '1' is already there on rail 'switch'",
    ),
    (
        "[schedule]",
        '[chair.extra]\nx = "14.2 m"\n[schedule]',
        "chair.extra.x = 14.2 m: is off rail",
    ),
    (
        "[schedule]",
        '[chair.extra]\nx = "0.3 m"\n[schedule]',
        "chair.extra.x = 0.3 m: chair '1' is al",
    ),
    ("[schedule]", '[sleeper.17]\nx = "20 m"\n[schedule]', "sleeper.17.x = 20 m: is off the rails"),
    ('x = "3.9 m"', 'x = "39 m"', "sensor.TKK1.x = 39 m: is off rail 'switch', 0 ... 14 m"),
    ('end = "14 m"', 'end = "-2 m"', "rail.switch.end = -2 m: must be more than start, 0 m"),
    # names
    (
        'rail = "switch"\nx',
        'rail = "swich"\nx',
        'sensor.TKK1.rail = "swich": there is no such rail; n',
    ),
    (
        'instrumented_rail = "switch"',
        'instrumented_rail = "A"',
        'instrumented_rail = "A": there is n',
    ),
    (
        'section = "prismatic"',
        'section = "prism"',
        'rail.switch.section = "prism": there is no such s',
    ),
    (
        '2 = "0.2 s"',
        '3 = "0.2 s"',
        "movement.return.extra_time.3: there is no such drive; nearest is",
    ),
    (
        "[chair]",
        "[chair]\nrails = []",
        "chair.rails = []: names no rail; leave it out for all rails",
    ),
    (
        "[chair]",
        '[chair]\nrails = ["switch", "switch"]',
        'chair.rails = ["switch", "switch"]: names ',
    ),
    (
        '[object_defaults]  # source: benchmark SB1, case B\nrail = "switch"',
        '[object_defaults]\nrail = "x"',
        'object_defaults.rail = "x": there is no such rail; there are',
    ),
    (
        'closes = "+y"',
        'closes = "-y"',
        'rail.switch.closes = "-y": the instrumented rail must close',
    ),
    ('closes = "+y"', 'closes = "left"', "rail.switch.closes = \"left\": must be '+y' or '-y'"),
    # tables
    (
        'x = "0 m"\narea',
        "area",
        "section.prismatic: needs stations, either x or running_edge_offset",
    ),
    (
        'x = "0 m"\narea',
        'x = "0 m"\nrunning_edge_offset = "1 mm"\narea',
        "section.prismatic: needs st",
    ),
    (
        'x = "0 m"\narea',
        'running_edge_offset = "1 mm"\narea',
        "rail.switch.running_edge: is missing; ",
    ),
    (
        'area = "9.3e-3 m^2"',
        'area = ["1 m^2", "2 m^2"]',
        "section.prismatic.area: has 2 entries, x ha",
    ),
    ('area = "9.3e-3 m^2"', "area = []", "section.prismatic.area = []: needs at least one value"),
    (
        'area = "9.3e-3 m^2"',
        'area = "9.3e-3 m^2"\nproduct_moment = "2e-5 m^4"',
        "section.prismatic.product_moment: entry 1: its square must be less than",
    ),
    (
        '"4.85 m", "9.7 m", "14.55 m"',
        '"4.85 m", "4.85 m", "14.55 m"',
        "rail.switch.stock_rail_gap.x: must rise, but 4.85 m comes after 4.85 m",
    ),
    ('"1 mm", "30.5 mm"]', '"1 mm"]', "rail.switch.stock_rail_gap.value: has 3 entries, x has 4"),
    (
        '"1 mm", "30.5 mm"]',
        '"-1 mm", "30.5 mm"]',
        "rail.switch.stock_rail_gap.value: a gap must be a",
    ),
    # drives
    (
        'saturated_stiffness = "10 kN/m"',
        'saturated_stiffness = "760 kN/m"',
        "drive.saturated_stiffness = 760000 N/m: must not be more than stiffness, 750000 N/m",
    ),
    (
        'stroke = "120 mm"',
        'stroke = "120 mm"\nover_travel_open = "-121 mm"',
        "drive.1.over_travel_open = -0.121 m: takes away the whole stroke, 0.12 m",
    ),
    (
        'stroke = "120 mm"',
        'stroke = "120 mm"\nextension = ["0 m"]',
        "drive.1.force: is missing; the e",
    ),
    (
        'stroke = "120 mm"',
        'stroke = "120 mm"\nextension = ["0 m", "1 mm"]\nforce = ["0 N", "-1 N"]',
        "drive.1.force: must rise, but -1 N comes after 0 N",
    ),
    (
        'stroke = "120 mm"',
        'stroke = "120 mm"\nextension = ["0 m", "1 mm"]\nforce = ["1 N", "2 N"]',
        "drive.1.force: the law must pass through the origin",
    ),
    (
        'stroke = "120 mm"',
        'stroke = "120 mm"\nextension = ["0 m", "1 mm"]\nforce = ["0 N"]',
        "drive.1.force: has 1 entries, extension has 2",
    ),
    (
        "[chair]",
        '[chair]\nfoot_offsets = ["1 mm", "1 mm"]',
        "chair.foot_offsets = [0.001, 0.001]: the",
    ),
    # schedule
    (
        'start = "5 s"',
        'start = "3 s"',
        "movement.return.start = 3 s: movement 'throw' only ends at 4 s",
    ),
    (
        'to = "open"',
        'to = "closed"',
        'movement.return.to = "closed": the panel is already closed then',
    ),
    (
        'starts = "open"',
        'starts = "closed"',
        'movement.throw.to = "closed": the panel is already clos',
    ),
    ('end = "9 s"', 'end = "8.1 s"', "schedule.end = 8.1 s: movement 'return' only ends at 8.2 s"),
    (
        'end = "9 s"',
        'end = "9 s"\nloaded_by = "cycles"',
        'schedule.loaded_by = "cycles": needs loaded = true',
    ),
    (
        'end = "9 s"',
        'end = "20 s"\nloaded = true\nloaded_by = "cycles"\n[movement.again]\nstart = "10 s"\n'
        'duration = "3 s"\nto = "closed"\nshape = "linear"',
        'schedule.loaded_by = "cycles": needs a last movement to open',
    ),
    (
        '2 = "0.2 s"',
        '2 = "-3 s"',
        "movement.return.extra_time.2 = -3 s: takes away the whole duration",
    ),
    (
        'shape = "smoothstep"',
        'shape = "jump"',
        'movement.throw.shape = "jump": must be \'raised cosin',
    ),
    (
        'shape = "smoothstep"',
        'shape = "raised cosine"\nramp = "1.6 s"',
        "movement.throw.ramp = 1.6 s: must be at most half of the movement, 1.5 s",
    ),
    ('shape = "smoothstep"', 'shape = "table"', "movement.throw.table_time: is missing; shape = "),
    (
        'shape = "smoothstep"',
        'shape = "linear"\ntable_fraction = [0, 1]',
        'movement.throw.table_fraction: only for shape = "table", the shape is "linear"',
    ),
    (
        'shape = "smoothstep"',
        'shape = "table"\ntable_time = ["0 s", "3 s"]\ntable_fraction = [0, 0.9]',
        "movement.throw.table_fraction: must rise from 0 to 1, goes from 0 to 0.9",
    ),
    (
        'shape = "smoothstep"',
        'shape = "table"\ntable_time = ["0 s", "1 s", "2 s", "3 s"]\n'
        "table_fraction = [0, 0.9, 0.8, 1]",
        "movement.throw.table_fraction: must rise from 0 to 1",
    ),
    (
        'shape = "smoothstep"',
        'shape = "table"\ntable_time = ["0 s", "2 s"]\ntable_fraction = [0, 1]',
        "movement.throw.table_time: must end at the duration, 3 s, ends at 2 s",
    ),
    (
        'shape = "smoothstep"',
        'shape = "table"\ntable_time = ["1 s", "3 s"]\ntable_fraction = [0, 1]',
        "movement.throw.table_time: must start at 0 s, starts at 1 s",
    ),
    (
        'shape = "smoothstep"',
        'shape = "table"\ntable_time = ["0 s", "3 s"]\ntable_fraction = [0]',
        "movement.throw.table_fraction: has 1 entries, table_time has 2",
    ),
    (
        'shape = "smoothstep"',
        'shape = "table"\ntable_file = "none.csv"',
        "movement.throw.table_file = ",
    ),
    # the rest
    (
        'frequencies = ["20 Hz"]',
        'frequencies = ["20 Hz", "2 Hz"]',
        "damping.frequencies = [20, 2]: mu",
    ),
    (
        'frequencies = ["20 Hz"]',
        'frequencies = ["0 Hz"]',
        "damping.frequencies = [0]: every frequency",
    ),
    (
        'frequencies = ["20 Hz"]',
        "frequencies = []",
        "damping.frequencies = []: needs at least 1, has",
    ),
    (
        'element_length = "0.1 m"',
        'element_length = "1 um"',
        "discretisation.element_length = 1e-06 m:",
    ),
    ('stiffness_x = "2e7 N/m"', "", 'rail.switch.heel = "free": nothing holds the rail along x'),
    ("[sleeper]", "[sleeper]\nnames = 3", "sleeper.names = 3: must be a list of texts"),
]


@pytest.mark.parametrize(("old", "new", "problem"), SINGLE, ids=[item[2][:60] for item in SINGLE])
def test_one_fault_is_one_problem(old: str, new: str, problem: str) -> None:
    found = problems("sb1", (old, new))
    assert len(found) == 1, found
    assert found[0].startswith(problem), found[0]


OBJECTS = [
    (
        'size = "200 mm"\nat = "sleeper 6"',
        "object.stone.size = 200 mm: larger than the opening, rail",
    ),
    (
        'size = "13 mm"\nat = "sleeper 12"',
        "object.stone.at = \"sleeper 12\": there is no sleeper '12'",
    ),
    ('size = "13 mm"\nat = "x = 30 m"', 'object.stone.at = "x = 30 m": x = 30 m is not on rail'),
    (
        'size = "13 mm"\nat = "sleeper 6"\nrail = "C"',
        'object.stone.rail = "C": there is no such rail',
    ),
    ('size = 13\nat = "sleeper 6"', "object.stone.size = 13: has no unit, 13 would be 13 m"),
    ('size = "0 mm"\nat = "sleeper 6"', "object.stone.size = 0: must be more than 0"),
    ('at = "sleeper 6"', "object.stone.size: is missing"),
    ('size = "13 mm"\nat = 6', "object.stone.at = 6: must be text in quotes"),
    (
        'size = "13 mm"\nat = "drive 1"\nappears = "20 s"',
        "object.stone.appears = 20 s: is after the end",
    ),
]


@pytest.mark.parametrize(("body", "problem"), OBJECTS)
def test_objects_of_the_file(body: str, problem: str) -> None:
    found = problems("sb2", ("[schedule]", f"[object.stone]\n{body}\n[schedule]"))
    assert len(found) == 1, found
    assert found[0].startswith(problem), found[0]


def test_links_join_two_different_rails_and_two_rails_close_opposite_ways() -> None:
    assert problems("sb2", ('rails = ["A", "B"]', 'rails = ["A", "A"]')) == (
        'link.rails = ["A", "A"]: names the same rail twice',
    )
    assert problems("sb2", ('rails = ["A", "B"]', 'rails = ["A"]')) == (
        'link.rails = ["A"]: needs at least 2, has 1',
    )
    assert problems("sb2", ('closes = "-y"', 'closes = "+y"')) == (
        'rail: two rails must close opposite ways, one "+y" and one "-y"',
    )


def test_too_many_rails_and_drives_and_none() -> None:
    third = '[rail.C]\ncloses = "-y"\nstress_free = "open"\n[schedule]'
    found = problems("sb2", ("[schedule]", third))
    assert "rail: at most 2 are allowed, has 3" in found
    many = '[drive]\nx = { start = "0 m", step = "0.1 m", count = 7 }\nstroke = "1 mm"\n'
    assert "drive: at most 6 are allowed, has 7" in problems(
        "sb1", ("[drive]", many + 'stiffness = "10 kN/m"')
    )
    text = library_text("sb1")
    start, end = text.index("[drive]"), text.index("[sensor.TKK1]")
    with pytest.raises(PanelError, match="drive: needs at least 1, has 0"):
        panel_from_file(parse_toml(text[:start] + text[end:], source="x"))


def test_missing_tables_are_named_once() -> None:
    with pytest.raises(PanelError) as caught:
        panel_from_file(parse_toml("schema_version = 1\nmaterial = 3\ndrive = 4", source="x"))
    found = caught.value.problems
    assert "material = 3: must be a table" in found
    assert "drive = 4: must be a table of members" in found
    assert "schedule: is missing" in found
    assert "rail: needs at least 1, has 0" in found
    assert len(set(found)) == len(found)


@pytest.mark.parametrize(
    ("key", "place"),
    [
        ("ratio = ", "damping."),  # of a plain table
        ("normal_stiffness = ", "chair."),  # shared by a family
    ],
)
def test_a_misspelt_key_is_not_missing_as_well(key: str, place: str) -> None:
    name = key.split()[0]
    found = problems("uic60-760-1-15", (f"\n{key}", f"\n{name[:-2]}{name[-1]} = "))
    assert found[0].startswith(place)
    assert all(f"nearest is '{name}'" in problem for problem in found), found
    assert not [problem for problem in found if "missing" in problem]


def test_all_problems_of_a_file_come_at_once_in_the_order_of_its_keys() -> None:
    found = problems(
        "sb1",
        ('gravity = "9.81 m/s^2"', "gravity = 9.81"),
        ("poisson_ratio = 0.3", "poisson_ratio = nan"),
        ('"750 kN/m"', '"-750 kN/m"'),
        ('x = "0.3 m"\nstroke', 'x = "15 m"\nstroke'),
        ("[drive.1]", '[drive.1]\nmass = "1 kg"'),
        ('closes = "+y"', 'closes = "+y"\ncolour = "red"'),
        ('end = "9 s"', 'end = "8 s"'),
        ("[schedule]", '[object.stone]\nsize = "13 mm"\nat = "sleeper 99"\n[schedule]'),
    )
    assert [item.split(" ")[0].rstrip(":") for item in found] == [
        "gravity",
        "material.poisson_ratio",
        "rail.switch.colour",
        "drive.1.stiffness",
        "drive.1.mass",
        "drive.1.x",
        "schedule.end",
        "object.stone.at",
    ]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "the file is empty"),
        ("time,share\n0,0\n3,1", "must name the columns time,fraction"),
        ("time,fraction\n0,0\n3,one", "line 3: 'one' is not a number"),
        ("time,fraction\n0,0,0\n3,1", "line 2: 3 cells, must be 2"),
        ("time,fraction\n0,0\nnan,1", "finite"),
        ("time,fraction\n0,0\n3,inf", "finite"),
        ("time,fraction\n", "at least one value|needs at least"),
        ("\0", "binary file"),
    ],
)
def test_wrong_csv_schedules(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "throw.csv").write_text(content)
    path = tmp_path / "mine.toml"
    text = library_text("sb1").replace('"smoothstep"', '"table"\ntable_file = "throw.csv"', 1)
    path.write_text(text)
    with pytest.raises(PanelError, match=message) as caught:
        load_panel(path)
    assert len(caught.value.problems) == 1


def test_a_csv_beside_a_table_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    new = '"table"\ntable_file = "throw.csv"\ntable_time = ["0 s", "3 s"]\ntable_fraction = [0, 1]'
    path.write_text(library_text("sb1").replace('"smoothstep"', new, 1))
    with pytest.raises(PanelError, match="give either the file or table_time"):
        load_panel(path)


def test_the_raw_gap_needs_a_stock_rail_to_measure_from() -> None:
    text = library_text("sb1").replace('rule = "no slip"', 'rule = "raw gap"')
    start, end = text.index("[rail.switch.stock_rail_gap]"), text.index("[chair]")
    bare = text[:start] + text[end:]
    with pytest.raises(PanelError) as caught:
        panel_from_file(parse_toml(bare, source="panel.toml"))
    assert "lock.rule = \"raw gap\": rail 'switch' has no stock rail" in str(caught.value)
    assert '"no slip"' in str(caught.value)
    panel_from_file(parse_toml(text, source="panel.toml"))


@pytest.mark.parametrize("value", ["1 Pa", "210 TPa"])
def test_a_material_that_is_no_solid(value: str) -> None:
    """It would show up as a rail that nothing holds."""
    (problem,) = problems("sb1", ('"210 GPa"', f'"{value}"'))
    assert problem.startswith("material.youngs_modulus = ")
    assert ": must be at " in problem
