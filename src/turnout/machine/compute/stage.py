"""One implicit stage of a machine.

A stage of length g asks for the gear speed w2 with

    J2 (w2 - w2*)/g + c2 w2 - T_c(w2) + X'(th2) F(x) + t_g = 0

where T_c is what the motor side answers (it falls with w2), F what the rod answers (it rises with
the rod position x = X(th2), th2 = th2* + g w2), and t_g the loss of the gear: the load appears at
the shaft as X' F / eta where it is driven, as X' F eta_b where it drives back, and as any value
between while the gear stands. All of it rises with w2, jumps included, so there is one solution;
it is looked for on the side of w2 that the last stage was on, and the standing gear is tried when
that side has no solution. Nothing is smoothed and no sign is guessed.
"""

import math

from turnout.kernels.compiled import compiled, compiled_part
from turnout.law.table import Floats
from turnout.machine.compute import places as at
from turnout.machine.compute.induction import NO_CURVE, fill_fluxes, known_curve
from turnout.machine.compute.motor import ITERATIONS, ROUNDING, motor_side
from turnout.machine.compute.rail import friction_twist, rail_side, rod_position


@compiled_part
def load_factor(constants: Floats, state: Floats, force: float, sign: float) -> float:
    """Return torque at the shaft per load, X' F, when the gear turns with a sign."""
    if force * sign > 0.0:
        return float(constants[at.FACTOR_DRIVING] / state[at.GEAR_RATIO])
    return float(constants[at.FACTOR_DRIVEN] * state[at.GEAR_RATIO])


@compiled_part
def _fill(
    constants: Floats,
    rail: Floats,
    state: Floats,
    g: float,
    base: Floats,
    stage: Floats,
    solution: tuple[float, float, float, float, float, float],
) -> None:
    """Write the solution of a stage; what a steady circuit carries follows when it is accepted."""
    i, w1, w2, x, force, y = solution
    stage[at.CURRENT], stage[at.SPEED], stage[at.GEAR_SPEED] = i, w1, w2
    stage[at.GEAR_ANGLE] = base[at.GEAR_ANGLE] + g * w2
    stage[at.ROD_POSITION], stage[at.ROD_FORCE] = x, force
    stage[at.RAIL_POSITION] = y
    transient = constants[at.THREE_PHASE] > 0.0 and constants[at.STEADY_CIRCUIT] == 0.0
    if transient and state[at.ARMATURE_OPEN] == 0.0 and state[at.PHASE_LOST] == 0.0:
        fill_fluxes(constants, state, g, base, stage, w1)
    if rail[at.ONE_MASS] > 0.0:
        moved = y - base[at.RAIL_POSITION]
        stage[at.RAIL_SPEED] = moved / g
        stage[at.RAIL_TWIST] = friction_twist(rail, base[at.RAIL_TWIST] + moved)[0]


@compiled_part
def follow_gear(w1: float, change: float) -> float:
    """Return where the motor will be to first order, or its speed where that turns it round."""
    ahead = w1 + change
    return ahead if ahead * w1 > 0.0 else w1


@compiled
def solve_stage(
    constants: Floats,
    rail: Floats,
    table: Floats,
    state: Floats,
    g: float,
    base: Floats,
    span: tuple[float, float, float],
    stage: Floats,
    known: Floats,
) -> int:
    """Solve one stage; `stage` holds the guess and receives the solution.

    Parameters
    ----------
    constants, rail : ndarray
        Rows of the machine and of its rail.
    table : ndarray, shape (n, 5)
        Of the stroke, see `rod_position`.
    state : ndarray
        Circuit, lock, clutch level, and whether the gear is dry here.
    g : float
        [s].
    base : ndarray, shape (INTEGRATED,)
        What the earlier stages leave.
    span : tuple of float
        Speed of the hand at the crank [rad/s], position of an affine rail without rod force [m]
        and its compliance [m/N], at the end of the stage.
    stage : ndarray
        As the first entries of a state row, up to ROD_FORCE.
    known : ndarray
        Of `known_curve`; zeros at first.

    Returns
    -------
    int
        CONVERGED or NOT_CONVERGED.
    """
    hand, free, compliance = span
    inertia = constants[at.GEAR_INERTIA] / g
    w1, y = stage[at.SPEED], stage[at.RAIL_POSITION]
    w2 = 0.0 if state[at.LOCKED] > 0.0 else stage[at.GEAR_SPEED]
    sign = math.copysign(1.0, w2)
    stands = w2 == 0.0
    checked = False
    curve = NO_CURVE
    if constants[at.THREE_PHASE] > 0.0 and state[at.ARMATURE_OPEN] == 0.0:
        curve = known_curve(constants, state, g, base, known)
    low, high = -math.inf, math.inf
    for _ in range(2 * ITERATIONS):
        w1, i, clutch, clutch_slope, follows = motor_side(
            constants, state, g, base, curve, hand, w1, w2
        )
        x, dx, ddx = rod_position(constants, table, base[at.GEAR_ANGLE] + g * w2)
        force, force_slope, y = rail_side(constants, rail, g, base, free, compliance, y, x)
        load = dx * force
        f = inertia * (w2 - base[at.GEAR_SPEED]) - clutch
        if not abs(f + load) < math.inf or math.isnan(i):
            return at.NOT_CONVERGED
        if stands:
            below = load_factor(constants, state, load, -1.0)
            above = load_factor(constants, state, load, 1.0)
            settled = state[at.LOCKED] > 0.0 or f + below * load <= 0.0 <= f + above * load
            if not settled:
                stands, checked, low, high = False, True, -math.inf, math.inf
                sign = 1.0 if f + above * load < 0.0 else -1.0
        else:
            settled = False
        if not stands:
            factor = load_factor(constants, state, load, sign)
            f += constants[at.GEAR_DRAG] * w2 + factor * load
            slope = inertia + constants[at.GEAR_DRAG] - clutch_slope
            slope += factor * g * (dx * dx * force_slope + ddx * force)
            scale = (
                inertia * (abs(w2) + abs(base[at.GEAR_SPEED])) + abs(clutch) + factor * abs(load)
            )
            settled = abs(f) <= ROUNDING * scale
            if not settled:
                if slope <= 0.0:
                    return at.NOT_CONVERGED
                if f > 0.0:
                    high = w2
                else:
                    low = w2
                new = w2 - f / slope
                if not low < new < high:
                    new = 0.5 * (low + high)
                settled = new in (w2, low, high)
                if not settled:
                    w1, w2 = follow_gear(w1, follows * (new - w2)), new
                    continue
            if not checked and w2 * sign < 0.0:
                stands, w2 = True, 0.0
                continue
        if settled:
            _fill(constants, rail, state, g, base, stage, (i, w1, w2, x, force, y))
            stage[at.TWIST] = clutch / constants[at.CLUTCH_STIFFNESS]
            return at.CONVERGED
    return at.NOT_CONVERGED
