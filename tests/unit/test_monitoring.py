"""What a monitoring system stores: RMS windows, steps, and one transformer for two motors."""

import json

import numpy as np
import pytest
import xarray as xr

from turnout.core.errors import MeasurementError
from turnout.measurement.chain.monitoring import Monitoring, monitored, monitoring_of


def run_of(**rows: list[float]) -> xr.Dataset:
    """Return a run in which each drive has one current, and so on."""
    time = np.arange(0.0, 0.2, 1e-3)
    wide = {
        f"drive_{name}": (("drive", "time"), np.outer(values, np.ones(time.size)))
        for name, values in rows.items()
    }
    return xr.Dataset(wide, {"time": time, "drive": ["1", "2", "3"][: len(rows["current"])]})


PHASORS = run_of(current=[1.0, 0.8], power=[300.0, 0.0], apparent_power=[500.0, 400.0])


@pytest.mark.parametrize("rate", [25.0, 50.0, 100.0])
def test_windows_are_rms_and_end_where_they_are_stored(rate: float) -> None:
    run = run_of(current=[0.0])
    time = run["time"].values
    run["drive_current"][0] = np.sin(2.0 * np.pi * 100.0 * time)
    found = monitored(run, Monitoring(rate=rate, current_step=0.0))
    assert found["drive_current"].values == pytest.approx(np.sqrt(0.5), rel=1e-6)
    assert float(found["time"][0]) == pytest.approx(1.0 / rate - 1e-3)
    assert found.sizes["time"] == round(0.2 * rate)


def test_values_end_at_the_range_of_the_system() -> None:
    """A start of 12 A and 6 kW is 10 A and 5 kW in 8 bits; a voltage is that of its supply."""
    run = run_of(current=[-12.0, 1.0], power=[6e3, 220.0], voltage=[-391.04, 220.0])
    found = monitored(run, monitoring_of(rate="zyj7", together=["both=1,2"]))
    alone = monitored(run, monitoring_of(rate="zyj7"))
    assert alone["drive_current"].values[:, 0] == pytest.approx([10.0, 1.02], abs=1e-3)
    assert alone["drive_power"].values[:, 0] == pytest.approx([5e3, 215.7], abs=0.1)
    assert alone["drive_voltage"].values[:, 0] == pytest.approx([391.0, 220.0])
    assert found["drive_voltage"].values[:, 0] == pytest.approx([391.0])


S_380, S_110 = np.sqrt(3.0) * 380.0 * 1.0, np.sqrt(3.0) * 110.0 * 2.0


@pytest.mark.parametrize(
    ("run", "drives", "expected"),
    [
        # P 300 and 0 W, S 500 and 400 V A at 3 U = 500 V: (0.6, 0.8) and (0, 0.8) A
        (PHASORS, "12", {"current": np.hypot(0.6, 1.6), "power": 300.0}),
        (run_of(current=[1.004, -0.5]), "12", {"current": 0.504}),
        # 1 A at 380 V and cos 0.6, 2 A at 110 V and cos 0.8; weighting by S gives 2.93 A
        (
            run_of(
                current=[1.0, 2.0],
                power=[0.6 * S_380, 0.8 * S_110],
                apparent_power=[S_380, S_110],
            ),
            "12",
            {"current": abs((0.6 - 0.8j) + 2.0 * (0.8 - 0.6j))},
        ),
        # 1.768 A rms beside 1.4 A direct: a clamp shows sqrt(1.768^2 + 1.4^2) = 2.2552 A
        (
            run_of(current=[1.768, 1.4], power=[345.0, 308.0], apparent_power=[1163.5, 308.0]),
            "12",
            {"current": np.hypot(1.768, 1.4), "power": 653.0},
        ),
        (
            run_of(
                current=[1.768, 1.0, -0.6],
                power=[345.0, 220.0, -132.0],
                apparent_power=[1163.5, 220.0, 132.0],
            ),
            "23",
            {"current": 0.4, "apparent_power": 88.0},
        ),
    ],
    ids=["phasors", "direct", "other voltages", "direct and alternating", "direct beside one"],
)
def test_motors_in_one_transformer_add_as_phasors(
    run: xr.Dataset, drives: str, expected: dict[str, float]
) -> None:
    """Direct currents add with their signs, and to alternating ones in the squares."""
    found = monitored(run, Monitoring(together={"both": [*drives]}, current_step=0.0))
    assert set(found["drive"].values) == {*run["drive"].values} - {*drives} | {"both"}
    for name, value in expected.items():
        of_both = found[f"drive_{name}"].sel(drive="both").values
        np.testing.assert_allclose(of_both, value, rtol=1e-9)


