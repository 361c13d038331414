"""Induction motor: breakdown and steady circuit in closed form, direct start, energy, s700k class.

Reference of the start: two own programs (Gamma, synchronous frame, Radau; inverse-Gamma, stator
frame, DOP853) and motulator 0.18.0 (MIT) agree to 6e-11; every second sample of their answer is
kept in data/induction.npz. Its R_R 2.1, L_sigma 0.021, L_M 0.224 are inverse-Gamma values.
"""

import math

import numpy as np
import pytest
from tests.verification.machines import on_a_rail_without_force, stored_energy
from tests.verification.reference import DATA

from turnout.machine.components import Machine
from turnout.machine.compute import places as at
from turnout.machine.compute.machine_step import accept_step, take_step
from turnout.machine.machine_file import load_machines
from turnout.machine.motor_kind import (
    Motor,
    SteadyPoint,
    breakdown_slip,
    gamma_from_inverse_gamma,
    gamma_point,
    motor_row,
)
from turnout.machine.rows import machine_row
from turnout.machine.steady import steady_point, torque_for
from turnout.throw.machine import throw_one_mass

RESISTANCE, ROTOR, LEAKAGE, MAIN = 3.7, 2.1, 0.021, 0.224
PAIRS, INERTIA, SUPPLY = 2, 0.015, 2.0 * math.pi * 50.0


def reference_motor(**changes: object) -> Motor:
    rotor, stator, leakage = gamma_from_inverse_gamma(
        rotor_resistance=ROTOR, leakage_inductance=LEAKAGE, magnetising_inductance=MAIN
    )
    values: dict[str, object] = {
        "kind": "induction",
        "voltage": 400.0,
        "frequency": 50.0,
        "pole_pairs": PAIRS,
        "resistance": RESISTANCE,
        "rotor_resistance": rotor,
        "stator_inductance": stator,
        "leakage_inductance": leakage,
        "inertia": INERTIA,
    }
    values |= changes
    return Motor.model_validate({k: _si(v) for k, v in values.items()})


def _si(value: object) -> object:
    from turnout.core.units import SI

    return SI(value) if isinstance(value, float) else value


def bare(motor: Motor, *, line: float = 0.0) -> Machine:
    """Return a machine of which the clutch transmits next to nothing."""
    base = load_machines("sb3").machine["sb3"]
    clutch = base.clutch.model_copy(update={"torque": 1e-13, "stiffness": 1e-12})
    supply = base.supply.model_copy(update={"line_resistance": line, "voltage": None})
    return base.model_copy(update={"motor": motor, "clutch": clutch, "supply": supply})


def breakdown(machine: Machine) -> tuple[float, float]:
    """Return slip and torque."""
    row = motor_row(machine.motor, machine.supply)
    return breakdown_slip(row), machine.motor.of_kind.stall_torque(row)


def steady_at(machine: Machine, speed: float) -> tuple[float, SteadyPoint]:
    return gamma_point(motor_row(machine.motor, machine.supply), speed)


