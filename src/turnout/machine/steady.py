"""Steady points of a machine in closed form: current, speed and power under a constant force."""

import math

from turnout.core.lru_cache import LRUCache
from turnout.machine.components import Machine
from turnout.machine.motor_kind import SteadyPoint, motor_row, nominal_voltage


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
    k(i) i = T_0 + (c1 + c2) w + torque with V = R i + k(i) w + V_b. An induction motor is on the
    branch above its breakdown speed, or stands.
    """
    viscous = machine.motor.drag + (machine.gear.drag if drag else 0.0)
    row = motor_row(machine.motor, machine.supply)
    return machine.motor.of_kind.steady_point(row, torque=torque, viscous=viscous)


def torque_for(machine: Machine, force: float) -> float:
    """Return the torque at the clutch that a force on the rod asks for, in mid-stroke [N m]."""
    return force * shaft_travel(machine) / machine.gear.efficiency


def shaft_travel(machine: Machine) -> float:
    """Return the rod's travel per shaft angle in mid-stroke [m/rad]."""
    if machine.stroke.kind == "screw":
        return 1.0 / (machine.stroke.ratio or math.inf)
    from turnout.machine.compute.machine_step import rod_position
    from turnout.machine.rows import machine_row, stroke_table

    middle = 0.5 * (machine.stroke.angle or 0.0)
    return rod_position(machine_row(machine), stroke_table(machine.stroke), middle)[1]


def clutch_force(machine: Machine) -> float:
    """Return the force on the rod at which the clutch slips, in mid-stroke [N]."""
    return machine.clutch.slip_torque * machine.gear.efficiency / shaft_travel(machine)


def supply_slopes(machine: Machine, *, force: float) -> tuple[SteadyPoint, float, float]:
    """Return the point under a force, and the slopes of its current with voltage and load.

    Parameters
    ----------
    machine : Machine
        Whose motor does not stall there.
    force : float
        On the rod, in mid-stroke [N].

    Returns
    -------
    SteadyPoint
    per_volt : float
        Rise of the current with the voltage of the supply at the same active power [A/V].
    per_watt : float
        Rise of the current with the active power, by the load, at the same voltage [A/W].

    Examples
    --------
    >>> from turnout.machine.machine_file import load_machines
    >>> machine = load_machines("three-phase").machine["three-phase"]
    >>> _, per_volt, per_watt = supply_slopes(machine, force=1500.0)
    >>> round(1e3 * per_volt), round(1e5 * per_watt)
    (26, -57)
    """
    supply, voltage = machine.supply, nominal_voltage(machine.motor, machine.supply)

    def at(volts: float, load: float) -> SteadyPoint:
        fed = supply.model_copy(update={"voltage": voltage + volts})
        changed = machine.model_copy(update={"supply": fed})
        return steady_point(changed, torque=torque_for(changed, load))

    step, volts = 0.05 * force, 0.005 * voltage
    less, more = at(0.0, force - step), at(0.0, force + step)
    low, high = at(-volts, force), at(volts, force)
    per_watt = (more.current - less.current) / (more.power - less.power)
    rest = high.current - low.current - per_watt * (high.power - low.power)
    return at(0.0, force), rest / (2.0 * volts), per_watt


def slip_point(machine: Machine) -> SteadyPoint:
    """Return the steady point while the clutch slips."""
    return steady_point(machine, torque=machine.clutch.slip_torque, drag=False)


_ranges: LRUCache[tuple[float, float]] = LRUCache(64)
BLIND = 0.10
"""A current that load moves by a smaller share of that at the low end cannot show the load [-]."""


CLEARER = 2.0
"""Power shows load that current does not where load moves it by so much more [-]."""


