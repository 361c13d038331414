"""An independent program: every degree of freedom, a fine fixed step, full Newton on all laws.

It shares no code and no method with turnout: no modes, no residual flexibility, no rank-one
updates, no guess-and-check of sets. BDF2 in time, second order and without memory of what the step
cannot resolve,

.. math:: v_n = (3 u_n - 4 u_{n-1} + u_{n-2}) / 2h, \\quad a_n = (3 v_n - 4 v_{n-1} + v_{n-2}) / 2h,

and in each step a semi-smooth Newton iteration on ``S u + G^T f(G u) = r`` with all laws evaluated
afresh. The linear algebra of that is done on the rows: with A = G S^-1 G^T it is
``g + A f(g) = G S^-1 r``, the same equations. Friction is an elastic-plastic return mapping with
the normal force of the same instant; ``frozen`` puts constant normal forces in its place. Forces
`f` resist the growth of their row.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Floats = np.ndarray


@dataclass(frozen=True)
class Laws:
    """Bushings between markers and rows, contacts, and feet that name their contact by index."""

    bushing_row: list[int]
    bushing_marker: list[int]
    bushing_stiff: Floats
    bushing_soft: Floats
    bushing_bend: Floats
    contact_row: list[int]
    contact_stiffness: Floats
    foot_row: list[int]
    foot_contact: list[int]
    foot_coefficient: Floats
    foot_stiffness: Floats


@dataclass(frozen=True)
class Path:
    """What a run leaves: time, rows, forces of bushings on the body, of contacts and of feet."""

    time: Floats
    g: Floats
    bushing: Floats
    contact: Floats
    friction: Floats
    newton_iterations: int


def forces(
    laws: Laws, g: Floats, markers: Floats, anchor: Floats, frozen: Floats | None
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return bushing, contact and foot forces for rows `g`, and their derivative by the rows."""
    n = g.size
    derivative = np.zeros((n, n))
    stretch = g[laws.bushing_row] - markers
    beyond = np.abs(stretch) > laws.bushing_bend
    bend = np.sign(stretch) * laws.bushing_bend
    bushing = np.where(
        beyond,
        laws.bushing_stiff * bend + laws.bushing_soft * (stretch - bend),
        laws.bushing_stiff * stretch,
    )
    np.add.at(
        derivative,
        (laws.bushing_row, laws.bushing_row),
        np.where(beyond, laws.bushing_soft, laws.bushing_stiff),
    )
    pressed = g[laws.contact_row]
    slope = np.where(pressed > 0, laws.contact_stiffness, 0.0)
    contact = slope * pressed
    np.add.at(derivative, (laws.contact_row, laws.contact_row), slope)
    normal = contact[laws.foot_contact] if frozen is None else frozen[laws.foot_contact]
    limit = laws.foot_coefficient * normal
    trial = laws.foot_stiffness * (g[laws.foot_row] - anchor)
    sticks = np.abs(trial) <= limit
    friction = np.where(sticks, trial, np.sign(trial) * limit)
    rows = np.array(laws.foot_row)
    np.add.at(derivative, (rows, rows), np.where(sticks, laws.foot_stiffness, 0.0))
    if frozen is None:
        gain = np.where(sticks, 0.0, np.sign(trial) * laws.foot_coefficient)
        gain = gain * slope[laws.foot_contact]
        normal_rows = np.array(laws.contact_row)[laws.foot_contact]
        np.add.at(derivative, (rows, normal_rows), gain)
    return bushing, contact, friction, derivative


def on_rows(laws: Laws, n: int, bushing: Floats, contact: Floats, friction: Floats) -> Floats:
    """Add the forces up on their rows."""
    total = np.zeros(n)
    np.add.at(total, laws.bushing_row, bushing)
    np.add.at(total, laws.contact_row, contact)
    np.add.at(total, laws.foot_row, friction)
    return total


def newton(
    laws: Laws,
    flexibility: Floats,
    free: Floats,
    guess: Floats,
    markers: Floats,
    anchor: Floats,
    frozen: Floats | None,
) -> tuple[Floats, tuple[Floats, Floats, Floats], int]:
    """Solve ``g + A f(g) = free``; return rows, forces and iterations."""
    g = guess.copy()
    eye = np.eye(g.size)
    for iteration in range(60):
        *parts, derivative = forces(laws, g, markers, anchor, frozen)
        residual = g + flexibility @ on_rows(laws, g.size, *parts) - free
        if np.max(np.abs(residual)) < 1e-13:
            return g, (parts[0], parts[1], parts[2]), iteration
        change = np.linalg.solve(eye + flexibility @ derivative, residual)
        g -= change if iteration < 20 else 0.5 * change
    message = "the brute-force program found no solution of a step"
    raise RuntimeError(message)


def brute_force(
    mass: Floats,
    stiffness: Floats,
    damping: Floats,
    load: Floats,
    rows: Floats,
    laws: Laws,
    *,
    markers: Callable[[Floats], Floats],
    step: float,
    end: float,
    every: int,
    frozen: Floats | None = None,
) -> Path:
    """Simulate from the static equilibrium without friction; store each `every`-th step."""
    n_steps = round(end / step)
    positions = markers(step * np.arange(n_steps + 1)).T
    frictionless = np.zeros(len(laws.foot_contact))
    slippery = Laws(**{**vars(laws), "foot_coefficient": frictionless})
    soft = np.linalg.inv(stiffness)
    g, parts, total = newton(
        slippery,
        rows @ soft @ rows.T,
        rows @ soft @ load,
        np.zeros(rows.shape[0]),
        positions[0],
        frictionless,
        None,
    )
    u = soft @ (load - rows.T @ on_rows(laws, g.size, *parts))
    anchor = g[laws.foot_row]
    inverse = np.linalg.inv(9 / (4 * step**2) * mass + 3 / (2 * step) * damping + stiffness)
    flexibility = rows @ inverse @ rows.T
    older, v, v_older = u, np.zeros(u.size), np.zeros(u.size)
    stored = [(g, *parts)]
    for n in range(1, n_steps + 1):
        right = mass @ (
            (12 * u - 3 * older) / (4 * step**2) + (4 * v - v_older) / (2 * step)
        ) + damping @ ((4 * u - older) / (2 * step))
        right += load
        free = rows @ (inverse @ right)
        g, parts, iterations = newton(laws, flexibility, free, g, positions[n], anchor, frozen)
        total += iterations
        u_new = inverse @ (right - rows.T @ on_rows(laws, g.size, *parts))
        v, v_older = (3 * u_new - 4 * u + older) / (2 * step), v
        u, older = u_new, u
        anchor = g[laws.foot_row] - parts[2] / laws.foot_stiffness
        if n % every == 0:
            stored.append((g, *parts))
    columns = [np.array(c) for c in zip(*stored, strict=True)]
    time = step * every * np.arange(len(stored))
    return Path(time, columns[0], -columns[1], columns[2], columns[3], total)
