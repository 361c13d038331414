"""Datasets that are filled from an empty one of their kind are those that xarray makes afresh."""

import numpy as np
import pytest
import xarray as xr

from turnout.core.errors import ResponseError
from turnout.throw import dataset_template as alike
from turnout.throw.dataset_template import clear_datasets, labelled_dataset
from turnout.throw.signals import Channel

Variables = dict[str, Channel]


def made(
    seed: int, *, count: int = 5, step: float = 0.1, drives: int = 2
) -> tuple[Variables, Variables]:
    """Return some channels of drives with drawn values, and their coordinates."""
    random = np.random.default_rng(seed)
    channels: Variables = {
        "object_force": (("time",), random.normal(size=count)),
        "drive_force": (("drive", "time"), random.normal(size=(drives, count))),
        "contact_time": ((), np.array(random.normal())),
        "least_flangeway_rail": ((), np.array("A")),
    }
    coordinates: Variables = {
        "time": (("time",), step * np.arange(count)),
        "drive": (("drive",), np.array([str(number) for number in range(drives)])),
        "drive_x": (("drive",), random.normal(size=drives)),
    }
    return channels, coordinates


def test_a_filled_dataset_is_identical_to_one_made_with_all_checks() -> None:
    """Values, also of coordinates, are those of its own throw, attributes those of the schema."""
    cases = [made(1), made(2), made(3, count=7), made(4, step=0.2), made(5, drives=3), made(6)]
    copied = [labelled_dataset(*case) for case in cases]
    for case, found in zip(cases, copied, strict=True):
        clear_datasets()
        fresh = labelled_dataset(*case)
        xr.testing.assert_identical(found, fresh)
        assert list(found.variables) == list(fresh.variables)
        assert found.xindexes["time"].equals(fresh.xindexes["time"])
        assert found["drive_force"].attrs["units"] == "N"
        assert found["drive_force"].dtype == np.float64


def test_a_dataset_that_is_changed_leaves_those_that_come_later_alone() -> None:
    """Arrays and attributes belong to one throw."""
    clear_datasets()
    first = labelled_dataset(*made(1))
    for changed in (first, labelled_dataset(*made(1))):
        changed["drive_force"].values[:] = 7.0
        changed["drive_x"].values[:] = 7.0
        changed["drive_force"].attrs["units"] = "kN"
        changed["time"].attrs["units"] = "h"
        changed.attrs["title"] = "changed"
        changed["added"] = ("time", np.zeros(5))
    later = labelled_dataset(*made(1))
    clear_datasets()
    xr.testing.assert_identical(later, labelled_dataset(*made(1)))


def test_times_that_datasets_share_cannot_be_written_to() -> None:
    """An index is the same object in all of them."""
    found = labelled_dataset(*made(1))
    with pytest.raises(ValueError, match="read-only"):
        found["time"].values[0] = 1.0


def test_what_departs_from_the_schema_is_refused_each_time() -> None:
    """Nothing is kept of a dataset that was refused."""
    channels, coordinates = made(1)
    channels["drive_force"] = (("drive", "time"), np.zeros((2, 5), dtype=np.float32))
    for _ in range(2):
        with pytest.raises(ResponseError, match="must be float64"):
            labelled_dataset(channels, coordinates)


def test_an_xarray_made_of_other_parts_is_copied_by_its_own_means(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The quick way reaches inside xarray; where that has changed, the dataset stays the same."""
    clear_datasets()
    labelled_dataset(*made(1))
    quick = labelled_dataset(*made(2))
    assert alike._fills_alike()

    def other_parts(*_: object) -> xr.Dataset:
        raise AttributeError

    monkeypatch.setattr(alike, "_filled", other_parts)
    alike._fills_alike.cache_clear()
    copied = labelled_dataset(*made(2))
    assert not alike._fills_alike()
    alike._fills_alike.cache_clear()
    xr.testing.assert_identical(copied, quick)
    assert list(copied.variables) == list(quick.variables)
    assert copied["drive_force"].encoding == quick["drive_force"].encoding == {}
