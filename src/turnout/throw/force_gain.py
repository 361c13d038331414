r"""How much the current and the power of a machine change with the force on its rod.

.. math:: g_I = \frac{\partial I}{\partial F}, \qquad g_P = \frac{\partial P}{\partial F}

at its steady points (`turnout.machine.steady`), in mid-stroke.
"""

import numpy as np
from numpy.typing import NDArray

from turnout.machine.components import Machine
from turnout.machine.rows import supply_voltage
from turnout.machine.steady import shaft_travel, steady_point, torque_for
from turnout.panel.model import Panel
from turnout.throw.drives import ON

Floats = NDArray[np.float64]

POWER = "power"
FORCES = 41
"""Of the table of steady points, from 0 to what the clutch holds."""


def gain_along(panel: Panel, drive: str, quantity: str, *, force: Floats, state: Floats) -> Floats:
    """Return the local gain of a drive's machine at every instant of a throw.

    Parameters
    ----------
    panel : Panel
        With the machine.
    drive : str
        A drive that is a machine.
    quantity : str
        "current" or "power".
    force : ndarray, shape (n_times,)
        Of the drive [N].
    state : ndarray, shape (n_times,)
        `drive_state`; the gain is 0 where the machine is off, held, or its clutch slips.

    Returns
    -------
    ndarray, shape (n_times,)
        [A/N] or [W/N].
    """
    name = panel.drive[drive].machine
    assert name is not None
    table = local_gain(panel.machine[name], quantity)
    return np.where(state == ON, np.interp(np.maximum(force, 0.0), *table), 0.0)


def local_gain(machine: Machine, quantity: str) -> tuple[Floats, Floats]:
    """Return forces [N] and the change of current [A/N] or power [W/N] with the force there.

    Parameters
    ----------
    machine : Machine
        In mid-stroke, moving.
    quantity : str
        "current" or "power".

    Examples
    --------
    >>> from turnout.machine.machine_file import load_machines
    >>> force, gain = local_gain(load_machines("jea73").machine["jea73"], "current")
    >>> bool(np.all((1e3 * gain > 0.1) & (1e3 * gain < 0.3)))  # A/kN
    True
    """
    held = machine.clutch.torque * (1.0 - machine.clutch.worn) * machine.gear.efficiency
    force = np.linspace(0.0, held / shaft_travel(machine), FORCES)
    points = [steady_point(machine, torque=torque_for(machine, float(each))) for each in force]
    power = np.array([point.power for point in points])
    from_supply = machine.circuit.measured_current == "supply" and machine.motor.kind != "induction"
    current = power / supply_voltage(machine) if from_supply else [p.current for p in points]
    values = power if quantity == POWER else np.asarray(current)
    return force, np.gradient(values, force)
