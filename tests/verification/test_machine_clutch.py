"""Clutch, gear and what holds the rail: closed cycles of one machine on a one-mass rail."""

import numpy as np
import pytest

from turnout.throw.machine import MachineThrow, throw_one_mass

WALL = {"rail.object_size": 0.013, "throw.duration": 3.5, "circuit.time_out": 4.0}
TORQUE, RATIO, EFFICIENCY = 6000 / (5600 * 0.9), 5600, 0.9


def sb3(changes: dict[str, object]) -> MachineThrow:
    return throw_one_mass("sb3", overrides=changes)


@pytest.mark.parametrize("inertia", [1e-8, 1e-7, 2e-6, 1e-5])
def test_force_held_by_the_standing_gear(inertia: float) -> None:
    """Between N eta T_s, where it would creep on, and N T_s / eta, where it is thrown back."""
    wall = WALL | {"gear.inertia": inertia, "throw.duration": 6.0, "circuit.time_out": 5.5}
    thrown = sb3(wall)
    at = np.searchsorted(thrown.time, 5.5)
    force = thrown["rod_force"][at]
    assert RATIO * EFFICIENCY * TORQUE <= force <= RATIO * TORQUE / EFFICIENCY
    # heavier parts behind the clutch overshoot more (6046 N for none, 6372 N for 1e-5: SB3)
    expected = {1e-8: 6046, 1e-7: 6048, 2e-6: 6111, 1e-5: 6372}[inertia]
    assert force == pytest.approx(expected, rel=2e-3)
    assert thrown["gear_speed"][at] == 0.0


def test_no_creep_while_it_slips() -> None:
    wall = WALL | {"throw.duration": 30.0, "circuit.time_out": 30.0, "throw.step": 1e-3}
    thrown = sb3(wall)
    late = thrown.time > 20.0  # the rail on its rod has rung out
    assert np.ptp(thrown["rod_position"][late]) <= 1e-12
    assert np.ptp(thrown["rail_position"][late]) <= 1e-9
    # all the while the clutch turns
    assert thrown["clutch_slip"][-1] > 4000


def test_slip_is_remembered_over_a_reversal() -> None:
    """Closing against a wall, opening, closing again: the slip stays, the twist is elastic."""
    commands = [
        {"time": 0.1, "direction": "close"},
        {"time": 5.0, "direction": "open"},
        {"time": 10.0, "direction": "close"},
    ]
    thrown = sb3(
        WALL | {"throw.command": commands, "throw.duration": 9.9, "rail.object_size": 0.013}
    )
    slip, time = thrown["clutch_slip"], thrown.time
    held, later = np.searchsorted(time, [4.9, 9.8])
    assert slip[held] > 100
    # 0.08 mm at the rod, when the released rod throws the gear back
    assert abs(slip[later] - slip[held]) / RATIO < 1e-4
    twist = thrown["clutch_torque"] / 5.0
    assert np.abs(twist).max() <= TORQUE / 5.0 * (1 + 1e-9)


def test_breakaway_above_the_slip_torque() -> None:
    thrown = sb3(WALL | {"clutch.static_ratio": 1.25})
    torque = thrown["clutch_torque"]
    assert torque.max() > 1.15 * TORQUE
    slipping = np.searchsorted(thrown.time, 3.4)
    assert torque[slipping] == pytest.approx(TORQUE, rel=1e-9)
    assert thrown.energy_residual <= 1e-6
    assert np.all(np.diff(thrown["energy_clutch"]) >= -1e-12)


def test_heat_lowers_the_level() -> None:
    heated = WALL | {
        "clutch.heat_capacity": 500.0,
        "clutch.temperature_coefficient": -0.01,
        "throw.duration": 6.0,
        "circuit.time_out": 6.0,
    }
    thrown = sb3(heated)
    heat, rise = thrown["energy_clutch"], thrown["clutch_temperature"]
    assert rise[-1] == pytest.approx(heat[-1] / 500.0, rel=1e-9)
    at = np.searchsorted(thrown.time, 5.9)
    assert thrown["clutch_torque"][at] == pytest.approx(TORQUE * (1 - 0.01 * rise[at]), rel=1e-3)
    cooled = sb3(heated | {"clutch.cooling_time": 1.0})
    assert cooled["clutch_temperature"][-1] < 0.7 * rise[-1]


