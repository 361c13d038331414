"""An induction motor that loses one phase: mean torque, current, power, energy, start and stall.

Reference: the Gamma model in the stator's frame with the current of phase a held at zero, whose
periodic answer at constant speed is a phasor per state; no symmetrical components enter it.
"""

import math
from typing import Any

import numpy as np
import pytest
from tests.verification.machines import on_a_rail_without_force, stored_energy
from tests.verification.test_machine_induction import bare, random_motor, reference_motor

from turnout.core.errors import MachineError
from turnout.machine.components import Machine
from turnout.machine.compute import places as at
from turnout.machine.compute.induction import lost_phase_circuit
from turnout.machine.compute.machine_step import accept_step, take_step
from turnout.machine.machine_file import load_machines
from turnout.machine.rows import machine_row
from turnout.throw.machine import throw_one_mass

SUPPLY = 2.0 * math.pi * 50.0


def with_two_phases(machine: Machine, *, since: float = 0.0) -> Machine:
    """Return a machine of which one conductor opens."""
    supply = machine.supply.model_copy(update={"phase_lost_at": since})
    return machine.model_copy(update={"supply": supply})


def state_at(constants: np.ndarray, speed: float) -> np.ndarray:
    """Return a state that turns at a speed with one phase lost."""
    state = np.zeros(at.STATES)
    state[at.ENERGISED], state[at.DIRECTION], state[at.PHASE_LOST] = 1.0, 1.0, 1.0
    state[at.LOCKED], state[at.LEVEL], state[at.GEAR_RATIO] = 1.0, 1e-13, 1.0
    state[at.SPEED] = speed
    return state


def periodic(constants: np.ndarray, speed: float) -> tuple[float, float, float]:
    """Return mean torque, rms current and mean power of the stator frame's periodic answer.

    Unknown are psi_b of the stator and both parts of psi_r; i_a = 0 makes psi_a = g psi_ra. The
    voltage between the two lines drives the b axis.
    """
    l_s, l_l = constants[at.STATOR_INDUCTANCE], constants[at.LEAKAGE_INDUCTANCE]
    r_s = constants[at.RESISTANCE] + constants[at.LINE_RESISTANCE]
    r_r, pairs = constants[at.ROTOR_RESISTANCE], constants[at.POLE_PAIRS]
    g = l_s / (l_s + l_l)
    turned = pairs * speed
    # psi_b' = u - r_s i_b, psi_ra' = -r_r i_ra - turned psi_rb, psi_rb' = -r_r i_rb + turned psi_ra
    i_b = np.array([1.0 / l_s + 1.0 / l_l, 0.0, -1.0 / l_l])
    i_ra, i_rb = np.array([0.0, (1.0 - g) / l_l, 0.0]), np.array([-1.0 / l_l, 0.0, 1.0 / l_l])
    system = np.array([-r_s * i_b, -r_r * i_ra, -r_r * i_rb])
    system[1, 2] -= turned
    system[2, 1] += turned
    voltage = constants[at.PHASE_VOLTAGE]  # of the b axis: sqrt(2) V/sqrt(3), the same
    driven = np.array([voltage, 0.0, 0.0])
    psi = np.linalg.solve(1j * SUPPLY * np.eye(3) - system, driven)
    current = i_b @ psi
    torque = 1.5 * pairs * 0.5 * (current * np.conj(g * psi[1])).real
    return torque, abs(current) * math.sqrt(0.75) / math.sqrt(2.0), 0.75 * voltage * current.real


@pytest.mark.parametrize("speed", [0.0, 40.0, 120.0, 150.0, 157.0])
def test_periodic_answer(speed: float) -> None:
    """Tolerance 1e-9: the same linear circuit by two ways."""
    machine = with_two_phases(bare(reference_motor(), line=4.0))
    constants = machine_row(machine)
    state = state_at(constants, speed)
    torque, current, power = periodic(constants, speed)
    ours = lost_phase_circuit(constants, state, speed)
    assert ours[0] == pytest.approx(current, rel=1e-9)
    assert ours[1] == pytest.approx(torque, rel=1e-9, abs=1e-9)
    assert ours[3] == pytest.approx(power, rel=1e-9)
    found = [float(row[0]) for row in machine.motor.of_kind.powers(constants, state[None])]
    assert found == pytest.approx([power, 400.0 * current], rel=1e-9)
    back = lost_phase_circuit(
        constants, np.where(np.arange(at.STATES) == at.DIRECTION, -1, state), -speed
    )
    assert back == pytest.approx((ours[0], -ours[1], ours[2], ours[3]), rel=1e-9, abs=1e-9)


