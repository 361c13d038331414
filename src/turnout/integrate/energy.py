r"""The books of energy of a step, every term from its own state or force history.

With forces in balance at both ends of a step, the identity

.. math:: \Delta(\text{kinetic}+\text{strain}+\text{laws}+\text{gravity}) =
          W_{markers} + W_{switched} - W_{friction} - W_{dampers} - W_{numerical}

holds to rounding when work is the mean of the forces at both ends times the displacement between
them. None of the terms is computed as what is left of the others, so a term that is wrong leaves a
residual. The numerical loss is the scheme's (`algorithmic`) and, law by law, the work absorbed less
the change of potential where a law changes its segment within a step.
"""

import numpy as np

from turnout.integrate.solve import mark_law
from turnout.integrate.state import State, set_segment
from turnout.integrate.system import Floats, System
from turnout.integrate.vector import add, copy, dot, total
from turnout.integrate.work import Work
from turnout.law.compiled import compiled
from turnout.law.kernel import STICK, law_argument, law_energy, law_force, segment_for
from turnout.law.table import LawTable

MARKERS, FRICTION, DAMPING, SWITCHED, ALGORITHMIC, SEGMENTS = range(6)
KINETIC, STRAIN, CONTACT, GRAVITY = range(4)


LEAST_SCALE = 0.1
"""Where less than this has moved, rounding is compared with it: forces of 10 kN times 1e-12 m are a
share of 1e-7 [J]."""
ROUNDING = 1e-12
"""What the books may be off besides, as a share of the energy in the folded linear system [-]."""


def closing_error(stored: Floats, ledger: Floats, *, folded: float = 0.0) -> float:
    """Return the largest residual of the books over the scale of a run (work and stored) [-].

    Parameters
    ----------
    stored, ledger : ndarray, shape (n, 4), (n, 6)
        Energies at the stored instants [J].
    folded : float
        Largest energy of the linear system with the base segments of all laws [J], of which the
        books are a small difference where a chair is far from its rail; `ROUNDING` of it is
        overlooked.
    """
    change = stored.sum(axis=1) - stored[:1].sum()
    gained = ledger[:, MARKERS] + ledger[:, SWITCHED]
    lost = ledger[:, [FRICTION, DAMPING, ALGORITHMIC, SEGMENTS]].sum(axis=1)
    turned = np.abs(stored - stored[:1]).sum(axis=1)
    scale = max(float(np.max(np.abs(ledger[:, MARKERS]) + turned)), LEAST_SCALE)
    residual = float(np.max(np.abs(change - gained + lost)))
    return max(residual - ROUNDING * folded, 0.0) / scale if np.isfinite(residual) else residual


@compiled
def account_modal(state: State, work: Work) -> None:
    """Book damping and the scheme's own loss between the saved and the present state."""
    q, v, acceleration, force = state.q, state.v, state.acceleration, state.damped[1]
    old_q, old_v, old_acceleration = work.q, work.v, work.acceleration
    old_force, part = work.damped[1], work.of_modes
    for i in range(q.size):
        part[i] = 0.5 * (force[i] + old_force[i]) * (q[i] - old_q[i])
    state.ledger[DAMPING] += total(part)
    for i in range(q.size):
        inertial = 0.5 * (acceleration[i] + old_acceleration[i]) * (q[i] - old_q[i])
        part[i] = inertial - 0.5 * (v[i] + old_v[i]) * (v[i] - old_v[i])
    state.ledger[ALGORITHMIC] += total(part)


@compiled
def account_laws(
    system: System, table: LawTable, state: State, work: Work, old_inputs: Floats, time: float
) -> None:
    """Book marker work and segment losses; bring law forces, energies and arguments up to date.

    ``work.argument`` is that of the solution.
    """
    for k in range(system.input_law.size):
        law = system.input_law[k]
        index = table.input_index[law]
        at = state.g[table.row[law]] - state.inputs[index]
        force = state.slope[law] * at + state.constant[law]
        mean = 0.5 * (force + state.law_force[law])
        state.ledger[MARKERS] -= mean * (state.inputs[index] - old_inputs[index])
    at, offset = work.argument, table.offset
    slope, constant = state.slope, state.constant
    intercept, potential = state.intercept, state.potential
    forces, energies, arguments = state.law_force, state.law_energy, state.law_argument
    lost = work.of_laws
    for law in range(at.size):
        force = slope[law] * at[law] + constant[law]
        e = at[law] - offset[law]
        energy = (0.5 * slope[law] * e + intercept[law]) * e + potential[law]
        lost[law] = 0.5 * (force + forces[law]) * (e - arguments[law]) - (energy - energies[law])
        forces[law] = force
        energies[law] = energy
        arguments[law] = e
    state.ledger[SEGMENTS] += total(lost)
    peak, first = state.law_peak, state.law_first
    for law in range(at.size):
        size = abs(forces[law])
        peak[law] = max(peak[law], size)
        first[law] = min(first[law], time if size > 0.0 else np.inf)