def test_currents_are_rounded_to_steps() -> None:
    assert monitored(PHASORS)["drive_current"].sel(drive="2").values == pytest.approx(0.8)
    added = monitored(run_of(current=[1.004, -0.5]), Monitoring(together={"both": ["1", "2"]}))
    assert added["drive_current"].values.ravel()[0] == 0.5


@pytest.mark.parametrize(
    ("second", "words"),
    [
        ({"frequency": 60.0, "phase_lost_at": None}, "50 and 60 Hz"),
        ({"frequency": 50.0, "phase_lost_at": 0.1}, "drive 2 loses a phase at 0.1 s"),
        ({"frequency": 50.0, "phase_lost_at": 500.0}, None),
    ],
)
def test_motors_that_do_not_add_up(second: dict[str, float], words: str | None) -> None:
    run = PHASORS.copy()
    first = {"frequency": 50.0, "phase_lost_at": None}
    run.attrs["machine_supplies"] = json.dumps({"1": first, "2": second})
    monitored(run)  # each alone
    together = Monitoring(together={"both": ["1", "2"]})
    if words is None:
        assert monitored(run, together).sizes["drive"] == 1
        return
    with pytest.raises(MeasurementError, match=words):
        monitored(run, together)


@pytest.mark.parametrize("rate", [30.0, 60.0, 75.0, 1000.0])
def test_windows_need_not_be_whole_samples(rate: float) -> None:
    """A ramp: the mean over each window of its square, of samples that stand for 1 ms each."""
    run = run_of(current=[0.0])
    run["drive_current"][0] = 10.0 * (run["time"].values + 1e-3)
    found = monitored(run, Monitoring(rate=rate, current_step=0.0))
    ends = np.arange(1, int(0.2 * rate) + 1) / rate
    begins = ends - 1.0 / rate
    smooth = 10.0 * np.sqrt((ends**3 - begins**3) / 3.0 * rate)
    assert found["time"].values == pytest.approx(ends - 1e-3)
    assert found["drive_current"].values[0] == pytest.approx(smooth, abs=0.0051)


@pytest.mark.parametrize(
    ("monitoring", "words"),
    [
        (Monitoring(rate=0.0), "must be 1 to 1000"),
        (Monitoring(rate=2.0), "the run is shorter than one window, 0.2 of 0.5 s"),
        (Monitoring(together={"a": ["1", "3"]}), "drive 3 is not there"),
        (Monitoring(together={"x": []}), "name its drives in a list"),
        (Monitoring(current_step=-1.0), "current_step = -1 A: must be 0 to 100"),
        (Monitoring(current_step=1e300), "current_step = 1e\\+300 A: must be 0 to 100"),
        (Monitoring(power_step=float("nan")), "power_step = nan W: must be 0 to 100000"),
    ],
)
def test_what_cannot_be_sampled(monitoring: Monitoring, words: str) -> None:
    with pytest.raises(MeasurementError, match=words):
        monitored(run_of(current=[1.0]), monitoring)
    with pytest.raises(MeasurementError, match="drive_current: is missing"):
        monitored(run_of(current=[1.0]).drop_vars("drive_current"))


def test_a_run_of_few_instants() -> None:
    run = run_of(current=[1.0])
    with pytest.raises(MeasurementError, match="the run has 1 instants"):
        monitored(run.isel(time=[0]))
    with pytest.raises(MeasurementError, match=r"what it samples has 100 1/s only"):
        monitored(run.isel(time=slice(None, None, 10)), Monitoring(rate=200.0))


def test_a_transformer_named_as_a_drive_outside_it_loses_nothing() -> None:
    run = run_of(current=[1.0, 0.8])
    with pytest.raises(MeasurementError, match="'1': is the name of a drive outside it"):
        monitored(run, Monitoring(together={"1": ["2"]}))
    both = monitored(run, Monitoring(together={"1": ["1", "2"]}))
    assert list(both["drive"].values) == ["1"]
