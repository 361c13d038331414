"""What a sweep says of trapped objects is what the verdict on each throw says."""

import io
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from tests.unit.sweeps import here, small_study, study_file

from turnout.calibration.load_study import load_study
from turnout.metric.sweep_map import STATES, end_state
from turnout.panel.foreign_object import ForeignObject
from turnout.study.sweep.batch import batch_variables
from turnout.study.sweep.batch_bytes import file_bytes
from turnout.study.sweep.read import read_labels
from turnout.study.sweep.row import throw_scenarios
from turnout.study.sweep.run import throw_study
from turnout.throw.simulate import simulate
from turnout.throw.verdict import verdict

STUDY = """
schema_version = 1
name = "objects"
description = "Springs and stones."
panel = "uic60-760-1-15"

[scheme]
mode = "quick"

[[together]]
keys = ["object.size", "object.at", "object.kind", "object.disappears"]
rows = [
    ["0 mm", "sleeper 6", "spring", "20 s"],
    ["10 mm", "sleeper 6", "spring", "20 s"],
    ["10 mm", "sleeper 6", "spring", "7.6 s"],
    ["10 mm", "drive 1", "stone", "20 s"],
    ["18 mm", "sleeper 6", "spring", "20 s"],
    ["113.5 mm", "sleeper 6", "spring", "20 s"],
]
"""


def test_an_object_that_is_gone_is_not_undetected(tmp_path: Path) -> None:
    """One stays; one is taken out after it was touched, and a stone breaks to nothing."""
    study = load_study(study_file(tmp_path, text=STUDY))
    throw_study(study, tmp_path / "sweep", pool=here)
    labels = read_labels(tmp_path / "sweep")
    assert labels["object_touched"].values.tolist() == [0, 1, 1, 1, 1, 0]
    assert labels["object_trapped"].values.tolist() == [0, 1, 0, 0, 1, 0]
    ends = [STATES[state] for state in end_state(labels).values]
    scenarios = [study.scenario(number) for number in range(study.count)]
    alone = [
        verdict(
            simulate(study.panel, foreign_object=item.foreign_objects, scheme=study.scheme)
        ).kind
        for item in scenarios
    ]
    expected = ["sound", "undetected object", "sound", "sound", "detected by TKK", "not judged"]
    assert ends == alone == expected
    assert float(labels["end_locked"].min()) == pytest.approx(1.0)


@pytest.mark.parametrize("kinds", [("spring", "stone"), ("stone", "spring")])
def test_a_history_that_one_of_alike_throws_has_is_stored(
    tmp_path: Path, kinds: tuple[str, str]
) -> None:
    """What is left of a stone has a dimension that a throw with a spring does not have."""
    study = small_study(tmp_path, count=2)
    kept = replace(study.output, channels=("drive_force", "object_left"))
    study = replace(study, output=kept)
    items = [(ForeignObject("13 mm", "drive 1", kind=kind),) for kind in kinds]
    scenarios = [replace(study.scenario(n), foreign_objects=item) for n, item in enumerate(items)]
    rows = throw_scenarios(study, scenarios)
    assert ["object" in row.stored.coordinates for row in rows] == [
        kind == "stone" for kind in kinds
    ]
    with h5py.File(io.BytesIO(file_bytes(batch_variables(study, rows)))) as file:
        left = file["object_left"][...]
    assert np.isnan(left).ravel().tolist() == [kind == "spring" for kind in kinds]


def test_a_sweep_knows_an_object_that_the_other_rail_of_a_pair_reports(tmp_path: Path) -> None:
    """18 mm keep the curved rail open: reported after the movement to open, gone at the end."""
    text = (
        STUDY.partition("[[together]]")[0]
        + """
[set]
"object_defaults.rail" = "curved"
[[together]]
keys = ["object.size", "object.at"]
rows = [["10 mm", "sleeper 6"], ["18 mm", "sleeper 6"]]
"""
    )
    study = load_study(study_file(tmp_path, text=text))
    throw_study(study, tmp_path / "sweep", pool=here)
    labels = read_labels(tmp_path / "sweep")
    ends = [STATES[state] for state in end_state(labels).values]
    assert ends == ["undetected object", "detected by TKK"]
    assert labels["end_locked"].values.tolist() == [1, 1]
