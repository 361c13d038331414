"""Oscillator with an elastic-plastic foot, in closed form and as a mechanism; a block on a belt.

Between events the motion is harmonic, in closed form; events (stick to slip, slip to stick) are
found with brentq to 1e-14 s and phases are joined. On the belt friction acts between two bodies:
its row is the block's displacement less the belt's. In the frame of the belt the block starts with
the belt's speed backwards and its spring is pulled backwards, so that the same closed form holds.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import brentq
from tests.verification.agreement import Check
from tests.verification.hand_made import energy_residual, hand_made, linear_spring, run

from turnout.law.table import LawTableBuilder
from turnout.solver.integration import History

MASS, SPRING, STICK, LIMIT = 2.0, 8e3, 1e7, 30.0
OMEGA = np.sqrt(SPRING / MASS)
PERIOD = 2 * np.pi / OMEGA


@dataclass
class Phase:
    """Harmonic motion from `start`: x = offset + drift s + a cos(w s) + b sin(w s)."""

    start: float
    omega: float
    offset: float
    drift: float
    a: float
    b: float

    def x(self, t: float | np.ndarray) -> float | np.ndarray:
        s = t - self.start
        return (
            self.offset
            + self.drift * s
            + self.a * np.cos(self.omega * s)
            + self.b * np.sin(self.omega * s)
        )

    def v(self, t: float) -> float:
        s = self.omega * (t - self.start)
        return self.drift + self.omega * (self.b * np.cos(s) - self.a * np.sin(s))


def first_root(function: Callable[[float], float], start: float, end: float) -> float | None:
    """Return the first upward crossing of zero after `start`."""
    grid = np.linspace(start, end, 20001)[1:]
    values = np.array([function(t) for t in grid])
    up = np.flatnonzero((values[:-1] <= 0) & (values[1:] > 0))
    return brentq(function, grid[up[0]], grid[up[0] + 1], xtol=1e-14) if up.size else None


def exact(
    x: float, *, u0: float, speed: float, end: float, stick: float, v: float = 0.0
) -> list[Phase]:
    """Join closed-form phases of a mass at `x` with speed `v`, pulled from u0 + speed t."""
    beyond = LIMIT * (1 + 1e-9)  # a swing that only grazes the limit stays stuck
    t, anchor, branch, phases = 0.0, x, 0, []
    while t < end:
        total = SPRING + (stick if branch == 0 else 0.0)
        foot = stick * anchor if branch == 0 else -branch * LIMIT
        omega = np.sqrt(total / MASS)
        offset = (SPRING * (u0 + speed * t) + foot) / total
        drift = SPRING * speed / total
        phase = Phase(t, omega, offset, drift, x - offset, (v - drift) / omega)
        phases.append(phase)
        if branch == 0:  # stuck until the limit
            event = first_root(
                lambda s, p=phase, a=anchor: abs(stick * (p.x(s) - a)) - beyond, t, end
            )
        else:  # slipping until the velocity turns round
            event = first_root(lambda s, p=phase, d=branch: -d * p.v(s), t, end)
        if event is None:
            return phases
        x, v, t = phase.x(event), phase.v(event), event
        if branch == 0:
            branch = int(np.sign(x - anchor))
        else:
            anchor, branch = x - branch * LIMIT / stick, 0
    return phases


def exact_path(phases: list[Phase], time: np.ndarray) -> np.ndarray:
    starts = np.array([p.start for p in phases])
    which = np.searchsorted(starts, time, side="right") - 1
    return np.array([phases[k].x(t) for k, t in zip(which, time, strict=True)])


def simulate(
    marker: Callable[[np.ndarray], np.ndarray], *, end: float, step: float, stick: float = STICK
) -> History:
    laws = LawTableBuilder()
    linear_spring(laws, 0, SPRING, input_index=0)
    normal = laws.add_contact(1, stiffness=1e7, clearance=0.0, base_closed=True)
    laws.add_friction(0, normal=normal, friction_coefficient=0.3, stick_stiffness=stick)
    mechanism = hand_made(laws, mass=[MASS, MASS], load=[0.0, LIMIT / 0.3])
    return run(mechanism, marker, end=end, step=step, spectral_radius=0.9)


def jump(amplitude: float) -> Callable[[np.ndarray], np.ndarray]:
    """Marker that jumps at once from 0 to `amplitude`."""
    return lambda t: np.where(t > 0, amplitude, 0.0)


@dataclass(frozen=True)
class Path:
    """Found and exact displacement over time [m], what scales it, and the energy residual."""

    time: np.ndarray
    found: np.ndarray
    exact: np.ndarray
    scale: float
    residual: float

    @property
    def error(self) -> float:
        """Largest difference over the scale."""
        return float(np.max(np.abs(self.found - self.exact)) / self.scale)


@cache
def released(stick: float, *, steps: int) -> Path:
    """Pull a block off its spring's rest at once and let it swing out."""
    amplitude, end = 0.02, 4 * PERIOD
    phases = exact(0.0, u0=amplitude, speed=0.0, end=end, stick=stick)
    history = simulate(jump(amplitude), end=end, step=PERIOD / steps, stick=stick)
    # a marker that jumps within the first step is, on average, half a step late
    reference = exact_path(phases, np.maximum(history.time - 0.5 * PERIOD / steps, 0.0))
    return Path(history.time, history.g[:, 0], reference, amplitude, energy_residual(history))


BELT_SPEED, BELT_STICK = 0.12, 2e5


@cache
def on_a_belt(*, steps: int) -> Path:
    """Lay a block on a spring at rest on a belt that runs; displacement from the spring's rest."""
    laws = LawTableBuilder()
    linear_spring(laws, 0, SPRING)
    linear_spring(laws, 1, 1e9, input_index=0)
    normal = laws.add_contact(3, stiffness=1e7, clearance=0.0, base_closed=True)
    laws.add_friction(2, normal=normal, friction_coefficient=0.3, stick_stiffness=BELT_STICK)
    rows = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 0.0, 1.0]]
    # the belt is so light that it follows its marker at once, above the cut-off
    mechanism = hand_made(laws, mass=[MASS, 1e-3, MASS], rows=rows, load=[0.0, 0.0, LIMIT / 0.3])
    end = 6 * PERIOD
    history = run(
        mechanism,
        lambda t: BELT_SPEED * t,
        end=end,
        step=PERIOD / steps,
        spectral_radius=0.9,
        cutoff_frequency=2e3,
    )
    phases = exact(0.0, u0=0.0, speed=-BELT_SPEED, end=end, stick=BELT_STICK, v=-BELT_SPEED)
    reference = exact_path(phases, history.time) + BELT_SPEED * history.time
    scale = LIMIT / SPRING
    return Path(history.time, history.g[:, 0], reference, scale, energy_residual(history))


def checks() -> list[Check]:
    """Return what the page shows."""
    found = [
        Check(
            f"foot of {stick / 1e3:g} kN/m, {steps} steps a period: largest difference",
            100 * released(stick, steps=steps).error,
            0,
            limit,
            "% of swing",
        )
        for stick in (2e4, 2e5)
        for steps, limit in ((100, 0.5), (400, 0.06))
    ]
    return found + [
        Check(
            f"block on a belt, {steps} steps a period: largest difference",
            100 * on_a_belt(steps=steps).error,
            0,
            limit,
            "% of slip stretch",
        )
        for steps, limit in ((100, 2.0), (400, 0.25))
    ]
