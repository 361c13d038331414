"""The energy of an instant: kinetic, in beams and supports, in the laws, and of height."""

from turnout.integrate.state import State
from turnout.integrate.system import Floats, Ints, System
from turnout.integrate.vector import add_rows, copy, dot
from turnout.integrate.work import Work
from turnout.law.compiled import compiled, compiled_loop, compiled_part
from turnout.law.lanes import LANES, every, load, pick, total
from turnout.law.table import LawTable

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
    done, height, moving = every(0.0), every(0.0), every(0.0)
    for i in range(0, q.size, LANES):
        at, speed, weight = load(q, i), load(v, i), load(constant, i)
        force = weight - load(acceleration, i) - load(damping, i) * speed
        done = done + (load(held, i) * at + force * (at - load(resting, i)))
        height = height + weight * at
        moving = moving + speed * speed
    return total(done), total(height), total(moving)


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
    half = every(0.5)
    done, contacts, raised = every(0.0), every(0.0), every(0.0)
    for i in range(0, forces.size, LANES):
        argument, force, apart = load(arguments, i), load(forces, i), load(aparts, i)
        e, at = argument - load(offset, i), argument + load(inputs, i)
        stored = (half * load(slope, i) * e + load(intercept, i)) * e
        contacts = contacts + (stored + load(potential, i))
        held = load(base_slope, i) * at
        raised = raised + (held - force) * load(loads, i)
        done = done + (force * (at + apart) - held * apart)
    return total(done), total(contacts), total(raised)


@compiled_loop
def _friction_work(
    g: Floats, row: Ints, forces: Floats, held: tuple[Floats, Floats, Floats]
) -> tuple[float, float, float]:
    """Return what frictions do on their way, twice the energy of their springs, and the height."""
    aparts, loads, flexibility = held
    done, springs, lowered = every(0.0), every(0.0), every(0.0)
    for i in range(0, forces.size, LANES):
        force = load(forces, i)
        done = done + force * (pick(g, row, i) + load(aparts, i))
        springs = springs + force * force * load(flexibility, i)
        lowered = lowered + force * load(loads, i)
    return total(done), total(springs), total(lowered)