def started(
    machine: Machine, *, step: float, end: float, loads: dict[float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return constants, states at every step from a direct start, and stored energies.

    The load is a dry torque, `loads` gives it by the time from which it acts.
    """
    constants = machine_row(machine)
    arrays = on_a_rail_without_force(constants)
    state = np.zeros(at.STATES)
    state[at.ENERGISED], state[at.DIRECTION], state[at.LOCKED] = 1.0, 1.0, 1.0
    state[at.LEVEL], state[at.GEAR_RATIO] = 1e-13, 1.0
    kept = [state.copy()]
    for number in range(round(end / step)):
        time = number * step
        state[at.STILL_TORQUE] = [v for t, v in loads.items() if time >= t - 1e-12][-1]
        left, h = step, step
        while left > 0.0:
            if take_step(arrays, state, time + step - left, h):
                h *= 0.5
                assert h > 1e-3 * step
                continue
            accept_step(arrays, state, time + step - left, h)
            left -= h
        kept.append(state.copy())
    states = np.array(kept)
    return constants, states, stored_energy(machine, constants, states)


def test_inverse_gamma_parameters() -> None:
    motor = reference_motor()
    assert motor.stator_inductance == pytest.approx(0.245, rel=1e-12)
    assert motor.leakage_inductance == pytest.approx(0.02296875, rel=1e-12)
    assert motor.rotor_resistance == pytest.approx(2.512207, rel=1e-6)


def test_breakdown() -> None:
    """Reference: closed form of the benchmark's README; and the top of the circuit's own curve."""
    motor = reference_motor()
    slip, torque = breakdown(bare(motor))
    assert slip == pytest.approx(0.304007148, rel=1e-6)
    assert torque == pytest.approx(42.502448505, rel=1e-6)
    machine = bare(motor.model_copy(update={"iron_resistance": 900.0}), line=5.0)
    slip, torque = breakdown(machine)
    speeds = (1.0 - slip * np.array([0.999, 1.0, 1.001])) * SUPPLY / PAIRS
    below, top, above = (steady_at(machine, float(w))[0] for w in speeds)
    assert top == pytest.approx(torque, rel=1e-9)
    assert below < top > above


def test_steady_circuit() -> None:
    """Reference: the benchmark's circuit at the speed that its start ends with."""
    alone = bare(reference_motor())
    torque, point = steady_at(alone, 152.8597)
    assert point.current == pytest.approx(3.86822, rel=1e-5)
    assert point.power == pytest.approx(1736.88, rel=1e-4)
    assert torque == pytest.approx(10.0, rel=1e-4)


def test_direct_start_with_a_load_step() -> None:
    """Tolerance 0.1 % rms of the peak in every channel."""
    step = 1e-4
    constants, states, _ = started(
        bare(reference_motor()), step=step, end=1.5, loads={0.0: 0.0, 1.0: 10.0}
    )
    time = step * np.arange(len(states))
    power, apparent = reference_motor().of_kind.powers(constants, states)
    current = states[:, at.CURRENT]
    psi_s = states[:, at.STATOR_FLUX] + 1j * states[:, at.STATOR_FLUX_ACROSS]
    psi_r = states[:, at.ROTOR_FLUX] + 1j * states[:, at.ROTOR_FLUX_ACROSS]
    i_s = psi_s / 0.245 + (psi_s - psi_r) / 0.02296875
    ours = {
        "current_abs": math.sqrt(2.0) * current,
        "current_a": np.real(i_s * np.exp(1j * SUPPLY * time)),
        "speed": states[:, at.SPEED],
        "torque": 1.5 * PAIRS * np.imag(i_s * np.conj(psi_s)),
        "power": power,
    }
    with np.load(DATA / "induction.npz") as theirs:
        places = np.rint(theirs["time"] / step).astype(int)
        for name, values in ours.items():
            error = values[places] - theirs[name]
            assert np.sqrt(np.mean(error**2)) <= 1e-3 * np.abs(theirs[name]).max(), name
        reactive = np.sqrt(np.maximum(apparent**2 - power**2, 0.0))[places]
        assert reactive[1:] == pytest.approx(np.abs(theirs["reactive"][1:]), abs=120.0)
    assert np.abs(ours["current_abs"]).max() == pytest.approx(40.748, rel=1e-3)
    assert ours["torque"].max() == pytest.approx(64.16, rel=1e-3)
    assert states[-1, at.SPEED] == pytest.approx(152.8597, rel=1e-6)
    assert current[-1] == pytest.approx(3.86823, rel=1e-5)


def test_order_of_the_step() -> None:
    """Halved steps quarter the error of a start: the scheme is of order 2."""
    ends = [
        started(bare(reference_motor()), step=h, end=0.05, loads={0.0: 0.0})[1][-1, at.STATOR_FLUX]
        for h in (4e-4, 2e-4, 1e-4, 2.5e-5)
    ]
    errors = np.abs(np.array(ends[:3]) - ends[3])
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.25)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.25)


def random_motor(generator: np.random.Generator) -> Machine:
    """Return a motor far from any that is built, with line and iron loss."""
    stator = float(np.exp(generator.uniform(np.log(0.02), np.log(2.0))))
    motor = reference_motor(
        voltage=float(generator.uniform(100.0, 700.0)),
        frequency=float(generator.choice([50.0, 60.0, 16.7])),
        pole_pairs=int(generator.integers(1, 5)),
        resistance=float(np.exp(generator.uniform(np.log(0.3), np.log(60.0)))),
        rotor_resistance=float(np.exp(generator.uniform(np.log(0.3), np.log(60.0)))),
        stator_inductance=stator,
        leakage_inductance=stator * float(generator.uniform(0.05, 0.5)),
        iron_resistance=float(np.exp(generator.uniform(np.log(300.0), np.log(1e4)))),
        inertia=float(np.exp(generator.uniform(np.log(2e-4), np.log(5e-2)))),
        drag=float(generator.uniform(0.0, 1e-3)),
        transient=bool(generator.integers(2)),
    )
    return bare(motor, line=float(generator.choice([0.0, 10.0, 54.0])))


