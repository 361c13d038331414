r"""The generalised-alpha step: what it predicts, and how the solved coordinates complete it.

Each coordinate is damped by itself, so that the right side of the implicit step

.. math:: p = \iota \tilde q + f + c\,(\nu\tilde q - \tilde v)

follows from the predicted coordinates :math:`\tilde q` and velocities :math:`\tilde v` one by one.
"""

from typing import NamedTuple

from turnout.integrate.energy import ALGORITHMIC, DAMPING
from turnout.integrate.scratch import Work
from turnout.integrate.state import State
from turnout.integrate.system import Floats, System
from turnout.kernels.compiled import compiled, compiled_loop, compiled_part
from turnout.kernels.lanes import LANES, broadcast, horizontal_sum, load, store


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


class Factors(NamedTuple):
    """What a step of one length is multiplied by: its matrix is ``inertia I + viscosity C + K``."""

    inertia: float
    viscosity: float
    share: float


@compiled
def factors_of(stepping: Stepping, h: float) -> Factors:
    """Return the factors of a step of length `h`."""
    kappa = (1.0 - stepping.alpha_f) / (1.0 - stepping.alpha_m)
    inertia, viscosity = 1.0 / (h * h * stepping.beta * kappa), stepping.gamma / (h * stepping.beta)
    return Factors(inertia, viscosity, 1.0 / (1.0 - stepping.alpha_m))


@compiled_part
def begin_step(
    system: System,
    state: State,
    work: Work,
    stepping: Stepping,
    h: float,
    factors: Factors,
) -> None:
    """Save the coordinates; predict the step without new acceleration, and write its right side."""
    _predict(
        stepping,
        h,
        factors,
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
    factors: Factors,
    motion: tuple[Floats, Floats, Floats, Floats],
    damping: Floats,
    constant: Floats,
    saved: Floats,
    predicted: Floats,
    velocity: Floats,
    side: Floats,
) -> None:
    inertia, viscosity = broadcast(factors.inertia), broadcast(factors.viscosity)
    share = factors.share
    old, older = broadcast(share * stepping.alpha_f), broadcast(-share * stepping.alpha_m)
    rest, new = broadcast(0.5 - stepping.beta), broadcast(stepping.beta)
    early, late = broadcast(1.0 - stepping.gamma), broadcast(stepping.gamma)
    step, square = broadcast(h), broadcast(h * h)
    q, v, a, acceleration = motion
    for i in range(0, side.size, LANES):
        now, speed, last = load(q, i), load(v, i), load(a, i)
        known = old * load(acceleration, i) + older * last
        there = now + step * speed + square * (rest * last + new * known)
        fast = speed + step * (early * last + late * known)
        store(now, saved, i)
        store(there, predicted, i)
        store(fast, velocity, i)
        damped = load(damping, i) * (viscosity * there - fast)
        store(inertia * there + load(constant, i) + damped, side, i)


@compiled_part
def complete_step(
    system: System, state: State, work: Work, stepping: Stepping, factors: Factors
) -> None:
    """Complete velocity and accelerations from the solved coordinates.

    Damping and the scheme's own loss are booked, `turnout.integrate.energy`.
    """
    before = (work.q, work.predicted, work.velocity)
    of_damping, of_scheme = _complete(
        stepping, factors, before, system.damping, state.q, state.v, state.a, state.acceleration
    )
    state.ledger[DAMPING] += of_damping
    state.ledger[ALGORITHMIC] += of_scheme


@compiled_loop
def _complete(
    stepping: Stepping,
    factors: Factors,
    before: tuple[Floats, Floats, Floats],
    damping: Floats,
    q: Floats,
    v: Floats,
    a: Floats,
    acceleration: Floats,
) -> tuple[float, float]:
    inertia, viscosity, half = (
        broadcast(factors.inertia),
        broadcast(factors.viscosity),
        broadcast(0.5),
    )
    share, new = broadcast(factors.share), broadcast(1.0 - stepping.alpha_f)
    old, older = broadcast(stepping.alpha_f), broadcast(stepping.alpha_m)
    saved, predicted, velocity = before
    damped, lost = broadcast(0.0), broadcast(0.0)
    for i in range(0, q.size, LANES):
        now, speed, last = load(q, i), load(v, i), load(acceleration, i)
        change, way = now - load(predicted, i), now - load(saved, i)
        fast, push = load(velocity, i) + viscosity * change, inertia * change
        mean = half * (fast + speed)
        damped = damped + load(damping, i) * mean * way
        lost = lost + (half * (push + last) * way - mean * (fast - speed))
        store(share * (new * push + old * last - older * load(a, i)), a, i)
        store(fast, v, i)
        store(push, acceleration, i)
    return horizontal_sum(damped), horizontal_sum(lost)
