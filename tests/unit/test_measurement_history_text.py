"""A table of a run reads back as the run."""

from pathlib import Path

import numpy as np
from tests.unit.simulated import sb2_dataset

from turnout.measurement.formats.history import READ, history_text, read_history


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
