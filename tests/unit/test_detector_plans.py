"""Rows of throws with causes: what changes is what was meant to change."""

import numpy as np
import pytest

from turnout.detection.detector.training_plan import DEFECTS, Population
from turnout.detection.detector.training_sets import Counts, after_history, training_plans
from turnout.detection.reference import reference_study
from turnout.panel.load import load_panel


@pytest.fixture(scope="module")
def population() -> Population:
    return Population(reference_study())


@pytest.mark.parametrize("cause", DEFECTS)
def test_a_cause_changes_its_own_values_alone(population: Population, cause: str) -> None:
    sound = population.row(3)
    row = DEFECTS[cause](sound, np.random.default_rng(4), population)
    changed = [name for name in row if row[name] != sound.get(name, 0.0)]
    key = {
        "dry chairs": "friction_coefficient",
        "adjustment": "over_travel_closed",
        "clutch": "saturation_force",
        "loose rod": "stiffness",
        "frozen blade": "frozen_force",
        "slow drive": "extra_time",
    }[cause]
    assert changed
    assert all(key in name for name in changed)


def test_frozen_chairs_keep_their_force_in_newtons(population: Population) -> None:
    """A factor on the panel's 0 N would freeze nothing."""
    row = DEFECTS["frozen blade"](population.row(0), np.random.default_rng(2), population)
    plan = population.plan("frozen blade", [row])
    frozen = {name: value for name, value in row.items() if name.endswith("frozen_force")}
    assert 50.0 * 0.5 <= max(frozen.values()) <= 400.0
    inputs = plan.study.scenario(0).inputs
    assert all(inputs[name] == value for name, value in frozen.items())
    assert not any(plan.study.variables[name].factor for name in frozen)


def test_machines_wear_their_clutch_and_slow_down_by_their_supply() -> None:
    """The slip level of a machine is that of its clutch, and the motor sets its speed."""
    machines = {"drive.1.machine": "jea73", "drive.2.machine": "jea73-drive2"}
    panel = load_panel("uic60-760-1-15").with_overrides(machines)
    population = Population(reference_study(panel))
    sound = population.row(1)
    plan = population.plan("sound", [sound])
    keys = {name: item.key for name, item in plan.study.variables.items()}
    assert keys["drive.1.saturation_force, defect"] == "machine.jea73.clutch.torque"
    assert {"drive_current", "drive_power"} <= set(plan.study.output.channels)
    row = DEFECTS["slow drive"](sound, np.random.default_rng(1), population)
    changed = {name: row[name] for name in row if row[name] != sound[name]}
    assert changed
    assert all(name.endswith("supply.voltage") for name in changed)
    assert all(0.85 * 220.0 <= value <= 0.97 * 220.0 for value in changed.values())


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
