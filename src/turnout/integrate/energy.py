r"""Energy of a run: work of a step, and what is stored at an instant.

The books of energy of a step, every term from its own state or force history.

With forces in balance at both ends of a step, the identity

.. math:: \Delta(\text{kinetic}+\text{strain}+\text{laws}+\text{gravity}) =
          W_{markers} + W_{switched} - W_{friction} - W_{dampers} - W_{numerical}

holds to rounding when work is the mean of the forces at both ends times the displacement between
them. None of the terms is computed as what is left of the others, so a term that is wrong leaves a
residual. The numerical loss is the scheme's (`algorithmic`) and, law by law, the work absorbed less
the change of potential where a law changes its segment within a step.

The energy of an instant: kinetic, in beams and supports, in the laws, and of height.
"""

import math

from turnout.integrate.scratch import Work
from turnout.integrate.solve import mark_law
from turnout.integrate.state import State, set_segment
from turnout.integrate.system import Floats, Ints, System
from turnout.kernels.compiled import compiled, compiled_loop, compiled_part
from turnout.kernels.lanes import (
    LANES,
    absolute,
    broadcast,
    gather,
    greater,
    horizontal_sum,
    load,
    select,
    store,
)
from turnout.kernels.vector import add_rows, copy, dot
from turnout.law.kernel import law_argument, law_energy, law_force, segment_for
from turnout.law.table import LawTable

MARKERS, FRICTION, DAMPING, SWITCHED, ALGORITHMIC, SEGMENTS = range(6)


@compiled
def energy_balance(stored: Floats, ledger: Floats) -> tuple[float, float]:
    """Return how far the energy balance of a run is open, and its scale [J].

    Parameters
    ----------
    stored, ledger : ndarray, shape (n, 4), (n, 6)
        Energies at the stored instants [J].

    Returns
    -------
    tuple of float
        Largest residual of all instants, NaN if one is; largest sum of the work of the markers and
        the change of stored energy, both without their signs.
    """
    residual, scale = 0.0, 0.0
    for n in range(stored.shape[0]):
        change = 0.0
        for column in range(stored.shape[1]):
            change += stored[n, column] - stored[0, column]
        gained = ledger[n, MARKERS] + ledger[n, SWITCHED]
        lost = ledger[n, FRICTION] + ledger[n, DAMPING]
        lost += ledger[n, ALGORITHMIC] + ledger[n, SEGMENTS]
        off = abs(change - gained + lost)
        if math.isnan(off):
            return off, scale
        residual = max(residual, off)
        scale = max(scale, abs(ledger[n, MARKERS]) + abs(change))
    return residual, scale


@compiled_part
def account_laws(
    system: System, table: LawTable, state: State, work: Work, old_inputs: Floats, time: float
) -> None:
    """Book the work of the markers and what laws lose that change their segment.

    A law that stays on its segment loses nothing: the mean force times the way is its change of
    energy. ``work.argument`` and ``work.force`` are those of the solution, ``work.g_start`` are the
    displacements before.
    """
    g, old_g, argument, inputs = state.g, work.g_start, work.argument, state.inputs
    forces = work.force
    for k in range(system.input_law.size):
        law = system.input_law[k]
        index = table.input_index[law]
        force = forces[law]
        mean = 0.5 * (force + state.push_force[k])
        state.ledger[MARKERS] -= mean * (inputs[index] - old_inputs[index])
        state.push_force[k] = force
    for k in range(system.timed_law.size):
        law = system.timed_law[k]
        if forces[law] != 0.0:
            state.law_first[law] = min(state.law_first[law], time)
        if state.jump[law] != 0.0:
            way = law_argument(table, law, g, inputs) - law_argument(table, law, old_g, old_inputs)
            state.ledger[SEGMENTS] += 0.5 * state.jump[law] * way
            state.jump[law] = 0.0
    if work.changed[0]:
        for law in range(argument.size):
            if state.segment[law] != work.old_segment[law] and state.present[law]:
                e, old = argument[law] - table.offset[law], work.old_segment[law]
                before = law_argument(table, law, old_g, old_inputs)
                force = state.slope[law] * e + state.intercept[law]
                mean = 0.5 * (force + law_force(table, law, old, before))
                change = law_energy(table, law, state.segment[law], e)
                change -= law_energy(table, law, old, before)
                state.ledger[SEGMENTS] += mean * (e - before) - change


