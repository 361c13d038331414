"""Overrides: broad and narrow keys, every family, new objects, what matches nothing."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import BaseModel

from turnout.core.errors import PanelError
from turnout.panel import load
from turnout.panel.compiled_keys import CompiledKeys
from turnout.panel.load import library_text, load_panel
from turnout.panel.model import FAMILIES, PANEL_KEYS

PANEL = load_panel("uic60-760-1-15-symmetric")


def test_a_family_key_sets_all_members_also_those_with_an_own_value() -> None:
    one = PANEL.with_overrides({"chair.5.friction_coefficient": 0.1})
    assert one.chair["5"].friction_coefficient == 0.1
    assert one.chair["4"].friction_coefficient == 0.4
    every = one.with_overrides({"chair.friction_coefficient": 0.3})
    assert {chair.friction_coefficient for chair in every.chair.values()} == {0.3}
    assert dict(every.overrides) == {"chair.friction_coefficient": 0.3}
    assert {
        drive.stroke for drive in PANEL.with_overrides({"drive.stroke": 0.1}).drive.values()
    } == {0.1}


def test_narrow_keys_win_over_broad_ones_in_either_order() -> None:
    narrow, broad = ("chair.5.friction_coefficient", 0.1), ("chair.friction_coefficient", 0.3)
    for items in ([narrow, broad], [broad, narrow]):
        panel = PANEL.with_overrides(dict(items))
        assert panel.chair["5"].friction_coefficient == 0.1
        assert panel.chair["6"].friction_coefficient == 0.3
    assert PANEL.chair["5"].friction_coefficient == 0.4


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("drive.2.stiffness", "81 kN/m", 81e3),
        ("drive.2.stiffness", 81_000, 81e3),
        ("drive.2.stiffness", np.float64(81e3), 81e3),
        ("drive.1.saturation_force", "5 kN", 5e3),
        ("stud.3.clearance", 0.002, 0.002),
        ("stop.stiffness", "1e8 N/m", 1e8),
        ("link.1.stiffness", 0.0001, 0.0001),
        ("fastening.stiffness_z", "60 kN/mm", 60e6),
        ("sensor.TKK1.limit", "10 mm", 0.01),
        ("sleeper.6.x", "3.7 m", 3.7),
        ("movement.return.start", 4.5, 4.5),
        ("movement.return.extra_time.2", 0.1, 0.1),
        ("movement.throw.extra_time.1", "0.1 s", 0.1),
        ("schedule.end", "9 s", 9.0),
        ("lock.rule", "raw gap", "raw gap"),
        ("material.density", "7800 kg/m^3", 7800.0),
        ("rail.end", "18.7 m", 18.7),
        ("rail.curved.running_edge.radius", 300.0, 300.0),
        ("rail.curved.fit_gap.interpolation", "linear", "linear"),
        ("rail.curved.fit_gap", "5 mm", 0.005),
        ("section.tongue.torsion_constant", [1e-6] * 13, (1e-6,) * 13),
        ("section.tongue.product_moment", np.zeros(13), (0.0,) * 13),
        ("rail.curved.fit_gap", None, None),
        ("damping.frequencies", [1.0, 10], [1.0, 10.0]),
        ("name", "mine", "mine"),
    ],
)
def test_every_kind_of_key_can_be_set(key: str, value: object, expected: object) -> None:
    panel = PANEL.with_overrides({key: value})
    node: object = panel
    parts = key.split(".")
    if parts[0] in FAMILIES and parts[1] in FAMILIES[parts[0]].model_fields:
        parts.insert(1, next(iter(getattr(panel, parts[0]))))
    for part in parts:
        node = node[part] if isinstance(node, dict) else getattr(node, part)
    assert node == expected
    assert panel.hash != PANEL.hash
    assert panel.origins[".".join(parts)].kind == "override"


def test_an_object_may_be_added_key_by_key_or_as_a_table() -> None:
    keys = PANEL.with_settings(["object.stone.size=13 mm", "object.stone.at=sleeper 6"])
    table = PANEL.with_overrides({"object.stone": {"size": 0.013, "at": "sleeper 6"}})
    assert keys.object == table.object
    assert keys.hash == table.hash
    two = keys.with_overrides({"object": {"ice": {"size": "5 mm", "at": "drive 1"}}})
    assert list(two.object) == ["stone", "ice"]


@pytest.mark.parametrize(
    ("key", "near"),
    [
        ("chair.friction", "chair.friction_coefficient"),
        ("drive.3.stiffness", "drive.2.stiffness"),
        ("drive.1.stifness", "drive.1.stiffness"),
        ("chair.26.friction_coefficient", "chair.[0-9]+.friction_coefficient"),
        ("drive.1", "drive.1.x"),
        ("drive", "drive.x"),
        ("schedule.start", "schedule.starts"),
        ("lock.rule.x", "lock.rule"),
        ("object.size", "object"),
        ("rail.curved.running_edge.radios", "rail.curved.running_edge.radius"),
        ("Name", "name"),
    ],
)
def test_a_key_that_matches_nothing_names_the_nearest(key: str, near: str) -> None:
    with pytest.raises(PanelError, match=f"{key}: matches nothing in this panel; nearest is"):
        PANEL.with_overrides({key: 1.0})
    if key != "object.size":
        with pytest.raises(PanelError, match=f"nearest is '{near}"):
            PANEL.with_overrides({key: 1.0})


def test_schema_version_and_empty_families_cannot_be_set() -> None:
    with pytest.raises(PanelError, match="matches nothing"):
        PANEL.with_overrides({"schema_version": 1})
    with pytest.raises(PanelError, match="matches nothing"):
        load_panel("sb1").with_overrides({"stud.clearance": 0.001})


def test_known_keys_are_accepted_as_keys() -> None:
    keys = set(PANEL_KEYS.names({"chair": {"5": {}}}))
    assert {"chair.friction_coefficient", "chair.5.x", "lock.rule", "gravity"} <= keys
    assert "schema_version" not in keys


def test_the_old_panel_is_not_changed() -> None:
    before = PANEL.hash, dict(PANEL.origins)
    PANEL.with_overrides({"drive.1.stiffness": 1e5, "chair.friction_coefficient": 0.1})
    assert (PANEL.hash, dict(PANEL.origins)) == before
    assert load_panel("uic60-760-1-15-symmetric").hash == before[0]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a.b=13 mm", ("a.b", "13 mm")),
        ('a.b = "13 mm"', ("a.b", "13 mm")),
        ("a=0.3", ("a", 0.3)),
        ("a=[1, 2]", ("a", [1, 2])),
        ('a=["1 m", "2 m"]', ("a", ["1 m", "2 m"])),
        ('a={unit="mm", values=[1]}', ("a", {"unit": "mm", "values": [1]})),
        ("a=no slip", ("a", "no slip")),
        ("a=x = 3.6 m", ("a", "x = 3.6 m")),
        ("a=", ("a", "")),
        ("outline_section.stock.outline=60E1", ("outline_section.stock.outline", "60E1")),
        ('rail.section="60E1"', ("rail.section", "60E1")),
        ("rail.straight.matrices=1e3", ("rail.straight.matrices", "1e3")),
        ("drive.1.stroke=1", ("drive.1.stroke", 1)),
    ],
)
def test_settings_of_a_command_line(text: str, expected: tuple[str, object]) -> None:
    assert PANEL_KEYS.setting(text) == expected


@pytest.mark.parametrize("text", ["a", "=3", " = 3"])
def test_settings_without_key_or_value(text: str) -> None:
    with pytest.raises(ValueError, match="is not KEY=VALUE"):
        PANEL_KEYS.setting(text)


def test_bare_numbers_are_si_from_python_and_refused_as_text() -> None:
    assert PANEL.with_overrides({"drive.1.stroke": 0.1}).drive["1"].stroke == 0.1
    with pytest.raises(PanelError, match=r"drive.1.stroke = 0.1: has no unit, 0.1 would be 0.1 m"):
        PANEL.with_settings(["drive.1.stroke=0.1"])
    with pytest.raises(PanelError, match="has no unit"):
        PANEL.with_overrides({"drive.1.stroke": 0.1}, si=False)
    assert PANEL.with_settings(["chair.friction_coefficient=0.1"]).chair["1"].friction_coefficient


def test_all_problems_of_overrides_come_at_once() -> None:
    with pytest.raises(PanelError) as caught:
        PANEL.with_settings(["nonsense", "drive.9.x=1 m", "drive.1.x=99 m", "gravity=9.81"])
    assert len(caught.value.problems) == 4
    assert caught.value.source == "overrides"


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("drive.height", "20 m", "at most 1"),
        ("fastening.offset", "-9 m", "at least -1"),
        ("rail.straight.curve_radius", "10 m", "at least 20"),
    ],
)
def test_what_no_rail_measures_is_refused(key: str, value: str, message: str) -> None:
    with pytest.raises(PanelError, match=rf"{key.split('.')[-1]}.*{message}"):
        PANEL.with_overrides({key: value})


def test_overrides_of_a_file_are_set_before_it_is_checked(tmp_path: Path) -> None:
    path = tmp_path / "far.toml"
    text = library_text("sb1")
    path.write_text(text.replace("[drive.1]", '[drive.1]\nover_travel_open = "-9 m"', 1))
    with pytest.raises(PanelError, match="over_travel_open"):
        load_panel(path)
    panel = load_panel(path, overrides={"drive.1.over_travel_open": 0.0})
    assert panel.hash == load_panel("sb1", overrides={"drive.1.over_travel_open": 0.0}).hash
    assert panel.overrides == {"drive.1.over_travel_open": 0.0}
    with pytest.raises(PanelError, match="nonsense") as caught:
        load_panel(path, overrides={"nonsense": 1})
    assert len(caught.value.problems) == 2


def test_members_that_are_left_alone_keep_their_records_and_their_checks() -> None:
    """What an override does not touch is not read again, yet held against what it changes."""
    panel = load_panel("uic60-760-1-15")
    changed = panel.with_overrides({"drive.2.stiffness": 81e3, "gravity": 9.0})
    assert changed.chair["1"] is panel.chair["1"]
    assert changed.drive["1"] is panel.drive["1"]
    assert changed.drive["2"].stiffness == 81e3
    assert changed.material is panel.material
    assert changed.hash != panel.hash
    back = changed.with_overrides(
        {"drive.2.stiffness": panel.drive["2"].stiffness, "gravity": panel.gravity}
    )
    assert back.hash == panel.hash
    with pytest.raises(PanelError, match=r"drive\.1\.x|rail"):
        changed.with_overrides({"rail.A.end": 0.5})


@pytest.mark.parametrize(
    "changes",
    [
        {"chair.3.x": PANEL.chair["4"].x},
        {"chair.foot_offsets": [0.01, 0.01]},
        {"drive.saturated_stiffness": 1e9, "drive.1.stroke": -1.0},
        {"rail.straight.end": 0.5},
        {"rail.curved.closes": "+y"},
        {"instrumented_rail": "neither"},
        {"movement.return.start": 0.1, "movement.throw.extra_time": {"9": 0.1}},
        {"stock_rail.curved.faces": "curved"},
        {"discretisation.element_length": 1e-5},
        {"damping.frequencies": [50.0, 5.0], "lock.rule": "no slip"},
        {"object.a": {"size": 0.5, "at": "sleeper 6"}, "object_defaults.rail": "neither"},
        {"sensor.rail": "neither", "link.1.rails": ["straight"], "fastening.stiffness_x": 0.0},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_checks_that_are_spared_would_have_found_nothing(
    changes: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A panel made from a valid one is refused for the same as if all of it were read again."""

    def problems(panel: load.LoadedPanel) -> list[str]:
        try:
            panel.with_overrides(changes)
        except PanelError as error:
            return list(error.problems)
        return []

    panel = load_panel("uic60-760-1-15").with_overrides({"chair.friction_coefficient": 0.2})
    near = panel.with_overrides({"drive.2.stiffness": 6e5})
    found = problems(near)
    monkeypatch.setattr(CompiledKeys, "derive", lambda *given: None)
    assert found == problems(near)
    assert found


