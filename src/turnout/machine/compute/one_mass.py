"""A machine on its one-mass rail from the start to the end of a throw, kept at a regular rate."""

from turnout.kernels.compiled import compiled
from turnout.law.table import Floats
from turnout.machine.compute import places as at
from turnout.machine.compute.circuit import advance
from turnout.machine.compute.machine_step import stored_energy


@compiled
def throw(
    constants: Floats,
    rail: Floats,
    table: Floats,
    commands: Floats,
    state: Floats,
    stepping: tuple[float, int, int],
    work: Floats,
    log: Floats,
    kept: Floats,
    stored: Floats,
) -> int:
    """March from time 0 and return the number of kept instants reached.

    Parameters
    ----------
    stepping : tuple
        Step [s], steps between kept instants, kept instants.
    kept : ndarray, shape (n_kept + 1, STATES)
        Receives the state rows; the first is the start.
    stored : ndarray, shape (n_kept + 1,)
        Receives the stored energy [J].
    """
    step, every, count = stepping
    for k in range(state.size):
        kept[0, k] = state[k]
    stored[0] = stored_energy(constants, rail, state)
    for row in range(count):
        for sub in range(every):
            time = (row * every + sub) * step
            span = (time, (row * every + sub + 1) * step - time)
            if advance(constants, rail, table, commands, state, span, work, log) != at.CONVERGED:
                return row
        for k in range(state.size):
            kept[row + 1, k] = state[k]
        stored[row + 1] = stored_energy(constants, rail, state)
    return count
