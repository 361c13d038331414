r"""The generalised-alpha step: what it predicts, and how the solved coordinates complete it.

The damping matrix `C` may be full. It is multiplied with the solved coordinates once a step; since
the scheme forms velocities and accelerations from coordinates linearly, the products with these
follow by the same formulas, and so does the right side

.. math:: p = \iota \tilde q + f + C(\nu\tilde q - \tilde v)

from the predicted coordinates :math:`\tilde q` and velocities :math:`\tilde v`.
"""

from typing import NamedTuple

from turnout.integrate.state import State
from turnout.integrate.system import Floats, System
from turnout.integrate.vector import add_rows, copy
from turnout.integrate.work import Work
from turnout.law.compiled import compiled


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
def _predict(
    stepping: Stepping,
    h: float,
    motion: tuple[Floats, Floats, Floats, Floats],
    saved: tuple[Floats, Floats, Floats, Floats],
    predicted: tuple[Floats, Floats],
) -> None:
    """Save a motion and write coordinates and velocities for a step without new acceleration."""
    share = 1.0 / (1.0 - stepping.alpha_m)
    old, older = share * stepping.alpha_f, -share * stepping.alpha_m
    beta, gamma = stepping.beta, stepping.gamma
    q, v, a, acceleration = motion
    coordinate, velocity = predicted
    for k in range(4):
        copy(motion[k], saved[k])
    for i in range(q.size):
        known = old * acceleration[i] + older * a[i]
        coordinate[i] = q[i] + h * v[i] + h * h * ((0.5 - beta) * a[i] + beta * known)
        velocity[i] = v[i] + h * ((1.0 - gamma) * a[i] + gamma * known)


@compiled
def _complete(
    stepping: Stepping,
    h: float,
    motion: tuple[Floats, Floats, Floats, Floats],
    saved: tuple[Floats, Floats, Floats, Floats],
    predicted: tuple[Floats, Floats],
) -> None:
    """Complete velocity and accelerations of a motion from its solved coordinates."""
    inertia, viscosity = coefficients(stepping, h)
    share = 1.0 / (1.0 - stepping.alpha_m)
    new, old, older = 1.0 - stepping.alpha_f, stepping.alpha_f, stepping.alpha_m
    q, v, a, acceleration = motion
    coordinate, velocity = predicted
    old_a, old_acceleration = saved[2], saved[3]
    for i in range(q.size):
        change = q[i] - coordinate[i]
        v[i] = velocity[i] + viscosity * change
        acceleration[i] = inertia * change
        a[i] = share * (new * acceleration[i] + old * old_acceleration[i] - older * old_a[i])


@compiled
def begin_step(system: System, state: State, work: Work, stepping: Stepping, h: float) -> None:
    """Save the state and write the right side of the implicit step."""
    inertia, viscosity = coefficients(stepping, h)
    motion, damped = (state.q, state.v, state.a, state.acceleration), state.damped
    saved, saved_damped = (work.q, work.v, work.a, work.acceleration), work.damped
    _predict(stepping, h, motion, saved, (work.predicted, work.velocity))
    _predict(
        stepping,
        h,
        (damped[0], damped[1], damped[2], damped[3]),
        (saved_damped[0], saved_damped[1], saved_damped[2], saved_damped[3]),
        (work.damped_predicted, work.damped_velocity),
    )
    side, load, predicted = work.right_side, system.load, work.predicted
    damped_predicted, damped_velocity = work.damped_predicted, work.damped_velocity
    for i in range(side.size):
        side[i] = inertia * predicted[i] + load[i]
        side[i] += viscosity * damped_predicted[i] - damped_velocity[i]


@compiled
def damp_coordinates(system: System, state: State) -> None:
    """Multiply the modal coordinates with the damping matrix."""
    product, damping = state.damped[0], system.damping
    for block in range(system.mode_start.size - 1):
        first, last = system.mode_start[block], system.mode_start[block + 1]
        if system.diagonal[block]:
            for mode in range(first, last):
                product[mode] = damping[mode, mode - first] * state.q[mode]
        else:
            product[first:last] = 0.0
            add_rows(state.q[first:last], damping[first:last], product[first:last])


@compiled
def end_step(system: System, state: State, work: Work, stepping: Stepping, h: float) -> None:
    """Complete the state from the solved coordinates; the damping matrix is multiplied once."""
    motion, damped = (state.q, state.v, state.a, state.acceleration), state.damped
    saved, saved_damped = (work.q, work.v, work.a, work.acceleration), work.damped
    _complete(stepping, h, motion, saved, (work.predicted, work.velocity))
    damp_coordinates(system, state)
    _complete(
        stepping,
        h,
        (damped[0], damped[1], damped[2], damped[3]),
        (saved_damped[0], saved_damped[1], saved_damped[2], saved_damped[3]),
        (work.damped_predicted, work.damped_velocity),
    )
