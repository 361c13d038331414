r"""Track gauge beside the closed switch rail.

The gauge is the distance between the running edges of a route, 14 mm below the running surface. On
the route of a closed switch rail these are the edges of that rail and of the stock rail on the
other side of the track, which is taken to stand where it was laid. With the gap
:math:`g_0` between rail and unloaded stock rail in the stress-free position, in which the rail does
not roll, and displacements towards the stock rail,

.. math:: G(x) = G_n + w(x) - g_0(x) + g_d(x) + u_y(x) - r_x(x) z_G

with the nominal gauge :math:`G_n`, the widening w of the design, and the part :math:`g_d` of the
gap that is designed: the fit gap if it is meant, else nothing. A rail that leaves :math:`g_d` to an
unloaded stock rail and stands upright has the design gauge :math:`G_n + w`.
"""

import numpy as np
from numpy.typing import NDArray

from turnout.core.lru_cache import SharedResults
from turnout.panel.layout import SIDE
from turnout.panel.model import Panel
from turnout.panel.profile import evaluate_profile
from turnout.throw.flangeway import EndDistance
from turnout.throw.gaps import stock_gap
from turnout.throw.recovery import CondensedShapes, Motion, Parts, lateral_rows, row_motion
from turnout.throw.route import closed_rail, closed_spans
from turnout.throw.signals import Channel

Floats = NDArray[np.float64]


def judged_rail(panel: Panel, position: str) -> str | None:
    """Return the closed rail whose gauge the panel knows, at a position of the instrumented rail.

    None where the file says nothing of the gauge, where the rail has no stock rail, and for a
    single rail that is open.
    """
    name = closed_rail(panel, position)
    single = len(panel.rail) == 1 and position == "open"
    known = panel.gauge is not None and panel.rail[name].has_stock_rail
    return name if known and not single else None


_rows = SharedResults[Floats](32)


def gauge_along(
    panel: Panel, motion: CondensedShapes, rail: str, x: Floats
) -> tuple[Floats, Parts]:
    """Return the gauge beside a rail in its stress-free position, and the rows that lessen it.

    Parameters
    ----------
    panel, motion
        Panel, which has data of its gauge, and run.
    rail : str
        A switch rail with a stock rail.
    x : ndarray, shape (n,)
        Places [m].

    Returns
    -------
    gauge : ndarray, shape (n,)
        [m]
    parts : sequence of (RailBody, ndarray)
        Rows over the coordinates of the rail, shape (n, body.count).
    """
    record, data, body = panel.rail[rail], panel.gauge, motion.rails[rail]
    if data is None:
        message = f"panel {panel.name} has no [gauge]"
        raise ValueError(message)
    start = data.nominal - stock_gap(panel, motion, rail, x)
    if record.gauge_widening is not None:
        start = start + evaluate_profile(record.gauge_widening, x)
    if data.fit_gap_is_design and record.fit_gap is not None:
        start = start + evaluate_profile(record.fit_gap, x)
    height = data.height

    def made() -> Floats:
        rows = -SIDE[record.closes] * lateral_rows(body, x, np.full(x.size, height))
        rows.flags.writeable = False
        return rows

    rows = _rows.get([body.recovery], [record.closes, height, x.tobytes()], made)
    return start, [(body, rows)]


GAUGE = EndDistance("gauge", judged_rail, gauge_along)
"""Distance between the running edges of the route of the closed rail."""


def gauge_channel(panel: Panel, motion: Motion, x: Floats) -> Channel:
    """Return the gauge beside the rail that should be closed, over places and time [m].

    That rail is the one which the present or last movement closes; while it moves, the gauge is how
    far its edge has come. NaN where the panel does not say what it takes, and beyond the rail.

    Parameters
    ----------
    panel, motion
        Panel and run.
    x : ndarray, shape (n_points,)
        Places [m].
    """
    time = motion.history.time
    found = np.full((x.size, time.size), np.nan)
    for begin, end, closed in closed_spans(panel, time):
        rail = judged_rail(panel, "closed" if closed else "open")
        if rail is not None and end > begin:
            start, parts = gauge_along(panel, motion, rail, x)
            lessened = row_motion(motion, parts, at=np.arange(begin, end))
            found[:, begin:end] = start[:, np.newaxis] - lessened
    return ("x", "time"), found
