"""Between the steps: dents that stay, failures, bonds of ice, and friction along the stroke.

Laws are elastic within a step, `turnout.law.obstruction`; here, once a step has been accepted, what
they remember follows from where the step ended. A dent changes neither force nor stiffness of the
present state, so no column changes. A failure changes the law of its row, as a law that is switched
does: the force drops at the instant between two steps. A step that passes a failure is taken again
in halves, until the smallest of them ends there.
"""

from turnout.kernels.compiled import compiled
from turnout.kernels.vector import sum_weighted_rows
from turnout.law.friction import STICK, forces_beyond_level
from turnout.law.kernel import law_argument, segment_for
from turnout.law.obstruction import (
    BREAKS_AWAY,
    CRUMBLES,
    LARGEST_OVERRUN,
    NEVER,
    SPLITS,
    crumble,
    dent,
    failure,
    overrun,
    split,
)
from turnout.solver.columns import mark_law, mark_row, shift_constant
from turnout.solver.energy import OBJECTS, SEGMENTS, force_and_energy
from turnout.solver.state import Run, State, set_segment

ELASTIC = 1
"""Segment of an obstruction without change."""
CURVE_RATE = 10.0
"""Share of the range of a curve, per length of a step, by which a sliding foot may be off it [1/s];
beyond, its limit is changed. So what this leaves out shrinks with the step."""
EVERY_STEP = 2e-3
"""Length of a step from which on limits follow speeds at each one, else at every other [s]."""


@compiled
def update_obstructions(run: Run, state: State, time: float) -> int:
    """Leave dents and break what fails at the present state.

    Parameters
    ----------
    time : float
        Of the present state [s].

    Returns
    -------
    int
        Rows that are marked for an update of the columns.
    """
    table, obstructions = run.table, run.obstructions
    count = 0
    for row in range(obstructions.law.size):
        law = obstructions.law[row]
        segment, breaks = state.segment[law], obstructions.breaks[row]
        if state.present[law] == 0:
            continue
        if segment == ELASTIC:
            if breaks == SPLITS:
                e = law_argument(table, law, state.g, state.inputs)
                obstructions.deepest[row] = max(obstructions.deepest[row], e)
            continue
        if segment == 0 and breaks != BREAKS_AWAY:
            continue
        e = law_argument(table, law, state.g, state.inputs)
        if breaks != NEVER and overrun(table, obstructions, row, e) > 0.0:
            _break(run, state, row, e, time)
            count = mark_law(run, state, count, law)
        elif breaks in (NEVER, CRUMBLES) and e > obstructions.deepest[row]:
            lost = dent(table, law, segment, e, obstructions.unloading[row])
            obstructions.deepest[row] = e
            obstructions.dissipated[row] += lost
            state.ledger[OBJECTS] += lost
            set_segment(table, state, law, segment)
    return count


@compiled
def passes_failure(run: Run, state: State) -> bool:
    """Return whether some obstruction is further beyond its failure than is overlooked."""
    table, obstructions = run.table, run.obstructions
    for row in range(obstructions.law.size):
        law = obstructions.law[row]
        if state.present[law] == 0 or obstructions.breaks[row] == NEVER:
            continue
        e = law_argument(table, law, state.g, state.inputs)
        if overrun(table, obstructions, row, e) > LARGEST_OVERRUN * failure(
            table, obstructions, row
        ):
            return True
    return False


@compiled
def has_just_broken(run: Run, state: State) -> bool:
    """Return whether a force has dropped at the present instant."""
    obstructions = run.obstructions
    for row in range(obstructions.law.size):
        if obstructions.broken[row] > 0 and state.jump[obstructions.law[row]] != 0.0:
            return True
    return False


