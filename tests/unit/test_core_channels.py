"""The table of channels and the check of datasets against it."""

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr
from tests.unit.simulated import sb1_dataset, sb2_dataset

from turnout.core.channels import (
    CHANNELS,
    COORDINATES,
    OPTIONAL,
    check_schema,
    label,
    schema_problems,
)
from turnout.core.errors import ResponseError


def small() -> xr.Dataset:
    time = np.linspace(0.0, 1.0, 5)
    force = np.zeros((2, 5))
    return label(
        xr.Dataset(
            {"drive_force": (("drive", "time"), force), "locked": ("time", force[0] > 1)},
            {"time": time, "drive": ["1", "2"]},
        )
    )


def test_a_channel_is_no_coordinate_as_well() -> None:
    assert not set(CHANNELS) & set(COORDINATES)


def test_every_dimension_is_a_coordinate() -> None:
    used = {dim for channel in CHANNELS.values() for dim in channel.dims}
    assert used <= set(COORDINATES)


def test_labels_carry_unit_name_and_sign() -> None:
    force = small()["drive_force"]
    assert force.attrs == {
        "units": "N",
        "long_name": "drive force on the rail",
        "positive": "closing",
    }
    assert "positive" not in small()["locked"].attrs


def test_labelling_leaves_its_argument_alone() -> None:
    bare = xr.Dataset({"object_force": ("time", np.zeros(2))}, {"time": [0.0, 1.0]})
    label(bare)
    assert bare["object_force"].attrs == {}


def test_a_dataset_in_order_passes() -> None:
    assert schema_problems(small()) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.rename(drive_force="drive_forse"), "nearest is drive_force"),
        (lambda d: d.transpose("time", "drive"), "dimensions"),
        (lambda d: d.assign(drive_force=d.drive_force.astype("f4")), "must be float64"),
        (lambda d: d.assign(locked=d.locked.astype(float)), "not a logical"),
        (lambda d: d.assign_coords(drive=[1, 2]), "not a text"),
        (lambda d: d.isel(time=slice(None, None, -1)), "must be finite and rise"),
        (lambda d: d.drop_attrs(), "units None, must be 'N'"),
    ],
)
def test_a_departure_is_named(change: Callable[[xr.Dataset], xr.Dataset], words: str) -> None:
    changed = change(small())
    assert any(words in problem for problem in schema_problems(changed))
    with pytest.raises(ResponseError, match="dataset: "):
        check_schema(changed)


@pytest.mark.parametrize("dataset", [sb1_dataset, sb2_dataset])
def test_simulations_keep_to_the_table(dataset: Callable[[], xr.Dataset]) -> None:
    assert schema_problems(dataset()) == []


def test_a_whole_panel_has_every_channel() -> None:
    assert set(sb2_dataset().data_vars) == set(CHANNELS) - OPTIONAL
