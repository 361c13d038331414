"""Rows of throws with causes: what changes is what was meant to change."""

import numpy as np
import pytest
from benchmarks.detection.definition import Switch
from benchmarks.detection.switch_throws import causes_of

from turnout.detection.detector.throw_verdict import advice_on
from turnout.detection.detector.training_plan import Population
from turnout.detection.detector.training_sets import (
    Counts,
    after_history,
    learned_kinds,
    training_plans,
)
from turnout.detection.reference import reference_study
from turnout.figures.detection import trend_sheet
from turnout.panel.load import load_panel
from turnout.study.defects import DEFECTS, Defect, Rng, Row, Switches, trained_changes
from turnout.study.virtual.campaign_plan import virtual_plan


@pytest.fixture(scope="module")
def population() -> Population:
    return Population(reference_study())


@pytest.mark.parametrize("cause", trained_changes())
def test_a_cause_changes_its_own_values_alone(population: Population, cause: str) -> None:
    sound = population.row(3)
    row = trained_changes()[cause](sound, np.random.default_rng(4), population)
    changed = [name for name in row if row[name] != sound.get(name, 0.0)]
    key = {
        "dry chairs": "friction_coefficient",
        "adjustment": "over_travel_closed",
        "clutch": "saturation_force",
        "loose rod": "stiffness",
        "frozen blade": "frozen_force",
        "in-drive": "extra_time",
        "supply": "extra_time",
    }[cause]
    assert changed
    assert all(key in name for name in changed)


def test_frozen_chairs_keep_their_force_in_newtons(population: Population) -> None:
    """A factor on the panel's 0 N would freeze nothing."""
    row = trained_changes()["frozen blade"](population.row(0), np.random.default_rng(2), population)
    plan = population.plan("frozen blade", [row])
    frozen = {name: value for name, value in row.items() if name.endswith("frozen_force")}
    assert 50.0 * 0.5 <= max(frozen.values()) <= 400.0
    inputs = plan.study.scenario(0).inputs
    assert all(inputs[name] == value for name, value in frozen.items())
    assert not any(plan.study.variables[name].factor for name in frozen)


@pytest.mark.parametrize(("cause", "drives"), [("in-drive", 1), ("supply", 2)])
def test_a_fault_within_a_drive_slows_that_one_and_a_weak_supply_all(
    population: Population, cause: str, drives: int
) -> None:
    """In both directions, by the same time."""
    sound = population.row(2)
    for seed in range(6):
        row = trained_changes()[cause](sound, np.random.default_rng(seed), population)
        usual = {"movement.return.extra_time.2": sound["movement.return.extra_time.2"]}
        longer = {
            name: float(row[name]) - float(usual.get(name, 0.0))
            for name in row
            if "extra_time" in name
        }
        slow = {name: value for name, value in longer.items() if abs(value) > 1e-9}
        assert len({name.rsplit(".", 1)[-1] for name in slow}) == drives
        assert len(slow) == 2 * drives
        assert np.ptp(list(slow.values())) < 1e-9
        assert 0.15 <= min(slow.values()) <= 0.6


@pytest.fixture(scope="module")
def machines() -> Population:
    panel = load_panel("uic60-760-1-15").with_overrides(
        {"drive.1.machine": "jea73", "drive.2.machine": "jea73-drive2"}
    )
    return Population(reference_study(panel))


def test_machines_wear_their_clutch_and_slow_down_by_their_supply(machines: Population) -> None:
    """The slip level of a machine is that of its clutch, and the motor sets its speed."""
    sound = machines.row(1)
    plan = machines.plan("sound", [sound])
    keys = {name: item.key for name, item in plan.study.variables.items()}
    assert keys["drive.1.saturation_force, defect"] == "machine.jea73.clutch.torque"
    assert {"drive_current", "drive_power"} <= set(plan.study.output.channels)
    row = trained_changes()["supply"](sound, np.random.default_rng(1), machines)
    changed = {name: row[name] for name in row if row[name] != sound[name]}
    assert set(changed) == {
        "machine.jea73.supply.voltage",
        "machine.jea73-drive2.supply.voltage",
    }
    assert all(0.85 * 220.0 <= value <= 0.97 * 220.0 for value in changed.values())


