"""The energy of an instant: kinetic, in beams and supports, in the laws, and of height."""

import numpy as np

from turnout.integrate.state import State
from turnout.integrate.system import Floats, System
from turnout.integrate.vector import add_rows, dot, total, two_totals
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
    _hold(system, state.q, state.held_at_rest)
    state.law_apart[:] = system.law_load - modes[table.row]
    state.friction_apart[:] = system.friction_load - modes[table.friction_row]


@compiled
def _hold(system: System, q: Floats, force: Floats) -> None:
    """Write the forces that hold the modes at `q`."""
    force[:] = 0.0
    for block in range(system.mode_start.size - 1):
        first, last = system.mode_start[block], system.mode_start[block + 1]
        add_rows(q[first:last], system.stiffness[first:last], force[first:last])


@compiled
def folded_energy(system: System, state: State, work: Work) -> float:
    """Return the energy of the linear system with the base segments of all laws [J]."""
    _hold(system, state.q, work.of_modes)
    return 0.5 * dot(work.of_modes, state.q)


@compiled
def store_energy(
    system: System, table: LawTable, state: State, work: Work, stored: Floats
) -> None:
    """Write the energies of the present instant [J].

    Strain is that of beams and linear supports, by Clapeyron's theorem: half of what all forces on
    a linear body in balance, those of inertia and damping included, do on its displacement. What
    modes do is counted from where they rested at first, and the laws push at their rows, where the
    load has moved what lies above the modes by `r`; see `rest_at`. Gravity and strain leave out the
    same constant. ``work.argument`` and ``work.force`` are those of the solution.
    """
    q, v, acceleration, resting = state.q, state.v, state.acceleration, state.resting
    held, load, damping = state.held_at_rest, system.load, system.damping
    done, height = work.of_modes, work.of_modes_too
    for i in range(q.size):
        force = load[i] - acceleration[i] - damping[i] * v[i]
        done[i] = held[i] * q[i] + force * (q[i] - resting[i])
        height[i] = load[i] * q[i]
    of_modes, lifted = two_totals(done, height)
    _law_work(system, table, state, work)
    of_laws, of_contacts = two_totals(work.of_laws, work.law_energy)
    _friction_work(system, table, state, work)
    of_frictions, of_springs = two_totals(work.of_frictions, work.held)
    lowered = dot(state.friction_force, system.friction_load) - total(work.raised)
    stored[KINETIC] = 0.5 * dot(v, v)
    stored[STRAIN] = 0.5 * (of_modes - of_laws - of_frictions)
    stored[CONTACT] = of_contacts + 0.5 * of_springs
    stored[GRAVITY] = lowered - lifted


@compiled
def _law_work(system: System, table: LawTable, state: State, work: Work) -> None:
    """Write energies of the laws, what they do on their way, and what they raise."""
    argument, force, offset, apart = work.argument, work.force, table.offset, state.law_apart
    base_slope, load = system.base_slope, system.law_load
    slope, intercept, potential = state.slope, state.intercept, state.potential
    raised, done, energies = work.raised, work.of_laws, work.law_energy
    for law in range(force.size):
        at = argument[law]
        e = at - offset[law]
        energies[law] = (0.5 * slope[law] * e + intercept[law]) * e + potential[law]
        held = base_slope[law] * at
        raised[law] = (held - force[law]) * load[law]
        done[law] = force[law] * (at + apart[law]) - held * apart[law]
    for k in range(system.input_law.size):  # of which the argument is not the displacement
        law = system.input_law[k]
        at = argument[law] + state.inputs[table.input_index[law]]
        held = base_slope[law] * at
        raised[law] = (held - force[law]) * load[law]
        done[law] = force[law] * (at + apart[law]) - held * apart[law]


@compiled
def _friction_work(system: System, table: LawTable, state: State, work: Work) -> None:
    """Write what frictions do on their way, and twice the energy of their springs."""
    row, g, apart = table.friction_row, state.g, state.friction_apart
    flexibility = system.stick_flexibility
    forces, done, held = state.friction_force, work.of_frictions, work.held
    for friction in range(forces.size):
        force = forces[friction]
        done[friction] = force * (g[row[friction]] + apart[friction])
        held[friction] = force * force * flexibility[friction]
