r"""How well a solution found from many times updated columns fulfils the equations themselves.

Each rank-one update multiplies the rounding that the columns already carry by about its divisor or
the inverse, whichever is larger: a stiff stop that closes leaves small differences of large
numbers, one that opens makes them large again. `State.drift` keeps the product since the columns
were last measured; when it has grown by `DRIFTS`, the solution is put into the equations

.. math:: g = \Phi q + R\lambda + r, \qquad
          (\iota + \Lambda)\,q + \nu C q = p + \Phi^T\lambda

with the deviations :math:`\lambda` from the laws' own numbers. Columns and modal inverse must be
made anew if the rows are off by more than `LARGEST_ERROR`, or if what is left over in the modal
equations does work in the step that the books of energy would notice, `LARGEST_LEAK`.
"""

from turnout.integrate.energy import MARKERS
from turnout.integrate.solve import Work, row_forces
from turnout.integrate.system import COUNT_ACTIVE, Floats, State, System
from turnout.law.compiled import compiled
from turnout.law.table import LawTable

DRIFTS = 100.0
"""Growth of rounding after which a solution is measured [-]."""
LARGEST_ERROR = 1e-12
"""Error of a row that is overlooked [m]."""
LARGEST_LEAK = 1e-10
"""Work of a step out of nowhere that is overlooked, as a share of 1 J and the work so far [-]."""


@compiled
def _deviations(system: System, table: LawTable, state: State, force: Floats) -> None:
    """Write the deviation force of every row for the solution just found [N]."""
    force[:] = 0.0
    for slot in range(state.counters[COUNT_ACTIVE]):
        row = state.row_of_slot[slot]
        total = state.shift[row]
        for k in range(system.pattern_start[row], system.pattern_start[row + 1]):
            total += state.entries[k] * state.g[system.pattern_list[k]]
        force[row] = total
    for k in range(system.input_law.size):
        law = system.input_law[k]
        force[table.row[law]] += state.slope[law] * state.inputs[table.input_index[law]]


@compiled
def _row_errors(system: System, state: State, force: Floats, error: Floats) -> float:
    """Write how far the base system under row forces is from the rows [m]; return the largest."""
    n_rows, n_modes = system.row_load.size, system.eigenvalues.size
    worst = 0.0
    for i in range(n_rows):
        total = system.row_load[i] - state.g[i]
        base = system.base[i]
        for j in range(n_rows):
            total += base[j] * force[j]
        for j in range(n_modes):
            total += base[n_rows + j] * state.q[j]
        error[i] = total
        worst = max(worst, abs(total))
    return worst


@compiled
def _modal_errors(
    system: System, state: State, work: Work, force: Floats, inertia: float, viscosity: float
) -> float:
    """Write what is left over in the modal equations to ``work.modal_error``.

    Returns the work that it does in the step [J].
    """
    n_rows, n_modes = system.row_load.size, system.eigenvalues.size
    leak = 0.0
    for j in range(n_modes):
        total = work.right_side[j] - (inertia + system.eigenvalues[j]) * state.q[j]
        for i in range(n_modes):
            total -= viscosity * system.damping[j, i] * state.q[i]
        for i in range(n_rows):
            if force[i] != 0.0:
                total += system.base[i, n_rows + j] * force[i]
        work.modal_error[j] = total
        leak += abs(total * (state.q[j] - work.q[j]))
    return leak


@compiled
def correct(system: System, state: State, work: Work) -> None:
    """Take the errors that `is_inaccurate` has found off the solution, with the same columns."""
    n_rows, n_modes = system.row_load.size, system.eigenvalues.size
    moved, right = work.g, work.predicted_error
    moved[:] = work.row_error
    right[:] = work.modal_error
    for slot in range(state.counters[COUNT_ACTIVE]):
        row = state.row_of_slot[slot]
        column = state.columns[n_modes + 1 + slot]
        weight = 0.0
        for k in range(system.pattern_start[row], system.pattern_start[row + 1]):
            weight += state.entries[k] * work.row_error[system.pattern_list[k]]
        for i in range(n_rows):
            moved[i] += weight * column[i]
        for i in range(n_modes):
            right[i] += weight * column[n_rows + i]
    for i in range(n_modes):
        change = 0.0
        for j in range(n_modes):
            change += state.inverse[i, j] * right[j]
        state.q[i] += change
        column = state.columns[i]
        for k in range(n_rows):
            moved[k] += change * column[k]
    for i in range(n_rows):
        state.g[i] += moved[i]


@compiled
def is_inaccurate(
    system: System, table: LawTable, state: State, work: Work, inertia: float, viscosity: float
) -> bool:
    """Tell whether the solution of the step just found suffers from worn columns.

    Parameters
    ----------
    inertia, viscosity : float
        What multiplies identity and damping in the matrix of the step.
    """
    if state.drift[0] < DRIFTS:
        return False
    state.drift[0] = 1.0
    force = work.row[: system.row_load.size]
    _deviations(system, table, state, force)
    error = _row_errors(system, state, force, work.row_error)
    leak = _modal_errors(system, state, work, force, inertia, viscosity)
    allowed = LARGEST_LEAK * (1.0 + abs(float(state.ledger[MARKERS])))
    return error > LARGEST_ERROR or leak > allowed


@compiled
def equilibrium_residual(system: System, table: LawTable, state: State, work: Work) -> float:
    """Return the largest disagreement of the rows with the base system under the law forces [m].

    The columns are bypassed, so that their drift shows.
    """
    force = work.row[: system.row_load.size]
    row_forces(system, table, state, force)
    return _row_errors(system, state, force, work.row_error)