@compiled_part
def account_friction(system: System, state: State, work: Work) -> None:
    """Book friction work; move the anchors of slipping feet so that force and spring agree.

    ``work.trial`` and ``work.limit`` are those of the solution. A cut of the
    limit at zero, where a contact pulls by a trace, would leave the books open. Work is the mean
    force times the way, but a force of before that would push along the way, of a foot that turned
    round within the step, does not count; what the mean would be less is a loss of the scheme, like
    that of laws which change their segment.
    """
    of_friction, of_turns = _slip(
        state.friction, work.trial, work.limit, system.stick_flexibility, state.friction_force,
        state.anchor,
    )  # fmt: skip
    state.ledger[FRICTION] += of_friction
    state.ledger[SEGMENTS] += of_turns


@compiled_loop
def _slip(
    branches: Floats,
    trials: Floats,
    limits: Floats,
    flexibility: Floats,
    forces: Floats,
    anchor: Floats,
) -> tuple[float, float]:
    zero, half = broadcast(0.0), broadcast(0.5)
    lost, turned = zero, zero
    for i in range(0, trials.size, LANES):
        branch, old, trial = load(branches, i), load(forces, i), load(trials, i)
        force = select(greater(absolute(branch), zero), branch * load(limits, i), trial)
        way = (trial - force) * load(flexibility, i)
        kept = select(greater(zero, old * way), force, old)
        lost = lost + half * (force + kept) * way
        turned = turned + half * (old - kept) * way
        store(force, forces, i)
        store(load(anchor, i) + way, anchor, i)
    return horizontal_sum(lost), horizontal_sum(turned)


@compiled_part
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
        force, energy = _present_law(state, law, e)
        state.present[law] = present
        set_segment(table, state, law, segment)
        new_force, new_energy = _present_law(state, law, e)
        state.ledger[SWITCHED] += new_energy - energy
        state.jump[law] += force - new_force
        count = mark_law(system, table, state, work, count, law)
    return count


@compiled
def _present_law(state: State, law: int, e: float) -> tuple[float, float]:
    """Return force [N] and energy [J] of a law as it is; both are 0 where it is absent."""
    slope, intercept = state.slope[law], state.intercept[law]
    return slope * e + intercept, (0.5 * slope * e + intercept) * e + state.potential[law]


KINETIC, STRAIN, CONTACT, GRAVITY = range(4)


@compiled
def rest_at(system: System, table: LawTable, state: State, work: Work) -> None:
    """Take the present modal coordinates for those from which modes are counted.

    Accelerations are small differences of coordinates over the square of the step. Rounding in them
    would count with the whole sag of a rail otherwise.
    """
    by_modes, ends = work.found, system.joining_ends
    by_modes[:] = 0.0
    for block in range(system.end_stop.size):
        q = state.q[system.mode_start[block] : system.mode_start[block + 1]]
        for end in range(system.end_start[block], system.end_stop[block]):
            by_modes[end] = dot(q, system.end_modes[end])
        for end in range(system.follower_start[block], system.follower_start[block + 1]):
            by_modes[end] = dot(q, system.end_modes[end])
    for row in range(ends.shape[1]):
        joined = by_modes[ends[0, row]] + by_modes[ends[1, row]]
        by_modes[system.follower_start[-1] + row] = joined
    copy(state.q, state.resting)
    _holding_forces(system, state.q, state.held_at_rest)
    for law in range(table.row.size):
        state.law_apart[law] = system.law_load[law] - by_modes[table.row[law]]
    for friction in range(table.friction_row.size):
        row = table.friction_row[friction]
        state.friction_apart[friction] = system.friction_load[friction] - by_modes[row]


@compiled
def _holding_forces(system: System, q: Floats, force: Floats) -> None:
    """Write the forces that hold the modes at `q`."""
    force[:] = 0.0
    for block in range(system.mode_start.size - 1):
        first, last = system.mode_start[block], system.mode_start[block + 1]
        add_rows(q[first:last], system.stiffness[first:last], force[first:last])


