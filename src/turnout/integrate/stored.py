"""The energy of an instant: kinetic, in beams and supports, in the laws, and of height."""

import numpy as np

from turnout.integrate.state import State
from turnout.integrate.system import Floats, System
from turnout.integrate.vector import add_rows, dot, gather, total, two_totals
from turnout.integrate.work import Work
from turnout.law.compiled import compiled, compiled_loop
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
    _holding_forces(system, state.q, state.held_at_rest)
    state.law_apart[:] = system.law_load - modes[table.row]
    state.friction_apart[:] = system.friction_load - modes[table.friction_row]


@compiled
def _holding_forces(system: System, q: Floats, force: Floats) -> None:
    """Write the forces that hold the modes at `q`."""
    force[:] = 0.0
    for block in range(system.mode_start.size - 1):
        first, last = system.mode_start[block], system.mode_start[block + 1]
        add_rows(q[first:last], system.stiffness[first:last], force[first:last])


@compiled
def folded_energy(system: System, state: State, work: Work) -> float:
    """Return the energy of the linear system with the base segments of all laws [J]."""
    _holding_forces(system, state.q, work.of_modes)
    return 0.5 * dot(work.of_modes, state.q)


@compiled
def store_energy(system: System, table: LawTable, state: State, work: Work, stored: Floats) -> None:
    """Write the energies of the present instant [J].

    Strain is that of beams and linear supports, by Clapeyron's theorem: half of what all forces on
    a linear body in balance, those of inertia and damping included, do on its displacement. What
    modes do is counted from where they rested at first, and the laws push at their rows, where the
    load has moved what lies above the modes by `r`; see `rest_at`. Gravity and strain leave out the
    same constant. ``work.argument`` and ``work.force`` are those of the solution.
    """
    v, done, height = state.v, work.of_modes, work.of_modes_too
    motion = (state.q, v, state.acceleration)
    rest = (state.resting, state.held_at_rest)
    _modal_work(motion, rest, system.load, system.damping, done, height)
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


@compiled_loop
def _modal_work(
    motion: tuple[Floats, Floats, Floats],
    rest: tuple[Floats, Floats],
    load: Floats,
    damping: Floats,
    done: Floats,
    height: Floats,
) -> None:
    q, v, acceleration = motion
    resting, held = rest
    for i in range(q.size):
        force = load[i] - acceleration[i] - damping[i] * v[i]
        done[i] = held[i] * q[i] + force * (q[i] - resting[i])
        height[i] = load[i] * q[i]


@compiled
def _law_work(system: System, table: LawTable, state: State, work: Work) -> None:
    """Write energies of the laws, what they do on their way, and what they raise."""
    argument, force = work.argument, work.force
    base_slope, load = system.base_slope, system.law_load
    raised, done, apart = work.raised, work.of_laws, state.law_apart
    energy = (state.slope, state.intercept, state.potential)
    _energy_of_laws(argument, table.offset, energy, work.law_energy)
    _work_at_rows(argument, force, base_slope, load, apart, raised, done)
    for k in range(system.input_law.size):  # of which the argument is not the displacement
        law = system.input_law[k]
        at = argument[law] + state.inputs[table.input_index[law]]
        held = base_slope[law] * at
        raised[law] = (held - force[law]) * load[law]
        done[law] = force[law] * (at + apart[law]) - held * apart[law]


@compiled_loop
def _energy_of_laws(
    argument: Floats, offset: Floats, energy: tuple[Floats, Floats, Floats], energies: Floats
) -> None:
    slope, intercept, potential = energy
    for law in range(energies.size):
        e = argument[law] - offset[law]
        energies[law] = (0.5 * slope[law] * e + intercept[law]) * e + potential[law]


@compiled_loop
def _work_at_rows(
    at: Floats,
    force: Floats,
    base_slope: Floats,
    load: Floats,
    apart: Floats,
    raised: Floats,
    done: Floats,
) -> None:
    for law in range(force.size):
        held = base_slope[law] * at[law]
        raised[law] = (held - force[law]) * load[law]
        done[law] = force[law] * (at[law] + apart[law]) - held * apart[law]


@compiled
def _friction_work(system: System, table: LawTable, state: State, work: Work) -> None:
    """Write what frictions do on their way, and twice the energy of their springs."""
    gather(state.g, table.friction_row, work.of_frictions)
    forces, apart, flexibility = (
        state.friction_force,
        state.friction_apart,
        system.stick_flexibility,
    )
    _work_of_frictions(forces, apart, flexibility, work.of_frictions, work.held)


@compiled_loop
def _work_of_frictions(
    forces: Floats, apart: Floats, flexibility: Floats, done: Floats, held: Floats
) -> None:
    for friction in range(forces.size):
        force = forces[friction]
        done[friction] = force * (done[friction] + apart[friction])
        held[friction] = force * force * flexibility[friction]
