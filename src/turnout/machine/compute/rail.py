"""What stands behind the gear: stroke map, rod, and the rail at the rod's end.

The rail is either a mass with an elastic-plastic friction, a bed, a stop and an object, or affine:
y = free + compliance F, which is what a larger mechanism looks like from the rod for one step.
Positions in m, positive in the closing direction, home at 0; the force is that of the rod on the
rail, positive when it pushes it home.
"""

import math

from turnout.kernels.compiled import compiled_part
from turnout.law.table import Floats
from turnout.machine.compute import places as at
from turnout.machine.compute.motor import ITERATIONS, ROUNDING


@compiled_part
def rod_position(constants: Floats, table: Floats, angle: float) -> tuple[float, float, float]:
    """Return the rod position and its first two derivatives over the shaft angle.

    Parameters
    ----------
    constants : ndarray
    table : ndarray, shape (n, 5)
        Of a stroke given as a table: share of the angle at which a piece begins, and the
        coefficients of 1, s, s^2, s^3 of the share of the stroke in it; the last row ends it.
    angle : float
        [rad].
    """
    if constants[at.STROKE_KIND] == at.SCREW:
        return angle / constants[at.RATIO], 1.0 / constants[at.RATIO], 0.0
    whole, stroke, start = constants[at.RATIO], constants[at.STROKE], constants[at.STROKE_START]
    if constants[at.STROKE_KIND] == at.CRANK:
        turn = math.pi / whole
        phi, half = turn * angle, 0.5 * stroke
        x = start + half * (1.0 - math.cos(phi))
        return x, half * turn * math.sin(phi), half * turn * turn * math.cos(phi)
    share = min(max(angle / whole, 0.0), 1.0)
    row = 0
    while row < table.shape[0] - 2 and share >= table[row + 1, 0]:
        row += 1
    s = share - table[row, 0]
    a0, a1, a2, a3 = table[row, 1], table[row, 2], table[row, 3], table[row, 4]
    x = start + stroke * (a0 + s * (a1 + s * (a2 + s * a3)))
    if not 0.0 < angle / whole < 1.0:
        return x, 0.0, 0.0
    slope = stroke / whole * (a1 + s * (2.0 * a2 + s * 3.0 * a3))
    return x, slope, stroke / whole**2 * (2.0 * a2 + s * 6.0 * a3)


@compiled_part
def rod_stretch(constants: Floats, stretch: float) -> float:
    """Return the elastic part of the distance between rod end and rail, beyond the lost motion."""
    half = 0.5 * constants[at.ROD_PLAY]
    if abs(stretch) <= half:
        return 0.0
    return float(stretch - math.copysign(half, stretch))


@compiled_part
def friction_twist(rail: Floats, trial: float) -> tuple[float, float]:
    """Return displacement and stiffness of the elastic-plastic friction for a trial value."""
    stiffness = rail[at.FRICTION_STIFFNESS]
    if stiffness * abs(trial) <= rail[at.FRICTION_FORCE]:
        return trial, stiffness
    return float(math.copysign(rail[at.FRICTION_FORCE] / stiffness, trial)), 0.0


@compiled_part
def bed_force(rail: Floats, y: float) -> tuple[float, float, float]:
    """Return force against +y of bed, stop and object, its slope, and the size of its terms."""
    force = rail[at.BED_STIFFNESS] * (y - rail[at.BED_REST])
    slope = rail[at.BED_STIFFNESS]
    scale = rail[at.BED_STIFFNESS] * (abs(y) + abs(rail[at.BED_REST]))
    if y > 0.0:
        force += rail[at.STOP_STIFFNESS] * y
        slope += rail[at.STOP_STIFFNESS]
        scale += rail[at.STOP_STIFFNESS] * y
    if y + rail[at.OBJECT_SIZE] > 0.0 and rail[at.OBJECT_STIFFNESS] > 0.0:
        force += rail[at.OBJECT_STIFFNESS] * (y + rail[at.OBJECT_SIZE])
        slope += rail[at.OBJECT_STIFFNESS]
        scale += rail[at.OBJECT_STIFFNESS] * (abs(y) + rail[at.OBJECT_SIZE])
    return force, slope, scale


@compiled_part
def rail_side(
    constants: Floats,
    rail: Floats,
    g: float,
    base: Floats,
    free: float,
    compliance: float,
    start: float,
    x: float,
) -> tuple[float, float, float]:
    """Return rod force, its slope over the rod position, and the rail's position.

    Parameters
    ----------
    base : ndarray
        What the earlier stages leave of the integrated states.
    free, compliance : float
        Of an affine rail [m], [m/N].
    start : float
        First guess of the rail's position [m].
    x : float
        Rod position [m].

    Notes
    -----
    With v = (y - y*)/g the one-mass rail solves m (v - v*)/g + c_y v + f + k_b (y - y_f)
    + k_s max(y, 0) + k_o max(y + s, 0) = F(x - y), whose left side rises with y: one solution.
    The force is NaN where the iteration did not end.
    """
    k = constants[at.ROD_STIFFNESS]
    if rail[at.ONE_MASS] == 0.0:
        stiffness = k / (1.0 + k * compliance)
        elastic = rod_stretch(constants, x - free)
        force = stiffness * elastic
        return force, stiffness if elastic != 0.0 else 0.0, free + compliance * force
    inertia = rail[at.RAIL_MASS] / (g * g)
    viscous = rail[at.RAIL_DAMPING] / g
    y, y_base = start, base[at.RAIL_POSITION]
    momentum = rail[at.RAIL_MASS] / g * base[at.RAIL_SPEED]
    low, high = -math.inf, math.inf
    for _ in range(ITERATIONS):
        moved = y - y_base
        twist, friction_slope = friction_twist(rail, base[at.RAIL_TWIST] + moved)
        f, slope, scale = bed_force(rail, y)
        friction = rail[at.FRICTION_STIFFNESS] * twist
        elastic = rod_stretch(constants, x - y)
        force = k * elastic
        rod_slope = k if elastic != 0.0 else 0.0
        f += (inertia + viscous) * moved - momentum + friction - force
        slope += inertia + viscous + friction_slope
        scale += (inertia + viscous) * (abs(y) + abs(y_base)) + abs(momentum)
        scale += rail[at.FRICTION_STIFFNESS] * abs(twist) + k * (abs(x) + abs(y))
        if not abs(f) < math.inf:
            break
        settled = abs(f) <= ROUNDING * scale
        if not settled:
            if f > 0.0:
                high = y
            else:
                low = y
            new = y - f / (slope + rod_slope)
            if not low < new < high:
                new = 0.5 * (low + high)
            settled = new in (y, low, high)
            if not settled:
                y = new
                continue
        return force, rod_slope * slope / (slope + rod_slope), y
    return math.nan, 0.0, y