@compiled
def account_friction(table: LawTable, state: State, work: Work) -> None:
    """Book friction work; move the anchors of slipping feet so that force and spring agree.

    ``work.trial`` and ``work.limit`` are those of the solution, and are used up. A cut of the
    limit at zero, where a contact pulls by a trace, would leave the books open.
    """
    trial, limit, branches = work.trial, work.limit, state.friction
    forces, stiffness = state.friction_force, table.stick_stiffness
    lost = work.of_frictions
    for friction in range(trial.size):
        branch = branches[friction]
        force = trial[friction] if branch == STICK else branch * limit[friction]
        trial[friction] = (trial[friction] - force) / stiffness[friction]
        limit[friction] = force
        lost[friction] = 0.5 * (force + forces[friction]) * trial[friction]
    state.ledger[FRICTION] += total(lost)
    copy(limit, forces)
    add(1.0, trial, state.anchor)


@compiled
def switch_laws(system: System, table: LawTable, state: State, work: Work, time: float) -> int:
    """Let laws appear or disappear at `time`; return how many rows are marked for an update.

    A law that waits for room (a foreign object) does not appear while it would press at once.
    """
    count = 0
    for k in range(system.timed_law.size):
        law = system.timed_law[k]
        present = 1 if table.appears[law] <= time + 1e-9 <= table.disappears[law] + 2e-9 else 0
        if present == state.present[law]:
            continue
        e = law_argument(table, law, state.g, state.inputs)
        segment = state.segment[law]
        if present:
            segment = segment_for(table, law, e, segment, 0.0)
            if table.waits[law] and law_force(table, law, segment, e) > 0.0:
                continue
            state.law_placed[law] = time
        state.present[law] = present
        set_segment(table, state, law, segment)
        energy = law_energy(table, law, segment, e) if present else 0.0
        state.ledger[SWITCHED] += energy - state.law_energy[law]
        state.law_energy[law] = energy
        state.law_argument[law] = e
        count = mark_law(system, table, state, work, count, law)
    return count


@compiled
def stored_energy(
    system: System, table: LawTable, state: State, work: Work, stored: Floats
) -> float:
    """Write kinetic, strain, law (contact, bushing, stick) and gravity energy of the state [J].

    Strain is that of beams and linear supports: half of ``q Lambda q`` plus the residual part
    ``lambda R lambda + 2 lambda r = lambda (e + r) - (Phi^T lambda) q``, less what the base
    segments of the laws hold, where ``Phi^T lambda`` is what keeps the modes in balance. Gravity
    and strain leave out the same constant. Returns the energy of the linear system with the base
    segments of all laws.
    """
    q, v, g, part = state.q, state.v, state.g, work.of_modes
    eigenvalues, load, viscous = system.eigenvalues, system.load, state.damped[1]
    for i in range(q.size):
        part[i] = eigenvalues[i] * q[i]
    folded = 0.5 * dot(part, q)
    for i in range(q.size):  # what the laws push the modes with is what keeps them in balance
        part[i] += state.acceleration[i] + viscous[i] - load[i]
    strain, gravity = folded - 0.5 * dot(part, q), -dot(load, q)
    row, base_slope, forces = table.row, system.base_slope, state.law_force
    of_law, residual, end_load = work.of_laws, work.of_laws_alone, system.end_load
    for law in range(of_law.size):
        at, alone = g[row[law]], end_load[row[law]]
        deviation = base_slope[law] * at - forces[law]
        of_law[law] = deviation * (at + alone) - base_slope[law] * at**2
        residual[law] = deviation * alone
    strain += 0.5 * total(of_law)
    gravity -= total(residual)
    row, forces, stiffness = table.friction_row, state.friction_force, table.stick_stiffness
    of_friction, residual = work.of_frictions, work.of_frictions_alone
    stuck = work.of_frictions_stuck
    for friction in range(of_friction.size):
        at, alone, force = g[row[friction]], end_load[row[friction]], forces[friction]
        of_friction[friction] = force * (at + alone)
        residual[friction] = force * alone
        stuck[friction] = force**2 / stiffness[friction]
    stored[KINETIC] = 0.5 * dot(v, v)
    stored[STRAIN] = strain - 0.5 * total(of_friction)
    stored[CONTACT] = total(state.law_energy) + 0.5 * total(stuck)
    stored[GRAVITY] = gravity + total(residual)
    return folded
