"""Random machines, far beyond those that are built: each throw closes its energy balance.

Inertia behind the clutch 1e-8 ... 1e-4 kg m^2, rod 0.2 ... 5 MN/m, eta 0.5 ... 0.98, a quarter with
series motors, lost motion, breakaway above the slip torque, self-locking gears, objects, a closing
and an opening throw, steps of 1 and 4 ms. Steps that do not converge are halved, none is accepted.
"""

from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest
from tests.verification.machines import random_induction_overrides, random_overrides

from turnout.machine.machine_file import load_machines
from turnout.throw.machine import throw_one_mass


def throw_many(
    count: int,
    seed: int,
    draw: Callable[[np.random.Generator], dict[str, object]] = random_overrides,
) -> Counter[str]:
    generator = np.random.default_rng(seed)
    base = load_machines("sb3")
    outcomes: Counter[str] = Counter()
    for number in range(count):
        thrown = throw_one_mass(base.with_overrides(draw(generator)))
        outcomes[thrown.outcome] += 1
        outcomes["halved"] += thrown.halved > 0
        outcomes["slipped"] += np.abs(thrown["clutch_slip"]).max() > 1.0
        assert all(np.isfinite(values).all() for values in thrown.histories.values()), number
        assert thrown.energy_residual <= 1e-6, number
    return outcomes


def test_a_hundred() -> None:
    outcomes = throw_many(100, seed=21)
    assert outcomes["limit"] > 10
    assert outcomes["time-out"] > 10
    assert outcomes["slipped"] > 10


def test_forty_induction_motors() -> None:
    outcomes = throw_many(40, 28, random_induction_overrides)
    assert outcomes["limit"] + outcomes["time-out"] > 20


@pytest.mark.long
def test_two_thousand() -> None:
    outcomes = throw_many(2000, seed=2000)
    print(dict(outcomes))
    assert outcomes["limit"] + outcomes["time-out"] > 1000


def test_steps_are_halved_where_a_motor_excites_itself() -> None:
    """A series motor without saturation, reversed at speed: its current grows within a step."""
    reversed_at_speed = {
        "motor.kind": "series",
        "motor.constant": None,
        "motor.field_constant": 1.155,
        "motor.inertia": 1e-2,
        "throw.step": 4e-3,
        "throw.output_interval": 4e-3,
        "throw.duration": 3.0,
        "throw.command": [
            {"time": 0.1, "direction": "close"},
            {"time": 1.2, "direction": "open"},
        ],
    }
    thrown = throw_one_mass("sb3", overrides=reversed_at_speed)
    assert thrown.halved > 0
    assert thrown.energy_residual <= 1e-6
    assert np.isfinite(thrown["current"]).all()
