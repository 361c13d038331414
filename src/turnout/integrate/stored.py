"""The energy of an instant: kinetic, in beams and supports, in the laws, and of height."""

import numpy as np

from turnout.integrate.state import State
from turnout.integrate.system import Floats, System
from turnout.integrate.vector import dot, total
from turnout.integrate.work import Work
from turnout.law.compiled import compiled
from turnout.law.table import LawTable

KINETIC, STRAIN, CONTACT, GRAVITY = range(4)


def rest_at(system: System, table: LawTable, state: State) -> None:
    """Take the present modal coordinates for those from which modes are counted.

    Accelerations are small differences of coordinates over the square of the step. Rounding in them
    would count with the whole sag of a rail otherwise.
    """
    modes = np.zeros(state.g.size)
    for block in range(system.end_stop.size):
        mine = slice(system.mode_start[block], system.mode_start[block + 1])
        q = state.q[mine]
        for first, last in (
            (system.end_start[block], system.end_stop[block]),
            (system.follower_start[block], system.follower_start[block + 1]),
        ):
            modes[first:last] = system.end_modes[first:last, : q.size] @ q
    modes[system.follower_start[-1] :] = modes[system.joining_ends].sum(axis=0)
    state.resting[:] = state.q
    state.law_apart[:] = system.law_load - modes[table.row]
    state.friction_apart[:] = system.friction_load - modes[table.friction_row]


@compiled
def stored_energy(
    system: System, table: LawTable, state: State, work: Work, forces: Floats, stored: Floats
) -> float:
    """Write the forces of the laws [N] and the energies of the present instant [J].

    Strain is that of beams and linear supports, by Clapeyron's theorem: half of what all forces on
    a linear body in balance, those of inertia and damping included, do on its displacement. What
    modes do is counted from where they rested at first, and the laws push at their rows, where the
    load has moved what lies above the modes by `r`; see `rest_at`. Gravity and strain leave out the
    same constant.

    Parameters
    ----------
    work : Work
        ``work.argument`` is that of the solution.

    Returns
    -------
    float
        The energy of the linear system with the base segments of all laws [J].
    """
    q, v, part = state.q, state.v, work.of_modes
    eigenvalues, load, viscous = system.eigenvalues, system.load, state.damped[1]
    for i in range(q.size):
        part[i] = eigenvalues[i] * q[i]
    folded = 0.5 * dot(part, q)
    work_at_rest = dot(part, state.resting)
    for i in range(q.size):
        force = load[i] - state.acceleration[i] - viscous[i]
        part[i] = force * (q[i] - state.resting[i])
    _law_work(system, table, state, work, forces)
    _friction_work(system, table, state, work)
    of_laws, of_frictions = total(work.of_laws), total(work.of_frictions)
    held = dot(state.friction_force, work.held)
    height = dot(load, q) + dot(work.deviation, system.law_load)
    stored[KINETIC] = 0.5 * dot(v, v)
    stored[STRAIN] = 0.5 * (work_at_rest + total(part) - of_laws - of_frictions)
    stored[CONTACT] = total(work.law_energy) + 0.5 * held
    stored[GRAVITY] = dot(state.friction_force, system.friction_load) - height
    return folded


@compiled
def _law_work(system: System, table: LawTable, state: State, work: Work, forces: Floats) -> None:
    """Write forces, energies and deviations of the laws, and what these do on their way."""
    argument, offset, apart = work.argument, table.offset, state.law_apart
    base_slope = system.base_slope
    slope, constant = state.slope, state.constant
    intercept, potential = state.intercept, state.potential
    deviation, done, energies = work.deviation, work.of_laws, work.law_energy
    for law in range(forces.size):
        at = argument[law]
        force = slope[law] * at + constant[law]
        e = at - offset[law]
        energies[law] = (0.5 * slope[law] * e + intercept[law]) * e + potential[law]
        forces[law] = force
        held = base_slope[law] * at
        deviation[law] = held - force
        done[law] = force * (at + apart[law]) - held * apart[law]
    for k in range(system.input_law.size):  # of which the argument is not the displacement
        law = system.input_law[k]
        at = argument[law] + state.inputs[table.input_index[law]]
        held = base_slope[law] * at
        deviation[law] = held - forces[law]
        done[law] = forces[law] * (at + apart[law]) - held * apart[law]


@compiled
def _friction_work(system: System, table: LawTable, state: State, work: Work) -> None:
    """Write what frictions do on their way, and how far their springs are drawn."""
    row, g, apart = table.friction_row, state.g, state.friction_apart
    flexibility = system.stick_flexibility
    forces, done, held = state.friction_force, work.of_frictions, work.held
    for friction in range(forces.size):
        done[friction] = forces[friction] * (g[row[friction]] + apart[friction])
    for friction in range(forces.size):
        held[friction] = forces[friction] * flexibility[friction]
