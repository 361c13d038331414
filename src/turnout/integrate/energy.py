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

from turnout.integrate.solve import Work, friction_limit, mark_law, row_forces
from turnout.integrate.system import Floats, State, System, set_segment
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
def account_modal(system: System, state: State, work: Work) -> None:
    """Book damping and the scheme's own loss between the saved and the present state."""
    n_modes = state.q.size
    for i in range(n_modes):
        dq = state.q[i] - work.q[i]
        mean_velocity = 0.5 * (state.v[i] + work.v[i])
        mean_acceleration = 0.5 * (state.acceleration[i] + work.acceleration[i])
        state.ledger[ALGORITHMIC] += mean_acceleration * dq - mean_velocity * (
            state.v[i] - work.v[i]
        )
        force = 0.0
        for j in range(n_modes):
            force += system.damping[i, j] * 0.5 * (state.v[j] + work.v[j])
        state.ledger[DAMPING] += force * dq


@compiled
def account_laws(table: LawTable, state: State, old_inputs: Floats, time: float) -> None:
    """Book marker work and segment losses; bring law forces, energies and arguments up to date."""
    for law in range(table.row.size):
        at = state.g[table.row[law]]
        if table.input_index[law] >= 0:
            at -= state.inputs[table.input_index[law]]
        force = state.slope[law] * at + state.constant[law]
        old_force = state.law_force[law]
        e = at - table.offset[law]
        if force == 0.0 and old_force == 0.0:
            state.law_argument[law] = e
            continue
        energy = 0.0
        if state.present[law]:
            energy = law_energy(table, law, state.segment[law], e)
        mean = 0.5 * (force + old_force)
        if table.input_index[law] >= 0:
            index = table.input_index[law]
            state.ledger[MARKERS] -= mean * (state.inputs[index] - old_inputs[index])
        state.ledger[SEGMENTS] += mean * (e - state.law_argument[law]) - (
            energy - state.law_energy[law]
        )
        state.law_force[law] = force
        state.law_energy[law] = energy
        state.law_argument[law] = e
        if abs(force) > state.law_peak[law]:
            state.law_peak[law] = abs(force)
        if force != 0.0 and not state.law_first[law] <= time:
            state.law_first[law] = time


@compiled
def account_friction(table: LawTable, state: State) -> None:
    """Book friction work; move the anchors of slipping feet so that force and spring agree."""
    for friction in range(table.friction_row.size):
        row = table.friction_row[friction]
        stiffness = table.stick_stiffness[friction]
        branch = state.friction[friction]
        if branch == STICK:
            state.friction_force[friction] = stiffness * (state.g[row] - state.anchor[friction])
            continue
        force = branch * friction_limit(table, state, friction)
        anchor = state.g[row] - force / stiffness
        mean = 0.5 * (force + state.friction_force[friction])
        state.ledger[FRICTION] += mean * (anchor - state.anchor[friction])
        state.friction_force[friction] = force
        state.anchor[friction] = anchor


@compiled
def switch_laws(system: System, table: LawTable, state: State, work: Work, time: float) -> int:
    """Let laws appear or disappear at `time`; return how many rows are marked for an update.

    A law that waits for room (a foreign object) does not appear while it would press at once.
    """
    count = 0
    for law in range(table.row.size):
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
) -> None:
    """Write kinetic, strain, law (contact, bushing, stick) and gravity energy of the state [J].

    Strain is that of beams and linear supports: half of ``q Lambda q`` plus the residual part
    ``lambda R lambda + 2 lambda r``, less what the base segments of the laws hold. Gravity and
    strain leave out the same constant.
    """
    n_rows, n_modes = system.row_load.size, system.eigenvalues.size
    force = work.row[:n_rows]
    row_forces(system, table, state, force)
    kinetic, strain, gravity = 0.0, 0.0, 0.0
    for i in range(n_modes):
        kinetic += 0.5 * state.v[i] ** 2
        strain += 0.5 * system.eigenvalues[i] * state.q[i] ** 2
        gravity -= system.load[i] * state.q[i]
    for i in range(n_rows):
        if force[i] == 0.0:
            continue
        modal = 0.0
        for j in range(n_modes):
            modal += system.base[i, n_rows + j] * state.q[j]
        strain += 0.5 * force[i] * (state.g[i] - modal + system.row_load[i])
        gravity -= force[i] * system.row_load[i]
    contact = 0.0
    for law in range(table.row.size):
        contact += state.law_energy[law]
        strain -= 0.5 * system.base_slope[law] * state.g[table.row[law]] ** 2
    for friction in range(table.friction_row.size):
        contact += 0.5 * state.friction_force[friction] ** 2 / table.stick_stiffness[friction]
    stored[KINETIC] = kinetic
    stored[STRAIN] = strain
    stored[CONTACT] = contact
    stored[GRAVITY] = gravity
