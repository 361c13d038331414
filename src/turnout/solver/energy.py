r"""Energy balance of a run: the work of each step, and the energy stored at an instant.

With forces in equilibrium at both ends of a step, the identity

.. math:: \Delta(\text{kinetic}+\text{strain}+\text{laws}+\text{gravity}) =
          W_{markers} + W_{switched} - W_{friction} - W_{dampers} - W_{objects} - W_{numerical}

holds to rounding when work is the mean of the forces at both ends times the displacement between
them. Every term comes from its own states or forces and none is the difference of the others, so a
wrong term leaves an energy residual. Numerical dissipation is that of the scheme (`ALGORITHMIC`)
and, where a law changes its segment within a step, the work absorbed less the change of potential
(`SEGMENTS`). The stored energy of an instant is kinetic, strain (beams and linear supports), that
of the laws, and potential energy in the field of gravity.
"""

import functools
from itertools import pairwise

import numpy as np

from turnout.kernels.compiled import compiled, compiled_loop, compiled_part
from turnout.kernels.lanes import (
    LANES,
    broadcast,
    gather,
    horizontal_sum,
    load,
)
from turnout.kernels.vector import add_weighted_rows, copy, dot
from turnout.law.friction import slip_anchors
from turnout.law.kernel import law_argument, law_energy, law_force, segment_for
from turnout.solver.columns import mark_law
from turnout.solver.state import LAWS, Run, State, set_segment
from turnout.solver.system import Floats, Ints, System

MARKERS, FRICTION, DAMPING, SWITCHED, ALGORITHMIC, SEGMENTS, OBJECTS = range(7)
LEDGER = 7
"""Columns of the ledger, the work since the start [J], and their number."""
KINETIC, STRAIN, CONTACT, GRAVITY = range(4)
STORED = GRAVITY + 1
"""Columns of the stored energies [J], and their number."""


def unaccounted_energy(stored: Floats, ledger: Floats) -> tuple[Floats, Floats]:
    """Return changes of stored energy, and these less the net energy put in [J].

    Parameters
    ----------
    stored, ledger : ndarray, shape (n, 4), (n, 7)
        Stored energies and work so far, at the stored instants [J].

    Returns
    -------
    tuple of ndarray, shape (n,)
        Of all stored energies since the first instant.
    """
    change = functools.reduce(np.add, (stored - stored[:1]).T)
    gained = ledger[:, MARKERS] + ledger[:, SWITCHED]
    lost = ledger[:, FRICTION] + ledger[:, DAMPING]
    lost = lost + (ledger[:, ALGORITHMIC] + ledger[:, SEGMENTS] + ledger[:, OBJECTS])
    return change, change - gained + lost


def energy_balance(stored: Floats, ledger: Floats) -> tuple[float, float]:
    """Return the energy residual of a run, and its scale [J].

    Parameters
    ----------
    stored, ledger : ndarray
        As of `unaccounted_energy`.

    Returns
    -------
    tuple of float
        Largest residual of all instants, NaN if one is; largest sum of the work of the markers and
        the change of stored energy, both without their signs.
    """
    with np.errstate(invalid="ignore", over="ignore"):  # of a run that diverged
        change, residual = unaccounted_energy(stored, ledger)
        turned_over = np.abs(ledger[:, MARKERS]) + np.abs(change)
    largest = np.abs(residual).max(initial=0.0)
    return float(largest), float(np.fmax.reduce(turned_over, initial=0.0))


def folded_energy(run: Run, state: State) -> float:
    """Return the present energy of the linear system with all laws on their base segments [J].

    The stored energy of an instant is a small difference of such energies where chairs that are
    closed in the linear system lie metres below their rails.
    """
    of_modes, system = 0.0, run.system
    for first, last in pairwise(system.mode_start.tolist()):
        q = state.q[first:last]
        of_modes += float(q @ system.stiffness[first:last, : last - first] @ q)
    displacement = state.g[run.table.row]
    return 0.5 * (of_modes + float(system.base_slope @ (displacement * displacement)))