def load_range(machine: Machine) -> tuple[float, float] | None:
    """Return the changes of current and active power from 10 to 100 % of the load, as shares [-].

    100 % is what the clutch transmits; both are over their values at 10 %. None where the motor
    stalls below that, or runs on two phases from the start.

    Examples
    --------
    >>> from turnout.machine.machine_file import load_machines
    >>> current, power = load_range(load_machines("s700k").machine["s700k"])
    >>> abs(current) < BLIND < power
    True
    """
    level = machine.clutch.slip_torque
    key = (machine.motor, machine.supply, level, machine.gear.drag)
    if machine.supply.phase_lost_at == 0.0:
        return None
    found = _ranges.get(key)
    if found is None:
        low, high = (steady_point(machine, torque=share * level) for share in (0.1, 1.0))
        if low.stalled or high.stalled:
            return None
        found = _ranges.put(key, (high.current / low.current - 1.0, high.power / low.power - 1.0))
    return found


def blind_text(machine: Machine) -> str:
    """Return a warning where the current cannot show the load, otherwise nothing."""
    found = load_range(machine)
    if found is None or not abs(found[0]) < BLIND:
        return ""
    current, power = found
    clear = abs(power) >= max(BLIND, CLEARER * abs(current))
    said = "current cannot show load: use power" if clear else "neither current nor power show load"
    return (
        f"{said} (10 to 100 % of what the clutch transmits moves the "
        f"current by {100 * current:+.0f} %, the active power by {100 * power:+.0f} %)"
    )


def stall_text(machine: Machine) -> str:
    """Return a warning where the motor stalls before the clutch slips, otherwise nothing.

    By the supply as it is, line included.

    Examples
    --------
    >>> from turnout.machine.machine_file import load_machines
    >>> weak = load_machines("s700k", overrides={"supply.voltage": 100.0}).machine["s700k"]
    >>> stall_text(weak)
    'the motor stalls before the clutch slips (breakdown 0.791 N m, clutch 2.1 N m)'
    """
    if not slip_point(machine).stalled:
        return ""
    kind, level = machine.motor.of_kind, machine.clutch.slip_torque
    most = kind.stall_torque(motor_row(machine.motor, machine.supply))
    shown = f"{kind.stall} {most:.3g} N m, clutch {level:.3g} N m"
    return f"the motor stalls before the clutch slips ({shown})"


def steady_lines(machine: Machine) -> list[str]:
    """Return a table of steady points in mid-stroke.

    Those of an induction motor are of three phases; without them where one is lost at the start.
    """
    lost = machine.supply.phase_lost_at
    if lost == 0.0:
        return ["  none: one phase is lost from the start (supply.phase_lost_at = 0 s)"]
    slip, held = slip_point(machine), clutch_force(machine)
    rows = [f"  {'force, kN':>10}{'current, A':>12}{'shaft, rad/s':>14}{'rod, mm/s':>11}{'W':>8}"]
    for share in (0.0, 0.25, 0.5, 0.75):
        force = share * held
        point = steady_point(machine, torque=torque_for(machine, force))
        rod = 1e3 * point.speed * shaft_travel(machine)
        if point.stalled:
            rows.append(f"  {force / 1e3:>10.2f}  stalls, at {point.current:.4f} A")
            continue
        rows.append(
            f"  {force / 1e3:>10.2f}{point.current:>12.4f}{point.speed:>14.1f}{rod:>11.2f}"
            f"{point.power:>8.0f}"
        )
    blind = blind_text(machine)
    rows += [f"  {blind}"] if blind else []
    if not slip.stalled:
        _, per_volt, per_watt = supply_slopes(machine, force=0.25 * held)
        rows.append(
            f"  at {0.25 * held / 1e3:.2f} kN the current rises by {1e5 * per_watt:.0f} mA per "
            f"100 W of load and by {1e3 * per_volt:.1f} mA per volt of supply"
        )
    rows.append(
        f"  {stall_text(machine)}"
        if slip.stalled
        else f"  the clutch slips at {held / 1e3:.2f} kN with {slip.current:.4f} A, "
        f"{slip.power:.0f} W"
    )
    if lost is not None:
        rows.append(f"  all with three phases; one is lost at {lost:g} s")
    return rows
