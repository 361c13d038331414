"""Open distances at many points at some instants, from modes and the forces on rows.

Stands alone: kernels are compiled again when one of their files changes.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.kernels.compiled import compiled
from turnout.kernels.vector import add_multiple

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class DistanceColumns(NamedTuple):
    """Columns by which modes and row forces lessen the distances along some rails.

    Stored transposed: a row for each mode or row force, an entry for each point of the rail, up to
    whole cache lines.

    Attributes
    ----------
    first_mode, first_row : ndarray of int, shape (n_rails + 1,)
        First column of each rail among those of modes and of rows.
    mode, row : ndarray of int, shapes (n_modes,), (n_forces,)
        Which mode and which row of the mechanism each column belongs to.
    of_mode, of_row : ndarray, shapes (n_modes, n_points), (n_forces, n_points)
        The columns, for unit modal coordinates and unit forces.
    """

    first_mode: Ints
    first_row: Ints
    mode: Ints
    row: Ints
    of_mode: Floats
    of_row: Floats


@compiled
def lessen_distances(
    distances: Floats,
    columns: DistanceColumns,
    rails: Ints,
    runs: Ints,
    modal: Floats,
    law_row: Ints,
    law_force: Floats,
    friction_row: Ints,
    friction_force: Floats,
    force: Floats,
) -> None:
    r"""Subtract from distances along rails the reductions at some instants.

    The force on a row is :math:`\lambda = k g - \sum F`, see `turnout.throw.recovery`. At most
    instants few of the rows have one, so that few columns are read.

    Parameters
    ----------
    distances : ndarray, shape (n, n_points)
        At an instant each; points fill whole cache lines; changed [m].
    columns : DistanceColumns
        A record of `turnout.kernels.shared_record`.
    rails, runs : ndarray of int, shape (n,)
        Numbers of the rail and of the run.
    modal : ndarray, shape (n, n_modes)
        Modal coordinates of the whole mechanism.
    law_row, friction_row : ndarray of int, shapes (n_runs, n_laws), (n_runs, n_frictions)
        Rows of laws and frictions of each run.
    law_force, friction_force : ndarray, shapes (n, n_laws), (n, n_frictions)
        :math:`F` [N].
    force : ndarray, shape (n, n_rows)
        :math:`k g`; changed to the force on each row [N].
    """
    for e in range(rails.size):
        on_rows, along, weights, r = force[e], distances[e], modal[e], runs[e]
        for k in range(law_row.shape[1]):
            on_rows[law_row[r, k]] -= law_force[e, k]
        for k in range(friction_row.shape[1]):
            on_rows[friction_row[r, k]] -= friction_force[e, k]
        for k in range(columns.first_mode[rails[e]], columns.first_mode[rails[e] + 1]):
            add_multiple(-weights[columns.mode[k]], columns.of_mode[k], along)
        for k in range(columns.first_row[rails[e]], columns.first_row[rails[e] + 1]):
            weight = on_rows[columns.row[k]]
            if weight != 0.0:
                add_multiple(-weight, columns.of_row[k], along)