def test_a_fault_within_a_machine_is_its_gear_or_its_motor(machines: Population) -> None:
    """A dry gear takes torque; a bad motor gets less voltage; the other machine stays as it is."""
    sound, found = machines.row(1), []
    change = trained_changes()["in-drive"]
    rows = [change(sound, np.random.default_rng(seed), machines) for seed in range(20)]
    usual = {"gear.efficiency": 0.9, "motor.loss_torque": 0.745, "supply.voltage": 220.0}
    for row in rows:
        changed = {
            name.removeprefix("machine."): float(row[name]) / value
            for name in row
            for key, value in usual.items()
            if name.endswith(key) and abs(float(row[name]) / value - 1.0) > 1e-9
        }
        (machine,) = {name.split(".")[0] for name in changed}
        found.append((machine, tuple(sorted(name.split(".", 1)[1] for name in changed))))
        if len(changed) == 2:
            assert 0.7 <= changed[f"{machine}.gear.efficiency"] <= 0.94
            assert 1.2 <= changed[f"{machine}.motor.loss_torque"] <= 2.0
    assert {machine for machine, _ in found} == {"jea73", "jea73-drive2"}
    assert {keys for _, keys in found} == {
        ("gear.efficiency", "motor.loss_torque"),
        ("supply.voltage",),
    }
    assert machines.plan("in-drive", rows).study.count == 20


def test_each_kind_is_thrown_with_the_same_objects() -> None:
    plans = training_plans(reference_study(), Counts(sound=4, objects=3, kinds=2, switches=0))
    rows = [dict(zip(plans["object"].study.design.axes[0].names, row, strict=True))
            for row in plans["object"].study.design.axes[0].rows]  # fmt: skip
    for kind in learned_kinds():
        (axis,) = plans[f"object-{kind}"].study.design.axes
        own = [dict(zip(axis.names, row, strict=True)) for row in axis.rows]
        assert own == [{**row, "object.kind": kind} for row in rows[:2]]
        assert plans[f"object-{kind}"].partner.tolist() == [0, 1]


def test_more_throws_begin_with_the_same_ones() -> None:
    study = reference_study()
    few = training_plans(study, Counts(sound=4, objects=3, defects=2, switches=0))
    more = training_plans(study, Counts(sound=4, objects=4, defects=3, switches=0))
    for name, plan in few.items():
        own, other = plan.study.design.axes[0].rows, more[name].study.design.axes[0].rows
        assert other[: len(own)] == own, name
    assert len(few["dry chairs"].level) == 6 * len(few["clutch"].level)
    assert len(few["adjustment"].level) == 2 * len(few["clutch"].level)
    assert after_history("object") == "history, object"


def _bent(row: Row, rng: Rng, population: Switches) -> Row:
    """Let drive 1 be half as stiff."""
    del rng, population
    return {**row, "drive.1.stiffness, defect": 0.5}


def test_a_defect_is_one_row(monkeypatch: pytest.MonkeyPatch) -> None:
    """Training, advice, trend, benchmark and virtual campaigns follow from its row alone."""
    toy = Defect(
        change=_bent, advice="straighten it", times=3, trend=1, slows=1, benchmark=True,
        campaign={"slip_scatter": 0.01},
    )  # fmt: skip
    odds = {"odds": {"toy": 2.0}, "friction": 0.3, "log_ratio": -5.0, "threshold": 4.0}
    before = trend_sheet([odds, odds])
    assert len(before.rows) == 2
    monkeypatch.setitem(DEFECTS, "toy", toy)
    counts = Counts(sound=2, objects=0, defects=4, switches=0)
    plans = training_plans(reference_study(), counts)
    assert plans["toy"].study.count == 12
    assert list(plans)[-1] == "toy"  # what others draw stays as it is
    key = next(v for v in plans["toy"].study.variables.values() if v.name.startswith("drive.1.st"))
    assert key.key == "drive.1.stiffness"
    assert advice_on("toy") == "straighten it"
    assert [line.label for line in trend_sheet([odds, odds]).rows[-1].lines] == ["toy"]
    assert "toy" in causes_of(
        Switch(number=1, panel=0, machines=(), rate=1e3, split="test", phase=0.0)
    )
    plan = virtual_plan(load_panel("sb2"), sizes=["13 mm"], defects=["toy"])
    assert plan.defects.slip_scatter == 0.01
