"""The Gamma circuit against its textbook form, and against the stage of the step it belongs to."""

import math

import numpy as np
import pytest

from turnout.core.errors import MachineError
from turnout.machine.compute import places as at
from turnout.machine.compute.induction import drop_fluxes, gamma_impedance
from turnout.machine.machine_file import load_machines
from turnout.machine.motor_kind import gamma_point, motor_row


def textbook(slip: float, values: tuple[float, float, float, float], speed: float) -> complex:
    """Return R_s + jX_s parallel to jX_l + R_r/S."""
    r_s, r_r, l_s, l_l = values
    main, rotor = 1j * speed * l_s, 1j * speed * l_l + r_r / slip
    return r_s + main * rotor / (main + rotor)


@pytest.mark.parametrize("slip", [-0.3, 1e-3, 0.04, 0.5, 1.0, 1.96])
def test_impedance_of_the_gamma_circuit(slip: float) -> None:
    values, speed = (11.0, 12.0, 0.4, 0.06), 2.0 * math.pi * 50.0
    given = (values[:2], values[2:])
    _, found, _ = gamma_impedance(speed, slip * speed, *given)
    assert found == pytest.approx(textbook(slip, values, speed), rel=1e-13)
    _, turned, _ = gamma_impedance(-speed, -slip * speed, *given)  # the other way round
    assert turned == pytest.approx(found.conjugate(), rel=1e-13)


def test_gamma_circuit_at_synchronous_speed_is_the_magnetising_branch() -> None:
    speed = 2.0 * math.pi * 50.0
    per_flux, found, _ = gamma_impedance(speed, 0.0, (11.0, 12.0), (0.4, 0.06))
    assert per_flux == pytest.approx(1.0 / 0.4, rel=1e-15)
    assert found == pytest.approx(11.0 + 1j * speed * 0.4, rel=1e-15)


def test_steady_torque_is_the_power_across_the_air_gap() -> None:
    """T w/n_p = 3 |I_r|^2 R_r/S, by the textbook circuit with iron loss at the terminals."""
    straight = {"motor.main_saturation": 1.0, "supply.line_resistance": 0.0}
    machine = load_machines("s700k", overrides=straight).machine["s700k"]
    motor, row = machine.motor, motor_row(machine.motor, machine.supply)
    speed = 2.0 * math.pi * (motor.frequency or 0.0)
    values = (motor.resistance, motor.rotor_resistance, motor.stator_inductance)
    r_s, r_r, l_s = (float(value or 0.0) for value in values)
    l_l, pairs = float(motor.leakage_inductance or 0.0), motor.pole_pairs or 1
    for slip in (0.02, 0.2, 1.0):
        torque, _ = gamma_point(row, (1.0 - slip) * speed / pairs)
        voltage = motor.voltage / math.sqrt(3.0)  # no line: iron loss changes no torque
        stator = voltage / textbook(slip, (r_s, r_r, l_s, l_l), speed)
        main, rotor = 1j * speed * l_s, 1j * speed * l_l + r_r / slip
        through = stator * main / (main + rotor)
        expected = 3.0 * pairs / speed * np.abs(through) ** 2 * r_r / slip
        assert torque == pytest.approx(expected, rel=1e-12)


def test_a_main_branch_without_a_flux_of_its_own_is_refused() -> None:
    """At 9 the branch would take no current at all below the rated flux: no point is left."""
    with pytest.raises(MachineError, match="main_saturation"):
        load_machines("three-phase", overrides={"motor.main_saturation": 9.0})
    steep = load_machines("three-phase", overrides={"motor.main_saturation": 8.9})
    motor, supply = steep.machine["three-phase"].motor, steep.machine["three-phase"].supply
    torque, _ = gamma_point(motor_row(motor, supply), 150.0)
    assert torque > 0.0


def test_a_motor_that_was_switched_off_starts_as_at_first() -> None:
    machine = load_machines("three-phase").machine["three-phase"]
    constants, state = motor_row(machine.motor, machine.supply), np.zeros(at.STATES)
    state[[at.STATOR_FLUX, at.MAIN_EXCESS]] = 0.9, 0.4
    drop_fluxes(constants, state)
    assert not state[[at.STATOR_FLUX, at.MAIN_EXCESS]].any()