def test_worn_clutch_slips_earlier() -> None:
    fresh = sb3(WALL)
    worn = sb3(WALL | {"clutch.worn": 0.2})
    wearing = sb3(WALL | {"clutch.wear": 2e-4})
    at = np.searchsorted(fresh.time, 3.45)
    assert worn["clutch_torque"][at] == pytest.approx(0.8 * TORQUE, rel=1e-9)
    heat = wearing["energy_clutch"][at]
    assert wearing["clutch_torque"][at] == pytest.approx(TORQUE * (1 - 2e-4 * heat), rel=1e-3)
    assert worn["current"][at] < fresh["current"][at]


def test_what_holds_the_rail() -> None:
    """A lock holds, a self-locking gear holds; without either the closing force drives back."""
    sound = {"throw.duration": 6.0}
    lock = sb3(sound)
    gear = sb3(sound | {"circuit.holding": "gear", "gear.back_efficiency": 0.0})
    brake = sb3(sound | {"circuit.holding": "brake", "motor.brake_torque": 1.0})
    weak = sb3(
        sound
        | {
            "circuit.holding": "brake",
            "motor.brake_torque": 1e-6,
            "motor.loss_torque": 0.05,
            "circuit.after_cutoff": "open",
        }
    )
    for held in (lock, gear, brake):
        late = held.time > 5.0
        assert np.ptp(held["rod_position"][late]) < 1e-9
        assert held["rod_force"][-1] > 2500
    assert weak["rod_force"][-1] < 1000
    assert weak["rod_position"][-1] < lock["rod_position"][-1] - 1e-3


def test_strokes_with_unlocking() -> None:
    """A crank and a table move the rod by the same stroke, the table with dwells at both ends."""
    crank = sb3(
        {
            "stroke": {"kind": "crank", "angle": 650.0, "length": 0.12, "start": -0.117},
            "circuit.limit_closing": 2.9e-3,
            "throw.duration": 6.0,
        }
    )
    assert crank.outcome == "limit"
    assert crank.energy_residual <= 1e-6
    assert crank["rod_position"].max() <= 0.003 + 1e-9
    table = throw_one_mass("zd6")
    moving = np.abs(np.diff(table["rod_position"])) > 1e-7
    turning = np.abs(table["gear_speed"][1:]) > 10.0
    assert np.count_nonzero(turning & ~moving) > 200
    assert table["rod_position"][-1] == pytest.approx(0.0, abs=1e-9)


def test_play_of_the_rod() -> None:
    thrown = sb3({"rod.play": 4e-3})
    force = thrown["rod_force"]
    stretch = thrown["rod_position"] - thrown["rail_position"]
    free = np.abs(stretch) < 2e-3 - 1e-12
    assert np.all(force[free] == 0.0)
    assert np.count_nonzero(free) > 20
    assert force[-1] == pytest.approx(750e3 * (stretch[-1] - 2e-3), rel=1e-6)


def test_relay_time_out_and_stall() -> None:
    wall = {"rail.object_size": 0.1, "throw.duration": 3.0}
    relay = sb3(wall | {"circuit.overload_current": 1.9, "circuit.overload_time": 0.5})
    assert relay.outcome == "overload"
    # 0.5 s after the current reached 1.9 A for good, not after the inrush
    rising = np.flatnonzero(relay["current"][relay.time > 0.4] >= 1.9)[0] * 1e-3 + 0.401
    assert relay.events[1][0] == pytest.approx(rising + 0.5, abs=2e-3)
    stalled = sb3({"supply.voltage": 4.0, "circuit.time_out": 2.0})
    assert stalled.outcome == "stalled"
    assert stalled["current"][1500] == pytest.approx((4 - 2) / 15, rel=1e-6)


def test_lock_rule_keeps_the_motor_on() -> None:
    """With a gap rule the limit contact does not act before the rail is near."""
    blocked = {"rail.object_size": 8e-3, "circuit.limit_closing": -2.5e-3, "throw.duration": 9.0}
    assert sb3(blocked).outcome == "limit"
    ruled = sb3(blocked | {"circuit.lock_gap": 5e-3})
    assert ruled.outcome == "time-out"
    assert np.abs(ruled["clutch_slip"]).max() > 100


def test_detection_and_delays() -> None:
    thrown = sb3(
        {
            "circuit.detection_open": -0.11,
            "circuit.detection_closed": 1e-3,
            "circuit.cutoff_delay": 0.03,
        }
    )
    texts = [text for _, text in thrown.events]
    assert texts == ["on", "detection opens", "detection closes", "off limit", "locked"]
    plain = sb3({})
    assert thrown.energised_time == pytest.approx(plain.energised_time + 0.03, abs=1e-6)
