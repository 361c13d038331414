"""Between the steps: dents that stay, failures, bonds of ice, and friction along the stroke.

Laws are elastic within a step, `turnout.law.obstruction`; here, once a step has been accepted, what
they remember follows from where the step ended. A dent changes neither force nor stiffness of the
present state, so no column changes. A failure changes the law of its row, as a law that is switched
does: the force drops at the instant between two steps. A step that passes a failure is taken again
in halves, until the smallest of them ends there.
"""

from turnout.kernels.compiled import compiled
from turnout.law.friction import STICK, FrictionCourses
from turnout.law.kernel import law_argument, segment_for
from turnout.law.obstruction import (
    BREAKS_AWAY,
    CRUMBLES,
    LARGEST_OVERRUN,
    NEVER,
    SPLITS,
    Obstructions,
    crumble,
    dent,
    failure,
    overrun,
    split,
)
from turnout.law.table import LawTable
from turnout.solver.energy import OBJECTS, SEGMENTS, force_and_energy
from turnout.solver.scratch import Work
from turnout.solver.solve import mark_law, mark_row
from turnout.solver.state import State, set_segment
from turnout.solver.system import System

ELASTIC = 1
"""Segment of an obstruction without change."""


@compiled
def update_obstructions(
    system: System,
    table: LawTable,
    state: State,
    work: Work,
    obstructions: Obstructions,
    time: float,
) -> int:
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
            _break(table, state, obstructions, row, e, time)
            count = mark_law(system, table, state, work, count, law)
        elif breaks in (NEVER, CRUMBLES) and e > obstructions.deepest[row]:
            lost = dent(table, law, segment, e, obstructions.unloading[row])
            obstructions.deepest[row] = e
            obstructions.dissipated[row] += lost
            state.ledger[OBJECTS] += lost
            set_segment(table, state, law, segment)
    return count


@compiled
def passes_failure(table: LawTable, state: State, obstructions: Obstructions) -> bool:
    """Return whether some obstruction is further beyond its failure than is overlooked."""
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
def has_just_broken(state: State, obstructions: Obstructions) -> bool:
    """Return whether a force has dropped at the present instant."""
    for row in range(obstructions.law.size):
        if obstructions.broken[row] > 0 and state.jump[obstructions.law[row]] != 0.0:
            return True
    return False


@compiled
def update_courses(
    table: LawTable, state: State, work: Work, courses: FrictionCourses, count: int
) -> int:
    """Give frictions the coefficients at the present openings of their rails.

    Parameters
    ----------
    count : int
        Rows that are marked for an update already.

    Returns
    -------
    int
        Rows that are marked in all.
    """
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
        if state.friction[friction] != STICK:
            count = mark_row(work, count, place)
    return count


@compiled
def freeze(table: LawTable, state: State, obstructions: Obstructions) -> None:
    """Bond what is frozen where it stands now, without force."""
    for row in range(obstructions.law.size):
        if obstructions.breaks[row] == BREAKS_AWAY:
            law = obstructions.law[row]
            table.offset[law] = state.g[table.row[law]]


@compiled
def _break(
    table: LawTable, state: State, obstructions: Obstructions, row: int, e: float, time: float
) -> None:
    """Break an obstruction at the compression `e` [m]; what its law stored beyond is dissipated.

    The work of the force that falls, on the way that the step went on beyond the failure, is none
    of the obstruction's and counts as numerical.
    """
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
