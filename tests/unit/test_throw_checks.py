"""Checks of a throw: values against their limits, and lamps, which are checks at instants."""

import json

import numpy as np
import pytest
import xarray as xr
from tests.unit.simulated import sb1_panel, sb2_dataset

from turnout.metric.key_figure import key_figures
from turnout.metric.summary import summary, wheel_texts
from turnout.throw.checks import Check, checks, lamps, margins
from turnout.throw.simulate import simulate


def small(**attributes: object) -> xr.Dataset:
    spans = [
        {"name": "out", "to": "open", "start": 1.0, "end": 2.0},
        {"name": "back", "to": "closed", "start": 3.0, "end": 4.0},
    ]
    return xr.Dataset(
        {
            "locked": ("time", [True, False, True, False, True]),
            "in_control": (("sensor", "time"), [[True, False, False, False, True]]),
            "drive_slipping": (("drive", "time"), [[False, False, False, True, True]]),
            "sensor_gap": (("sensor", "time"), [[0.001, 0.05, 0.1, 0.05, 0.002]]),
        },
        {
            "time": [0.5, 1.5, 2.5, 3.5, 4.0],
            "sensor": ["TKK1"],
            "sensor_limit": ("sensor", [0.013]),
            "drive": ["1"],
            "saturation_force": ("drive", [6000.0]),
        },
        {"movements": json.dumps(spans), "lock_rule": "no slip", **attributes},
    )


def test_each_lamp_has_its_rule() -> None:
    assert [(lamp.kind, lamp.name, lamp.rule) for lamp in lamps(small())] == [
        ("lock", "switch", "no drive is at its saturation force, and no movement is under way"),
        ("control", "TKK1", "its gap is below 13 mm"),
        ("slip", "drive 1", "its force has reached 6 kN"),
    ]


def test_the_rule_of_gaps_names_its_limit() -> None:
    rule = lamps(small(lock_rule="raw gap", lock_gap_limit=0.005))[0].rule
    assert rule == "the gap at every drive is below 5 mm, and no movement is under way"
    limits = '{"1": 0.005, "2": 0.004}'
    own = small(lock_rule="slip or gap", lock_gap_limit=0.005, lock_gap_limits=limits)
    assert lamps(own)[0].rule == (
        "no drive is at its saturation force, the gap at every drive is below 5 mm at drive 1 and "
        "4 mm at drive 2, and no movement is under way"
    )


def test_a_moving_or_open_switch_is_not_judged() -> None:
    judged = [[check.met is not None for check in lamp.checks] for lamp in lamps(small())]
    lock, control, slip = judged
    assert lock == [True, False, True, False, True]
    assert control == [True, False, False, False, True]
    assert all(slip)


def test_lamps_of_a_run_are_its_channels() -> None:
    run = sb2_dataset()
    by_name = {lamp.name: lamp.on for lamp in lamps(run)}
    np.testing.assert_array_equal(by_name["switch"], run["locked"].values)
    np.testing.assert_array_equal(by_name["TKK1"], run["in_control"].sel(sensor="TKK1").values)


def test_key_figures_are_those_of_the_run() -> None:
    run = sb2_dataset()
    found = {item.key: item for item in key_figures(run)}
    assert found["end_force:2"].value == float(run["drive_force"].sel(drive="2")[-1])
    assert found["object_peak"].value == float(run["object_force"].max())
    assert found["sensor_gap:TKK1"].unit == "m"
    assert found["contact_time"].value == pytest.approx(float(run["contact_time"]), rel=0)
    alone = run.assign_attrs(foreign_objects="[]")
    assert "object_peak" not in {item.key for item in key_figures(alone)}


