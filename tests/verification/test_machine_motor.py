"""Motors against closed forms: start, steady points, supply, line and temperature.

The start of an unloaded permanent-magnet motor is a linear equation of second order; steady points
of all motors are roots of one polynomial, see `machines.py`.
"""

import numpy as np
import pytest
from tests.verification.machines import (
    PEAK_CURRENT,
    PEAK_TIME,
    bare_motor,
    start_current,
    steady_current,
)

from turnout.machine.machine_file import load_machines
from turnout.machine.steady import shaft_travel, slip_point, steady_point, torque_for
from turnout.throw.machine import MachineThrow, throw_one_mass

SLIPPING = {"rail.object_size": 0.1, "throw.duration": 2.0}


def started(*, duration: float, step: float, **motor: float) -> MachineThrow:
    timing = {
        "throw.duration": duration,
        "throw.step": step,
        "throw.output_interval": step,
    }
    return throw_one_mass("sb3", overrides=bare_motor(**motor) | timing)


def test_peak_of_the_start() -> None:
    thrown = started(V=220, R=15, L=0.15, k=0.99, J=2e-3, duration=0.03, step=5e-6)
    peak = thrown["current"].argmax()
    around = slice(peak - 1, peak + 2)
    curve = np.polyfit(thrown.time[around] - thrown.time[peak], thrown["current"][around], 2)
    offset = -curve[1] / (2 * curve[0])
    assert np.polyval(curve, offset) == pytest.approx(PEAK_CURRENT, rel=1e-4)
    assert thrown.time[peak] + offset == pytest.approx(PEAK_TIME, rel=1e-4)


def test_random_starts() -> None:
    generator = np.random.default_rng(20)
    damped = 0
    for _ in range(12):
        R, L = generator.uniform(2, 30), np.exp(generator.uniform(np.log(5e-3), np.log(0.3)))
        k, J = generator.uniform(0.2, 2.0), np.exp(generator.uniform(np.log(3e-4), np.log(2e-2)))
        damped += k * k / (J * L) < (R / (2 * L)) ** 2
        fastest = max(np.abs(np.roots([L, R, k * k / J])))
        step, count = 8e-4 / fastest, 6000
        motor = {"V": 220.0, "R": R, "L": L, "k": k, "J": J}
        thrown = started(duration=step * count, step=step, **motor)
        exact = start_current(thrown.time, **motor)
        assert np.abs(thrown["current"] - exact).max() <= 1e-6 * exact.max()
    assert 2 <= damped <= 10


@pytest.mark.parametrize("kind", ["permanent magnet", "series", "separate field"])
def test_steady_points(kind: str) -> None:
    generator = np.random.default_rng(3)
    for _ in range(8):
        changes: dict[str, object] = {
            "motor.voltage": generator.uniform(180, 260),
            "motor.loss_torque": generator.uniform(0.2, 0.8),
            "motor.drag": generator.uniform(0, 2e-4),
            "clutch.torque": generator.uniform(0.5, 1.5),
            "circuit.time_out": 20.0,
            "throw.duration": 6.0,
            "throw.step": 1e-3,
            "rail.object_size": 0.1,
        }
        if kind == "series":
            changes |= {
                "motor.kind": kind,
                "motor.constant": None,
                "motor.field_constant": generator.uniform(0.8, 1.4),
                "motor.saturation_current": generator.uniform(1, 5),
            }
        if kind == "separate field":
            changes |= {
                "motor.kind": kind,
                "motor.constant": None,
                "motor.field_constant": 2.0,
                "motor.field_resistance": 400.0,
            }
        loaded = load_machines("sb3", overrides=changes)
        machine = loaded.machine["sb3"]
        thrown = throw_one_mass(loaded)
        if kind == "separate field":
            current = slip_point(machine).current
            k = 2.0 * machine.motor.voltage / 400.0
            speed = (machine.motor.voltage - 2 - 15 * current) / k
            torque = machine.motor.loss_torque + machine.clutch.torque + machine.motor.drag * speed
            assert k * current == pytest.approx(torque, rel=1e-9)
        else:
            load = machine.motor.loss_torque + machine.clutch.torque
            current = steady_current(machine, torque=load, viscous=machine.motor.drag)
        assert thrown["lead_current"][-1] == pytest.approx(current, rel=1e-6)
        assert slip_point(machine).current == pytest.approx(current, rel=1e-9)


SUPPLIES = {
    "rated": {},
    "supply -20 %": {"supply.voltage": 0.8 * 220},
    "supply +20 %": {"supply.voltage": 1.2 * 220},
    "line 0": {"supply.line_resistance": 0.0},
    "line 20": {"supply.line_resistance": 20.0},
    "line 54": {"supply.line_resistance": 54.0},
    "-25 degC": {"motor.temperature": 248.15},
    "40 degC": {"motor.temperature": 313.15},
}


@pytest.mark.parametrize(
    ("name", "supply"),
    [*(("jea73", supply) for supply in SUPPLIES), ("zd6", "rated"), ("zd6", "supply -20 %")],
)
def test_supply_line_and_temperature(name: str, supply: str) -> None:
    changes = dict(SUPPLIES[supply])
    if name == "zd6" and "supply.voltage" in changes:
        changes["supply.voltage"] = float(changes["supply.voltage"]) * 160 / 220
    force = 2000.0
    constant_load = {
        "rail.friction_force": force,
        "rail.friction_at_start": 0.0,
        "rail.mass": 1.0,  # so light that nothing rings
        "rail.damping": 2000.0,
        "rail.bed_stiffness": 0.0,
        "throw.duration": 12.0,
        "circuit.time_out": 12.0,
    }
    loaded = load_machines(name, overrides=changes | constant_load)
    machine = loaded.machine[name]
    thrown = throw_one_mass(loaded)
    middle = 0.5 * (thrown["rod_position"].min() + thrown["rod_position"].max())
    at = np.searchsorted(thrown["rod_position"], middle)
    load = machine.motor.loss_torque + torque_for(machine, force)
    travel, damping = shaft_travel(machine), 2000.0  # the rail's damper, at the shaft
    viscous = machine.motor.drag + machine.gear.drag
    viscous += damping * travel**2 / machine.gear.efficiency
    exact = steady_current(machine, torque=load, viscous=viscous)
    assert thrown["lead_current"][at] == pytest.approx(exact, rel=1e-3)
    point = steady_point(machine, torque=torque_for(machine, float(thrown["rod_force"][at])))
    assert thrown["speed"][at] == pytest.approx(point.speed, rel=1e-3)
    slipping = throw_one_mass(loaded.with_overrides({"rail.object_size": 0.05}))
    assert slipping["lead_current"][-200] == pytest.approx(slip_point(machine).current, rel=1e-3)
