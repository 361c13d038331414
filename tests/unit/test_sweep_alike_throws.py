"""Signals and labels of throws that lie in one array are those of each throw alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.sweeps import small_study

from turnout.measurement.chain.recorder import Recorder
from turnout.panel.foreign_object import ForeignObject
from turnout.study.scenario import Scenario
from turnout.study.study import Study
from turnout.sweep import alike_throws
from turnout.sweep import row as sweep_row

FURTHER = ("drive_force", "drive_slipping", "object_force", "drive_gap", "stop_force")


def _scenarios(study: Study) -> list[Scenario]:
    """Return scenarios that differ in all that throws with the same instants may differ in."""
    plain = study.scenario(0)
    at = {"appears": 0.04, "disappears": 9.0}
    two = (ForeignObject("30 mm", "x = 1.2 m", **at), ForeignObject("40 mm", "x = 0.8 m", **at))
    ice = ForeignObject("45 mm", "x = 1.2 m", kind="ice", **at)
    return [
        plain,
        replace(plain, overrides={"lock.gap_limit": "0.1 mm"}),
        replace(plain, overrides={"lock.rule": "raw gap"}),
        replace(plain, overrides={"drive.1.saturation_force": "300 N"}),
        replace(plain, recorder=Recorder(gain=1.1, offset=20.0, clock_offset=0.01)),
        replace(plain, foreign_objects=two[:1]),
        replace(plain, foreign_objects=two),
        replace(plain, foreign_objects=(ice,)),
        replace(plain, overrides={"drive.1.machine": "sb3"}),
    ]


@pytest.mark.parametrize("channels", [("drive_force", "drive_gap"), FURTHER])
def test_rows_are_those_of_each_throw_alone(tmp_path: Path, channels: tuple[str, ...]) -> None:
    study = small_study(tmp_path, count=2)
    study = replace(study, output=replace(study.output, channels=channels))
    scenarios = _scenarios(study)
    together = sweep_row.throw_scenarios(study, scenarios)
    stored = {name: [] for name in ("drive_force", "object_trapped", "end_locked")}
    for row, scenario in zip(together, scenarios, strict=True):
        (alone,) = sweep_row.throw_scenarios(study, [scenario])
        assert (row.outcome, row.reason) == (alone.outcome, alone.reason) == ("complete", "")
        assert list(row.variables) == list(alone.variables)
        for name, (dims, values) in row.variables.items():
            assert dims == alone.variables[name][0]
            np.testing.assert_array_equal(values, alone.variables[name][1], err_msg=name)
            assert values.dtype == alone.variables[name][1].dtype
        for name, found in stored.items():
            found.append(row.variables[name][1].tobytes())
    assert len(set(stored["drive_force"])) >= 6, "they would not show an exchange"
    assert len(set(stored["end_locked"])) == 2


def test_throws_of_other_movements_do_not_lie_in_one_array(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study, groups = small_study(tmp_path, count=4), list[list[int]]()

    def grouped(runs: list[alike_throws.ThrowSignals]) -> list[list[int]]:
        groups.extend(alike_throws.alike(runs))
        return alike_throws.alike(runs)

    monkeypatch.setattr(sweep_row, "alike", grouped)
    changes = ({}, {"movement.return.start": 0.5}, {"chair.friction_coefficient": 0.3}, {})
    sweep_row.throw_scenarios(
        study, [replace(study.scenario(0), overrides=changed) for changed in changes]
    )
    assert groups == [[0, 2, 3], [1]]


def test_numbers_are_stored_in_single_precision_and_flags_as_they_are() -> None:
    turned = np.arange(6.0).reshape(2, 3).T
    found = alike_throws.single_precision(turned)
    assert (found.dtype, found.flags.c_contiguous) == (np.float32, True)
    np.testing.assert_array_equal(found, turned)
    flags = np.array([True, False])
    kept = alike_throws.single_precision(flags)
    assert kept.dtype == np.bool_
    assert not np.shares_memory(kept, flags), "views would hold all instants in memory"
