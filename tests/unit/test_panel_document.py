"""Families: defaults, generators, members, and the origin of each value."""

import pytest

from turnout.core.errors import PanelError
from turnout.core.toml import Origin, parse_toml
from turnout.panel.document import expand
from turnout.panel.load import LoadedPanel, library_text, panel_from_file
from turnout.panel.model import FAMILIES

FAMILY_NAMES = (
    "outline", "section", "outline_section", "planed_section", "rail", "stock_rail",
    "stock_fastening", "chair", "fastening", "stop", "stud",
    "drive", "machine",
    "link", "back_drive", "sensor", "sleeper", "movement", "object",
)  # fmt: skip


def tree(text: str) -> dict[str, dict[str, dict[str, object]]]:
    return expand(parse_toml(text, source="text")).tree


def panel(*changes: tuple[str, str]) -> LoadedPanel:
    text = library_text("sb1")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return panel_from_file(parse_toml(text, source="sb1"))


def test_families_are_those_of_the_panel() -> None:
    assert tuple(FAMILIES) == FAMILY_NAMES


@pytest.mark.parametrize("family", FAMILY_NAMES)
def test_a_default_reaches_every_member_that_has_no_own_value(family: str) -> None:
    field = next(iter(FAMILIES[family].model_fields))
    text = f'[{family}]\n{field} = "1 m"\n[{family}.a]\n[{family}.b]\n{field} = "2 m"\n'
    members = tree(text)[family]
    assert {name: member[field] for name, member in members.items()} == {"a": "1 m", "b": "2 m"}


def test_generators_number_or_name_their_members() -> None:
    numbered = tree('[chair]\nx = { start = "1 m", step = "0.5 m", count = 3 }')["chair"]
    assert {name: member["x"] for name, member in numbered.items()} == {"1": 1.0, "2": 1.5, "3": 2}
    named = tree('[stud]\nx = ["9 m", "10 m"]\nnames = ["front", "rear"]')["stud"]
    assert {name: member["x"] for name, member in named.items()} == {"front": 9.0, "rear": 10.0}


def test_a_single_place_is_a_member_where_there_is_no_other() -> None:
    """It was a default of no member, so that the family was left out without a word."""
    alone = tree('[stud]\nx = "9 m"\nheight = "0.1 m"')["stud"]
    assert alone == tree('[stud]\nx = ["9 m"]\nheight = "0.1 m"')["stud"]
    shared = tree('[stud]\nx = "9 m"\n[stud.rear]\nheight = "0.1 m"')["stud"]
    assert list(shared) == ["rear"]


def test_a_member_overrides_or_joins_a_generated_family() -> None:
    text = library_text("sb1") + '\n[chair.5]\nclearance = "1 mm"\n[chair.extra]\nx = "9.5 m"\n'
    changed = panel_from_file(parse_toml(text, source="sb1"))
    assert changed.chair["5"].clearance == 0.001
    assert changed.chair["5"].x == pytest.approx(2.7, abs=1e-12)
    assert changed.chair["4"].clearance == 0.0
    assert list(changed.chair)[-1] == "extra"
    assert changed.chair["extra"].friction_coefficient == 0.4


def test_origin_of_a_value_is_the_nearest_comment() -> None:
    text = (
        "[drive] # source: family\n"
        'height = "1 m" # paper: default\n'
        'stroke = "2 m"\n'
        "[drive.1] # assumption: member\n"
        'x = "3 m"\n'
        "[drive.2]\n"
        'x = "4 m" # computed: own\n'
        "[rail.A.stock_rail_gap]  # computed: all\n"
        'x = ["0 m", "1 m"]\n'
        'value = ["0 m",\n "1 m", # paper: second\n]\n'
    )
    origins = expand(parse_toml(text, source="text")).origins
    assert origins == {
        "drive.1.height": Origin("paper", "default"),
        "drive.1.stroke": Origin("source", "family"),
        "drive.1.x": Origin("assumption", "member"),
        "drive.2.height": Origin("paper", "default"),
        "drive.2.stroke": Origin("source", "family"),
        "drive.2.x": Origin("computed", "own"),
        "rail.A.stock_rail_gap.x": Origin("computed", "all"),
        "rail.A.stock_rail_gap.value": Origin("computed", "all"),
        "rail.A.stock_rail_gap.value.1": Origin("paper", "second"),
    }


def test_an_error_in_a_default_is_reported_once_at_the_family() -> None:
    with pytest.raises(PanelError) as caught:
        panel(('normal_stiffness = "1e8 N/m"', 'normal_stiffness = "-1e8 N/m"'))
    assert caught.value.problems == ("chair.normal_stiffness = -1e+08: must be more than 0",)


def test_a_value_that_every_member_lacks_is_reported_once() -> None:
    with pytest.raises(PanelError) as caught:
        panel(("friction_coefficient = 0.4\n", ""), ('stiffness = "810 kN/m"', ""))
    assert caught.value.problems == (
        "chair.friction_coefficient: is missing (in every chair)",
        "drive.2.stiffness: is missing",
    )


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ('[chair]\nx = ["1 m"]\nnames = ["a", "b"]', "2 names for 1 positions"),
        ('[chair]\nx = ["1 m", "2 m"]\nnames = ["a", "a"]', "the same name twice"),
        ('[chair]\nx = ["1 m"]\nnames = "a"', "must be a list of texts"),
        ('[chair]\nnames = ["a"]', "needs a generator"),
        ('[chair]\nx = ["1 kN"]', "chair.x = .*unit of force"),
        ('[chair]\nx = { start = "1 m", count = 3 }', "got a table with count, start"),
        ("[chair]\nfriction = 0.4", "unknown key; nearest is 'friction_coefficient'"),
        ('[chair."a.b"]\nx = "1 m"', "may not be empty or contain a dot"),
    ],
)
def test_wrong_families_are_described(text: str, problem: str) -> None:
    problems = expand(parse_toml(text, source="text")).problems
    assert len(problems) == 1
    with pytest.raises(ValueError, match=problem):
        raise ValueError(str(problems[0]))
