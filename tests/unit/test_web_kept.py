"""What is handed from one process of the studio to its successor."""

import numpy as np
import xarray as xr

from turnout.web.measured import Measured
from turnout.web.tasks import measured_from_bytes, measured_to_bytes


def movement() -> Measured:
    time = np.linspace(0.0, 1.0, 5)
    force = np.array([[0.0, 1.0, np.nan, 3.0, 4.0], [1.0, 1.0, 1.0, 1.0, 1.0]])
    dataset = xr.Dataset(
        {"drive_force": (("drive", "time"), force, {"units": "N"})},
        {"time": time, "drive": np.array(["1", "2"], dtype=object)},
        {"kind": "measurement"},
    )
    return Measured("m1", "closing", float("nan"), "", dataset)


def test_a_movement_survives_its_process() -> None:
    given = movement()
    kept = measured_from_bytes(measured_to_bytes(given))
    assert (kept.title, kept.direction, kept.place) == ("m1", "closing", "")
    assert np.isnan(kept.size)
    xr.testing.assert_identical(kept.dataset, given.dataset)
    assert kept.dataset["drive_force"].sel(drive="2").values.tolist() == [1.0] * 5
