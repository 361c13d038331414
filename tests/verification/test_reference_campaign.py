"""A campaign that another program wrote is calibrated back to what that program was given.

Reference: SB1 by Exudyn 1.13.6, without an object and with 13 mm at x = 3.9 m, as text: time
and forces with noise of 5 N; no motor currents, so that onsets come from the forces. Tolerances:
friction, stiffness and slip level of each drive within 1 %; field drives are not known better.
The fit starts from friction 0.3 and stiffnesses 25 % off.
"""

from pathlib import Path

import numpy as np
import pytest

from turnout.calibration.calibrate import calibrate
from turnout.measurement.campaign.build_campaign import build_campaign_dataset
from turnout.panel.load import load_panel

TRUE = {
    "chair.friction_coefficient": 0.4,
    "drive.1.stiffness": 750e3,
    "drive.1.saturation_force": 6e3,
    "drive.2.stiffness": 810e3,
    "drive.2.saturation_force": 6e3,
}
START = {
    "chair.friction_coefficient": 0.3,
    "drive.1.stiffness": 600e3,
    "drive.2.stiffness": 1000e3,
}
NOISE = 5.0
CHANNELS = """
[drive_force.1]
column = "Rod 1"
kind = "scaled"
unit = "N"
[drive_force.2]
column = "Rod 2"
kind = "scaled"
unit = "N"
[object_force]
column = "Load cell"
kind = "scaled"
unit = "N"
optional = true
"""
SHEET = """file,movement,direction,size [mm],place,repeat
A.csv,1,closing,0,none,1
A.csv,2,opening,0,none,1
B.csv,1,closing,13,x = 3.9 m,1
"""


def written(reference: Path, folder: Path) -> Path:
    """Write the answers of the other program as a folder of recordings."""
    rng = np.random.default_rng(3)
    for name in ("A", "B"):
        with np.load(reference / "sb1" / f"{name}.npz") as run:
            columns = [run["time"], run["drive1"], run["drive2"], run["object"]]
        for row in columns[1:]:
            row += NOISE * rng.standard_normal(row.size)
        np.savetxt(
            folder / f"{name}.csv",
            np.column_stack(columns),
            delimiter=",",
            header="Time (s),Rod 1 (N),Rod 2 (N),Load cell (N)",
            comments="",
            fmt="%.6g",
        )
    (folder / "channels.toml").write_text(CHANNELS, encoding="utf-8")
    (folder / "runs.csv").write_text(SHEET, encoding="utf-8")
    return folder


def test_another_programs_campaign_gives_its_values_back(
    reference_dir: Path, tmp_path: Path
) -> None:
    campaign = build_campaign_dataset(written(reference_dir, tmp_path), strict=True)
    assert campaign.dataset is not None
    assert campaign.dataset.sizes["movement"] == 3
    # The last starts from held forces that grow slowly, which once put it 0.25 s early.
    assert campaign.dataset["onset"].values == pytest.approx([1.0, 5.0, 1.0], abs=0.04)
    found = calibrate(campaign.dataset, load_panel("sb1").with_overrides(START)).calibration
    assert found.values == pytest.approx(TRUE, rel=0.01)