def largest_residual(machine: Machine, *, step: float, end: float, load: float) -> float:
    """Return the largest residual of a start's energy balance over the energy turned over."""
    constants, states, stored = started(machine, step=step, end=end, loads={0.0: load})
    assert np.isfinite(states[:, at.SPEED]).all()
    sums = states[:, at.ENERGIES :]
    lost = sums[:, [at.COPPER, at.LINE, at.FIELD, at.MOTOR_FRICTION, at.MOTOR_DRAG_HEAT]].sum(
        axis=1
    )
    numerical = sums[:, at.INTO_STORES] - (stored - stored[0])
    residual = sums[:, at.SUPPLY] - lost - (stored - stored[0]) - numerical
    return float(np.abs(residual).max() / max(np.abs(sums[:, at.SUPPLY]).max(), 1e-9))


def test_energy_of_random_motors() -> None:
    """Tolerance 1e-6 by the scheme's own sums; `machine_page` makes 1,000."""
    generator = np.random.default_rng(28)
    for _ in range(60):
        machine = random_motor(generator)
        step = float(generator.choice([1e-4, 1e-3, 4e-3]))
        load = float(generator.uniform(0.0, 2.0))
        assert largest_residual(machine, step=step, end=60 * step, load=load) <= 1e-6


def test_an_s700k_shows_its_load_by_power() -> None:
    """From 10 to 100 % of 3 kN: current falls by less than 10 %, active power rises by 55 %."""
    machine = load_machines("s700k").machine["s700k"]
    low, high = (steady_point(machine, torque=torque_for(machine, f)) for f in (300.0, 3000.0))
    assert -0.10 < high.current / low.current - 1.0 < 0.0
    assert high.power / low.power - 1.0 > 0.55


def test_steady_point_of_a_random_motor() -> None:
    """The kernel's steady circuit against phasors, 1e-6."""
    generator = np.random.default_rng(29)
    for _ in range(20):
        machine = random_motor(generator)
        motor = machine.motor.model_copy(update={"transient": False})
        machine = machine.model_copy(update={"motor": motor})
        constants, states, _ = started(machine, step=1e-2, end=0.1, loads={0.0: 0.0})
        power, apparent = machine.motor.of_kind.powers(constants, states[-1:])
        _, point = steady_at(machine, float(states[-1, at.SPEED]))
        assert states[-1, at.CURRENT] == pytest.approx(point.current, rel=1e-6)
        assert power[0] == pytest.approx(point.power, rel=1e-6)
        voltage = machine.supply.voltage or machine.motor.voltage
        assert apparent[0] == pytest.approx(math.sqrt(3.0) * voltage * point.current, rel=1e-6)
        assert steady_point(machine, torque=0.0, drag=False).speed <= SUPPLY * 2


def test_a_saturating_main_branch_runs_on_its_own_flux() -> None:
    """Steady running by phasors, its flux found by bisection; the step must end there.

    Behind line and stator at one slip: i_m = psi/L_s (1 + c (psi/psi_0)^8 - c), c = (n - 1)/8.
    """
    l_s, l_l, r_s, r_r, slip, n = 0.38, 0.06, 15.0, 12.0, 0.02, 3.8
    speed, voltage = 2.0 * math.pi * 50.0, 380.0 / math.sqrt(3.0)
    rated, bend = voltage / speed, (n - 1.0) / 8.0
    low, high = 0.0, 2.0 * rated
    for _ in range(80):
        flux = 0.5 * (low + high)
        main = (1.0 + bend * ((flux / rated) ** 8 - 1.0)) / l_s
        current = flux * (main + 1j * slip * speed / (r_r + 1j * slip * speed * l_l))
        low, high = (
            (low, flux) if abs(r_s * current + 1j * speed * flux) > voltage else (flux, high)
        )
    changes = {"motor.iron_resistance": 1e12, "motor.resistance": 11.0, "motor.transient": True}
    loaded = load_machines("s700k", overrides=changes)
    machine = loaded.machine["s700k"]
    shaft = (1.0 - slip) * speed / 2.0
    found = steady_at(machine, shaft)[1]
    assert found.current == pytest.approx(abs(current), rel=1e-9)
    for transient in (True, False):
        one = load_machines("s700k", overrides={"motor.transient": transient})
        throw, machine = throw_one_mass(one), one.machine["s700k"]
        at = int(np.abs(throw.time - 4.0).argmin())
        point = steady_at(machine, float(throw["speed"][at]))[1]
        assert throw["lead_current"][at] == pytest.approx(point.current, rel=2e-4)
        assert throw["power"][at] == pytest.approx(point.power, rel=2e-3)
        assert throw.energy_residual < 1e-8
