"""The underside of a section: what of it rests on a slide chair."""

import numpy as np

from turnout.section.outline import FloatArray, Outline

# What lies this much above the lowest point still counts as the underside [m].
UNDERSIDE_DEPTH = 1e-3


def foot_edges(outline: Outline, *, depth: float = UNDERSIDE_DEPTH) -> tuple[float, float]:
    """Return the lateral positions between which a section stands on a plane [m].

    The section's part below its lowest point plus `depth` is taken, so that chamfers, and the
    slight tilt of a drawn underside, do not take the foot away.

    Parameters
    ----------
    outline : Outline
        In any frame with z up.
    depth : float
        How far above the lowest point a vertex still belongs to the underside [m].

    Returns
    -------
    least, most : float
        Least and largest y of the underside [m].

    Examples
    --------
    >>> from turnout.section.outline import make_outline
    >>> foot = make_outline([[-0.05, 0.0], [0.06, 0.0005], [0.06, 0.02], [-0.05, 0.02]])
    >>> foot_edges(foot)
    (-0.05, 0.06)
    """
    start = outline.points
    end = np.roll(start, -1, axis=0)
    level = float(start[:, 1].min()) + depth
    inside = start[start[:, 1] <= level, 0]
    crosses = (start[:, 1] <= level) != (end[:, 1] <= level)
    places = _at_level(start[crosses], end[crosses], level)
    found = np.concatenate([inside, places])
    return float(found.min()), float(found.max())


def _at_level(start: FloatArray, end: FloatArray, level: float) -> FloatArray:
    """Return y where edges pass a height."""
    share = (level - start[:, 1]) / (end[:, 1] - start[:, 1])
    places: FloatArray = start[:, 0] + share * (end[:, 0] - start[:, 0])
    return places
