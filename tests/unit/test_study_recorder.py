"""Errors of a recorder as variables of a study, and a clock error in a virtual campaign."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.unit.sweeps import STUDY, here, study_file

from turnout.calibration.load_study import load_study
from turnout.core.errors import FileError, StudyError
from turnout.measurement.chain.recorder import ERRORS, Recorder
from turnout.study.sweep.read import open_batches
from turnout.study.sweep.run import throw_study
from turnout.study.virtual.disturbance import QUIET, Disturbance, add_disturbance

ROWS = """
[[together]]
keys = [
    "recorder.gain", "recorder.offset", "recorder.resolution", "recorder.saturation",
    "recorder.clock_rate", "recorder.clock_offset",
]
rows = [
    [1.0, "0 N", "0 N", "0 N", 0.0, "0 s"],
    [1.02, "50 N", "0 N", "0 N", 0.0, "0 s"],
    [1.0, "0 N", "6 N", "0 N", 0.0, "0 s"],
    [1.0, "0 N", "0 N", "0 N", 1e-4, "10 ms"],
    [1.0, "0 N", "0 N", "500 N", 0.0, "0 s"],
]
"""


def test_what_a_recorder_changes_and_what_it_does_not(tmp_path: Path) -> None:
    head, _, _ = STUDY.partition("[[variable]]")
    study = load_study(study_file(tmp_path, text=head + ROWS))
    throw_study(study, tmp_path / "sweep", pool=here)
    made = open_batches(tmp_path / "sweep").load()
    force, time = made["drive_force"].values.astype(float), made["time"].values
    np.testing.assert_allclose(force[1], 1.02 * force[0] + 50.0, rtol=1e-6, atol=1e-3)
    np.testing.assert_allclose(force[2], 6.0 * np.round(force[0] / 6.0), atol=3.001)
    assert np.all(np.abs(force[2] / 6.0 - np.round(force[2] / 6.0)) < 1e-4)
    for drive in range(2):  # between kept instants the true force is not linear
        late = np.interp((time - 0.01) / 1.0001, time, force[0, drive])
        np.testing.assert_allclose(force[3, drive], late, atol=0.02 * np.abs(force[0]).max())
        assert np.abs(force[3, drive] - force[0, drive]).max() > 50.0
    np.testing.assert_allclose(force[4], np.clip(force[0], -500.0, 500.0), atol=1e-3)
    assert np.abs(force[0]).max() > 500.0
    peak = made["peak_force"].sel(direction="closing").values
    np.testing.assert_allclose(peak[1], 1.02 * peak[0] + 50.0, rtol=1e-12)
    for name in ("force_margin", "end_gap", "slipped", "end_locked", "drive_gap", "object_force"):
        values = made[name].values
        assert np.array_equal(values, np.broadcast_to(values[:1], values.shape), equal_nan=True)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ('key = "recorder.clock_rate"\nvalues = [0.0, 0.5]', "0.5: must be -0.01 to 0.01"),
        ('key = "recorder.clock_offset"\nvalues = [0.01]', "has no unit"),
        ('key = "recorder.clock_ofset"\nvalues = ["1 ms"]', "nearest is 'recorder.clock_offset'"),
        (
            'key = "recorder.gain"\nfactor = true\nvalues = [1.0]',
            "no number that can be multiplied",
        ),
        ('key = "object.piece"\nfactor = true\nvalues = [0.5]', "no number that can be multiplied"),
    ],
)
def test_what_a_recorder_cannot_be_is_refused(lines: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=said):
        load_study(study_file(tmp_path, more=f"[[variable]]\n{lines}\n"))


def test_a_virtual_campaign_may_have_a_wrong_clock() -> None:
    """A ramp of 100 N/s that starts at 2 s: 1 % fast and 0.5 s ahead."""
    time = np.arange(10_001) / 1000.0
    ramp = 100.0 * np.maximum(time - 2.0, 0.0)
    true = xr.Dataset({"object_force": ("time", ramp)}, {"time": time})
    wrong = Disturbance(
        drive_force=QUIET.drive_force, drive_current=QUIET.drive_current,
        object_force=QUIET.object_force, cross_talk=0.0, clock_rate=0.01, clock_offset=0.5,
    )  # fmt: skip
    seen = add_disturbance(true, rng=np.random.default_rng(0), disturbance=wrong)["object_force"]
    shown = 2.0 * 1.01 + 0.5
    expected = 100.0 / 1.01 * np.maximum(time - shown, 0.0)
    np.testing.assert_allclose(seen.values, expected, atol=0.1)
    with pytest.raises(FileError, match="clock_rate = 0.1: must be -0.01 to 0.01"):
        Disturbance(clock_rate=0.1)


def test_a_perfect_recorder_has_no_error() -> None:
    perfect = Recorder()
    assert {name: error.none for name, error in ERRORS.items()} == {
        name: getattr(perfect, name) for name in ERRORS
    }
