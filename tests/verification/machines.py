"""Machines for tests: closed forms of motors, and random machines far beyond those built."""

from typing import Any

import numpy as np
from scipy.optimize import brentq

from turnout.core.units import SI
from turnout.machine.components import Machine
from turnout.machine.compute import places as at
from turnout.machine.compute.machine_step import MachineArrays
from turnout.machine.motor_kind import Motor, Supply, motor_row
from turnout.machine.rows import machine_room

PEAK_CURRENT, PEAK_TIME = 10.295559, 18.264424e-3
"""Of the start of a bare motor with V 220, R 15, L 0.15, k 0.99, J 2e-3: closed form."""


def start_current(
    time: np.ndarray, *, V: float, R: float, L: float, k: float, J: float
) -> np.ndarray:
    """Current of an unloaded permanent-magnet motor after switching on.

    L i'' + R i' + k^2/J i = 0, i(0) = 0, i'(0) = V/L; both roots may be real (overdamped), complex,
    or nearly equal.
    """
    root = np.sqrt(complex((R / (2 * L)) ** 2 - k * k / (J * L)))
    x = root * time
    sinc = np.where(np.abs(x) < 1e-8, 1.0 + x * x / 6.0, np.sinh(x) / np.where(x == 0, 1.0, x))
    return np.real(V / L * time * np.exp(-R / (2 * L) * time) * sinc)


def bare_motor(*, V: float, R: float, L: float, k: float, J: float) -> dict[str, object]:
    """Overrides of `sb3` that leave a motor alone: no friction, nothing behind the clutch."""
    return {
        "motor.voltage": V,
        "motor.resistance": R,
        "motor.inductance": L,
        "motor.constant": k,
        "motor.inertia": J,
        "supply.line_resistance": 0.0,
        "motor.brush_drop": 0.0,
        "motor.loss_torque": 0.0,
        "motor.drag": 0.0,
        "gear.drag": 0.0,
        "gear.inertia": 1e-15,
        "clutch.torque": 1e-13,
        "clutch.stiffness": 1e-12,
        "rail.friction_force": 0.0,
        "rail.bed_stiffness": 0.0,
        "circuit.contactor_delay": 0.0,
        "throw.command": [{"time": 0.0, "direction": "close"}],
    }


def steady_current(machine: Any, *, torque: float, viscous: float) -> float:
    """Current at which k(i) i = torque + viscous w, written out apart from the program."""
    motor, supply = machine.motor, machine.supply
    R = motor.resistance * (1 + 0.0039 * (motor.temperature - 293.15)) + supply.line_resistance
    V = (supply.voltage or motor.voltage) - motor.brush_drop

    def k(i: float) -> float:
        if motor.constant is not None:
            return float(motor.constant)
        saturation = motor.saturation_current or np.inf
        return float(motor.field_constant * i / (1 + i / saturation))

    def balance(i: float) -> float:
        return k(i) * k(i) * i - torque * k(i) - viscous * (V - R * i)

    return float(brentq(balance, 1e-6, V / R, xtol=1e-16))


def random_overrides(generator: np.random.Generator) -> dict[str, object]:
    """Overrides of `sb3` for a random machine, rail and throw."""
    draw = generator.uniform

    def spread(low: float, high: float) -> float:
        return float(np.exp(draw(np.log(low), np.log(high))))

    series = draw() < 0.25
    ratio = spread(2000, 20000)
    efficiency = float(draw(0.5, 0.98))
    force = float(draw(2e3, 9e3))
    voltage = spread(60, 400)
    stall = float(draw(2.0, 6.0)) * force / ratio / efficiency  # torque of the standing motor
    resistance = spread(2, 25)
    current = voltage / resistance
    found: dict[str, object] = {
        "motor.voltage": voltage,
        "motor.resistance": resistance,
        "motor.inductance": resistance * spread(1e-3, 3e-2),
        "motor.brush_drop": float(draw(0, 3)),
        "motor.loss_torque": float(draw(0, 0.3)) * force / ratio,
        "motor.brake_torque": float(draw(0, 3)) * (draw() < 0.5),
        "motor.drag": spread(1e-6, 1e-4),
        "motor.inertia": spread(2e-4, 1e-2),
        "supply.line_resistance": float(draw(0, 1.0)) * resistance,
        "clutch.torque": force / ratio / efficiency,
        "clutch.stiffness": spread(100, 500) * 7.5e5 / ratio**2,
        "clutch.static_ratio": float(draw(1, 1.3)) if draw() < 0.3 else 1.0,
        "gear.inertia": spread(1e-8, 1e-4),
        "gear.drag": spread(1e-6, 1e-4),
        "gear.efficiency": efficiency,
        "stroke.ratio": ratio,
        "rod.stiffness": spread(2e5, 5e6),
        "rod.play": float(draw(0, 3e-3)) if draw() < 0.3 else 0.0,
        "rail.mass": spread(100, 2000),
        "rail.damping": spread(100, 10000),
        "rail.bed_stiffness": float(draw(0, 2e4)),
        "rail.friction_force": float(draw(0, 3000)),
        "circuit.limit_closing": float(draw(-5e-3, 5e-3)),
        "circuit.after_cutoff": "open" if draw() < 0.3 else "short circuit",
        "circuit.time_out": 1.9,
        "circuit.snub_resistance": float(draw(0, 5)) * (draw() < 0.5),
        "throw.command": [{"time": 0.1, "direction": "close"}, {"time": 2.2, "direction": "open"}],
        "throw.duration": 4.5,
        "throw.step": float(generator.choice([1e-3, 4e-3])),
        "throw.output_interval": 4e-3,
    }
    if series:
        saturation = current * float(draw(0.2, 1.0))
        found |= {
            "motor.kind": "series",
            "motor.constant": None,
            "motor.field_constant": 1.2 * stall / current**2 * (1 + current / saturation),
            "motor.saturation_current": saturation,
        }
    else:
        found["motor.constant"] = 1.2 * stall / current + 1.5 * found["motor.loss_torque"] / current
    if draw() < 0.3:
        found["gear.back_efficiency"] = float(draw(0, efficiency))
    if draw() < 0.5:
        found["rail.object_size"] = float(draw(5e-3, 4e-2))
    return found


