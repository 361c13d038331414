"""The verdict on a throw, on a run whose states are set by hand."""

import json

import numpy as np
import pytest
import xarray as xr
from tests.unit.simulated import sb1_dataset, sb2_dataset
from tests.unit.test_throw_simulate import interrupted

from turnout.metric.finding import findings
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.throw.checks import Check, checks, lamps
from turnout.throw.simulate import simulate
from turnout.throw.verdict import KINDS, accepted_by, verdict


def run_with(
    *,
    trapped: bool = True,
    slips: str = "",
    locked: bool = True,
    control: bool = True,
    gap: float = 0.002,
    flangeway: float = 0.06,
) -> xr.Dataset:
    """Return a throw of sb2 with its states at the end replaced, judged by "slip or gap"."""
    dataset = sb2_dataset().copy(deep=True)
    if slips:
        late = dataset["time"].values >= 7.5
        dataset["drive_slipping"].loc[{"drive": slips}] = late
    dataset["locked"].values[-1] = locked
    dataset["in_control"].values[:, -1] = control
    dataset["drive_gap"].values[:, -1] = np.array([gap, 0.001])
    dataset["least_flangeway"] = ((), flangeway)
    dataset.attrs["lock_rule"] = "slip or gap"
    if not trapped:
        dataset.attrs["foreign_objects"] = "[]"
    return dataset


@pytest.mark.parametrize(
    ("states", "kind", "words"),
    [
        (
            {},
            "undetected object",
            "13 mm at sleeper 6 stays in the switch and nothing reports it: the switch locks",
        ),
        ({}, "undetected object", "Drive 1 gap 2.00 of 5 mm"),
        ({"slips": "2", "locked": False}, "detected by slip", "Drive 2 slips at 6.00 kN, closing"),
        ({"slips": "2"}, "detected by slip", "Drive 2 slips"),
        (
            {"locked": False, "gap": 0.0052},
            "detected by lock",
            "the lock is refused after the movement to closed: Drive 1 gap 5.20 of 5 mm, 0.20 over",
        ),
        (
            {"control": False},
            "detected by TKK",
            "out of control after the movement to closed: TKK1 gap",
        ),
        ({"slips": "2", "control": False}, "detected by slip", "; out of control after"),
        ({"trapped": False}, "sound", "no object, and the switch locks (Drive 2 force"),
        (
            {"trapped": False, "locked": False, "gap": 0.0052},
            "not locked",
            "Not locked after closing",
        ),
        ({"trapped": False, "control": False}, "not sound", "but out of control after"),
        ({"trapped": False, "slips": "2"}, "not sound", "but Drive 2 slips at 6.00 kN, closing"),
    ],
)
def test_every_kind_is_reported_with_its_numbers(
    states: dict[str, bool | float | str], kind: str, words: str
) -> None:
    found = verdict(run_with(**states))  # type: ignore[arg-type]
    assert (found.kind, found.missed) == (kind, kind == "undetected object")
    assert words in found.text
    assert found.kind in KINDS


def test_an_open_position_without_lock_is_not_sound() -> None:
    dataset = run_with(trapped=False)
    spans = json.loads(dataset.attrs["movements"])
    time = dataset["time"].values
    dataset["locked"].values[(time >= spans[0]["end"]) & (time < spans[1]["start"])] = False
    assert "refused after the movement to open" in verdict(dataset).text


def test_an_object_that_was_taken_out_or_never_fitted_is_not_trapped() -> None:
    dataset = run_with()
    (item,) = json.loads(dataset.attrs["foreign_objects"])
    dataset.attrs["foreign_objects"] = json.dumps([{**item, "disappears": 1.0}])
    found = verdict(dataset)
    assert (found.kind, found.text[:52]) == (
        "sound",
        "Sound: 13 mm at sleeper 6 was taken out at t = 1.00 s"[:52],
    )
    unplaced = verdict(run_with().assign(object_placed=False))
    assert (unplaced.kind, unplaced.text) == (
        "not judged",
        "Not judged: 13 mm at sleeper 6 does not fit.",
    )


def broken(dataset: xr.Dataset, *left: float) -> xr.Dataset:
    """Return a run that states what is left of its objects [m]."""
    return dataset.assign(object_left=("object", np.array(left)))


def test_an_object_that_left_nothing_does_not_stay() -> None:
    found = verdict(broken(run_with(), 0.0))
    assert (found.kind, found.missed) == ("sound", False)
    assert "13 mm at sleeper 6 broke and left nothing, and the switch locks" in found.text
    assert verdict(broken(run_with(), 0.004)).missed
    slipped = verdict(broken(run_with(slips="2"), 0.0))
    assert slipped.kind == "detected by slip"
    assert "13 mm at sleeper 6, which broke and left nothing; Drive 2 slips" in slipped.text
    later = broken(run_with(), 0.0).assign(object_size=("object", np.zeros(1)))
    assert "13 mm at sleeper 6 was gone before" in verdict(later).text


