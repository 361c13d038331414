"""Signals and labels of throws that lie in one array are those of each throw alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.sweeps import small_study, variables_of

from turnout.calibration.load_study import load_study
from turnout.measurement.chain.recorder import Recorder
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.study.scenario import Scenario
from turnout.study.study import Study
from turnout.study.sweep import row as sweep_row
from turnout.study.sweep import throw_group as alike_throws
from turnout.throw.gaps import split_gaps, split_gaps_of
from turnout.throw.simulate import simulate

BETWEEN_INSTANTS = (0.5012, 0.5016)
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
        *(replace(plain, overrides={"movement.return.start": at}) for at in BETWEEN_INSTANTS),
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
        assert list(variables_of(row)) == list(variables_of(alone))
        for name, (dims, values) in variables_of(row).items():
            assert dims == variables_of(alone)[name][0]
            np.testing.assert_array_equal(values, variables_of(alone)[name][1], err_msg=name)
            assert values.dtype == variables_of(alone)[name][1].dtype
        for name, found in stored.items():
            found.append(variables_of(row)[name][1].tobytes())
    assert len(set(stored["drive_force"])) >= 6, "they would not show an exchange"
    assert len(set(stored["end_locked"])) == 2


def test_throws_whose_movements_differ_in_time_alone_lie_in_one_array(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study, groups = small_study(tmp_path, count=4), list[list[int]]()

    def grouped(runs: list[alike_throws.ThrowSignals]) -> list[list[int]]:
        groups.extend(alike_throws.group_by_layout(runs))
        return alike_throws.group_by_layout(runs)

    monkeypatch.setattr(sweep_row, "group_by_layout", grouped)
    changes = ({}, {"movement.return.start": 0.5}, {"chair.friction_coefficient": 0.3}, {})
    changes += tuple({"movement.return.start": at} for at in BETWEEN_INSTANTS)
    changes += ({"schedule.end": "1.5 s"},)
    sweep_row.throw_scenarios(
        study, [replace(study.scenario(0), overrides=changed) for changed in changes]
    )
    assert groups == [[*range(len(changes))]]


def test_numbers_are_stored_in_single_precision_and_flags_as_they_are() -> None:
    turned = np.arange(6.0).reshape(2, 3).T
    found = alike_throws.single_precision(turned)
    assert (found.dtype, found.flags.c_contiguous) == (np.float32, True)
    np.testing.assert_array_equal(found, turned)
    flags = np.array([True, False])
    kept = alike_throws.single_precision(flags)
    assert kept.dtype == np.bool_
    assert not np.shares_memory(kept, flags), "views would hold all instants in memory"


STUDY = """\
schema_version = 1
name = "two"
panel = "uic60-760-1-15"
[scheme]
mode = "quick"
[sampling]
count = 2
[[variable]]
key = "chair.friction_coefficient"
distribution = "uniform"
minimum = 0.2
maximum = 0.4
[[variable]]
key = "object.size"
values = ["13 mm", "28 mm"]
[[variable]]
key = "object.at"
values = ["drive 2"]
"""


def test_a_sweep_stores_what_a_dataset_of_the_throw_has(tmp_path: Path) -> None:
    path = tmp_path / "two.toml"
    path.write_text(STUDY, encoding="utf-8")
    study = load_study(path)
    scenarios = [study.scenario(number) for number in range(2)]
    for row, scenario in zip(sweep_row.throw_scenarios(study, scenarios), scenarios, strict=True):
        panel = study.panel.with_overrides(dict(scenario.overrides))
        objects = list(scenario.foreign_objects)
        throw = simulate(panel, foreign_object=objects, mode="quick")
        for name in ("drive_gap", "sensor_gap", "drive_force"):
            values = throw[name].to_numpy()[:, ::2]
            np.testing.assert_allclose(variables_of(row)[name][1], values, rtol=1e-6, atol=1e-9)
        for name in ("end_gap", "force_margin", "least_flangeway", "least_gauge", "least_gauge_x"):
            np.testing.assert_allclose(
                variables_of(row)[name][1], throw[name], rtol=1e-9, atol=1e-12
            )
        assert bool(variables_of(row)["end_locked"][1]) == bool(throw["locked"][-1])


def test_gaps_of_many_throws_are_split_as_those_of_each() -> None:
    panel = load_panel("uic60-760-1-15")
    time = np.linspace(0.0, panel.schedule.end, 30)
    gaps = np.random.default_rng(4).random((3, 2 * (len(panel.drive) + len(panel.sensor)), 30))
    starts = np.searchsorted(time, [[0.2 - 1e-9, 4.4 - 1e-9]] * 3)
    cut = [gaps[0], gaps[1], gaps[2][:, :20]]
    together = split_gaps_of(panel, cut, starts, kind=np.float64)
    for number, own in enumerate(cut):
        size = own.shape[1]
        for found, alone in zip(together, split_gaps(panel, own, time[:size]), strict=True):
            np.testing.assert_array_equal(found[number, :, :size], alone)
            assert np.isnan(found[number, :, size:]).all()
    assert not np.array_equal(together[0], gaps[:, :2])
