"""Values of a throw against their limits."""

import pytest
import xarray as xr
from tests.unit.simulated import sb2_dataset

from turnout.metric.limit_check import LimitCheck, limit_checks
from turnout.metric.slip import margins


def test_each_limit_is_that_of_the_dataset() -> None:
    dataset = sb2_dataset()
    found = {item.key: item for item in limit_checks(dataset)}
    gap = dataset["sensor_gap"].isel(time=-1)
    for name in dataset["sensor"].values:
        check = found[f"sensor_gap:{name}"]
        assert check.value == pytest.approx(float(gap.sel(sensor=name)), rel=1e-12)
        assert check.limit == pytest.approx(float(dataset["sensor_limit"].sel(sensor=name)))
        inside = bool(dataset["in_control"].isel(time=-1).sel(sensor=name))
        assert check.passed == inside
    for drive in dataset["drive"].values:
        least = min(item.force for item in margins(dataset) if item.drive == drive)
        assert found[f"drive_force:{drive}"].margin == pytest.approx(least, rel=1e-9)


def test_a_limit_itself_fails_for_a_gap_and_passes_for_the_flangeway() -> None:
    common = {"key": "k", "label": "l", "meaning": "m", "value": 0.058, "limit": 0.058}
    assert not LimitCheck(**common, unit="m", side="below").passed
    assert LimitCheck(**common, unit="m", side="at least").passed
    narrow = LimitCheck(**common | {"value": 0.05}, unit="m", side="at least")
    assert (narrow.passed, round(narrow.margin, 6)) == (False, -0.008)


def test_gaps_of_drives_are_no_limit_where_the_lock_rule_ignores_them() -> None:
    dataset = sb2_dataset()
    keys = {item.key for item in limit_checks(dataset)}
    ruled = dataset.assign_attrs(lock_rule="slip or gap", lock_gap_limit=0.005)
    more = {item.key for item in limit_checks(ruled)}
    assert dataset.attrs["lock_rule"] == "no slip"
    assert more - keys == {f"drive_gap:{name}" for name in dataset["drive"].values}


def test_what_was_not_kept_is_left_out() -> None:
    assert limit_checks(xr.Dataset()) == []
    assert limit_checks(xr.Dataset({"least_flangeway": 0.06})) == []
