"""Energies of a run as rows over time, from the instants that it has stored."""

from turnout.kernels.compiled import compiled
from turnout.solver.energy import ALGORITHMIC, GRAVITY, LEDGER, SEGMENTS, unaccounted_energy
from turnout.solver.system import Floats

STORED = GRAVITY + 1
"""Number of stored energies of an instant."""
NUMERICAL, RESIDUAL = STORED + LEDGER, STORED + LEDGER + 1
"""Rows of `write_energies` after those of the stored energies and the ledger."""
ROWS = RESIDUAL + 1
"""Their number."""


@compiled
def write_energies(stored: Floats, ledger: Floats, rows: Floats) -> None:
    """Write the change of each stored energy since the first instant, the ledger, and the residual.

    Parameters
    ----------
    stored, ledger : ndarray, shape (n_times, 4), (n_times, 7)
        Columns of `turnout.solver.energy` [J].
    rows : ndarray, shape (13, n_times)
        In the order of these columns, then the numerical dissipation, and last the stored change
        less what was put in and not taken out [J].

    Examples
    --------
    >>> import numpy as np
    >>> rows = np.empty((ROWS, 2))
    >>> write_energies.py_func(np.arange(8.0).reshape(2, 4), np.ones((2, 7)), rows)
    >>> rows[:, 1].tolist()
    [4.0, 4.0, 4.0, 4.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 19.0]
    """
    for n in range(stored.shape[0]):
        change = stored[n, 0] - stored[0, 0]
        rows[0, n] = change
        for column in range(1, STORED):
            rows[column, n] = stored[n, column] - stored[0, column]
            change += rows[column, n]
        for column in range(LEDGER):
            rows[STORED + column, n] = ledger[n, column]
        rows[NUMERICAL, n] = ledger[n, ALGORITHMIC] + ledger[n, SEGMENTS]
        rows[RESIDUAL, n] = unaccounted_energy(ledger, n, change)