# The parts of a machine are right only together: it is checked, and taken over, as a whole.
SIMPLE = [record for record in FAMILIES.values() if record.__name__ != "Machine"]


@pytest.mark.parametrize("record", SIMPLE, ids=lambda record: record.__name__)
def test_fields_of_members_are_valid_each_by_itself(record: type[BaseModel]) -> None:
    """A member takes over a value that was read for another one; checks between come later."""
    found = record.__pydantic_decorators__
    assert not found.model_validators
    assert not found.root_validators
    assert not found.field_validators


def test_a_value_of_a_family_is_read_for_each_member_that_had_an_own_one() -> None:
    own = PANEL.with_overrides({"chair.5.friction_coefficient": 0.1, "chair.5.clearance": "1 mm"})
    every = own.with_overrides({"chair.friction_coefficient": 0.3}, si=False)
    assert {chair.friction_coefficient for chair in every.chair.values()} == {0.3}
    assert every.chair["5"].clearance == 0.001
    assert every.chair["4"].clearance == PANEL.chair["4"].clearance
    assert every.hash == load_panel(PANEL.source).with_overrides(dict(every.overrides)).hash


def test_a_key_of_machines_that_the_panel_has_not_yet() -> None:
    changes = {"drive.1.machine": "jea73", "machine.supply.shared_resistance": 2.0}
    with pytest.raises(PanelError, match=r"no machine before these overrides.*machine\.NAME\."):
        load_panel("sb1", overrides=changes)


