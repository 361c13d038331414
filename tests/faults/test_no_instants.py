"""Recordings and runs that hold nothing, or declare far more than they hold: a clear message."""

from pathlib import Path

import h5netcdf
import h5py
import numpy as np
import pytest
import xarray as xr
from scipy.io import savemat
from tests.faults.terminal import run_here

from turnout.core.channels import SCHEMA_VERSION
from turnout.core.errors import FileError
from turnout.measurement.formats.file_format import read_recording
from turnout.throw.store import open_response, save_response


def dataset(instants: int, *, movements: int = 0) -> xr.Dataset:
    dims = ("movement", "drive", "time") if movements else ("drive", "time")
    shape = (movements, 1, instants) if movements else (1, instants)
    return xr.Dataset(
        {"drive_force": (dims, np.ones(shape))},
        {"time": np.arange(instants) / 1000, "drive": ["1"]},
        {"schema_version": SCHEMA_VERSION, "kind": "measurement"},
    )


@pytest.mark.parametrize("empty", [np.zeros(0), np.zeros((0, 3)), h5py.Empty("f8")])
def test_empty_datasets(tmp_path: Path, empty: object) -> None:
    path = tmp_path / "throw.h5"
    with h5py.File(path, "w") as file:
        file["time"] = file["rod 1"] = empty
    with pytest.raises(FileError, match="channel 'rod 1' is left out: no sample was recorded"):
        read_recording(path)
    with h5py.File(path, "a") as file:
        file.create_dataset("rod 2", data=np.arange(9.0)).attrs["rate"] = 1000.0
    assert "is left out: no sample was recorded" in read_recording(path).problems[-1]


def test_empty_arrays_of_matlab(tmp_path: Path) -> None:
    savemat(tmp_path / "throw.mat", {"rod": np.zeros(0), "time": np.zeros(0), "Fs": 1000.0})
    with pytest.raises(FileError, match="channel 'rod' is left out: no sample was recorded"):
        read_recording(tmp_path / "throw.mat")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (dataset(0), "no instant"),
        (dataset(0, movements=2), "no instant"),
        (dataset(1, movements=2), "one instant only"),
    ],
)
def test_a_run_without_instants(tmp_path: Path, given: xr.Dataset, said: str) -> None:
    save_response(given, tmp_path / "run.nc")
    for arguments in (("campaign", "plot", "run.nc"), ("report", "run.nc", "--out", "run.html")):
        code, message = run_here(*arguments, folder=tmp_path)
        assert code == 2, message
        assert f"run.nc: holds {said}, nothing that moves" in message
        assert "Traceback" not in message
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.nc"]


def test_a_small_run_that_declares_much(tmp_path: Path) -> None:
    with h5netcdf.File(tmp_path / "run.nc", "w") as file:
        file.dimensions = {"time": 10**9}
        file.create_variable("rod", ("time",), "f8", chunks=(1000,), fillvalue=1.0)
    with pytest.raises(FileError, match="declares 8000000.* bytes of data in"):
        open_response(tmp_path / "run.nc")


@pytest.mark.parametrize(
    ("attributes", "said"),
    [
        ({"schema_version": "one"}, "has schema_version one, this turnout reads"),
        ({"schema_version": "1"}, "has schema_version 1, this turnout reads"),
        ({"schema_version": 1.5}, "has schema_version 1.5, this turnout reads"),
        ({"schema_version": np.arange(3)}, r"has schema_version \[0 1 2\], this turnout reads"),
        ({"schema_version": "9" * 3000}, r"has schema_version 9{50,100} \.\.\."),
        ({"json_attributes": "gone"}, "its attributes are damaged; write it again"),
        ({"json_attributes": "text", "text": "{"}, "its attributes are damaged; write it again"),
    ],
)
def test_attributes_of_another_type(
    tmp_path: Path, attributes: dict[str, object], said: str
) -> None:
    path = tmp_path / "run.nc"
    run = xr.Dataset({"locked": ("time", [1.0, 1.0])}, {"time": [0.0, 1.0]})
    run.attrs = {"schema_version": SCHEMA_VERSION, "kind": "simulation", **attributes}
    run.to_netcdf(path, engine="h5netcdf")
    with pytest.raises(FileError, match=said):
        open_response(path)
