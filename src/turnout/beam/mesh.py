"""Node positions along a rail, with a node at each place that the mechanism acts on."""

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from turnout.core.errors import MechanicsError

MERGE_DISTANCE = 1e-6
"""Forced positions closer than this become one node [m]."""


def mesh_nodes(
    start: float, end: float, *, element_length: float, forced: Iterable[float] = ()
) -> npt.NDArray[np.float64]:
    """Divide a rail into elements so that every forced position is a node.

    Each stretch between neighbouring forced positions is divided into equal elements, as few as the
    greatest length allows. Of positions closer than `MERGE_DISTANCE` one stays, an end
    of the rail before any other.

    Parameters
    ----------
    start, end : float
        First and last node [m], start < end.
    element_length : float
        Greatest allowed element length [m].
    forced : iterable of float
        Positions that must be nodes [m], in any order, within the rail.

    Returns
    -------
    ndarray, shape (n,)
        Increasing positions [m].

    Raises
    ------
    MechanicsError
        If the rail has no length or a forced position lies off it.

    Examples
    --------
    >>> mesh_nodes(0.0, 1.0, element_length=0.3, forced=[0.5]).tolist()
    [0.0, 0.25, 0.5, 0.75, 1.0]
    """
    if not (np.isfinite([start, end]).all() and end - start > MERGE_DISTANCE):
        msg = f"a rail from {start} m to {end} m has no length"
        raise MechanicsError(msg)
    if not element_length > 0.0:
        msg = f"element_length is {element_length} m, allowed is above 0"
        raise MechanicsError(msg)
    ends = _merge_positions(start, end, np.sort(np.fromiter(forced, dtype=float)))
    # The factor keeps rounding from adding an element where the division is even.
    counts = np.maximum(1, np.ceil(np.diff(ends) / element_length * (1.0 - 1e-9))).astype(int)
    pieces = [
        np.linspace(left, right, count + 1)[:-1]
        for left, right, count in zip(ends[:-1], ends[1:], counts, strict=True)
    ]
    return np.concatenate([*pieces, ends[-1:]])


def _merge_positions(
    start: float, end: float, forced: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Return the ends and the forced positions between, merged within `MERGE_DISTANCE` [m]."""
    off = ~((forced >= start - MERGE_DISTANCE) & (forced <= end + MERGE_DISTANCE))
    if off.any():
        msg = f"positions {forced[off].tolist()} m lie off the rail from {start} m to {end} m"
        raise MechanicsError(msg)
    kept = [start]
    for position in forced:
        if position - kept[-1] >= MERGE_DISTANCE and end - position >= MERGE_DISTANCE:
            kept.append(float(position))
    return np.array([*kept, end])