@pytest.mark.parametrize("key", ["motor.resistence", "motr.resistance"])
def test_a_misspelt_key_of_a_machine_is_answered_by_the_nearest(key: str) -> None:
    """Also where the machine comes with these overrides."""
    changes = {"drive.1.machine": "jea73", f"machine.jea73.{key}": 2.0}
    near = r"machine\.jea73\.mot.*: matches nothing in this panel; nearest is "
    with pytest.raises(PanelError, match=near + r"'machine\.jea73\.motor\.resistance'"):
        load_panel("sb1", overrides=changes)


def test_the_same_keys_with_other_values_change_a_panel_alike(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Places of keys are looked for once; broad, narrow and repeated keys, and later overrides."""
    before = PANEL.with_overrides({"drive.1.stiffness": 8e5, "stop.stiffness": 2e8})
    first = {
        "chair.7.friction_coefficient": 0.2,
        "chair.friction_coefficient": 0.25,
        "drive.1.stiffness": "90 kN/m",
        "chair.8.normal_stiffness": 2e7,
    }
    second = {**dict.fromkeys(first, 0.35), "drive.1.stiffness": 9.5e5}
    second["chair.8.normal_stiffness"] = 3e7
    before.with_overrides(first)
    again = before.with_overrides(second)
    with monkeypatch.context() as patch:
        patch.setattr(CompiledKeys, "derive", lambda *given: None)
        fresh = before.with_overrides(second)
    assert again == fresh
    assert again.hash == fresh.hash
    assert list(again.overrides.items()) == list(fresh.overrides.items())
    for name in ("tree", "shared", "given"):
        mine, others = getattr(again.document, name), getattr(fresh.document, name)
        assert mine == others, name
    assert list(again.document.given) == list(fresh.document.given)
    assert before.chair["7"].friction_coefficient == 0.4
    with pytest.raises(PanelError, match="friction_coefficient"):
        before.with_overrides({**second, "chair.friction_coefficient": -1.0})
    assert before.chair["7"].friction_coefficient == 0.4
