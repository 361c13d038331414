"""A Coulomb block on a spring: cases that tests and the page share.

Rate-independent friction with an elastic stick spring has closed forms in the displacement of the
block: stick, breakaway and steady slip; Masing's loops of several feet in parallel; slip and
letting go under a normal force that changes in time.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from tests.verification.agreement import Check
from tests.verification.hand_made import (
    energy_residual,
    hand_made,
    linear_spring,
    run,
    smooth_ramp,
)

from turnout.law.table import LawTableBuilder
from turnout.mechanism.mechanism import Mechanism
from turnout.solver.integration import History

NORMAL, DRIVE, STICK = 200.0, 1e5, 1e6
MU = 0.3
LIMIT = MU * NORMAL
SERIES = DRIVE * STICK / (DRIVE + STICK)


def block(
    *,
    drive: float = DRIVE,
    feet: tuple[tuple[float, float], ...] = ((MU, STICK),),
    lifter: float = 0.0,
    mass: float = 0.1,
    damping: float = 20.0,
) -> Mechanism:
    """Return a block (x) on a contact spring (z down); marker 0 pushes, marker 1 lifts."""
    laws = LawTableBuilder()
    linear_spring(laws, 0, drive, input_index=0)
    normal = laws.add_contact(1, stiffness=1e6, clearance=0.0, base_closed=True)
    if lifter:
        linear_spring(laws, 1, lifter, input_index=1)
    for coefficient, stiffness in feet:
        laws.add_friction(
            0, normal=normal, friction_coefficient=coefficient, stick_stiffness=stiffness
        )
    return hand_made(
        laws, mass=[mass, mass], damping=np.diag([damping, 10 * damping]), load=[0.0, NORMAL]
    )


def drive_force(history: History) -> np.ndarray:
    """Force of the drive on the block, positive in the direction of the push."""
    return -history.law_force[:, 0]


@dataclass(frozen=True)
class Loop:
    """Found and exact force [N] over a displacement [m] or time [s]."""

    at: np.ndarray
    found: np.ndarray
    exact: np.ndarray
    history: History

    @property
    def error(self) -> float:
        """Largest difference over the largest exact force."""
        return float(np.max(np.abs(self.found - self.exact)) / np.max(np.abs(self.exact)))


@cache
def broken_away() -> Loop:
    """Push the block slowly to five times the reach of its stick spring, over the marker."""
    reach = 5 * LIMIT / SERIES
    # no damper: a slow push, so that inertia is all that is left of the tolerance
    history = run(
        block(damping=0.0), lambda t: reach * smooth_ramp(t, start=0.1, end=20.0), end=18.0
    )
    marker = history.inputs[:, 0]
    exact = np.minimum(SERIES * marker, LIMIT)
    return Loop(marker, drive_force(history), exact, history)


FEET = ((0.1, 2e6), (0.25, 1e6), (0.4, 4e5))


def virgin(x: np.ndarray) -> np.ndarray:
    """Force of the parallel feet on first loading to `x` >= 0."""
    return sum(np.minimum(kt * x, mu * NORMAL) for mu, kt in FEET)


@cache
def masing() -> Loop:
    """Load, reverse and load again three feet in parallel, over the block's displacement."""
    amplitude = 4e-4

    def marker(t: np.ndarray) -> np.ndarray:
        return amplitude * (
            smooth_ramp(t, start=0.0, end=1.0)
            - 1.7 * smooth_ramp(t, start=1.0, end=2.0)
            + 1.4 * smooth_ramp(t, start=2.0, end=3.0)
        )

    history = run(block(drive=1e9, feet=FEET, damping=2000.0), marker, end=3.0)
    x, force = history.g[:, 0], history.friction_force.sum(axis=1)
    top, bottom = np.argmax(x), np.argmin(x)
    instant = np.arange(x.size)
    # virgin curve, then twice the virgin curve from the last turning point
    there = virgin(np.maximum(x, 0.0))
    down = there[top] - 2 * virgin(np.maximum(x[top] - x, 0.0) / 2)
    again = down[bottom] + 2 * virgin(np.maximum(x - x[bottom], 0.0) / 2)
    exact = np.where(instant <= top, there, np.where(instant <= bottom, down, again))
    return Loop(x, force, exact, history)


LIFTER, LIFT = 1e4, 0.008


@cache
def changing_normal() -> Loop:
    """Drag the block while a second spring changes its normal force; drive force over time."""
    contact_share = 1e6 / (1e6 + LIFTER)

    def lifted(t: np.ndarray) -> np.ndarray:
        return -LIFT * 0.5 * (1 - np.cos(2 * np.pi * t))

    # the lifter is at rest where the block stands, so it carries some of the weight
    history = run(
        block(lifter=LIFTER, damping=2.0),
        lambda t: 0.06 * smooth_ramp(t, start=0.0, end=4.0),
        lifted,
        end=3.0,
        step=5e-4,
    )
    normal = (NORMAL + LIFTER * lifted(history.time)) * contact_share
    exact = np.minimum(MU * normal, SERIES * history.inputs[:, 0])
    return Loop(history.time, drive_force(history), exact, history)


@cache
def let_go() -> Loop:
    """Hold a push P while the normal force falls: it slips at mu N = P; drive force over time."""
    push = 0.8 * LIMIT
    history = run(
        block(lifter=LIFTER, damping=2.0),
        lambda t: push / SERIES * smooth_ramp(t, start=0.0, end=1.0),
        lambda t: -0.012 * smooth_ramp(t, start=2.0, end=12.0),
        end=12.0,
    )
    exact = np.minimum(
        push * smooth_ramp(history.time, start=0.0, end=1.0),
        np.minimum.accumulate(MU * history.law_force[:, 1]),
    )
    return Loop(history.time, drive_force(history), exact, history)


def checks() -> list[Check]:
    """Return what the page shows."""
    cases = (
        ("stick, breakaway and slip of a block", broken_away(), 0.5),
        ("Masing loops of three feet", masing(), 1e-4),
        ("slip under a changing normal force", changing_normal(), 1.0),
        ("letting go when the normal force falls", let_go(), 0.5),
    )
    found = [
        Check(f"{name}: largest difference", 100 * loop.error, 0, limit, "% of peak")
        for name, loop, limit in cases
    ]
    residual = max(energy_residual(loop.history) for _, loop, _ in cases)
    return [*found, Check("energy residual of these", residual, 0, 1e-6, "of scale")]