@compiled_part
def account_laws(run: Run, state: State, inputs_start: Floats, time: float) -> None:
    """Add up the work of the markers and the dissipation of laws that change their segment.

    A law that stays on its segment dissipates nothing: its mean force times the displacement is its
    change of energy. ``work.argument`` and ``work.force`` are those of the solution,
    ``work.g_start`` are the displacements at the start of the step.
    """
    system, table, work = run.system, run.table, run.work
    g, g_start, argument, inputs = state.g, work.g_start, work.argument, state.inputs
    forces = work.force
    for k in range(system.input_law.size):
        law = system.input_law[k]
        index = table.input_index[law]
        force = forces[law]
        mean = 0.5 * (force + state.input_law_force[k])
        state.ledger[MARKERS] -= mean * (inputs[index] - inputs_start[index])
        state.input_law_force[k] = force
    for k in range(system.timed_law.size):
        law = system.timed_law[k]
        if forces[law] != 0.0:
            state.law_first[law] = min(state.law_first[law], time)
        if state.jump[law] != 0.0:
            displacement = law_argument(table, law, g, inputs) - law_argument(
                table, law, g_start, inputs_start
            )
            state.ledger[SEGMENTS] += 0.5 * state.jump[law] * displacement
            state.jump[law] = 0.0
    if work.changed[LAWS]:
        for law in range(argument.size):
            if state.segment[law] != work.saved_segment[law] and state.present[law]:
                e, old_segment = argument[law] - table.offset[law], work.saved_segment[law]
                e_start = law_argument(table, law, g_start, inputs_start)
                force = state.slope[law] * e + state.intercept[law]
                mean = 0.5 * (force + law_force(table, law, old_segment, e_start))
                change = law_energy(table, law, state.segment[law], e)
                change -= law_energy(table, law, old_segment, e_start)
                state.ledger[SEGMENTS] += mean * (e - e_start) - change


@compiled_part
def account_friction(run: Run, state: State) -> None:
    """Add up friction work; move the anchors of slipping feet so that force and spring agree.

    ``work.trial`` and ``work.limit`` are those of the solution. The limit is not cut off at zero,
    where a contact pulls slightly within the tolerance: that would leave a residual. Work is the
    mean force times the slip. The force at the start does not count where it would act along the
    slip, since the foot reversed within the step; the difference is numerical dissipation, as of
    laws that change their segment.
    """
    system, work = run.system, run.work
    of_friction, of_turns = slip_anchors(
        state.friction, work.trial, work.limit, system.stick_flexibility, state.friction_force,
        state.anchor,
    )  # fmt: skip
    state.ledger[FRICTION] += of_friction
    state.ledger[SEGMENTS] += of_turns


@compiled_part
def switch_laws(run: Run, state: State, time: float) -> int:
    """Let laws appear or disappear at `time`; return how many rows are marked for an update.

    A law that waits for room (a foreign object) does not appear while it would press at once.
    """
    system, table = run.system, run.table
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
        force, energy = force_and_energy(state, law, e)
        state.present[law] = present
        set_segment(table, state, law, segment)
        new_force, new_energy = force_and_energy(state, law, e)
        state.ledger[SWITCHED] += new_energy - energy
        state.jump[law] += force - new_force
        count = mark_law(run, state, count, law)
    return count


@compiled
def force_and_energy(state: State, law: int, e: float) -> tuple[float, float]:
    """Return force [N] and energy [J] of a law on its present segment; 0 where it is absent."""
    slope, intercept = state.slope[law], state.intercept[law]
    return slope * e + intercept, (0.5 * slope * e + intercept) * e + state.potential[law]


@compiled
def set_energy_reference(run: Run, state: State) -> None:
    """Make the present modal coordinates the reference of strain and potential energy.

    Accelerations are small differences of coordinates over the square of the step. Without this
    reference their rounding would be multiplied by the whole sag of a rail.
    """
    system, table, work = run.system, run.table, run.work
    modal_g, ends = work.end_scratch, system.joining_ends
    modal_g[:] = 0.0
    for block in range(system.end_stop.size):
        q = state.q[system.mode_start[block] : system.mode_start[block + 1]]
        leading = (system.end_start[block], system.end_stop[block])
        following = (system.follower_start[block], system.follower_start[block + 1])
        for first, last in (leading, following):
            for end in range(first, last):
                modal_g[end] = dot(q, system.end_modes[end])
    for row in range(ends.shape[1]):
        joined = modal_g[ends[0, row]] + modal_g[ends[1, row]]
        modal_g[system.follower_start[-1] + row] = joined
    copy(state.q, state.q_rest)
    _modal_forces(system, state.q, state.modal_force_rest)
    for law in range(table.row.size):
        state.law_rest_offset[law] = system.law_load[law] - modal_g[table.row[law]]
    for friction in range(table.friction_row.size):
        row = table.friction_row[friction]
        state.friction_rest_offset[friction] = system.friction_load[friction] - modal_g[row]


@compiled
def _modal_forces(system: System, q: Floats, force: Floats) -> None:
    """Write the elastic forces of the modes at coordinates `q`."""
    force[:] = 0.0
    for block in range(system.mode_start.size - 1):
        first, last = system.mode_start[block], system.mode_start[block + 1]
        add_weighted_rows(q[first:last], system.stiffness[first:last], force[first:last])


