"""Behind the gear: stroke map, rod, and what a mechanism looks like from the rod for one step.

Positions in m, positive in the closing direction, home at 0.
"""

import math

from turnout.kernels.compiled import compiled_part
from turnout.law.table import Floats
from turnout.machine.compute import places as at


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
def rail_side(constants: Floats, free: float, compliance: float, x: float) -> tuple[float, float]:
    """Return rod force, positive when it pushes the rail home, and its slope over rod position x.

    The rail is at y = free + compliance F.
    """
    stiffness = constants[at.ROD_STIFFNESS] / (1.0 + constants[at.ROD_STIFFNESS] * compliance)
    elastic = rod_stretch(constants, x - free)
    return stiffness * elastic, stiffness if elastic != 0.0 else 0.0