def test_one_object_is_gone_and_the_other_stays() -> None:
    (item,) = json.loads(run_with().attrs["foreign_objects"])
    two = [item, {**item, "place": "sleeper 8", "size": 0.02}]
    found = verdict(broken(run_with().assign_attrs(foreign_objects=json.dumps(two)), 0.0, 0.02))
    assert found.kind == "undetected object"
    assert "20 mm at sleeper 8 stays in the switch" in found.text
    assert "13 mm at sleeper 6 broke and left nothing" in found.text


def test_a_stone_that_splits_and_is_gone_is_reported_as_such() -> None:
    stone = ForeignObject("15 mm", "drive 1", kind="stone", strength="10 MPa", piece=0.0)
    thrown = simulate(load_panel("uic60-760-1-15"), foreign_object=stone, mode="quick")
    assert float(thrown["object_left"][0]) == 0.0
    assert "15 mm at drive 1 broke and left nothing" in verdict(thrown).text


def test_an_object_without_room_is_reported_with_the_room_there_is() -> None:
    dataset = changed(run_with(), size=0.5).assign(object_placed=False)
    assert "500 mm at sleeper 6 (at most " in verdict(dataset).text


def changed(dataset: xr.Dataset, **values: object) -> xr.Dataset:
    """Return a run with other values of its one object."""
    (item,) = json.loads(dataset.attrs["foreign_objects"])
    return dataset.assign_attrs(foreign_objects=json.dumps([item | values]))


def slipping(dataset: xr.Dataset, drive: str, start: float, end: float) -> xr.Dataset:
    """Return a run in which a drive slips from one time to another."""
    time = dataset["time"].values
    during = (time >= start) & (time <= end)
    dataset["drive_slipping"].loc[{"drive": drive}] |= during
    return dataset


def unlocked_when_open(dataset: xr.Dataset) -> xr.Dataset:
    """Return a run that is not locked between its two movements."""
    time = dataset["time"].values
    dataset["locked"].values[(time >= 3.4) & (time < 4.4)] = False
    return dataset


def test_an_object_is_judged_by_the_movement_in_which_its_rail_closes() -> None:
    opening = unlocked_when_open(slipping(run_with(), "1", 3.2, 4.3))
    opening["contact_time"] = ((), 2.9)
    found = verdict(changed(opening, rail="B", place="drive 1", appears=0.2))
    assert found.kind == "detected by slip"
    assert "13 mm at drive 1; Drive 1 slips at 6.00 kN, opening; the lock is ref" in found.text
    # The last movement says nothing of it, and one that failed before contact nothing either.
    assert findings(opening)[0].answer == "Undetected object"


def test_a_slip_without_contact_is_no_detection() -> None:
    untouched = run_with(slips="2", locked=False)
    untouched = untouched.assign(object_touched=False, contact_time=np.nan)
    found = verdict(untouched)
    assert found.kind == "not locked"
    assert "13 mm at sleeper 6 is never touched, but Drive 2 slips" in found.text
    before = slipping(run_with(locked=False), "2", 7.2, 9.0)
    assert verdict(before).kind == "not locked"
    assert "is touched only after a slip" in verdict(before).text


def test_a_missed_object_is_reported_beside_a_slip_on_opening() -> None:
    found = verdict(unlocked_when_open(slipping(run_with(), "2", 2.6, 4.3)))
    assert found.kind == "undetected object"
    assert "apart from the object, Drive 2 slips at 6.00 kN, opening; the lock is" in found.text
    assert "refused after the movement to open" in found.text


def test_a_slip_at_rest_before_the_first_movement_is_reported_as_such() -> None:
    found = verdict(slipping(run_with(trapped=False), "2", 0.0, 0.1))
    assert "Drive 2 slips at rest, at 6.00 kN, before the first movement" in found.text


def test_a_narrow_gauge_is_not_sound_and_is_stated_with_an_undetected_object() -> None:
    narrow = {"least_gauge": 1.42, "least_gauge_place": "sleeper 6"}
    alone, missed = (
        verdict(run_with(trapped=trapped).assign(narrow).assign_attrs(gauge_limit=1.427))
        for trapped in (False, True)
    )
    text = "the closed rail narrows the gauge to 1420.0 mm at sleeper 6 (limit 1427)"
    assert (alone.kind, missed.kind) == ("not sound", "undetected object")
    assert text in alone.text
    assert text in missed.text


