"""The energy of an instant: kinetic, in beams and supports, in the laws, and of height."""

from turnout.integrate.state import State
from turnout.integrate.system import Floats, System
from turnout.integrate.vector import dot, total
from turnout.integrate.work import Work
from turnout.law.compiled import compiled
from turnout.law.table import LawTable

KINETIC, STRAIN, CONTACT, GRAVITY = range(4)


@compiled
def stored_energy(
    system: System, table: LawTable, state: State, work: Work, forces: Floats, stored: Floats
) -> float:
    """Write the forces of the laws [N] and the energies of the present instant [J].

    Strain is that of beams and linear supports: half of ``q Lambda q`` plus the residual part
    ``lambda R lambda + 2 lambda r = lambda (e + r) - (Phi^T lambda) q``, less what the base
    segments of the laws hold, where ``Phi^T lambda`` is what keeps the modes in balance. Gravity
    and strain leave out the same constant.

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
    for i in range(q.size):
        part[i] += state.acceleration[i] + viscous[i] - load[i]
    strain = folded - 0.5 * dot(part, q)
    _law_work(system, table, state, work, forces)
    _friction_work(system, table, state, work)
    of_laws, of_frictions = total(work.of_laws), total(work.of_frictions)
    held = dot(state.friction_force, work.held)
    height = dot(load, q) + dot(work.deviation, system.law_load)
    stored[KINETIC] = 0.5 * dot(v, v)
    stored[STRAIN] = strain + 0.5 * (of_laws - of_frictions)
    stored[CONTACT] = total(work.law_energy) + 0.5 * held
    stored[GRAVITY] = dot(state.friction_force, system.friction_load) - height
    return folded


@compiled
def _law_work(system: System, table: LawTable, state: State, work: Work, forces: Floats) -> None:
    """Write forces, energies and deviations of the laws, and what these do on their way."""
    argument, offset, load, base_slope = (
        work.argument,
        table.offset,
        system.law_load,
        system.base_slope,
    )
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
        done[law] = (held - force) * (at + load[law]) - held * at
    for k in range(system.input_law.size):  # of which the argument is not the displacement
        law = system.input_law[k]
        at = argument[law] + state.inputs[table.input_index[law]]
        held = base_slope[law] * at
        deviation[law] = held - forces[law]
        done[law] = deviation[law] * (at + load[law]) - held * at


@compiled
def _friction_work(system: System, table: LawTable, state: State, work: Work) -> None:
    """Write what frictions do on their way, and how far their springs are drawn."""
    row, g, load, flexibility = (
        table.friction_row,
        state.g,
        system.friction_load,
        system.stick_flexibility,
    )
    forces, done, held = state.friction_force, work.of_frictions, work.held
    for friction in range(forces.size):
        done[friction] = forces[friction] * (g[row[friction]] + load[friction])
    for friction in range(forces.size):
        held[friction] = forces[friction] * flexibility[friction]
