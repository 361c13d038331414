"""The blade by what can be seen at one size."""

import pytest
import xarray as xr
from tests.unit.detection_throws import toy_throws

from turnout.core.errors import ResponseError
from turnout.detection.limit.known_place_map import known_place_map
from turnout.detection.limit.limit_map import limit_map
from turnout.detection.reference import Conditions
from turnout.metric.blade_map import blade_maps


def test_each_place_has_its_probability_and_floor() -> None:
    dataset = limit_map(toy_throws(), Conditions(), closing=0.8)
    found = blade_maps(dataset, [1.25e-3])[0]
    assert [item.place for item in found] == ["drive 1", "sleeper 1"]
    pod = dataset["pod"].sel(channel="both drives", place="sleeper 1")
    middle = float(pod.sel(size=[1.2e-3, 1.3e-3], method="nearest").mean())
    assert found[1].pod == pytest.approx(middle, rel=1e-9)
    assert [item.untouched for item in found] == [False, True]
    assert found[0].a90 == pytest.approx(float(dataset["a90"][0, 0]))
    assert found[0].known_a90 is None
    assert blade_maps(dataset, [20e-3])[0][0].pod is None


def test_known_places_are_those_of_both_drives() -> None:
    throws = toy_throws()
    dataset = limit_map(throws, Conditions(), closing=0.8)
    known = known_place_map(throws, Conditions(), closing=0.8, draws=1000)
    dataset = dataset.merge(known, combine_attrs="no_conflicts")
    found = blade_maps(dataset, [2e-3])[0]
    at = known["known_pod"].sel(place="sleeper 1").sel(size=2e-3, method="nearest")
    assert found[1].known_pod == pytest.approx(float(at), abs=1e-9)
    assert found[1].known_a90 == pytest.approx(float(known["known_a90"][1]))
    assert blade_maps(dataset, [2e-3], channel="drive 1")[0][1].known_pod is None
    rows = blade_maps(dataset, [1e-3, 2e-3])
    assert rows[1] == found


def test_another_dataset_or_channel_is_refused() -> None:
    with pytest.raises(ResponseError, match="is no map of `turnout limit`"):
        blade_maps(xr.Dataset(), [0.01])
    dataset = limit_map(toy_throws(), Conditions(), closing=0.8)
    with pytest.raises(ResponseError, match="this map has both drives, drive 1"):
        blade_maps(dataset, [0.01], channel="current")[0]
