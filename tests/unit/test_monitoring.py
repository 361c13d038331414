"""What a monitoring system stores: RMS windows, steps, and one transformer for two motors."""

import numpy as np
import pytest
import xarray as xr

from turnout.errors import MeasurementError
from turnout.measurement.chain.monitoring import Monitoring, monitored


def run_of(**rows: list[list[float]]) -> xr.Dataset:
    time = np.arange(0.0, 0.2, 1e-3)
    wide = {
        name: (("drive", "time"), np.outer([r[0] for r in values], np.ones(time.size)))
        for name, values in rows.items()
    }
    return xr.Dataset(wide, {"time": time, "drive": ["1", "2"][: len(rows["drive_current"])]})


@pytest.mark.parametrize("rate", [25.0, 50.0, 100.0])
def test_windows_are_rms_and_end_where_they_are_stored(rate: float) -> None:
    run = run_of(drive_current=[[0.0]])
    time = run["time"].values
    run["drive_current"][0] = np.sin(2.0 * np.pi * 100.0 * time)
    found = monitored(run, Monitoring(rate=rate, current_step=0.0))
    assert found["drive_current"].values == pytest.approx(np.sqrt(0.5), rel=1e-6)
    assert float(found["time"][0]) == pytest.approx(1.0 / rate - 1e-3)
    assert found.sizes["time"] == round(0.2 * rate)


def test_two_motors_in_one_transformer_add_as_phasors() -> None:
    """P 300 and 0 W, S 500 and 400 V A at 3 U = 500 V: (0.6, 0.8) and (0, 0.8) A."""
    run = run_of(
        drive_current=[[1.0], [0.8]],
        drive_power=[[300.0], [0.0]],
        drive_apparent_power=[[500.0], [400.0]],
    )
    found = monitored(run, Monitoring(together={"both": ["1", "2"]}, current_step=1e-6))
    assert list(found["drive"].values) == ["both"]
    assert found["drive_current"].values == pytest.approx(np.hypot(0.6, 1.6), abs=1e-6)
    assert found["drive_power"].values == pytest.approx(300.0)
    alone = monitored(run)
    assert alone["drive_current"].sel(drive="2").values == pytest.approx(0.8)


def test_direct_currents_add_with_their_signs() -> None:
    run = run_of(drive_current=[[1.004], [-0.5]])
    found = monitored(run, Monitoring(together={"both": ["1", "2"]}))
    assert found["drive_current"].values.ravel()[0] == 0.5


@pytest.mark.parametrize(
    ("monitoring", "words"),
    [
        (Monitoring(rate=0.0), "must be 1 to 1000"),
        (Monitoring(rate=300.0), "must be a multiple"),
        (Monitoring(together={"a": ["1", "3"]}), "drive 3 is not there"),
    ],
)
def test_what_cannot_be_sampled(monitoring: Monitoring, words: str) -> None:
    with pytest.raises(MeasurementError, match=words):
        monitored(run_of(drive_current=[[1.0]]), monitoring)
    with pytest.raises(MeasurementError, match="drive_current: is missing"):
        monitored(run_of(drive_current=[[1.0]]).drop_vars("drive_current"))
