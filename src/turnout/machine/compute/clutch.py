"""What changes the clutch from step to step: breakaway, heat, temperature and wear.

Within a step the clutch slips at one level. At the end of a step a sticking clutch that reached
its breakaway torque falls to its kinetic level: the twist gives the difference to the slip, and the
released energy becomes heat. It sticks again as soon as its torque falls below the kinetic level.
"""

import math

from turnout.kernels.compiled import compiled
from turnout.law.table import Floats
from turnout.machine.compute import places as at

LEAST_LEVEL = 0.05
"""Share of the level of the new clutch that heat and wear leave at least."""
REACHED = 1e-12
"""Share of its level by which a clutch may be below it and count as slipping."""


@compiled
def kinetic_level(constants: Floats, state: Floats) -> float:
    """Return the torque of the slipping clutch at its temperature and wear [N m]."""
    share = 1.0 + constants[at.LEVEL_PER_KELVIN] * state[at.CLUTCH_TEMPERATURE]
    share -= constants[at.LEVEL_PER_JOULE] * state[at.ENERGIES + at.CLUTCH]
    return float(constants[at.CLUTCH_TORQUE] * max(share, LEAST_LEVEL))


@compiled
def update_clutch(constants: Floats, state: Floats, step: float) -> None:
    """Let breakaway, temperature and wear follow from the end of a step of a length [s]."""
    kinetic, stiffness = kinetic_level(constants, state), constants[at.CLUTCH_STIFFNESS]
    if constants[at.STATIC_RATIO] > 1.0:
        torque = stiffness * abs(state[at.TWIST])
        if state[at.SLIPPING] == 0.0 and torque >= state[at.LEVEL] * (1.0 - REACHED):
            twist = math.copysign(min(kinetic / stiffness, abs(state[at.TWIST])), state[at.TWIST])
            released = 0.5 * stiffness * (state[at.TWIST] ** 2 - twist**2)
            state[at.SLIP] += state[at.TWIST] - twist
            state[at.ENERGIES + at.CLUTCH] += released
            state[at.ENERGIES + at.INTO_STORES] -= released
            state[at.TWIST], state[at.SLIPPING] = twist, math.copysign(1.0, twist)
        elif state[at.SLIPPING] != 0.0 and torque < state[at.LEVEL] * (1.0 - REACHED):
            state[at.SLIPPING] = 0.0
    heat = state[at.ENERGIES + at.CLUTCH] - state[at.HEAT_COUNTED]
    state[at.HEAT_COUNTED] = state[at.ENERGIES + at.CLUTCH]
    state[at.CLUTCH_TEMPERATURE] += heat / constants[at.CLUTCH_HEAT_CAPACITY]
    state[at.LEVEL] = kinetic * (1.0 if state[at.SLIPPING] != 0.0 else constants[at.STATIC_RATIO])
    state[at.CLUTCH_TEMPERATURE] *= math.exp(-constants[at.CLUTCH_COOLING] * step)
