r"""A long rail lying on a friction bed, pushed sideways at its end: how far it slips.

An Euler-Bernoulli beam of stiffness EI, without end, lies on a bed that holds it elastically with k
(per length and displacement) up to the strength q per length. A force P pushes its end. The part
0 < x < a slips and feels -q, the part beyond sticks and is a beam on an elastic bed with
:math:`\beta^4 = k / 4 EI`. At x = a shear and moment of the slipping part are P - q a and
P a - q a^2 / 2. The end of a beam on an elastic bed under force V and moment M moves by
:math:`2 \beta (V + \beta M) / k`, and this must be q / k, where the bed gives way:

.. math:: 2 \beta (P - q a) + 2 \beta^2 (P a - q a^2 / 2) = q
          \quad\Rightarrow\quad \frac{\beta P}{q} = \frac{(1 + \beta a)^2}{2 (1 + \beta a)}
          \quad\Rightarrow\quad a = \frac{2 P}{q} - \frac{1}{\beta}

With s = beta (x - a), alpha = beta a the stuck part lies at
:math:`w = (q / k) e^{-s} (\cos s - \alpha \sin s)`; the slipping part is a cantilever on its slope
:math:`\beta (1 + \alpha) q / k`, so that the end moves by
:math:`(q / k) (1 + \alpha + \alpha^2 + 2 \alpha^3 / 3 + \alpha^4 / 6)`.
Both hold until the bed gives way backwards, where w = -q / k: at alpha = 3.87. On a stiffer bed
further zones follow that slip to either side; on a rigid one they would be without end, as one zone
that slips one way cannot leave the rest of the beam straight (deflection, slope, moment and shear
would all have to vanish at its end). That is why the bed here is elastic.

Reference: the closed form above; the bed of the program is chairs at the middle of equal cells,
each with its own weight of rail, k = k_t / spacing, q = mu N / spacing. Tolerance with
eight chairs in 1 / beta: 0.2 % of the slip length, 0.1 % of the end's displacement; order 2.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import brentq
from tests.verification.agreement import Check
from tests.verification.beams_by_hand import AREA, EI, RHO, Floats, joined, prismatic_rail
from tests.verification.hand_made import energy_residual, linear_spring, run

from turnout.law.table import LawTableBuilder
from turnout.mechanism.mechanism import Point

BETA = 1.0
BED = 4 * EI * BETA**4
MU, GRAVITY = 0.4, 9.81
STRENGTH = MU * RHO * AREA * GRAVITY
YIELD = STRENGTH / BED
LENGTH, PUSH = 18.0, 1e6
SETTLING = 1e7  # of the chairs under the weight, per length: soft, so that all carry the same
SPACINGS = (0.5, 0.25, 0.125)
REACH = 3.5
"""Slip length times beta at the end of the push."""


@dataclass(frozen=True)
class Dragged:
    """A push: forces on the end, slip lengths, displacements of the end; the shape at the last."""

    force: Floats
    slip_length: Floats
    end_displacement: Floats
    x: Floats
    shape: Floats
    slipping_chairs: int
    residual: float


def slip_length(force: Floats | float) -> Floats:
    """Return the closed-form slip length [m]; zero below the force that first slips."""
    return np.maximum(2 * np.asarray(force) / STRENGTH - 1 / BETA, 0.0)


def end_displacement(force: Floats | float) -> Floats:
    """Return the closed-form displacement of the pushed end [m]."""
    alpha = BETA * slip_length(force)
    slipping = 1 + alpha + alpha**2 + 2 * alpha**3 / 3 + alpha**4 / 6
    elastic = 2 * BETA * np.asarray(force) / STRENGTH
    return YIELD * np.where(alpha > 0, slipping, elastic)


def shape(force: float, x: Floats) -> Floats:
    """Return the closed-form deflection along the rail [m]."""
    alpha = BETA * float(slip_length(force))
    s = BETA * x - alpha
    stuck = np.exp(-s) * (np.cos(s) - alpha * np.sin(s))
    p, t = BETA * force / STRENGTH, -s
    shear = p - alpha
    moment = p * alpha - 0.5 * alpha**2
    # beyond a: w'''' = -4 in units of q / k and 1 / beta, from value, slope, moment and shear at a
    slipping = 1 + (1 + alpha) * t + 2 * moment * t**2 - 2 * shear * t**3 / 3 - t**4 / 6
    return YIELD * np.where(s > 0, stuck, slipping)


def validity() -> float:
    """Return beta a at which the bed gives way backwards."""

    def lowest(alpha: float) -> float:
        s = np.arctan2(alpha + 1, alpha - 1)
        return float(np.exp(-s) * (np.cos(s) - alpha * np.sin(s)) + 1)

    return float(brentq(lowest, 2.0, 8.0))


@cache
def dragged(spacing: float) -> Dragged:
    """Push a rail on chairs slowly at its end."""
    chairs = np.arange(0.5 * spacing, LENGTH, spacing)
    points = [Point(0.0, "uy")]
    laws = LawTableBuilder()
    linear_spring(laws, 0, PUSH, input_index=0)
    for number, x in enumerate(chairs):
        points += [Point(x, "uy"), Point(x, "uz", sign=-1.0)]
        normal = laws.add_contact(
            2 * number + 2, stiffness=SETTLING * spacing, clearance=0.0, base_closed=True
        )
        laws.add_friction(
            2 * number + 1,
            normal=normal,
            friction_coefficient=MU,
            stick_stiffness=BED * spacing,
        )
    rail = prismatic_rail(LENGTH, points, nodes=chairs, gravity=GRAVITY)
    mechanism = joined(laws, [rail], [[(0, point)] for point in range(len(points))])
    force = 0.5 * (1 + REACH) * STRENGTH / BETA
    travel = force / PUSH + float(end_displacement(force))
    # one mode keeps its inertia, the rest follows at rest: the push is as good as static
    history = run(
        mechanism,
        lambda t: travel * t / 20.0,
        end=20.0,
        step=0.02,
        cutoff_frequency=1e-3,
    )
    friction = history.friction_force
    moved = history.g[:, 1::2]
    limit = MU * history.law_force[:, 1 : 1 + chairs.size]
    count = np.argmax(friction < limit * (1 - 1e-9), axis=1)
    return Dragged(
        force=-history.law_force[:, 0],
        slip_length=_front(chairs, moved, count),
        end_displacement=history.g[:, 0],
        x=np.concatenate(([0.0], chairs)),
        shape=np.concatenate((history.g[-1:, 0], moved[-1])),
        slipping_chairs=int(count[-1]),
        residual=energy_residual(history),
    )


def _front(chairs: Floats, moved: Floats, count: Floats) -> Floats:
    """Return where between the last slipping and the first stuck chair the bed gives way [m]."""
    fronts = np.zeros(count.size)
    for n, first in enumerate(count):
        if first == 0:
            continue
        pair = moved[n, first - 1 : first + 1]
        share = (pair[0] - YIELD) / (pair[0] - pair[1])
        fronts[n] = chairs[first - 1] + share * (chairs[first] - chairs[first - 1])
    return fronts


def errors(spacing: float) -> tuple[float, float]:
    """Return errors of slip length and of the end's displacement at the last instant [-]."""
    found = dragged(spacing)
    force = found.force[-1]
    return (
        abs(found.slip_length[-1] / float(slip_length(force)) - 1),
        abs(found.end_displacement[-1] / float(end_displacement(force)) - 1),
    )


def rates() -> Floats:
    """Return observed orders of the end's displacement in the spacing."""
    values = np.array([errors(spacing)[1] for spacing in SPACINGS])
    return np.log2(values[:-1] / values[1:])


def checks() -> list[Check]:
    """Return what the page shows."""
    fine = dragged(SPACINGS[-1])
    slip, end = errors(SPACINGS[-1])
    sliding = slip_length(fine.force) > 2 * SPACINGS[-1]
    off = np.abs(fine.slip_length - slip_length(fine.force))[sliding].max()
    return [
        Check("slip length at the end of the push, error", 100 * slip, 0, 0.2, "%"),
        Check("slip length during the push, largest error", 1e3 * off, 0, 10, "mm"),
        Check("displacement of the pushed end, error", 100 * end, 0, 0.1, "%"),
        Check("order in the spacing of the chairs", float(rates()[-1]), 1.9, 2.1, ""),
    ]
