r"""Displacements of any point of a rail from the coordinates that a run has kept.

The condensed system gives the reduced coordinates of all rails as

.. math:: u = \Phi q + R \lambda + r

with the kept modes, the static shapes of the omitted part under the row forces :math:`\lambda`, and
their share of the constant load. :math:`\lambda` is what the laws add to the linear system:
``base_slope g - F`` summed over the laws of a row, less its friction forces. A rail's recovery
matrix then gives its nodes.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from turnout.integrate.run import History
from turnout.mechanism.condense import ModalModel, base_stiffness
from turnout.mechanism.mechanism import Mechanism, RailBody

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

UY, RX, PER_NODE = 1, 3, 6
PLACE_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True)
class Motion:
    """All that shapes are recovered from.

    Attributes
    ----------
    rails : dict of str to RailBody
        Reduced rails by name.
    model : ModalModel
        Modes and static shapes of the whole mechanism.
    q : ndarray, shape (n_times, n_modes)
        Modal coordinates.
    row_force : ndarray, shape (n_times, n_rows)
        Force of the laws on each row beyond the linear system [N].
    """

    rails: dict[str, RailBody]
    model: ModalModel
    q: Floats
    row_force: Floats


def recover_motion(mechanism: Mechanism, history: History) -> Motion:
    """Collect what the recovery of shapes needs from a run."""
    return Motion(
        rails={body.name: body for body in mechanism.rails},
        model=history.model,
        q=history.q,
        row_force=row_forces(mechanism, history),
    )


def row_forces(mechanism: Mechanism, history: History) -> Floats:
    """Return the force of laws and frictions on each row beyond the linear system.

    Returns
    -------
    ndarray, shape (n_times, n_rows)
        [N]
    """
    laws = history.laws
    n_rows = mechanism.rows.shape[0]
    slope = np.zeros(n_rows)
    np.add.at(slope, laws.row, base_stiffness(laws))
    force: Floats = history.g * slope
    force -= (_incidence(laws.row, n_rows) @ history.law_force.T).T
    force -= (_incidence(laws.friction_row, n_rows) @ history.friction_force.T).T
    return force


def lateral_rows(body: RailBody, x: Floats, z: Floats) -> Floats:
    """Return rows that take a rail's reduced coordinates to lateral displacements.

    A point at height z moves by ``u_y - r_x z``; between nodes both vary linearly.

    Parameters
    ----------
    body : RailBody
        The rail.
    x, z : ndarray, shape (n_points,)
        Places along the rail and heights above the reference line [m].

    Returns
    -------
    ndarray, shape (n_points, body.count)
        NaN where x lies beyond the rail.
    """
    left = np.clip(np.searchsorted(body.x, x, side="right") - 1, 0, body.x.size - 2)
    share = (x - body.x[left]) / (body.x[left + 1] - body.x[left])
    beyond = (x < body.x[0] - PLACE_TOLERANCE) | (x > body.x[-1] + PLACE_TOLERANCE)
    share = np.where(beyond, np.nan, np.clip(share, 0.0, 1.0))[:, np.newaxis]
    lateral, roll = body.recovery[UY::PER_NODE], body.recovery[RX::PER_NODE]
    at_left = lateral[left] - z[:, np.newaxis] * roll[left]
    at_right = lateral[left + 1] - z[:, np.newaxis] * roll[left + 1]
    rows: Floats = at_left + share * (at_right - at_left)
    return rows


def lateral_displacement(
    motion: Motion, rail: str, *, x: Floats, z: Floats, at: Ints | None = None
) -> Floats:
    """Return lateral displacements of points of a rail over time, positive in +y.

    Parameters
    ----------
    motion : Motion
        The run.
    rail : str
        Name of the rail.
    x, z : ndarray, shape (n_points,)
        Places and heights above the reference line [m].
    at : ndarray of int, optional
        Indices of the wanted instants; default all.

    Returns
    -------
    ndarray, shape (n_points, n_times)
        [m]; NaN beyond the rail.
    """
    return row_motion(motion, rail, lateral_rows(motion.rails[rail], x, z), at=at)


def row_motion(motion: Motion, rail: str, rows: Floats, *, at: Ints | None = None) -> Floats:
    """Return what rows over a rail's reduced coordinates come to over time.

    Parameters
    ----------
    motion : Motion
        The run.
    rail : str
        Name of the rail.
    rows : ndarray, shape (n_rows, count)
        Over the reduced coordinates of the rail.
    at : ndarray of int, optional
        Indices of the wanted instants; default all.

    Returns
    -------
    ndarray, shape (n_rows, n_times)
    """
    body, model = motion.rails[rail], motion.model
    mine = slice(body.first, body.first + body.count)
    q = motion.q if at is None else motion.q[at]
    force = motion.row_force if at is None else motion.row_force[at]
    displacement: Floats = (rows @ model.modes[mine]) @ q.T
    displacement += (rows @ model.residual_shapes[mine]) @ force.T
    displacement += (rows @ model.residual_load[mine])[:, np.newaxis]
    return displacement


def _incidence(targets: Ints, n_rows: int) -> sp.csr_array:
    """Return the matrix that sums columns into their rows."""
    return sp.csr_array(
        (np.ones(targets.size), (targets, np.arange(targets.size))), shape=(n_rows, targets.size)
    )