def test_slope_of_the_torque() -> None:
    machine = bare(reference_motor(iron_resistance=700.0), line=4.0)
    constants = machine_row(machine)
    for speed in (-30.0, 20.0, 100.0, 152.0):
        state = state_at(constants, speed)
        above, below = (lost_phase_circuit(constants, state, speed + d)[1] for d in (1e-3, -1e-3))
        slope = lost_phase_circuit(constants, state, speed)[2]
        assert slope == pytest.approx((above - below) / 2e-3, rel=1e-5)


def marched(machine: Machine, *, step: float, count: int, speed: float, load: float) -> Any:
    """Return states of a motor that turns and has lost a phase, and what it stores."""
    constants = machine_row(machine)
    arrays = on_a_rail_without_force(constants)
    state = state_at(constants, speed)
    state[at.STILL_TORQUE] = load
    kept = [state.copy()]
    for number in range(count):
        left, h = step, step
        while left > 0.0:
            if take_step(arrays, state, number * step, h):
                h *= 0.5
                assert h > 1e-3 * step
                continue
            accept_step(arrays, state, number * step, h)
            left -= h
        kept.append(state.copy())
    states = np.array(kept)
    return states, stored_energy(machine, constants, states)


def test_energy_of_random_motors() -> None:
    """Tolerance 1e-6 of what the supply gives."""
    generator = np.random.default_rng(31)
    for _ in range(40):
        machine = with_two_phases(random_motor(generator))
        speed = float(generator.uniform(0.0, 300.0)) / (machine.motor.pole_pairs or 1)
        load = float(generator.uniform(0.0, 2.0))
        kept, stored = marched(machine, step=2e-4, count=60, speed=speed, load=load)
        sums = kept[-1, at.ENERGIES :]
        places = [at.COPPER, at.LINE, at.FIELD, at.MOTOR_FRICTION, at.MOTOR_DRAG_HEAT]
        residual = sums[at.SUPPLY] - sums[places].sum() - sums[at.INTO_STORES]
        assert abs(residual) <= 1e-6 * sums[at.SUPPLY]
        assert sums[at.INTO_STORES] == pytest.approx(
            stored[-1] - stored[0], abs=0.02 * stored.max()
        )


@pytest.mark.parametrize("transient", [True, False])
def test_throws_of_an_s700k(transient: bool) -> None:
    """From the start it stalls; on the way it goes on, slower, but stops under a heavy load."""
    own = {"motor.transient": transient, "motor.iron_resistance": None}  # the reference has no iron
    base = load_machines("s700k").with_overrides(own)
    sound = throw_one_mass(base)
    assert sound.outcome == "limit"
    # nothing helps it to start: the rod is free of force
    unloaded = {"rail.bed_rest": -0.22, "rail.friction_at_start": 0.0, "throw.duration": 14.0}
    stalled = throw_one_mass(base, overrides=unloaded | {"supply.phase_lost_at": 0.0})
    assert stalled.outcome == "stalled"
    assert stalled.events[0][1] == "phase lost"
    held = stalled.time > 1.0
    _, current, _ = periodic(machine_row(base.machine["s700k"]), 0.0)
    assert stalled["current"][held][:100] == pytest.approx(current, rel=1e-9)
    late = throw_one_mass(base, overrides={"supply.phase_lost_at": 3.0, "throw.duration": 14.0})
    assert late.outcome == "limit"
    assert late.energised_time > sound.energised_time
    before, after = np.interp([2.9, 3.5], late.time, late["current"])
    assert after > 1.2 * before
    heavy = {"rail.friction_force": 4500.0, "supply.voltage": 200.0, "throw.duration": 14.0}
    assert throw_one_mass(base, overrides=heavy).outcome == "limit"
    stopped = throw_one_mass(base, overrides=heavy | {"supply.phase_lost_at": 3.0})
    assert stopped.outcome == "time-out"
    assert stopped["rod_position"][-1] < -0.02
    for run in (stalled, late, stopped):
        assert abs(run.energy_residual) < 1e-6 * run["energy_supply"].max()


def test_what_cannot_be() -> None:
    with pytest.raises(MachineError, match="phase_lost_at: without effect on a permanent magnet"):
        load_machines("jea73", overrides={"supply.phase_lost_at": 1.0})
    both = {"supply.phase_lost_at": 1.0, "supply.shared_resistance": 2.0}
    with pytest.raises(MachineError, match="leave out supply.shared_resistance"):
        load_machines("s700k", overrides=both)
