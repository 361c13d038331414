"""What changes the clutch from step to step: breakaway, heat, temperature and wear.

Within a step the clutch slips at one level. At the end of a step a sticking clutch that reached
its breakaway torque falls to its kinetic level: the twist gives the difference to the slip, and the
released energy becomes heat. It sticks again as soon as its torque falls below the kinetic level.
"""

import math

from turnout.kernels.compiled import compiled
from turnout.law.table import Floats
from turnout.machine.compute.places import (
    CLUTCH,
    CLUTCH_COOLING,
    CLUTCH_HEAT_CAPACITY,
    CLUTCH_STIFFNESS,
    CLUTCH_TEMPERATURE,
    CLUTCH_TORQUE,
    ENERGIES,
    HEAT_COUNTED,
    INTO_STORES,
    LEVEL,
    LEVEL_PER_JOULE,
    LEVEL_PER_KELVIN,
    SLIP,
    SLIPPING,
    STATIC_RATIO,
    TWIST,
)

LEAST_LEVEL = 0.05
"""Share of the level of the new clutch that heat and wear leave at least."""
REACHED = 1e-12
"""Share of its level by which a clutch may be below it and count as slipping."""


@compiled
def kinetic_level(constants: Floats, state: Floats) -> float:
    """Return the torque of the slipping clutch at its temperature and wear [N m]."""
    share = 1.0 + constants[LEVEL_PER_KELVIN] * state[CLUTCH_TEMPERATURE]
    share -= constants[LEVEL_PER_JOULE] * state[ENERGIES + CLUTCH]
    return float(constants[CLUTCH_TORQUE] * max(share, LEAST_LEVEL))


@compiled
def update_clutch(constants: Floats, state: Floats, step: float) -> None:
    """Let breakaway, temperature and wear follow from the end of a step of a length [s]."""
    kinetic, stiffness = kinetic_level(constants, state), constants[CLUTCH_STIFFNESS]
    if constants[STATIC_RATIO] > 1.0:
        torque = stiffness * abs(state[TWIST])
        if state[SLIPPING] == 0.0 and torque >= state[LEVEL] * (1.0 - REACHED):
            twist = math.copysign(min(kinetic / stiffness, abs(state[TWIST])), state[TWIST])
            released = 0.5 * stiffness * (state[TWIST] ** 2 - twist**2)
            state[SLIP] += state[TWIST] - twist
            state[ENERGIES + CLUTCH] += released
            state[ENERGIES + INTO_STORES] -= released
            state[TWIST], state[SLIPPING] = twist, math.copysign(1.0, twist)
        elif state[SLIPPING] != 0.0 and torque < state[LEVEL] * (1.0 - REACHED):
            state[SLIPPING] = 0.0
    heat = state[ENERGIES + CLUTCH] - state[HEAT_COUNTED]
    state[HEAT_COUNTED] = state[ENERGIES + CLUTCH]
    state[CLUTCH_TEMPERATURE] += heat / constants[CLUTCH_HEAT_CAPACITY]
    state[LEVEL] = kinetic * (1.0 if state[SLIPPING] != 0.0 else constants[STATIC_RATIO])
    state[CLUTCH_TEMPERATURE] *= math.exp(-constants[CLUTCH_COOLING] * step)
