"""Channels that are connected the wrong way: turned round, or exchanged with those of other drives.

Such forces are none of a switch, whatever its state, so no cause may be named and nothing called
sound. They are recognised by their likeness to sound throws once the mistake is undone.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from turnout.detection.detector.recorded import Match
from turnout.detection.detector.throw_layout import CLOSING, OPENING
from turnout.measurement.campaign.motion_signals import exchanged_pairs

Floats = NDArray[np.float64]
Movements = Callable[[Floats], tuple[Sequence[Match], tuple[float, float]]]

CONTRARY = -0.9
"""Correlation of the force of a drive with sound throws below which it is turned round [-]."""
ALIKE = 0.95
"""Correlation with sound throws from which on a mistake that is undone is named [-]."""
APART = 0.2
"""By which exchanged drives must be more alike than those that were not [-]."""
OPENED = "; or it is an opening"
DOUBTFUL = 0.9
"""Likeness below which a movement was perhaps recorded wrongly; sound ones have 0.99 [-]."""
NEARER = 0.005
"""By which a mistake that is undone must be more alike than the recording as it is [-]."""
TOGETHER = 30.0
"""A closing that an opening follows so soon may be an opening that is turned round [s]."""


def turned_round(drives: Sequence[str]) -> str:
    """Return that the forces of drives have the wrong sign, and the remedy."""
    who = "forces" if not drives else f"the force of drive {' and '.join(drives)}"
    verb = "are" if not drives else "is"
    return f"{who} {verb} turned round: positive is closing; 'sign = -1' in a channel map"


def exchanged(first: str, second: str) -> str:
    """Return that the channels of two drives are exchanged, and the remedy."""
    return f"the forces of drives {first} and {second} are exchanged; check columns and cables"


def wrong_features(
    own: Floats, usual: Floats, drive: NDArray[np.intp], names: Sequence[str]
) -> str:
    """Return which drives of a throw are turned round or exchanged; empty where none is.

    Parameters
    ----------
    own, usual : ndarray, shape (n_features,)
        Features of the throw and their mean in sound throws [N].
    drive : ndarray of int, shape (n_features,)
        Of each feature.
    names : sequence of str
        Of the drives.

    Examples
    --------
    >>> usual, drive = np.array([0.0, 1.0, 5.0, 0.0, 4.0, 5.0]), np.array([0, 0, 0, 1, 1, 1])
    >>> wrong_features(-usual, usual, drive, ["1", "2"])[:24]
    'forces are turned round:'
    >>> wrong_features(usual + 0.1 * drive, usual, drive, ["1", "2"])
    ''
    """
    rows = [drive == number for number in range(len(names))]
    contrary = [
        name
        for name, row in zip(names, rows, strict=True)
        if _correlation(own[row], usual[row]) < CONTRARY
    ]
    if contrary:
        return turned_round([] if len(contrary) == len(names) else contrary) + OPENED
    whole = _correlation(own, usual)
    if whole > DOUBTFUL:
        return ""
    for first, second in combinations(range(len(names)), 2):
        other = own.copy()
        if np.count_nonzero(rows[first]) == np.count_nonzero(rows[second]):
            other[rows[first]], other[rows[second]] = own[rows[second]], own[rows[first]]
        likeness = _correlation(other, usual)
        if likeness > ALIKE and likeness > whole + APART:
            return exchanged(names[first], names[second])
    return ""


def _correlation(one: Floats, other: Floats) -> float:
    one, other = one - one.mean(), other - other.mean()
    size = float(np.sqrt((one @ one) * (other @ other)))
    return float(one @ other) / size if size > 0.0 else 0.0


def wrong_forces(
    found: Sequence[Match],
    likeness: float,
    force: Floats,
    movements: Movements,
    names: Sequence[str],
) -> str:
    """Return which drives of a recording are turned round or exchanged; empty where none is.

    Parameters
    ----------
    found : sequence of Match
        Movements that were found in the recording as it is.
    likeness : float
        Of what is most like a closing in it [-].
    force : ndarray, shape (n_drives, n_times)
        Of the recording [N].
    movements : callable
        Finds movements in other forces at the same instants.
    names : sequence of str
        Of the drives.
    """
    if not _doubtful(found):
        return ""
    own = float(np.mean([item.likeness for item in found])) if found else likeness
    best, said = max(own + NEARER, ALIKE), ""
    for undone, what in _undone(force, names):
        other, _ = movements(undone)
        if any(item.name == CLOSING for item in other):
            mean = float(np.mean([item.likeness for item in other]))
            if mean > best:
                best, said = mean, what
    return said


def _doubtful(found: Sequence[Match]) -> bool:
    """Return True if channels may be wrong: no movements, unlike ones, or in the wrong order."""
    closings = [item for item in found if item.name == CLOSING]
    if not closings or min(item.likeness for item in closings) < DOUBTFUL:
        return True
    for number, item in enumerate(found[:-1]):
        after, before = found[number + 1], found[number - 1] if number else None
        soon = after.name == OPENING and after.onset - item.onset < TOGETHER
        alone = before is None or item.onset - before.onset > TOGETHER
        if item.name == CLOSING and soon and alone:
            return True
    return False


def _undone(force: Floats, names: Sequence[str]) -> Iterator[tuple[Floats, str]]:
    """Yield forces without each mistake, and what it is."""
    yield -force, turned_round([])
    if len(names) == 1:
        return
    for number, name in enumerate(names):
        sign = np.where(np.arange(len(names)) == number, -1.0, 1.0)
        yield sign[:, np.newaxis] * force, turned_round([name])
    for first, second, undone in exchanged_pairs(force):
        yield undone, exchanged(names[first], names[second])
