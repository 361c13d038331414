r"""The generalised-alpha step: what it predicts, and how the solved coordinates complete it.

Each coordinate is damped by itself, so that the right side of the implicit step

.. math:: p = \iota \tilde q + f + c\,(\nu\tilde q - \tilde v)

follows from the predicted coordinates :math:`\tilde q` and velocities :math:`\tilde v` one by one.
"""

from typing import NamedTuple

from turnout.integrate.energy import ALGORITHMIC, DAMPING
from turnout.integrate.state import State
from turnout.integrate.system import Floats, System
from turnout.integrate.vector import two_totals
from turnout.integrate.work import Work
from turnout.law.compiled import compiled, compiled_loop


class Stepping(NamedTuple):
    """Step size and generalised-alpha coefficients."""

    step: float
    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float
    halvings: int
    follow_path: bool
    stride: int
    inertia: bool


@compiled
def coefficients(stepping: Stepping, h: float) -> tuple[float, float]:
    """Return what multiplies identity and damping in the matrix of the implicit step."""
    kappa = (1.0 - stepping.alpha_f) / (1.0 - stepping.alpha_m)
    return 1.0 / (h * h * stepping.beta * kappa), stepping.gamma / (h * stepping.beta)


@compiled
def begin_step(system: System, state: State, work: Work, stepping: Stepping, h: float) -> None:
    """Save the coordinates; predict the step without new acceleration, and write its right side."""
    _predict(
        stepping,
        h,
        (state.q, state.v, state.a, state.acceleration),
        system.damping,
        system.load,
        work.q,
        work.predicted,
        work.velocity,
        work.right_side,
    )


@compiled_loop
def _predict(
    stepping: Stepping,
    h: float,
    motion: tuple[Floats, Floats, Floats, Floats],
    damping: Floats,
    load: Floats,
    saved: Floats,
    predicted: Floats,
    velocity: Floats,
    side: Floats,
) -> None:
    inertia, viscosity = coefficients(stepping, h)
    share = 1.0 / (1.0 - stepping.alpha_m)
    old, older = share * stepping.alpha_f, -share * stepping.alpha_m
    beta, gamma = stepping.beta, stepping.gamma
    q, v, a, acceleration = motion
    for i in range(side.size):
        known = old * acceleration[i] + older * a[i]
        there = q[i] + h * v[i] + h * h * ((0.5 - beta) * a[i] + beta * known)
        fast = v[i] + h * ((1.0 - gamma) * a[i] + gamma * known)
        saved[i] = q[i]
        predicted[i] = there
        velocity[i] = fast
        side[i] = inertia * there + load[i] + damping[i] * (viscosity * there - fast)


@compiled
def complete_step(system: System, state: State, work: Work, stepping: Stepping, h: float) -> None:
    """Complete velocity and accelerations from the solved coordinates.

    Damping and the scheme's own loss are booked, `turnout.integrate.energy`.
    """
    damped, lost = work.of_modes, work.of_modes_too
    before = (work.q, work.predicted, work.velocity)
    _complete(
        stepping, h, before, system.damping, state.q, state.v, state.a, state.acceleration,
        damped, lost,
    )  # fmt: skip
    of_damping, of_scheme = two_totals(damped, lost)
    state.ledger[DAMPING] += of_damping
    state.ledger[ALGORITHMIC] += of_scheme


@compiled_loop
def _complete(
    stepping: Stepping,
    h: float,
    before: tuple[Floats, Floats, Floats],
    damping: Floats,
    q: Floats,
    v: Floats,
    a: Floats,
    acceleration: Floats,
    damped: Floats,
    lost: Floats,
) -> None:
    inertia, viscosity = coefficients(stepping, h)
    share = 1.0 / (1.0 - stepping.alpha_m)
    new, old, older = 1.0 - stepping.alpha_f, stepping.alpha_f, stepping.alpha_m
    saved, predicted, velocity = before
    for i in range(q.size):
        change, way = q[i] - predicted[i], q[i] - saved[i]
        fast, push = velocity[i] + viscosity * change, inertia * change
        both = 0.5 * (fast + v[i])
        damped[i] = damping[i] * both * way
        lost[i] = 0.5 * (push + acceleration[i]) * way - both * (fast - v[i])
        a[i] = share * (new * push + old * acceleration[i] - older * a[i])
        v[i] = fast
        acceleration[i] = push