def test_state_and_number_of_a_lamp_are_of_one_instant() -> None:
    """The drive slips at 6.43 kN, red with this number, and then holds with 1 kN."""
    run = small(lock_rule="slip or gap", lock_gap_limit=0.005)
    run["drive_force"] = (("drive", "time"), [[0.0, 0.0, 0.0, 6430.0, 1000.0]])
    run["drive_gap"] = (("drive", "time"), [[0.0, 0.0, 0.0, 0.0, 0.00439]])
    run["drive_slipping"][0, -1] = False
    lock, _, slip = lamps(run, [3, 4])
    assert [(check.met, check.numbers, check.left) for check in slip.checks] == [
        (False, "6.43 of 6 kN", "0.43 over"),
        (True, "1.00 of 6 kN", "5.00 left"),
    ]
    assert (lock.checks[1].criterion, lock.checks[1].said) == ("gap", "Drive 1 gap 4.39 of 5 mm")
    run["locked"][-1], run["drive_slipping"][0, -1] = False, True
    (refused,) = lamps(run, [4])[0].checks
    assert (refused.met, refused.criterion) == (False, "slip"), (
        "not the gap, which is below its limit"
    )


def test_each_limit_is_that_of_the_dataset() -> None:
    run = sb2_dataset()
    found = {item.key: item for item in checks(run)}
    for name in run["sensor"].values:
        check = found[f"control:{name}:return"]
        assert check.value == float(run["sensor_gap"].sel(sensor=name)[-1])
        assert check.limit == float(run["sensor_limit"].sel(sensor=name))
        assert check.met == bool(run["in_control"].isel(time=-1).sel(sensor=name))
    for item in margins(found.values()):
        direction = "closing" if item.movement and item.movement.to == "closed" else "opening"
        kept = float(run["force_margin"].sel(drive=item.drive, direction=direction))
        assert item.margin == pytest.approx(kept, rel=1e-9)


def test_a_drive_that_slipped_or_was_switched_off_has_no_margin() -> None:
    """The force at which a clutch slips may be below its nominal level."""
    run = small(machine_supplies='{"1": {}}')
    run["drive_force"] = (("drive", "time"), [[0.0, -2e3, -1e3, 5e3, 5e3]])
    run["force_margin"] = (("drive", "direction"), [[4e3, 1e3]])
    run = run.assign_coords(direction=["opening", "closing"])
    lines = [text for heading, text in summary(run) if heading == "drive 1"]
    assert "margin to slip 4.00 kN opening, none left closing" in lines[0]
    figures = {item.key: item.value for item in key_figures(run)}
    assert (figures["margin:1:opening"], figures["margin:1:closing"]) == (4e3, 0.0)
    off = {"drive": "1", "to": "closed", "on": 3.0, "off": 3.5, "rest": 3.5, "outcome": "overload"}
    stopped = run.assign_attrs(machine_throws=json.dumps([{**off, "machine": "jea73"}]))
    keys = [item.key for item in key_figures(stopped) if item.key.startswith("margin")]
    assert keys == ["margin:1:opening"]


def test_a_limit_itself_fails_for_a_gap_and_passes_for_the_flangeway() -> None:
    run = xr.Dataset({"least_flangeway": 0.058}, attrs={"flangeway_limit": 0.058})
    assert checks(run)[0].met
    narrow = checks(run.assign(least_flangeway=0.05))[0]
    assert (narrow.met, narrow.numbers, narrow.left) == (False, "50.00 of min 58 mm", "8.00 short")
    at_limit = small(lock_rule="raw gap", lock_gap_limit=0.005)
    at_limit["drive_gap"] = (("drive", "time"), [[0.0, 0.0, 0.0, 0.0, 0.005]])
    at_limit["locked"][-1] = False
    lock = [item for item in checks(at_limit) if item.kind == "lock"][-1]
    assert (lock.criterion, lock.left) == ("gap", "0.00 over")


def test_gauge_names_its_place_and_passes_at_its_limit() -> None:
    run = xr.Dataset(
        {"least_gauge": 1.4268, "least_gauge_place": "sleeper 6"}, attrs={"gauge_limit": 1.427}
    )
    (narrow,) = checks(run)
    assert (narrow.met, narrow.key, narrow.left) == (False, "gauge:gauge", "0.20 short")
    assert narrow.text == "the closed rail narrows the gauge to 1426.8 mm at sleeper 6 (limit 1427)"
    (wide,) = checks(run.assign(least_gauge=1.427))
    assert (wide.met, wide.text) == (True, "the gauge is 1427.0 mm at sleeper 6 (limit 1427)")
    assert checks(run.drop_attrs()) == []


