"""Sweeps over panels whose drives are machines: the same numbers as a single throw gives."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.unit.sweeps import here, variables_of

from turnout.calibration.load_study import load_study
from turnout.core.scheme import Scheme
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.study.sweep import row as sweep_row
from turnout.study.sweep.read import open_batches
from turnout.study.sweep.run import throw_study
from turnout.throw.simulate import simulate

STUDY = """
schema_version = 1
name = "currents"
panel = "uic60-760-1-15"

[set]
"drive.1.machine" = "jea73"
"drive.2.machine" = "jea73-drive2"
"schedule.end" = "13.5 s"

[[variable]]
key = "object.size"
values = ["0 mm", "13 mm"]

[[variable]]
key = "object.at"
values = ["drive 1"]

[[variable]]
key = "machine.jea73.supply.voltage"
values = ["176 V", "220 V"]

[scheme]
mode = "quick"

[output]
channels = ["drive_force", "drive_current", "drive_state", "drive_slipping"]
rate = "25 Hz"
"""


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    folder = tmp_path_factory.mktemp("machines")
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    throw_study(load_study(folder / "study.toml"), folder / "out", pool=here)
    return open_batches(folder / "out").load()


def alone(size: float, voltage: float) -> xr.Dataset:
    machines = {"drive.1.machine": "jea73", "drive.2.machine": "jea73-drive2"}
    more = {"schedule.end": 13.5, "machine.jea73.supply.voltage": voltage}
    panel = load_panel("uic60-760-1-15", overrides=machines | more)
    piece = ForeignObject(size, "drive 1") if size else None
    return simulate(panel, foreign_object=piece, scheme=Scheme.of("quick"))


@pytest.mark.parametrize(("size", "voltage"), [(0.0, 176.0), (0.0, 220.0), (0.013, 220.0)])
def test_a_sweep_stores_what_one_throw_gives(
    swept: xr.Dataset, size: float, voltage: float
) -> None:
    inputs = swept["object.size"].values, swept["machine.jea73.supply.voltage"].values
    place = np.flatnonzero(np.isclose(inputs[0], size) & np.isclose(inputs[1], voltage))
    row, expected = swept.isel(scenario=int(place[0])), alone(size, voltage)
    for name in ("throw_time", "mean_current", "end_current", "force_margin"):
        np.testing.assert_allclose(row[name].values, expected[name].values, rtol=1e-6)
    assert bool(row["end_locked"]) == bool(expected["locked"][-1]) == (size == 0.0)
    assert bool(row["slipped"]) == (size > 0.0)
    for name in ("drive_current", "drive_state", "drive_slipping"):
        at = expected[name].sel(time=row["time"].values, method="nearest")
        np.testing.assert_allclose(row[name].values, at.values, rtol=1e-5, atol=1e-6)


def test_currents_of_one_throw_by_hand() -> None:
    """Mean after the inrush and over the last 0.1 s before the cut-off, from the stored current."""
    run = alone(0.0, 220.0)
    current = np.abs(run["drive_current"].sel(drive="2").values)
    time, state = run["time"].values, run["drive_state"].sel(drive="2").values
    closing = np.flatnonzero((state == 1) & (time > 4.0))
    on, off = time[closing[0]], time[closing[-1]]
    found = run.sel(drive="2", direction="closing")
    mean = current[(time > on + 0.3) & (time < off)].mean()
    end = current[(time > off - 0.1) & (time < off)].mean()
    assert float(found["mean_current"]) == pytest.approx(mean, rel=2e-3)
    assert float(found["end_current"]) == pytest.approx(end, rel=5e-3)


BOTH: dict[str, object] = {"drive.1.machine": "jea73", "drive.2.machine": "jea73-drive2"}
SLOW: dict[str, object] = {"drive.1.machine": "jea73", "machine.jea73.supply.voltage": "150 V"}
LATE: dict[str, object] = {
    "movement.return.start": "8.46 s",
    "movement.return.duration": "0.04 s",
    "movement.return.ramp": "0.01 s",
    "movement.return.extra_time": {"2": 0.0},
}
COURSES: dict[str, tuple[dict[str, object], ForeignObject | None]] = {
    "object taken out while the schedule waits": (
        BOTH,
        ForeignObject("13 mm", "drive 1", disappears="10 s"),
    ),
    "marker beside a machine that is waited for": (SLOW, None),
    "return that is not over": (
        BOTH | LATE,
        None,
    ),
}


@pytest.mark.parametrize("course", COURSES)
def test_a_watched_throw_gives_what_its_whole_history_gives(
    course: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    changes, piece = COURSES[course]
    (tmp_path / "study.toml").write_text(STUDY.replace('"13.5 s"', '"8.5 s"'), encoding="utf-8")
    study = load_study(tmp_path / "study.toml")
    channels = (*study.output.channels, "drive_gap", "sensor_gap", "motor_speed")
    study = replace(study, output=replace(study.output, channels=channels))
    study = replace(study, panel=load_panel("uic60-760-1-15").with_overrides(changes))
    objects = () if piece is None else (piece,)
    scenario = replace(study.scenario(0), overrides={}, foreign_objects=objects)
    (watched,) = sweep_row.throw_scenarios(study, [scenario])
    monkeypatch.setattr(sweep_row, "save_at_of", lambda study, panel: None)
    (whole,) = sweep_row.throw_scenarios(study, [scenario])
    assert watched.outcome == whole.outcome == "complete"
    assert variables_of(watched).keys() == variables_of(whole).keys()
    for name, (_, values) in variables_of(whole).items():
        found = variables_of(watched)[name][1]
        assert found.dtype == values.dtype
        if name in ("drive_gap", "sensor_gap", "end_gap"):
            np.testing.assert_allclose(found, values, rtol=1e-6, atol=1e-12, err_msg=name)
        else:
            np.testing.assert_array_equal(found, values, err_msg=name)
