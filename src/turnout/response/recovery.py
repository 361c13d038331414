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
from numpy.typing import NDArray

from turnout.integrate.run import History
from turnout.mechanism.condense import base_stiffness
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
    history : History
        The run, whose model has modes and static shapes of the whole mechanism.
    slope : ndarray, shape (n_rows,)
        Stiffness at each row that the linear system holds already [N/m].
    """

    rails: dict[str, RailBody]
    history: History
    slope: Floats


def recover_motion(mechanism: Mechanism, history: History) -> Motion:
    """Collect what the recovery of shapes needs from a run."""
    laws = history.laws
    slope = np.bincount(laws.row, base_stiffness(laws), mechanism.rows.shape[0])
    rails = {body.name: body for body in mechanism.rails}
    return Motion(rails=rails, history=history, slope=slope.astype(np.float64))


def force_motion(motion: Motion, shapes: Floats, *, at: Ints | None = None) -> Floats:
    """Return what displacements by row forces come to under those of the laws over time.

    The force on a row is that of laws and frictions beyond the linear system. It is never formed
    for all rows and instants: each kind of force goes by its own columns.

    Parameters
    ----------
    motion : Motion
        The run.
    shapes : ndarray, shape (n, n_rows)
        Displacements for a unit force along each row [m/N].
    at : ndarray of int, optional
        Indices of the wanted instants; default all.

    Returns
    -------
    ndarray, shape (n, n_times)
        [m]
    """
    history, laws = motion.history, motion.history.laws
    moved: Floats = (shapes * motion.slope) @ _at(history.g, at).T
    moved -= shapes[:, laws.row] @ _at(history.law_force, at).T
    moved -= shapes[:, laws.friction_row] @ _at(history.friction_force, at).T
    return moved


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
    rows = lateral_rows(motion.rails[rail], x, z)
    return row_motion(motion, whole_rows(motion, rail, rows), at=at)


def whole_rows(motion: Motion, rail: str, rows: Floats) -> Floats:
    """Return rows over the coordinates of one rail as rows over those of all rails."""
    body = motion.rails[rail]
    whole = np.zeros((rows.shape[0], motion.history.model.residual_load.size))
    whole[:, body.first : body.first + body.count] = rows
    return whole


def row_motion(motion: Motion, rows: Floats, *, at: Ints | None = None) -> Floats:
    """Return what rows over the reduced coordinates of all rails come to over time.

    Parameters
    ----------
    motion : Motion
        The run.
    rows : ndarray, shape (n_rows, n)
        Over all coordinates; see `whole_rows` for those of one rail.
    at : ndarray of int, optional
        Indices of the wanted instants; default all.

    Returns
    -------
    ndarray, shape (n_rows, n_times)
    """
    history, model = motion.history, motion.history.model
    # Whichever of rows and instants are fewer meet the large matrices first.
    if at is not None and at.size < rows.shape[0]:
        return rows @ _coordinates_at(motion, at)
    displacement: Floats = (rows @ model.modes) @ _at(history.q, at).T
    displacement += force_motion(motion, rows @ model.residual_shapes, at=at)
    displacement += (rows @ model.residual_load)[:, np.newaxis]
    return displacement


def _coordinates_at(motion: Motion, at: Ints) -> Floats:
    """Return the reduced coordinates of all rails at a few instants, shape (n, n_times)."""
    history = motion.history
    model, laws = history.model, history.laws
    force = history.g[at].T * motion.slope[:, np.newaxis]
    np.subtract.at(force, laws.row, history.law_force[at].T)
    np.subtract.at(force, laws.friction_row, history.friction_force[at].T)
    found: Floats = model.modes @ history.q[at].T + model.residual_shapes @ force
    found += model.residual_load[:, np.newaxis]
    return found


def _at(values: Floats, at: Ints | None) -> Floats:
    return values if at is None else values[at]