def random_induction_overrides(generator: np.random.Generator) -> dict[str, object]:
    """Overrides of `sb3` for a random machine with a three-phase motor, rail and throw.

    Half follow the fluxes, half the steady circuit; a fifth lose a phase on the way. The clutch
    slips at a half to a sixth of the breakdown torque.
    """
    draw = generator.uniform

    def spread(low: float, high: float) -> float:
        return float(np.exp(draw(np.log(low), np.log(high))))

    found = random_overrides(generator)
    stator, resistance = spread(0.05, 1.0), spread(0.5, 40.0)
    motor: dict[str, Any] = {
        "kind": "induction",
        "voltage": spread(100.0, 700.0),
        "frequency": float(generator.choice([16.7, 50.0, 60.0])),
        "pole_pairs": int(generator.integers(1, 5)),
        "resistance": resistance,
        "rotor_resistance": resistance * spread(0.3, 3.0),
        "stator_inductance": stator,
        "leakage_inductance": stator * float(draw(0.05, 0.4)),
        "iron_resistance": spread(500.0, 1e4) if draw() < 0.7 else None,
        "inertia": spread(2e-4, 1e-2),
        "drag": spread(1e-6, 1e-4),
        "transient": bool(draw() < 0.5),
    }
    line = float(draw(0.0, 1.0)) * resistance
    record = Motor.model_validate(
        {k: SI(v) if isinstance(v, float) else v for k, v in motor.items()}
    )
    supply = Supply.model_validate({"line_resistance": SI(line)})
    most = record.of_kind.stall_torque(motor_row(record, supply))
    torque = most / float(draw(2.0, 6.0))
    ratio = float(found["clutch.torque"] * found["stroke.ratio"]) / torque  # type: ignore[operator]
    found |= {f"motor.{key}": value for key, value in motor.items()}
    for key in ("inductance", "constant", "field_constant", "saturation_current"):
        found[f"motor.{key}"] = None
    return found | {
        "motor.brush_drop": 0.0,
        "circuit.after_cutoff": "open",
        "circuit.snub_resistance": 0.0,
        "motor.loss_torque": float(draw(0.0, 0.3)) * torque,
        "motor.brake_torque": float(draw(0.0, 1.0)) * torque,
        "supply.line_resistance": line,
        "supply.phase_lost_at": float(draw(0.0, 3.0)) if draw() < 0.2 else None,
        "stroke.ratio": ratio,
        "clutch.torque": torque,
        "clutch.stiffness": spread(100.0, 500.0) * 7.5e5 / ratio**2,
    }


def on_a_rail_without_force(constants: np.ndarray) -> MachineArrays:
    """Arrays of a machine with a screw, on a rail that yields to nothing."""
    room = machine_room(1, events=1)
    room.rails[0, at.RAIL_STEP] = 1.0
    none = np.zeros((0, 2))
    return MachineArrays(
        constants, room.rails[0], np.zeros((2, 5)), none, room.work[0], room.log[0]
    )


def stored_energy(machine: Machine, constants: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Energy in coil, fluxes, inertias and clutch of some states [J]."""
    stores = (
        (at.INDUCTANCE, at.CURRENT),
        (at.MOTOR_INERTIA, at.SPEED),
        (at.GEAR_INERTIA, at.GEAR_SPEED),
        (at.CLUTCH_STIFFNESS, at.TWIST),
    )
    energy = machine.motor.of_kind.field_energies(constants, states)
    for factor, place in stores:
        energy += 0.5 * constants[factor] * states[:, place] ** 2
    return np.asarray(energy)
