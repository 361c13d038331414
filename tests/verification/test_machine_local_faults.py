"""Faults that act at a part of the stroke or of a turn: a dry gear, a brush of poor contact.

Reference: steady motion of a permanent-magnet motor, k i = T_0 + (c1 + c2) w + F/(N eta), with the
efficiency of the place and what accelerates the motor; a brush that never has good contact is a
resistance in the circuit.
"""

import numpy as np
import pytest

from turnout.core.errors import MachineError
from turnout.machine.machine_file import load_machines
from turnout.throw.machine import MachineThrow, throw_one_mass

RATIO, DRY_FROM, DRY_TO = 0.5, -0.060, -0.035
"""There the bed is pressed and the rail slides, so that the rod is pushed."""
DRY = {"gear.dry_ratio": RATIO, "gear.dry_from": DRY_FROM, "gear.dry_to": DRY_TO}


def efficiency(thrown: MachineThrow, inside: np.ndarray) -> np.ndarray:
    """Return eta of the balance of torques at some instants."""
    machine = load_machines("sb3").machine["sb3"]
    motor, gear = machine.motor, machine.gear
    speed = thrown["speed"]
    inertia = motor.inertia + gear.inertia
    torque = (motor.constant or 0.0) * thrown["current"] - motor.loss_torque
    torque -= (motor.drag + gear.drag) * speed + inertia * np.gradient(speed, thrown.time)
    return np.asarray(thrown["rod_force"] / (machine.stroke.ratio or 1.0) / torque)[inside]


def test_a_gear_that_is_dry_on_a_part_of_the_stroke() -> None:
    thrown = throw_one_mass("sb3", overrides=DRY)
    x = thrown["rod_position"]
    within = (x > DRY_FROM + 0.008) & (x < DRY_TO - 0.002)
    after = (x > DRY_TO + 0.008) & (x < -0.002)
    assert np.median(efficiency(thrown, within)) == pytest.approx(RATIO * 0.9, rel=5e-3)
    assert np.median(efficiency(thrown, after)) == pytest.approx(0.9, rel=5e-3)
    assert thrown.energy_residual < 1e-9
    sound = throw_one_mass("sb3")
    lost = thrown["energy_gear"][-1] - sound["energy_gear"][-1]
    force = np.interp(np.linspace(DRY_FROM, DRY_TO, 500), x, thrown["rod_force"])
    work = float(force.mean()) * (DRY_TO - DRY_FROM)
    assert lost == pytest.approx(work * (1.0 / (RATIO * 0.9) - 1.0 / 0.9), rel=0.03)


def test_a_dry_part_without_loss_changes_no_bit() -> None:
    sound = throw_one_mass("sb3")
    same = throw_one_mass("sb3", overrides=DRY | {"gear.dry_ratio": 1.0})
    assert np.array_equal(same["current"], sound["current"])


def test_a_brush_that_never_has_good_contact_is_a_resistance() -> None:
    never = throw_one_mass(
        "sb3", overrides={"motor.contact_loss": 1.0, "motor.contact_resistance": 4.0}
    )
    known = throw_one_mass("sb3", overrides={"motor.resistance": 17.0})
    np.testing.assert_allclose(never["current"], known["current"], rtol=1e-9, atol=1e-12)
    heat = never["energy_copper"][-1] + never["energy_brush"][-1]
    assert heat == pytest.approx(known["energy_copper"][-1] + known["energy_brush"][-1], rel=1e-9)
    assert never.energy_residual < 1e-9


def test_a_brush_loses_contact_once_a_turn() -> None:
    share, resistance = 0.1, 60.0
    overrides = {"motor.contact_loss": share, "motor.contact_resistance": resistance}
    thrown = throw_one_mass("sb3", overrides=overrides | {"throw.output_interval": 1e-4})
    x, time, current = thrown["rod_position"], thrown.time, thrown["current"]
    drop = 2.0 * float(np.sum(np.abs(current[1:]) * np.diff(time)))
    heat = thrown["energy_brush"][-1] - drop
    turns = x * 5600.0 / (2.0 * np.pi)  # the clutch holds and twists by less than a tenth of a turn
    poor = (turns - np.floor(turns)) < share
    expected = resistance * float(np.sum(current[1:] ** 2 * poor[1:] * np.diff(time)))
    assert heat == pytest.approx(expected, rel=0.25)
    steady = (x > -0.10) & (x < -0.05)
    falls = np.flatnonzero(np.diff(np.sign(np.diff(current[steady]))) > 0).size
    assert falls == pytest.approx(0.05 * 5600.0 / (2.0 * np.pi), abs=3)
    assert thrown.energy_residual < 1e-9


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        ({"gear.dry_ratio": 0.5}, "needs dry_from and dry_to"),
        (DRY | {"gear.dry_to": -0.07}, "dry_to must be more than dry_from"),
        ({"motor.contact_loss": 1.5}, "at most 1"),
    ],
)
def test_what_cannot_be_is_refused(overrides: dict[str, float], said: str) -> None:
    with pytest.raises(MachineError, match=said):
        load_machines("sb3").with_overrides(overrides)
