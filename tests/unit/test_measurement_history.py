"""Histories of other programs: read in any unit, refused with everything that is wrong."""

from pathlib import Path

import numpy as np
import pytest
from tests.unit.simulated import sb2_dataset

from turnout.core.errors import FileError
from turnout.measurement.formats.history import READ, history_text, read_history

GOOD = """# computed elsewhere
time [ms], drive_force:1 [kN], drive_force:2 [N], sensor_gap:TKK1 [mm], object_force (kN)
0, 0.0, 10, 5.0, 0
1, 0.5, 20, , 0.1
3, 1.0, 30, 4.0, 0.2
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "other.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_columns_become_channels_in_si(tmp_path: Path) -> None:
    found = read_history(written(tmp_path, GOOD))
    np.testing.assert_allclose(found["time"], [0.0, 1e-3, 3e-3])
    np.testing.assert_allclose(found["drive_force"].sel(drive="1"), [0.0, 500.0, 1000.0])
    np.testing.assert_allclose(found["drive_force"].sel(drive="2"), [10.0, 20.0, 30.0])
    np.testing.assert_allclose(found["sensor_gap"].sel(sensor="TKK1"), [5e-3, np.nan, 4e-3])
    np.testing.assert_allclose(found["object_force"], [0.0, 100.0, 200.0])
    assert found.attrs["title"] == "other.csv"


def test_semicolons_part_columns_too(tmp_path: Path) -> None:
    found = read_history(written(tmp_path, "time [s];drive_gap:2 [mm]\n0;1\n1;2\n"))
    np.testing.assert_allclose(found["drive_gap"].sel(drive="2"), [1e-3, 2e-3])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("drive_force:1 [N]\n0\n1\n", "no column 'time"),
        ("time [s]\n0\n1\n", "there is no channel"),
        ("time [s],drive_force:1 [N]\n0,1\n", "at least two lines"),
        ("time [s],drive_forse:1 [N]\n0,1\n1,2\n", "did you mean|nearest|drive_force"),
        ("time [s],drive_force [N]\n0,1\n1,2\n", "which drive"),
        ("time [s],object_force:1 [N]\n0,1\n1,2\n", "has no member"),
        ("time:1 [s],object_force [N]\n0,1\n1,2\n", "time has no member"),
        ("time [s],drive_force:1\n0,1\n1,2\n", r"has no unit; write it .*'drive_force:1 \[N\]'"),
        ("time [s],drive_force:1 [mm]\n0,1\n1,2\n", "is a unit of length"),
        ("time [s],drive_force:1 [N],drive_force:1 [N]\n0,1,1\n1,2,2\n", "stands twice"),
        ("time [s],object_force [N]\n0,1\n1\n", "line 3: 1 cells, must be 2"),
        ("time [s],object_force [N]\n0,1\n1,x\n", "line 3: 'x' is not a number"),
        ("time [s],object_force [N]\n0,1\n2,1\n1,1\n", "line 4: time must rise"),
        ("time [s],object_force [N]\n0,1\n,1\n", "line 3: time must rise"),
    ],
)
def test_a_fault_is_named(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(FileError, match=words):
        read_history(written(tmp_path, text))


def test_all_faults_are_reported_at_once_and_a_flood_is_cut(tmp_path: Path) -> None:
    rows = "\n".join(f"{t},x" for t in range(30))
    with pytest.raises(FileError) as caught:
        read_history(written(tmp_path, f"time [s],drive_force:1\n{rows}\n"))
    text = str(caught.value)
    assert "has no unit" in text
    assert "line 2: 'x'" in text
    assert "and 19 more" in text


def test_missing_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"none\.csv"):
        read_history(tmp_path / "none.csv")


@pytest.mark.parametrize("line", [0, 2])
def test_a_cell_that_csv_refuses_is_one_message(tmp_path: Path, line: int) -> None:
    rows = ["time [s],object_force [N]", "0,1", "1,2", "2,3"]
    rows[line] = rows[line].replace(",", "," + "0" * 140_000)
    path = tmp_path / "history.csv"
    path.write_text("\n".join(rows), encoding="utf-8")
    with pytest.raises(FileError, match=rf"line {line + 1}: field larger.*shorten the cell"):
        read_history(path)


# ---- a table of a run reads back as the run


def test_a_table_reads_back(tmp_path: Path) -> None:
    run = sb2_dataset()
    file = tmp_path / "run.csv"
    file.write_text(history_text(run), encoding="utf-8")
    again = read_history(file)
    for channel in READ:
        np.testing.assert_allclose(again[channel].values, run[channel].values, rtol=1e-9, atol=1e-9)


def test_nan_is_an_empty_cell_and_a_channel_of_them_is_left_out() -> None:
    run = sb2_dataset().isel(time=slice(0, 3))[["object_force", "drive_gap"]].copy(deep=True)
    run["drive_gap"][0, 1] = np.nan
    run["object_force"][:] = np.nan
    lines = history_text(run).splitlines()
    assert lines[0] == "time [s],drive_gap:1 [mm],drive_gap:2 [mm]"
    assert lines[2].split(",")[1] == ""
