"""Keys of panels and machine files: what each names, and where it leads."""

import math

import pytest

from turnout.core.errors import PanelError
from turnout.core.keys import Key
from turnout.core.units import LENGTH, STIFFNESS
from turnout.machine.components import MACHINE_KEYS
from turnout.machine.machine_file import load_machines
from turnout.panel.load import load_panel
from turnout.panel.model import PANEL_KEYS

PANEL = load_panel("sb1")


def key(name: str) -> Key:
    found = PANEL_KEYS.find(name)
    assert found is not None
    return found


def test_a_key_says_unit_kind_bounds_default_and_range() -> None:
    found = key("drive.2.stiffness")
    assert (found.family, found.member, found.below) == ("drive", "2", ("stiffness",))
    assert (found.unit, found.kind, found.default) == ("N/m", STIFFNESS, "required")
    assert found.bounds == (0.0, 1e12)
    assert found.allowed == "more than 0, at most 1e+12"
    assert found.meaning == "bushing below saturation"
    assert key("lock.rule").kind is str
    assert key("schedule.loaded").kind is bool
    assert key("chair.friction_coefficient").kind is float
    assert key("drive.over_travel_open").bounds == (-math.inf, math.inf)
    assert key("rail.fit_gap.value").dimension is LENGTH
    assert key("object_defaults.appears").default == "onset of the last closing"


def test_an_item_of_a_list_has_a_key_but_no_place_to_set() -> None:
    found = key("chair.5.friction_factor.2")
    assert (found.item, found.whole, found.kind) == (2, "chair.5.friction_factor", float)
    assert PANEL_KEYS.places({"chair": {"5": {}}}, found.name) == []
    changed = PANEL.with_overrides(
        {"chair.friction_factor": [1.0, 0.5], "chair.friction_opening": ["0 mm", "50 mm"]}
    )
    first = next(iter(changed.chair))
    name = f"chair.{first}.friction_factor.2"
    assert changed.values_at(name) == {name: 0.5}


@pytest.mark.parametrize(
    "name", ["drive", "drive.1", "nothing", "drive.1.stiffness.x", "lock.rule.x", "chair..x"]
)
def test_what_is_no_key(name: str) -> None:
    assert PANEL_KEYS.find(name) is None or not PANEL_KEYS.places({"drive": {"1": {}}}, name)
    with pytest.raises(PanelError, match=r"matches nothing in this panel; nearest is"):
        PANEL.values_at(name)


def test_a_value_that_a_panel_lacks() -> None:
    with pytest.raises(PanelError, match=r"chair.friction_factor.1: has no value in this panel"):
        PANEL.values_at("chair.friction_factor.1")
    with pytest.raises(PanelError, match=r"drive.7.stiffness: matches nothing.*drive.2.stiffness"):
        PANEL.values_at("drive.7.stiffness")


def test_keys_of_machines_may_leave_the_family_out() -> None:
    machines = load_machines("sb3")
    short, whole = (MACHINE_KEYS.find(f"{start}motor.voltage") for start in ("", "machine."))
    assert short is not None
    assert whole is not None
    assert (short.family, short.below, short.unit) == (whole.family, whole.below, "V")
    assert MACHINE_KEYS.values(machines, "motor.voltage") == {"machine.sb3.motor.voltage": 220.0}
    tree = {"machine": {"a": {}, "b": {}}}
    assert MACHINE_KEYS.places(tree, "gear.efficiency") == [
        ("machine", name, "gear", "efficiency") for name in tree["machine"]
    ]
    assert MACHINE_KEYS.places(tree, "rail.mass") == [("rail", "mass")]
    assert MACHINE_KEYS.places(tree, "throw.command.0.time") == [("throw", "command", "0", "time")]
