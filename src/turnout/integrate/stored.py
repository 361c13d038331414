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
    stored[KINETIC] = 0.5 * dot(v, v)
    stored[STRAIN] = strain + 0.5 * (total(work.of_laws) - total(work.of_frictions))
    stored[CONTACT] = total(work.law_energy) + 0.5 * total(work.of_frictions_stuck)
    stored[GRAVITY] = total(work.of_frictions_alone) - total(work.of_laws_alone) - dot(load, q)
    return folded


@compiled
def _law_work(
    system: System, table: LawTable, state: State, work: Work, forces: Floats
) -> None:
    """Write forces and energies of the laws, and what their deviations do on the way and on `r`."""
    row, g, base_slope, end_load = table.row, state.g, system.base_slope, system.end_load
    argument, offset = work.argument, table.offset
    slope, constant = state.slope, state.constant
    intercept, potential = state.intercept, state.potential
    deviations, alone, energies = work.of_laws, work.of_laws_alone, work.law_energy
    for law in range(forces.size):
        force = slope[law] * argument[law] + constant[law]
        e = argument[law] - offset[law]
        energies[law] = (0.5 * slope[law] * e + intercept[law]) * e + potential[law]
        forces[law] = force
    for law in range(forces.size):
        at, of_load = g[row[law]], end_load[row[law]]
        deviation = base_slope[law] * at - forces[law]
        deviations[law] = deviation * (at + of_load) - base_slope[law] * at * at
        alone[law] = deviation * of_load


@compiled
def _friction_work(system: System, table: LawTable, state: State, work: Work) -> None:
    """Write what frictions do on the way and on `r`, and twice what their springs hold."""
    row, g, end_load = table.friction_row, state.g, system.end_load
    forces, stiffness = state.friction_force, table.stick_stiffness
    done, alone, stuck = work.of_frictions, work.of_frictions_alone, work.of_frictions_stuck
    for friction in range(forces.size):
        at, of_load, force = g[row[friction]], end_load[row[friction]], forces[friction]
        done[friction] = force * (at + of_load)
        alone[friction] = force * of_load
        stuck[friction] = force * force / stiffness[friction]