def test_a_flangeway_below_its_limit_is_not_sound() -> None:
    found = verdict(run_with(trapped=False, flangeway=0.01086))
    assert found.kind == "not sound"
    assert "is 10.86 mm, limit 58 mm" in found.text


def test_an_object_that_was_taken_out_after_a_slip_is_detected() -> None:
    found = verdict(changed(slipping(run_with(), "1", 7.4, 7.6), disappears=7.7))
    assert found.kind == "detected by slip"
    assert "13 mm at sleeper 6, taken out at t = 7.70 s; Drive 1 slips" in found.text


def test_several_objects_stay() -> None:
    dataset = run_with()
    (item,) = json.loads(dataset.attrs["foreign_objects"])
    both = [item, item | {"size": 0.003, "place": "drive 1"}]
    found = verdict(dataset.assign_attrs(foreign_objects=json.dumps(both)))
    assert "13 mm at sleeper 6 and 3 mm at drive 1 stay in the switch" in found.text


def test_findings_and_verdict_agree() -> None:
    assert findings(run_with())[0].answer == "Undetected object"
    opening = changed(slipping(run_with(), "1", 3.2, 4.3), rail="B")
    opening["contact_time"] = ((), 2.9)
    assert findings(opening)[0].answer == "Object detected"
    assert findings(run_with(trapped=False, flangeway=0.01))[0].answer == "Not sound"


def test_a_single_rail_without_sensors_is_judged() -> None:
    assert verdict(sb1_dataset()).kind == "not locked"


@pytest.mark.parametrize(
    ("dataset", "words"),
    [
        (sb2_dataset().assign_attrs(kind="measurement"), "the largest forces are"),
        (sb2_dataset()[["drive_force"]], "no lock and no control (TKK) and no slip"),
        (sb2_dataset().expand_dims("movement"), "a campaign of many movements"),
        (interrupted(), "the run is not complete (interrupted at"),
    ],
    ids=["measurement", "forces alone", "campaign", "interrupted"],
)
def test_what_cannot_be_judged_says_why(dataset: xr.Dataset, words: str) -> None:
    found = verdict(dataset)
    assert found.kind == "not judged"
    assert words in found.text


@pytest.mark.parametrize(
    ("setting", "item", "kind", "words"),
    [
        (
            {"object_defaults.rail": "curved"},
            ForeignObject(size=0.013, at="drive 1"),
            "detected by slip",
            "Drive 1 slips at 6.00 kN, opening; the lock is refused after the movement to open",
        ),
        (
            {"chair.friction_coefficient": 0.8},
            ForeignObject(size=0.003, at="sleeper 6"),
            "not locked",
            "3 mm at sleeper 6 is never touched, but Drive 2 slips",
        ),
        (
            {"drive.2.stiffness": 7500e3},
            ForeignObject(size=0.003, at="sleeper 6"),
            "not locked",
            "Drive 2 slips at rest, at 6.85 kN, before the first movement",
        ),
        ({"drive.2.stroke": 0.02}, None, "not sound", "the flangeway of rail curved"),
    ],
    ids=["other rail", "friction", "stiff rod", "short stroke"],
)
def test_throws_of_the_default_panel(
    setting: dict[str, object], item: ForeignObject | None, kind: str, words: str
) -> None:
    panel = load_panel("uic60-760-1-15").with_overrides(setting)
    found = verdict(simulate(panel, foreign_object=item, mode="quick"))
    assert found.kind == kind
    assert words in found.text


def test_of_a_closed_gap_the_whole_limit_is_left() -> None:
    """It said "5.25 left" of a limit of 5 mm."""
    check = Check(kind="lock", name="switch", criterion="gap", met=True, value=-2.5e-4, limit=5e-3)
    assert (check.numbers, check.left) == ("closed, limit 5 mm", "5.00 left")


def test_checks_of_an_object_taken_out_at_rest_have_keys_of_their_own() -> None:
    dataset = run_with()
    item = json.loads(dataset.attrs["foreign_objects"])[0]
    dataset.attrs["foreign_objects"] = json.dumps([item | {"disappears": 8.3}])
    keys = [check.key for check in checks(dataset)]
    assert len(set(keys)) == len(keys)
    assert {"lock:switch:return:8.3", "lock:switch:return"} <= set(keys)


def test_a_file_without_limits_of_sensors_is_judged() -> None:
    """Files of older versions lack them."""
    dataset = run_with(trapped=False).drop_vars("sensor_limit")
    assert verdict(dataset).kind == "sound"
    assert "below its limit" in [lamp.rule for lamp in lamps(dataset) if lamp.kind == "control"][0]


def test_a_lock_that_is_asked_at_no_rest_is_not_said_to_lock() -> None:
    assert accepted_by([]) == "is asked at no rest"
