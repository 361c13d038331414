"""What a run means in plain words: one small dataset a case, and a simulated throw."""

import json
from itertools import product

import numpy as np
import pytest
import xarray as xr
from tests.unit.simulated import sb2_dataset

from turnout.metric.finding import findings

OBJECT = json.dumps([{"size": 0.013, "place": "sleeper 6", "x": 3.6, "rail": "straight"}])


def ended(*, locked: bool, control: bool, touched: bool | None = None) -> xr.Dataset:
    """Return a run of two instants that ended so; touched is None where nothing was trapped."""
    dataset = xr.Dataset(
        {
            "locked": ("time", [False, locked]),
            "in_control": (("sensor", "time"), [[False, control]]),
            "sensor_gap": (("sensor", "time"), [[0.1, 0.012 if control else 0.02]]),
        },
        {"time": [0.0, 1.0], "sensor": ["TKK1"], "sensor_limit": ("sensor", [0.013])},
    )
    if touched is None:
        return dataset
    dataset = dataset.assign(object_touched=touched, contact_time=0.5 if touched else np.nan)
    return dataset.assign_attrs(foreign_objects=OBJECT)


def kept(*, locked: bool, control: bool, touched: bool | None = None) -> xr.Dataset:
    """Return the same with slips, without which a run is not judged."""
    run = ended(locked=locked, control=control, touched=touched).assign_coords(drive=["1"])
    return run.assign(drive_slipping=(("drive", "time"), [[False, False]]))


@pytest.mark.parametrize(
    ("dataset", "level", "answer", "words"),
    [
        (kept(locked=True, control=True), "good", "Sound", "the switch locks"),
        (kept(locked=False, control=True), "bad", "Not locked", "the lock is refused"),
        (kept(locked=True, control=True, touched=True), "bad", "Undetected object", "13 mm at s"),
        (kept(locked=False, control=True, touched=True), "good", "Object detected", "the lock is"),
        (kept(locked=True, control=False, touched=True), "good", "Object detected", "TKK1"),
        (kept(locked=True, control=True, touched=False), "look", "Object never touched", "locks"),
        (ended(locked=True, control=True, touched=True), "look", "Not judged", "has no slip"),
    ],
)
def test_the_headline(dataset: xr.Dataset, level: str, answer: str, words: str) -> None:
    first = findings(dataset)[0]
    assert (first.level, first.answer) == (level, answer)
    assert words in first.detail


def test_a_gap_is_reported_with_its_distance_from_the_limit() -> None:
    (control,) = [
        f for f in findings(ended(locked=True, control=False)) if "control?" in f.question
    ]
    assert control.detail == "TKK1 gap 20.00 of 13 mm, 7.00 over"


def test_a_slip_is_reported_with_drive_time_and_cause() -> None:
    dataset = ended(locked=False, control=False, touched=True)
    dataset = dataset.assign_coords(drive=["2"], drive_x=("drive", [6.9]))
    dataset["drive_slipping"] = (("drive", "time"), [[False, True]])
    slipped = next(f for f in findings(dataset) if f.question == "Did a drive slip?")
    assert slipped.answer == "Yes, drive 2"
    assert slipped.detail == "drive 2 at x = 6.9 m from t = 1.000 s, after an object was touched"


def test_what_a_measurement_cannot_answer_is_left_out() -> None:
    forces = xr.Dataset({"drive_force": (("drive", "time"), [[0.0, 1.0]])}, {"time": [0.0, 1.0]})
    assert [item.answer for item in findings(forces)] == ["Not judged"]
    assert findings(forces.isel(time=[]))[0].answer == "Nothing to judge"


def test_a_run_that_ended_early_says_so_first() -> None:
    dataset = ended(locked=True, control=True).assign_attrs(complete=False, outcome_message="no")
    assert findings(dataset)[0].detail == "no; what follows holds until then"


def test_a_simulated_throw_agrees_with_its_labels() -> None:
    dataset = sb2_dataset()
    reported = {item.question: item for item in findings(dataset)}
    assert (reported["Locked?"].answer == "Yes") == bool(dataset["locked"][-1])
    peak = float(dataset["object_force"].max()) / 1e3
    assert reported["Force on the object"].detail.endswith(
        f"{peak:.2f} kN at most (the peak of a blow is off by up to 4 %)"
    )


def test_no_check_is_good_that_lets_an_object_pass() -> None:
    for made, (touched, level) in product((ended, kept), ((True, "look"), (None, "good"))):
        reported = {
            f.question: f for f in findings(made(locked=True, control=True, touched=touched))
        }
        assert {reported["Locked?"].level, reported["In control?"].level} == {level}
