"""Rows of throws with causes: what changes is what was meant to change."""

import numpy as np
import pytest

from turnout.detection.reference import reference_study
from turnout.detection.training_plan import DEFECTS, Population
from turnout.detection.training_sets import Counts, after_history, training_plans


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


def test_more_throws_begin_with_the_same_ones() -> None:
    study = reference_study()
    few = training_plans(study, Counts(sound=4, objects=3, defects=2, switches=0))
    more = training_plans(study, Counts(sound=4, objects=4, defects=3, switches=0))
    for name, plan in few.items():
        own, other = plan.study.design.axes[0].rows, more[name].study.design.axes[0].rows
        assert other[: len(own)] == own, name
    assert len(few["dry chairs"].level) == 2 * len(few["clutch"].level)
    assert after_history("object") == "history, object"