@compiled
def update_courses(run: Run, state: State, n: int, count: int) -> int:
    """Give frictions the coefficients at the present openings and speeds of their feet.

    Parameters
    ----------
    n : int
        Number of the present step.
    count : int
        Rows that are marked for an update already.

    Returns
    -------
    int
        Rows that are marked in all.
    """
    table, work, courses = run.table, run.work, run.courses
    for row in range(courses.friction.size):
        friction = courses.friction[row]
        place = table.friction_row[friction]
        opening = courses.closed[row] - courses.side[row] * state.g[place]
        at = courses.start[row]
        while at + 1 < courses.start[row + 1] and opening >= courses.opening[at + 1]:
            at += 1
        if at == courses.at[row]:
            continue
        courses.at[row] = at
        table.friction_coefficient[friction] = courses.coefficient[row] * courses.factor[at]
        if courses.excess.size:
            courses.excess[friction] = courses.excess_from[at]
            courses.fall[friction] = courses.fall_from[at]
            courses.rise[friction] = courses.rise_from[at]
        if state.friction[friction] != STICK:
            count = mark_row(work, count, place)
    if courses.excess.size and (run.options.step >= EVERY_STEP or n % 2):
        count = _follow_speeds(run, state, count)
    return count


@compiled
def _follow_speeds(run: Run, state: State, count: int) -> int:
    """Give frictions the limits at the present speeds of the modes at their feet."""
    system, table, work, courses = run.system, run.table, run.work, run.courses
    width = courses.modes.shape[1]
    for block in range(courses.feet.size):
        if courses.feet[block]:
            first, last = system.mode_start[block], system.mode_start[block + 1]
            modes, speed = courses.modes[first:last], courses.speed[block * width :][:width]
            sum_weighted_rows(courses.modes[-1], state.v[first:last], modes, speed)
    if not forces_beyond_level(
        (work.force, table.friction_normal, table.friction_coefficient),
        (courses.excess, courses.fall, courses.rise),
        (courses.speed, courses.speed_of),
        state.friction, CURVE_RATE * run.options.step, state.friction_beyond, work.friction_shift,
    ):  # fmt: skip
        return count
    rows, total, moved, n_moved = table.friction_row, work.foot_shift, work.coupled_end, 0
    for friction in range(rows.size):
        place, change = rows[friction], work.friction_shift[friction]
        total[place] += change
        moved[n_moved] = place
        n_moved += change != 0.0
    for place in moved[:n_moved]:
        change, total[place] = total[place], 0.0
        shift = state.shift[place] + change
        if shift == 0.0 or state.slot_of_end[place] < 0:
            count = mark_row(work, count, place)
        elif change != 0.0:  # a foot may have several frictions
            state.shift[place] = shift
            shift_constant(run, state, place, change)
    return count


@compiled
def freeze(run: Run, state: State) -> None:
    """Bond what is frozen where it stands now, without force."""
    table, obstructions = run.table, run.obstructions
    for row in range(obstructions.law.size):
        if obstructions.breaks[row] == BREAKS_AWAY:
            law = obstructions.law[row]
            table.offset[law] = state.g[table.row[law]]


@compiled
def _break(run: Run, state: State, row: int, e: float, time: float) -> None:
    """Break an obstruction at the compression `e` [m]; what its law stored beyond is dissipated.

    The work of the force that falls, on the way that the step went on beyond the failure, is none
    of the obstruction's and counts as numerical.
    """
    table, obstructions = run.table, run.obstructions
    law, breaks = obstructions.law[row], obstructions.breaks[row]
    force, energy = force_and_energy(state, law, e)
    late = overrun(table, obstructions, row, e) * (abs(force) - obstructions.crushed[row])
    stays = True
    if breaks == SPLITS:
        stays = split(table, obstructions, row)
    elif breaks == CRUMBLES:
        crumble(table, obstructions, row, e)
    else:
        obstructions.broken[row] += 1
        stays = False
    if not stays:
        state.present[law] = 0
        table.disappears[law] = time - 1e-6
    left = law_argument(table, law, state.g, state.inputs)
    set_segment(table, state, law, segment_for(table, law, left, 0, 0.0))
    new_force, new_energy = force_and_energy(state, law, left)
    state.jump[law] += force - new_force
    state.ledger[SEGMENTS] += late
    obstructions.dissipated[row] += energy - new_energy - late
    state.ledger[OBJECTS] += energy - new_energy - late
