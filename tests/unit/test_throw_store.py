"""netCDF files: back to the last bit, whole or not at all."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.unit.simulated import sb1_dataset
from tests.unit.test_throw_simulate import interrupted

from turnout.core.errors import FileError
from turnout.throw.store import FIELD_STEP, open_response, save_response


@pytest.mark.parametrize("make", [sb1_dataset, interrupted])
def test_a_round_trip_changes_fields_by_half_a_step_and_nothing_else(
    tmp_path: Path, make: object
) -> None:
    dataset: xr.Dataset = make()  # type: ignore[operator]
    path = tmp_path / "run.nc"
    save_response(dataset, path)
    back = open_response(path)
    fields = [name for name, v in dataset.items() if {"x", "chair", "stop"} & {*v.dims}]
    xr.testing.assert_identical(back.drop_vars(fields), dataset.drop_vars(fields))
    for name in fields:
        largest = float(np.abs(back[name] - dataset[name]).max())
        assert 0.0 < largest <= 0.5 * FIELD_STEP[dataset[name].units], name
        assert back[name].attrs == dataset[name].attrs
    save_response(back, path)
    xr.testing.assert_identical(open_response(path), back)
    for name, variable in dataset.variables.items():
        assert back[name].dtype.kind == variable.dtype.kind, name
    assert {key: type(value) for key, value in back.attrs.items()} == {
        key: type(value) for key, value in dataset.attrs.items()
    }
    assert [file.name for file in tmp_path.iterdir()] == ["run.nc"]


def test_awkward_attributes_and_numbers_survive(tmp_path: Path) -> None:
    values = np.array([0.1, np.nan, -0.0, 5e-324, np.inf])
    dataset = xr.Dataset(
        {"object_force": ("time", values), "locked": ("time", values > 0)},
        {"time": np.arange(5.0)},
        {"schema_version": 1, "nothing": None, "yes": True, "no": np.False_, "text": "å µ"},
    )
    save_response(dataset, tmp_path / "a.nc")
    back = open_response(tmp_path / "a.nc")
    assert back["object_force"].values.tobytes() == values.tobytes()
    assert back["locked"].dtype == bool
    assert back.attrs == {**dataset.attrs, "no": False, "Conventions": "CF-1.11"}
    assert back.attrs["nothing"] is None
    assert back.attrs["yes"] is True


def test_other_programs_can_read_it(tmp_path: Path) -> None:
    save_response(sb1_dataset(), tmp_path / "a.nc")
    with xr.open_dataset(tmp_path / "a.nc", engine="h5netcdf", decode_timedelta=False) as plain:
        np.testing.assert_array_equal(plain["drive_force"], sb1_dataset()["drive_force"])
        assert plain["drive_force"].attrs["units"] == "N"


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"gone\.nc: no such file"):
        open_response(tmp_path / "gone.nc")


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="is a folder"):
        open_response(tmp_path)


@pytest.mark.parametrize("content", [b"", b"time;force\n0;1\n", b"\x89HDF\r\n\x1a\n" + b"\0" * 60])
def test_other_content_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.nc").write_bytes(content)
    with pytest.raises(FileError, match=r"a\.nc: is no netCDF-4 file"):
        open_response(tmp_path / "a.nc")


@pytest.mark.parametrize(
    ("attributes", "words"), [({}, "has no schema_version"), ({"schema_version": 99}, "99")]
)
def test_another_schema_is_refused(tmp_path: Path, attributes: dict[str, int], words: str) -> None:
    dataset = xr.Dataset({"object_force": ("time", np.zeros(2))}, {"time": [0.0, 1.0]}, attributes)
    save_response(dataset, tmp_path / "a.nc")
    with pytest.raises(FileError, match=words):
        open_response(tmp_path / "a.nc")


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no such folder"):
        save_response(sb1_dataset(), tmp_path / "none" / "a.nc")
