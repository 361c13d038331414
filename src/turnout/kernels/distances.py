"""Open distances at many points at one instant, from modes and the forces on rows."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.kernels.compiled import compiled
from turnout.kernels.vector import add_multiple

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class DistanceColumns(NamedTuple):
    """By how much modes and row forces lessen distances, a column of all points for each.

    Columns are rows in memory and fill whole cache lines.

    Attributes
    ----------
    mode, row : ndarray of int, shapes (n_modes,), (n_forces,)
        Which mode and which row of the mechanism each column belongs to.
    of_mode, of_row : ndarray, shapes (n_modes, n_points), (n_forces, n_points)
        For unit modal coordinates and unit forces.
    """

    mode: Ints
    row: Ints
    of_mode: Floats
    of_row: Floats


@compiled
def lessen_distances(
    distances: Floats,
    columns: DistanceColumns,
    modal: Floats,
    displacement: Floats,
    stiffness: Floats,
    law_row: Ints,
    law_force: Floats,
    friction_row: Ints,
    friction_force: Floats,
    force: Floats,
) -> None:
    r"""Subtract from distances what an instant lessens them by.

    The force on a row is :math:`\lambda = k g - \sum F`, see `turnout.response.recovery`. At most
    instants few of the rows have one, so that few columns are read.

    Parameters
    ----------
    distances : ndarray, shape (n_points,)
        Fills whole cache lines; changed [m].
    columns : DistanceColumns
        A record of `turnout.kernels.shared_record`.
    modal : ndarray, shape (n_modes,)
        Modal coordinates of the whole mechanism.
    displacement, stiffness : ndarray, shape (n_rows,)
        Of all rows [m], and what the linear system holds at them [N/m].
    law_row, friction_row : ndarray of int, shapes (n_laws,), (n_frictions,)
        Rows of laws and frictions.
    law_force, friction_force : ndarray, of the same shapes
        [N]
    force : ndarray, shape (n_rows,)
        The forces on all rows, written [N].
    """
    for i in range(force.size):
        force[i] = displacement[i] * stiffness[i]
    for k in range(law_row.size):
        force[law_row[k]] -= law_force[k]
    for k in range(friction_row.size):
        force[friction_row[k]] -= friction_force[k]
    for k in range(columns.mode.size):
        add_multiple(-modal[columns.mode[k]], columns.of_mode[k], distances)
    for k in range(columns.row.size):
        weight = force[columns.row[k]]
        if weight != 0.0:
            add_multiple(-weight, columns.of_row[k], distances)
