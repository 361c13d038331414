"""Figures of a quick case, kept to see that nothing moves by accident.

`python -m tests.golden.make` writes them again; check what changed before it is committed.
"""

import json
from pathlib import Path

import numpy as np
import xarray as xr

from turnout.core.scheme import Scheme
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.throw.simulate import simulate

FILE = Path(__file__).parent / "sb1_5mm.json"
INSTANTS = (0.5, 1.0, 1.25, 1.5, 2.0)


def case() -> xr.Dataset:
    """One rail closes onto a small object and opens again, in two seconds."""
    panel = load_panel("sb1").with_overrides(
        {
            "schedule.end": 2.0,
            "movement.throw.start": 0.1,
            "movement.throw.duration": 1.0,
            "movement.return.start": 1.3,
            "movement.return.duration": 0.5,
        }
    )
    item = ForeignObject(0.005, "x = 3.9 m", appears=0.1, disappears=1.4)
    return simulate(panel, foreign_object=item, scheme=Scheme(step=2e-3, output_interval=2e-3))


def figures(dataset: xr.Dataset) -> dict[str, list[float]]:
    """Return what is kept: channels at a few instants, extremes, energies, labels."""
    some = dataset.sel(time=list(INSTANTS), method="nearest")
    end = dataset.isel(time=-1)
    kept = {
        "drive_force": some["drive_force"].values,
        "object_force": some["object_force"].values,
        "gap": some["gap"].isel(rail=0).sel(x=[0.3, 3.9, 6.9], method="nearest").values,
        "sensor_gap": some["sensor_gap"].isel(sensor=0).values,
        "chair_friction_force": some["chair_friction_force"].sum("chair").values,
        "stop_force_largest": dataset["stop_force"].max("time").sum().values,
        "drive_force_largest": abs(dataset["drive_force"]).max("time").values,
        "work_markers": end["work_markers"].values,
        "energy_friction": end["energy_friction"].values,
        "energy_damping": end["energy_damping"].values,
        "energy_object_switched": end["energy_object_switched"].values,
        "contact_time": dataset["contact_time"].values,
        "force_margin": dataset["force_margin"].values,
        "highest_mode_frequency": np.array(dataset.attrs["highest_mode_frequency"]),
    }
    return {name: np.ravel(values).tolist() for name, values in kept.items()}


if __name__ == "__main__":
    FILE.write_text(json.dumps(figures(case()), indent=1) + "\n", encoding="utf-8")
