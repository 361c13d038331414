"""Kinds of objects in studies, labels of throws, and the library studies made of them."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from turnout.calibration.load_study import load_study
from turnout.core.errors import StudyError
from turnout.throw.simulate import simulate

LIBRARY = (
    *("stones", "winter-week", "one-year", "dry-chairs", "worn-clutch", "adjustment-drift"),
    *("switch-states", "in-drive-faults", "measuring-chain"),
)
THROWN = {
    ("none", "", ""),
    ("worn brush", "drive 1", "10 V, 5 ohm"),
    ("worn clutch", "drive 2", "-40 %"),
    ("dry gear", "drive 1", "efficiency 0.6"),
    ("dry part of the gear", "drive 2", "efficiency 0.63 on 40 mm"),
    ("brush contact", "drive 1", "30 ohm, 20 % of a turn"),
    ("backlash", "drive 1", "1 mm"),
}
"""Of in-drive-faults, by cause, place and size."""
HEAD = """
schema_version = 1
name = "kinds"
panel = "uic60-760-1-15"

[[variable]]
key = "object.at"
values = ["sleeper 6"]

[[variable]]
key = "object.size"
values = ["0 mm", "12 mm"]
"""


def variable(name: str, values: str) -> str:
    return f'\n[[variable]]\nkey = "object.{name}"\nvalues = {values}\n'


def study(tmp_path: Path, more: str):
    path = tmp_path / "kinds.toml"
    path.write_text(HEAD + more, encoding="utf-8")
    return load_study(path)


def test_an_object_has_what_belongs_to_its_kind(tmp_path: Path) -> None:
    made = study(
        tmp_path,
        variable("kind", '["snow", "stone"]')
        + variable("density", '["400 kg/m^3"]')
        + variable("piece", "[0.25]"),
    )
    objects = [item.foreign_objects[0] for item in made.scenarios() if item.foreign_objects]
    assert [(item.kind, item.density, item.piece) for item in objects] == [
        ("snow", 400.0, None),
        ("stone", None, 0.25),
    ]
    labels = [item.inputs for item in made.scenarios()]
    assert Counter(item["label.cause"] for item in labels) == {"none": 2, "snow": 1, "stone": 1}
    assert {item["label.size"] for item in labels} == {"", "12 mm"}
    assert {item["label.place"] for item in labels} == {"", "sleeper 6"}


def test_a_study_without_causes_has_no_labels(tmp_path: Path) -> None:
    """And a density alone belongs to no spring, and is left out."""
    made = study(tmp_path, variable("density", '["3 kg/m^3"]'))
    assert made.scenario(1).foreign_objects[0].density is None
    assert "label.cause" not in made.scenario(0).inputs


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (variable("kind", '["icee"]'), "nearest is 'ice'"),
        (variable("strength", "[3]"), "no unit"),
        (
            variable("kind", '["stone", "snow"]') + variable("density", '["3 kg/m^3"]'),
            "must be 50 to 900",
        ),
    ],
    ids=["kind", "unit", "range of the kind"],
)
def test_impossible_kinds_are_refused_before_any_throw(
    tmp_path: Path, more: str, said: str
) -> None:
    with pytest.raises(StudyError, match=said):
        study(tmp_path, more)


@pytest.mark.parametrize("name", LIBRARY)
def test_library_studies_label_their_throws(name: str) -> None:
    made = load_study(name)
    seen = [made.scenario(index) for index in range(min(made.count, 40))]
    for item in seen:
        cause = item.inputs["label.cause"]
        assert cause
        if item.foreign_objects:
            assert cause == item.foreign_objects[0].kind
            assert str(item.inputs["label.size"]).endswith(" mm")
            assert item.inputs["label.place"] == item.foreign_objects[0].at
    causes = {item.inputs["label.cause"] for item in seen}
    expected = {
        "stones": {"stone"},
        "dry-chairs": {"dry chairs"},
        "worn-clutch": {"worn clutch"},
        "adjustment-drift": {"adjustment"},
        "switch-states": {"states of the switch"},
        "measuring-chain": {"none", "spring"},
        "in-drive-faults": {
            *("none", "worn brush", "dry gear", "worn clutch", "backlash"),
            *("dry part of the gear", "brush contact"),
        },
    }
    assert name not in expected or causes == expected[name]


def mean(run: xr.Dataset, channel: str, first: float, last: float) -> float:
    """Return the mean of a channel of Drive 2 while it closes between two places [m]."""
    drive = run.sel(drive="2", time=slice(6.5, None))
    at = drive["drive_displacement"]
    return float(drive[channel].where((at > first) & (at < last)).mean())


def test_throws_of_in_drive_faults_differ_as_the_faults_say() -> None:
    made = load_study("in-drive-faults")
    usual = {
        "machine.supply.voltage": 220.0,
        "machine.supply.line_resistance": 2.0,
        "machine.motor.temperature": 293.15,
        "chair.friction_coefficient": 0.3,
        **{f"machine.{name}.clutch.torque": machine.clutch.torque
           for name, machine in made.panel.machine.items()},
    }  # fmt: skip
    known, thrown = set(), {}
    for item in (made.scenario(index) for index in range(25)):
        inputs = item.inputs
        key = tuple(str(inputs[f"label.{name}"]) for name in ("cause", "place", "size"))
        known.add(key)
        if key not in THROWN:
            continue
        panel = made.panel.with_overrides({**item.overrides, **usual})
        thrown[key] = simulate(panel, mode="quick")
        assert thrown[key].attrs["complete"]
    assert len(known) == 25
    assert thrown.keys() == THROWN
    sound = thrown["none", "", ""]
    assert bool(sound["locked"][-1])
    closing = sound["throw_time"].sel(drive="1")[-1]
    brush = thrown["worn brush", "drive 1", "10 V, 5 ohm"]
    assert brush["throw_time"].sel(drive="1")[-1] > closing + 0.05
    level = sound["saturation_force"]
    clutch = thrown["worn clutch", "drive 2", "-40 %"]["saturation_force"]
    assert np.allclose(clutch / level, [1.0, 0.6])
    gear = thrown["dry gear", "drive 1", "efficiency 0.6"]
    assert np.allclose(gear["saturation_force"] / level, [0.6 / 0.9, 1.0])
    part = thrown["dry part of the gear", "drive 2", "efficiency 0.63 on 40 mm"]
    assert np.allclose(part["saturation_force"], level)  # at home the gear is greased
    machine = made.panel.machine["jea73-drive2"]
    per_newton = 1.0 / (float(machine.stroke.ratio or 0.0) * 0.9 * float(machine.motor.constant))
    for where, lost in (((-0.07, -0.045), 0.7), ((-0.025, -0.005), 1.0)):
        current = [mean(run, "drive_current", *where) for run in (sound, part)]
        force = [mean(run, "drive_force", *where) for run in (sound, part)]
        expected = per_newton * (force[1] / lost - force[0])  # drag falls with the speed
        assert current[1] - current[0] == pytest.approx(expected, abs=0.02)
    spark = thrown["brush contact", "drive 1", "30 ohm, 20 % of a turn"]
    assert spark["throw_time"].sel(drive="1")[-1] > closing + 0.05
    loose = thrown["backlash", "drive 1", "1 mm"]
    assert not np.allclose(loose["drive_force"], sound["drive_force"], atol=50.0)


def test_throws_of_switch_states_are_complete() -> None:
    made = load_study("switch-states")
    for index in range(3):
        thrown = simulate(made.panel.with_overrides(made.scenario(index).overrides), mode="quick")
        assert thrown.attrs["complete"]
        turned_over = float(np.abs(thrown["energy_strain"]).max())
        assert float(np.abs(thrown["energy_residual"]).max()) < 1e-6 * turned_over
