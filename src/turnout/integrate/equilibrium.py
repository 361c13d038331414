"""Where a mechanism rests without friction: the lowest point of its potential energy.

`equilibrium` iterates the contact set of the condensed system. Where that goes round in circles,
`resting_segments` finds the segments of the laws first: every law resists with a force that does
not fall, so the energy is convex and Newton steps that are shortened until the energy falls find
its lowest point from anywhere, on all coordinates.
"""

import numpy as np

from turnout.integrate.accuracy import correct, measure
from turnout.integrate.columns import make_level, rebuild
from turnout.integrate.energy import account_friction, account_laws, rest_at
from turnout.integrate.scratch import Work
from turnout.integrate.solve import CONVERGED, Tolerances, evaluate, settle
from turnout.integrate.state import State
from turnout.integrate.system import Floats, Ints, System
from turnout.kernels.compiled import compiled
from turnout.kernels.vector import copy
from turnout.law.kernel import STICK
from turnout.law.table import LawTable
from turnout.mechanism.mechanism import Mechanism

ITERATIONS = 300


def resting_segments(mechanism: Mechanism, *, inputs: Floats, present: Ints) -> Ints:
    """Return the segment of every law at rest, as near as the iterations come.

    Parameters
    ----------
    mechanism : Mechanism
        Its laws without friction.
    inputs : ndarray, shape (n_inputs,)
        Marker positions [m].
    present : ndarray of int, shape (n_laws,)
        Whether a law acts.
    """
    table, rows = mechanism.laws, mechanism.rows
    at_input = np.where(table.input_index >= 0, inputs[table.input_index] if inputs.size else 0, 0)
    zero = table.offset + at_input
    u = np.zeros(rows.shape[1])

    def energy(u: Floats) -> float:
        _, potential, _ = _laws(table, (rows @ u)[table.row] - zero)
        return float(u @ (0.5 * (mechanism.stiffness @ u) - mechanism.load) + present @ potential)

    for _ in range(ITERATIONS):
        e = (rows @ u)[table.row] - zero
        force, _, slope = _laws(table, e)
        residual = mechanism.stiffness @ u - mechanism.load
        residual += np.bincount(table.row, present * force, rows.shape[0]) @ rows
        tangent = (
            mechanism.stiffness
            + (rows.T * np.bincount(table.row, present * slope, rows.shape[0])) @ rows
        )
        if not np.isfinite(residual).all():
            break
        direction = -np.linalg.lstsq(tangent, residual)[0]
        now, descent, share = energy(u), float(residual @ direction), 1.0
        while energy(u + share * direction) > now + 1e-4 * share * descent and share > 1e-9:
            share *= 0.5
        u = u + share * direction
        if np.abs(direction).max() <= 1e-12 * max(float(np.abs(u).max()), 1e-6):
            break
    return _segments(table, (rows @ u)[table.row] - zero)


def _segments(table: LawTable, e: Floats) -> Ints:
    counts = [
        int(np.searchsorted(table.segment_upper[first : last - 1], value))
        for first, last, value in zip(
            table.segment_start[:-1], table.segment_start[1:], e, strict=True
        )
    ]
    return np.array(counts, dtype=np.int64)


def _laws(table: LawTable, e: Floats) -> tuple[Floats, Floats, Floats]:
    """Return force [N], energy [J] and slope [N/m] of every law at its argument."""
    at = table.segment_start[:-1] + _segments(table, e)
    force = table.slope[at] * e + table.intercept[at]
    energy = (0.5 * table.slope[at] * e + table.intercept[at]) * e + table.potential[at]
    return force, energy, table.slope[at]


@compiled
def equilibrium(
    system: System, table: LawTable, state: State, work: Work, tolerances: Tolerances
) -> int:
    """Find the static equilibrium for the present inputs by iterating the contact set.

    The columns are made for a level without inertia and viscosity, the last one. What rounding has
    left in the equations is taken off once: nothing should move in the first step of a rail at
    rest.
    """
    static = state.made.size - 1
    make_level(system, state, static, 0.0, 0.0)
    rebuild(system, table, state, static, work.row)
    copy(system.load, work.right_side)
    code = settle(system, table, state, work, tolerances)
    if code == CONVERGED:
        measure(system, table, state, work, 0.0, 0.0)
        correct(system, state, work)
    return code


@compiled
def begin_at_rest(system: System, table: LawTable, state: State, work: Work) -> None:
    """Anchor every foot where it stands, and open the books of energy."""
    state.friction[:] = STICK
    for friction in range(state.anchor.size):
        state.anchor[friction] = state.g[table.friction_row[friction]]
    evaluate(table, state, work)
    account_laws(system, table, state, work, state.inputs, 0.0)
    account_friction(system, state, work)
    state.ledger[:] = 0.0
    work.unsettled[:] = 0
    rest_at(system, table, state, work)