def test_a_gauge_of_a_line_speed_names_it_and_the_speed_that_it_allows() -> None:
    run = xr.Dataset(
        {"least_gauge": 1.4268, "least_gauge_place": "sleeper 6"},
        attrs={"gauge_limit": 1.427, "gauge_nominal": 1.435, "gauge_line_speed": 160 / 3.6},
    )
    (narrow,) = checks(run)
    assert narrow.text.endswith("to 1426.8 mm at sleeper 6 (limit 1427 mm at 160 km/h)")
    text = wheel_texts(run)["gauge"]
    assert text.endswith(
        "1427 mm required at 160 km/h; allowed up to 120 km/h by the limits of immediate action"
    )
    own = run.assign_attrs(gauge_classes="[[20.0, 0.008]]")
    assert wheel_texts(own)["gauge"].endswith("; allowed at no speed by the limits of the panel")


def test_a_gap_below_zero_is_closed() -> None:
    check = Check(kind="lock", name="switch", criterion="gap", met=True, value=-2e-4, limit=5e-3)
    assert (check.numbers, check.margin) == ("closed, limit 5 mm", 5.2e-3)


def test_gaps_of_drives_do_not_decide_where_the_lock_rule_ignores_them() -> None:
    assert {item.criterion for item in checks(sb2_dataset()) if item.kind == "lock"} == {"slip"}


def test_of_a_pair_the_contact_on_the_closed_rail_is_asked() -> None:
    """The pair is asked after each movement, a contact after that in which its rail closes."""
    asked = [
        item.key
        for item in checks(sb2_dataset().assign_attrs(sensor_rails="{}"))
        if item.name == "TKK1"
    ]
    assert asked == ["control:TKK1:throw", "control:TKK1:return"]
    alone = sb2_dataset().assign_attrs(sensor_rails='{"TKK1": "A", "TKK2": "B"}')
    single = [item.key for item in checks(alone) if item.kind == "control"]
    assert single == ["control:TKK2:throw", "control:TKK1:return"]


def test_a_sensor_that_names_no_rail_is_asked_on_the_only_one() -> None:
    run = simulate(sb1_panel().with_overrides({"sensor.TKK1.rail": None}), mode="quick")
    directions = {check.movement.to for check in checks(run) if check.kind == "control"}
    assert directions == {"closed"}


@pytest.mark.parametrize(("rails", "decided"), [("A", "slip"), ("AB", "gap")])
def test_the_gap_of_a_single_open_rail_does_not_decide(rails: str, decided: str) -> None:
    """At 2.5 s the drive slips with a gap of 120 mm."""
    run = small(lock_rule="raw gap", lock_gap_limit=0.005).assign_coords(rail=list(rails))
    run["drive_force"] = (("drive", "time"), [[0.0, 0.0, 6100.0, 0.0, 0.0]])
    run["drive_gap"] = (("drive", "time"), [[0.0, 0.0, 0.12, 0.0, 0.0]])
    run["locked"][2], run["drive_slipping"][0, 2] = False, True
    found = {item.key: item for item in checks(run)}["lock:switch:out"]
    assert (found.met, found.criterion) == (False, decided)


def test_a_drive_of_which_no_margin_is_known_is_named_last() -> None:
    run = small(lock_rule="slip or gap", lock_gap_limit=0.005).isel(drive=[0, 0])
    run = run.assign_coords(drive=["1", "2"], saturation_force=("drive", [np.nan, 6000.0]))
    run["drive_force"] = (("drive", "time"), np.full((2, 5), 6100.0))
    run["drive_gap"] = (("drive", "time"), np.zeros((2, 5)))
    run["locked"][-1] = False
    found = {item.key: item for item in checks(run)}["lock:switch:back"]
    assert (found.criterion, found.drive) == ("slip", "2")


def test_what_was_not_kept_is_left_out() -> None:
    assert checks(xr.Dataset()) == []
    assert checks(xr.Dataset({"least_flangeway": 0.06})) == []
