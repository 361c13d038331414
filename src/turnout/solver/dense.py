r"""Interpolation of a record at instants between the steps.

Modal coordinates follow the cubic through coordinates and velocities at both ends of their step,

.. math:: q = (1-\theta)\,q_0 + \theta\,q_1 + \theta(1-\theta)
          \bigl[(1-\theta)(h v_0 - \Delta) - \theta\,(h v_1 - \Delta)\bigr],
          \qquad \Delta = q_1 - q_0,

which is of fourth order. The static share above the cut-off is interpolated linearly, as are
friction and energies. The laws that act all the time are evaluated at the new displacements, so
that they hold between the steps too.
"""

import numpy as np

from turnout.law.table import LawTable
from turnout.solver.seen import StepRecord
from turnout.solver.system import Floats


def interpolate_record(
    record: StepRecord,
    *,
    step: float,
    instants: Floats,
    inputs: Floats,
    modes: Floats,
    laws: LawTable,
) -> StepRecord:
    """Interpolate a record of every step at other instants.

    Parameters
    ----------
    record : StepRecord
        Of every step; without velocities all of it is interpolated linearly.
    step : float
        Time between the rows of the record [s].
    instants : ndarray, shape (n,)
        Within the time of the record [s].
    inputs : ndarray, shape (n, n_inputs)
        Marker positions at the instants [m].
    modes : ndarray, shape (n_rows, n_modes)
        Modes at the rows [m per unit of `q`].
    laws : LawTable
        The laws as integrated, by rows of the mechanism.
    """
    last = record.q.shape[0] - 1
    at = np.clip((instants / step + 1e-9).astype(np.int64), 0, max(last - 1, 0))
    share = np.clip(instants / step - at, 0.0, 1.0)[:, np.newaxis]
    after = np.minimum(at + 1, last)

    def interpolate_linearly(values: Floats) -> Floats:
        found: Floats = (1.0 - share) * values[at] + share * values[after]
        return found

    q, g = interpolate_linearly(record.q), interpolate_linearly(record.g)
    if record.v.shape[0] == record.q.shape[0]:
        change = record.q[after] - record.q[at]
        bend = (1.0 - share) * (step * record.v[at] - change)
        bend -= share * (step * record.v[after] - change)
        bend *= share * (1.0 - share)
        q += bend
        g += bend @ modes.T
    return record._replace(
        q=q,
        g=g,
        v=record.v[:1],
        friction=interpolate_linearly(record.friction),
        law=_law_forces(laws, g, inputs, interpolate_linearly(record.law)),
        stored=interpolate_linearly(record.stored),
        ledger=interpolate_linearly(record.ledger),
    )


def _law_forces(laws: LawTable, g: Floats, inputs: Floats, interpolated: Floats) -> Floats:
    """Return the forces of all laws [N]; interpolated ones for laws that appear or disappear."""
    force = interpolated.copy()
    always = np.isinf(laws.appears) & np.isinf(laws.disappears) & (laws.waits == 0)
    for law in np.flatnonzero(always):
        e = g[:, laws.row[law]] - laws.offset[law]
        if laws.input_index[law] >= 0:
            e = e - inputs[:, laws.input_index[law]]
        first, end = laws.segment_start[law], laws.segment_start[law + 1]
        at = first + np.searchsorted(laws.segment_upper[first : end - 1], e)
        force[:, law] = laws.slope[at] * e + laws.intercept[at]
    return force
