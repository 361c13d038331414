"""Steady points of a machine in closed form: current, speed and power under a constant force."""

import math
from dataclasses import dataclass

from turnout.machine.components import Machine
from turnout.machine.rows import (
    copper_factor,
    motor_constant,
    separate_field_current,
    supply_voltage,
)


@dataclass(frozen=True, slots=True)
class SteadyPoint:
    """Current of the motor [A], speed of the shaft [rad/s] and power from the supply [W]."""

    current: float
    speed: float
    power: float


def circuit_resistance(machine: Machine) -> float:
    """Return the resistance of copper, line and supply together [ohm]."""
    supply = machine.supply
    own = machine.motor.resistance * copper_factor(machine.motor)
    return own + supply.line_resistance + supply.shared_resistance


def constant_at(machine: Machine, current: float) -> float:
    """Return torque per ampere at a current [N m/A]."""
    constant = motor_constant(machine)
    if machine.motor.kind not in ("series", "split field"):
        return constant
    saturation = machine.motor.saturation_current or math.inf
    return constant * current / (1.0 + current / saturation)


def speed_at(machine: Machine, current: float) -> float:
    """Return the steady speed at a current [rad/s]: (V - R i - V_b)/k(i)."""
    left = supply_voltage(machine) - circuit_resistance(machine) * current
    return (left - machine.motor.brush_drop) / constant_at(machine, current)


def steady_point(machine: Machine, *, torque: float, drag: bool = True) -> SteadyPoint:
    """Return the steady point under a torque behind the motor's own friction.

    Parameters
    ----------
    machine : Machine
    torque : float
        At the clutch, beyond dry loss and drag of the motor [N m].
    drag : bool
        Whether the gear's drag is added, as where the clutch sticks.

    Notes
    -----
    k(i) i = T_0 + (c1 + c2) w + torque with V = R i + k(i) w + V_b.
    """
    from scipy.optimize import brentq  # slow to load; sweeps of markers need none

    motor = machine.motor
    viscous = motor.drag + (machine.gear.drag if drag else 0.0)
    most = (supply_voltage(machine) - motor.brush_drop) / circuit_resistance(machine)

    def short(current: float) -> float:
        speed = speed_at(machine, current)
        need = motor.loss_torque + viscous * speed + torque
        return constant_at(machine, current) * current - need

    current = most if short(most) < 0.0 else float(brentq(short, 1e-9 * most, most, xtol=1e-15))
    voltage = supply_voltage(machine)
    power = voltage * (current + separate_field_current(machine))
    return SteadyPoint(current, max(speed_at(machine, current), 0.0), power)


def torque_for(machine: Machine, force: float) -> float:
    """Return the torque at the clutch that a force on the rod asks for, in mid-stroke [N m]."""
    return force * shaft_travel(machine) / machine.gear.efficiency


def shaft_travel(machine: Machine) -> float:
    """Return the rod's travel per shaft angle in mid-stroke [m/rad]."""
    from turnout.machine.compute.rail import rod_position
    from turnout.machine.rows import machine_row, stroke_table

    middle = 0.5 * (machine.stroke.angle or 0.0)
    return rod_position(machine_row(machine), stroke_table(machine.stroke), middle)[1]


def slip_point(machine: Machine) -> SteadyPoint:
    """Return the steady point while the clutch slips."""
    return steady_point(
        machine, torque=machine.clutch.torque * (1 - machine.clutch.worn), drag=False
    )


def steady_lines(machine: Machine) -> list[str]:
    """Return a table of steady points in mid-stroke."""
    slip = slip_point(machine)
    level = machine.clutch.torque * (1.0 - machine.clutch.worn)
    held = level * machine.gear.efficiency / shaft_travel(machine)
    rows = [f"  {'force, kN':>10}{'current, A':>12}{'shaft, rad/s':>14}{'rod, mm/s':>11}{'W':>8}"]
    for share in (0.0, 0.25, 0.5, 0.75):
        force = share * held
        point = steady_point(machine, torque=torque_for(machine, force))
        rod = 1e3 * point.speed * shaft_travel(machine)
        rows.append(
            f"  {force / 1e3:>10.2f}{point.current:>12.4f}{point.speed:>14.1f}{rod:>11.2f}"
            f"{point.power:>8.0f}"
        )
    rows.append(
        f"  the clutch slips at {held / 1e3:.2f} kN with {slip.current:.4f} A, {slip.power:.0f} W"
    )
    return rows