@compiled_part
def store_energy(run: Run, state: State, stored: Floats) -> None:
    """Write the energies of the present instant [J].

    Strain energy of beams and linear supports follows from Clapeyron's theorem: half the work of
    all forces on a linear body in equilibrium, inertia and damping included, along its
    displacement. Modal displacements count from the reference of `set_energy_reference`; the laws
    act at their rows, which the load moves by `r` beyond the modes. Gravity and strain leave out
    the same constant. ``work.argument`` and ``work.force`` are those of the solution.
    """
    system, table, work = run.system, run.table, run.work
    motion = (state.q, state.v, state.acceleration)
    reference = (state.q_rest, state.modal_force_rest)
    of_modes, of_load, twice_kinetic = _modal_work(motion, reference, system.load, system.damping)
    energy = (state.slope, state.intercept, state.potential)
    rows = (table.offset, work.law_input, state.law_rest_offset, system.law_load)
    of_laws, of_contacts, of_law_load = _law_work(
        work.argument, work.force, energy, rows, system.base_slope
    )
    of_rows = (state.friction_rest_offset, system.friction_load, system.stick_flexibility)
    of_frictions, of_springs, of_friction_load = _friction_work(
        state.g, table.friction_row, state.friction_force, of_rows
    )
    stored[KINETIC] = 0.5 * twice_kinetic
    stored[STRAIN] = 0.5 * (of_modes - of_laws - of_frictions)
    stored[CONTACT] = of_contacts + 0.5 * of_springs
    stored[GRAVITY] = of_friction_load - of_law_load - of_load


@compiled_loop
def _modal_work(
    motion: tuple[Floats, Floats, Floats],
    reference: tuple[Floats, Floats],
    constant: Floats,
    damping: Floats,
) -> tuple[float, float, float]:
    """Return the work of the modal forces, that of the load, and twice the kinetic energy [J]."""
    q, v, acceleration = motion
    q_rest, force_rest = reference
    total, load_work, twice_kinetic = broadcast(0.0), broadcast(0.0), broadcast(0.0)
    for i in range(0, q.size, LANES):
        q_n, v_n, load_n = load(q, i), load(v, i), load(constant, i)
        force = load_n - load(acceleration, i) - load(damping, i) * v_n
        total = total + (load(force_rest, i) * q_n + force * (q_n - load(q_rest, i)))
        load_work = load_work + load_n * q_n
        twice_kinetic = twice_kinetic + v_n * v_n
    return horizontal_sum(total), horizontal_sum(load_work), horizontal_sum(twice_kinetic)


@compiled_loop
def _law_work(
    arguments: Floats,
    forces: Floats,
    energy: tuple[Floats, Floats, Floats],
    rows: tuple[Floats, Floats, Floats, Floats],
    base_slope: Floats,
) -> tuple[float, float, float]:
    """Return the work of the laws, their stored energy, and their work against the load [J]."""
    slope, intercept, potential = energy
    offset, inputs, rest_offsets, loads = rows
    half = broadcast(0.5)
    total, contacts, load_work = broadcast(0.0), broadcast(0.0), broadcast(0.0)
    for i in range(0, forces.size, LANES):
        argument, force, rest_offset = load(arguments, i), load(forces, i), load(rest_offsets, i)
        e, row_g = argument - load(offset, i), argument + load(inputs, i)
        stored = (half * load(slope, i) * e + load(intercept, i)) * e
        contacts = contacts + (stored + load(potential, i))
        base_force = load(base_slope, i) * row_g
        load_work = load_work + (base_force - force) * load(loads, i)
        total = total + (force * (row_g + rest_offset) - base_force * rest_offset)
    return horizontal_sum(total), horizontal_sum(contacts), horizontal_sum(load_work)


@compiled_loop
def _friction_work(
    g: Floats, row: Ints, forces: Floats, of_rows: tuple[Floats, Floats, Floats]
) -> tuple[float, float, float]:
    """Return the work of frictions, twice the energy of their springs, and that on the load [J]."""
    rest_offsets, loads, flexibility = of_rows
    total, springs, load_work = broadcast(0.0), broadcast(0.0), broadcast(0.0)
    for i in range(0, forces.size, LANES):
        force = load(forces, i)
        total = total + force * (gather(g, row, i) + load(rest_offsets, i))
        springs = springs + force * force * load(flexibility, i)
        load_work = load_work + force * load(loads, i)
    return horizontal_sum(total), horizontal_sum(springs), horizontal_sum(load_work)
