"""Forces of the fastenings on the switch rails, from the motion of the rails at their places.

Forces are those of the springs; the share of the dampers, which is small while a switch is thrown,
is left out. A force acts at the place of the fastening, a moment turns the section.
"""

import numpy as np
from numpy.typing import NDArray

from turnout.mechanism.build_rails import fastening_offset
from turnout.mechanism.mechanism import RailBody
from turnout.panel.model import Panel
from turnout.panel.support_records import Fastening
from turnout.response.recovery import Motion, row_motion
from turnout.response.save import Save
from turnout.response.signals import Variable

Floats = NDArray[np.float64]

AXES = ("x", "y", "z")
NAMES = ("fastening_force", "fastening_moment")


def fastening_signals(panel: Panel, motion: Motion, save: Save) -> dict[str, Variable]:
    """Return force and moment of every fastening on the switch rails, where they are asked for.

    NaN where a fastening does not hold a rail, or is part of matrices of another program.
    """
    if not panel.fastening or not save.keeps(*NAMES):
        return {}
    shape = (len(panel.rail), len(panel.fastening), len(AXES), motion.history.time.size)
    force, moment = np.full(shape, np.nan), np.full(shape, np.nan)
    for r, rail in enumerate(panel.rail):
        body = motion.rails[rail]
        for f, fastening in enumerate(panel.fastening.values()):
            if body.with_supports or (fastening.rails is not None and rail not in fastening.rails):
                continue
            offset = fastening_offset(panel, rail, fastening)
            rows = _rows(body, fastening, offset=offset)
            moved = row_motion(motion, [(body, rows)])
            spring = np.array(
                [
                    *(fastening.stiffness_x, fastening.stiffness_y, fastening.stiffness_z),
                    *(fastening.stiffness_roll, fastening.stiffness_pitch, fastening.stiffness_yaw),
                ]
            )
            resisted = 0.0 - spring[:, np.newaxis] * moved
            force[r, f], moment[r, f] = resisted[:3], resisted[3:]
    dims = ("rail", "fastening", "axis", "time")
    return {"fastening_force": (dims, force), "fastening_moment": (dims, moment)}


def _rows(body: RailBody, fastening: Fastening, *, offset: float) -> Floats:
    """Return rows to the motion of the rail where a fastening acts, shape (6, count)."""
    node = int(np.argmin(np.abs(body.x - fastening.x)))
    rows: Floats = body.recovery[6 * node : 6 * node + 6].copy()
    rows[0] += fastening.height * rows[4] - offset * rows[5]
    rows[1] -= fastening.height * rows[3]
    rows[2] += offset * rows[3]
    return rows
