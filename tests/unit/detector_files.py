"""Files that the studio's views of detection are tried with: small, made within seconds."""

from pathlib import Path

import numpy as np
import xarray as xr
from tests.unit.detector_toy import toy_detector, toy_throw

from turnout.core.channels import SCHEMA_VERSION
from turnout.panel.load import load_panel
from turnout.throw.store import save_response


def detector_file(folder: Path) -> Path:
    """Write the detector of the switch of formulas that a session trains once."""
    path = folder / "toy.detector"
    toy_detector().save(path)
    return path


def table_file(folder: Path, sizes: list[float], *, factor: float = 1.0) -> Path:
    """Write a table with a row a throw, of these object sizes [m]; 0 for none."""
    lines = ["throw,rate [Hz],start [s],force 1 [N],force 2 [N]"]
    for seed, size in enumerate(sizes):
        rows = factor * toy_throw(seed=seed, size=size).force
        cells = [" ".join(f"{value:.1f}" for value in row) for row in rows]
        lines.append(f"t{seed},125,-4.4,{cells[0]},{cells[1]}")
    path = folder / "throws.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def limit_file(folder: Path) -> Path:
    """Write a map as `turnout limit` does: detection rises within 2 mm about a size."""
    sizes = np.linspace(0.5e-3, 30e-3, 60)
    middle = np.array([2e-3, 5e-3, 11e-3, 4e-3])
    pod = np.clip(0.5 + (sizes - middle[:, np.newaxis]) / 2e-3, 0.0, 1.0)
    places = ["drive 1", "sleeper 3", "sleeper 6", "drive 2"]
    one = ("channel", "place")
    dataset = xr.Dataset(
        {
            "pod": ((*one, "size"), np.stack([pod, 0.5 * pod])),
            "a90": (one, np.stack([middle + 0.8e-3, np.full(4, np.nan)])),
            "a90_low": (one, np.stack([middle, np.full(4, np.nan)])),
            "a90_high": (one, np.stack([middle + 1e-3, np.full(4, np.nan)])),
            "known_pod": (("place", "size"), 0.9 * pod),
            "known_a90": (("place",), middle + 1.8e-3),
            "touch_floor": (("place",), np.array([0.5e-3, 2e-3, 6e-3, 1e-3])),
            "largest_size": (("place",), np.array([30e-3, 30e-3, 30e-3, 20e-3])),
        },
        {
            "channel": ["both drives", "drive 1"],
            "place": places,
            "x": (("place",), [0.3, 1.8, 3.6, 6.9]),
            "size": sizes,
        },
        {
            "schema_version": SCHEMA_VERSION,
            "kind": "limit",
            "discrepancy": 0.05,
            "false_alarm_rate": 1e-3,
            "history": 0,
            "states": 50,
            "panel": "sb2",
            "panel_hash": load_panel("sb2").hash,
        },
    )
    path = folder / "limit.nc"
    save_response(dataset, path)
    return path