@compiled_part
def store_energy(system: System, table: LawTable, state: State, work: Work, stored: Floats) -> None:
    """Write the energies of the present instant [J].

    Strain is that of beams and linear supports, by Clapeyron's theorem: half of what all forces on
    a linear body in balance, those of inertia and damping included, do on its displacement. What
    modes do is counted from where they rested at first, and the laws push at their rows, where the
    load has moved what lies above the modes by `r`; see `rest_at`. Gravity and strain leave out the
    same constant. ``work.argument`` and ``work.force`` are those of the solution.
    """
    motion = (state.q, state.v, state.acceleration)
    rest = (state.resting, state.held_at_rest)
    of_modes, lifted, moving = _modal_work(motion, rest, system.load, system.damping)
    energy = (state.slope, state.intercept, state.potential)
    rows = (table.offset, work.law_input, state.law_apart, system.law_load)
    of_laws, of_contacts, raised = _law_work(
        work.argument, work.force, energy, rows, system.base_slope
    )
    held = (state.friction_apart, system.friction_load, system.stick_flexibility)
    of_frictions, of_springs, lowered = _friction_work(
        state.g, table.friction_row, state.friction_force, held
    )
    stored[KINETIC] = 0.5 * moving
    stored[STRAIN] = 0.5 * (of_modes - of_laws - of_frictions)
    stored[CONTACT] = of_contacts + 0.5 * of_springs
    stored[GRAVITY] = lowered - raised - lifted


@compiled_loop
def _modal_work(
    motion: tuple[Floats, Floats, Floats],
    rest: tuple[Floats, Floats],
    constant: Floats,
    damping: Floats,
) -> tuple[float, float, float]:
    """Return what forces on the modes do on their way, and the load; and twice kinetic energy."""
    q, v, acceleration = motion
    resting, held = rest
    done, height, moving = broadcast(0.0), broadcast(0.0), broadcast(0.0)
    for i in range(0, q.size, LANES):
        at, speed, weight = load(q, i), load(v, i), load(constant, i)
        force = weight - load(acceleration, i) - load(damping, i) * speed
        done = done + (load(held, i) * at + force * (at - load(resting, i)))
        height = height + weight * at
        moving = moving + speed * speed
    return horizontal_sum(done), horizontal_sum(height), horizontal_sum(moving)


@compiled_loop
def _law_work(
    arguments: Floats,
    forces: Floats,
    energy: tuple[Floats, Floats, Floats],
    rows: tuple[Floats, Floats, Floats, Floats],
    base_slope: Floats,
) -> tuple[float, float, float]:
    """Return what laws do on their way, their energy, and what they raise."""
    slope, intercept, potential = energy
    offset, inputs, aparts, loads = rows
    half = broadcast(0.5)
    done, contacts, raised = broadcast(0.0), broadcast(0.0), broadcast(0.0)
    for i in range(0, forces.size, LANES):
        argument, force, apart = load(arguments, i), load(forces, i), load(aparts, i)
        e, at = argument - load(offset, i), argument + load(inputs, i)
        stored = (half * load(slope, i) * e + load(intercept, i)) * e
        contacts = contacts + (stored + load(potential, i))
        held = load(base_slope, i) * at
        raised = raised + (held - force) * load(loads, i)
        done = done + (force * (at + apart) - held * apart)
    return horizontal_sum(done), horizontal_sum(contacts), horizontal_sum(raised)


@compiled_loop
def _friction_work(
    g: Floats, row: Ints, forces: Floats, held: tuple[Floats, Floats, Floats]
) -> tuple[float, float, float]:
    """Return what frictions do on their way, twice the energy of their springs, and the height."""
    aparts, loads, flexibility = held
    done, springs, lowered = broadcast(0.0), broadcast(0.0), broadcast(0.0)
    for i in range(0, forces.size, LANES):
        force = load(forces, i)
        done = done + force * (gather(g, row, i) + load(aparts, i))
        springs = springs + force * force * load(flexibility, i)
        lowered = lowered + force * load(loads, i)
    return horizontal_sum(done), horizontal_sum(springs), horizontal_sum(lowered)
