"""What differs from throw to throw although nothing was changed, found from repeats."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
# A direction is identified where its expected scatter moves forces by at least so many noises.
LEAST_ANSWER = 0.5
# Correlation of neighbouring instants of the rest, at most [-].
MOST_ALIKE = 0.99


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Direction:
    """Something that a throw can have of its own.

    Attributes
    ----------
    name : str
        Name in texts and tables, such as "chair.friction_coefficient".
    slope : ndarray, shape (n_channels, n_movements, n_times)
        Of the forces with it [N/its unit].
    expected : float
        Standard deviation from throw to throw before repeats are seen; zero for none.
    """

    name: str
    slope: Floats
    expected: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThrowScatter:
    """Standard deviations from throw to throw, and what they make of forces.

    Attributes
    ----------
    sizes : dict of str to float
        By name of the direction.
    rest : ndarray, shape (n_channels,)
        What is left of the difference between repeats, noise among it [N].
    variance : ndarray, shape (n_channels, n_movements, n_times)
        Of one throw about the mean of its like [N^2].
    repeated : int
        Throws that it was found from; with none, the sizes are assumptions.
    freedom : dict of str to float
        Degrees of freedom of the sizes, one for what was expected among them.
    decay : ndarray, shape (n_channels,)
        Instants in which the rest decays to a third.
    """

    sizes: dict[str, float]
    rest: Floats
    variance: Floats
    repeated: int
    freedom: dict[str, float] = field(default_factory=dict)
    decay: Floats = field(default_factory=lambda: np.zeros(0))


def scatter_of(
    measured: Floats,
    directions: Sequence[Direction],
    *,
    groups: Sequence[Sequence[int]],
    noise: Floats,
) -> ThrowScatter:
    """Find from repeats how much each direction differs from throw to throw.

    The difference of each repeat from the mean of its like is written as a sum of the directions;
    what no such sum explains is the rest. Expected sizes count like one more repeat, so that few
    repeats that happen to agree do not make a prediction look sure.

    Parameters
    ----------
    measured : ndarray, shape (n_channels, n_movements, n_times)
        [N]; NaN where nothing was measured.
    directions : sequence of Direction
        What can differ.
    groups : sequence of sequence of int
        Movements that are equal by the sheet.
    noise : ndarray, shape (n_channels,)
        Of a bin, which the rest is never below [N].

    Returns
    -------
    ThrowScatter

    Examples
    --------
    >>> slope = np.ones((1, 2, 4))
    >>> measured = np.array([[[3.0] * 4, [1.0] * 4]])
    >>> found = scatter_of(
    ...     measured,
    ...     [Direction(name="level", slope=slope, expected=1.4142)],
    ...     groups=[[0, 1]],
    ...     noise=np.array([0.1]),
    ... )
    >>> round(found.sizes["level"], 3)
    1.414
    """
    squares = np.array([item.expected**2 for item in directions])
    freedom = np.ones(len(directions))
    left, samples = np.zeros(noise.size), np.zeros(noise.size)
    following = np.zeros(noise.size)
    for group in groups:
        lost = (len(group) - 1.0) / len(group)
        mean = measured[:, list(group)].mean(axis=1)
        for number in group:
            amounts, identified, remainder = _explained(
                measured[:, number] - mean, directions, number=number, noise=noise
            )
            squares += np.where(identified, amounts**2, 0.0)
            freedom += np.where(identified, lost, 0.0)
            known = np.isfinite(remainder)
            filled = np.where(known, remainder, 0.0)
            left += (filled**2).sum(axis=1)
            following += (filled[:, 1:] * filled[:, :-1]).sum(axis=1)
            samples += lost * known.sum(axis=1)
    sizes = np.sqrt(squares / freedom)
    rest = np.sqrt(np.divide(left, samples, out=noise**2, where=samples > 0))
    variance = np.broadcast_to(
        np.maximum(rest, noise)[:, np.newaxis, np.newaxis] ** 2, measured.shape
    ).copy()
    for size, item in zip(sizes, directions, strict=True):
        variance += (size * item.slope) ** 2
    return ThrowScatter(
        sizes={item.name: float(size) for item, size in zip(directions, sizes, strict=True)},
        rest=np.maximum(rest, noise),
        variance=variance,
        repeated=sum(len(group) for group in groups),
        freedom={item.name: float(n) for item, n in zip(directions, freedom, strict=True)},
        decay=_decay(following, left),
    )


def _decay(following: Floats, squares: Floats) -> Floats:
    """Return in how many instants a rest decays to a third, by its correlation with the next one.

    Examples
    --------
    >>> _decay(np.array([0.0, 0.5]), np.ones(2)).round(2)
    array([0.  , 1.44])
    """
    share = np.divide(following, squares, out=np.zeros_like(squares), where=squares > 0.0)
    share = np.clip(share, 0.0, MOST_ALIKE)
    found = np.zeros_like(share)
    np.divide(
        -1.0,
        np.log(share, where=share > 0.0, out=np.ones_like(share)),
        out=found,
        where=share > 0.0,
    )
    return found


def _explained(
    difference: Floats, directions: Sequence[Direction], *, number: int, noise: Floats
) -> tuple[Floats, NDArray[np.bool_], Floats]:
    """Return the share of each direction in a difference, which are identified, and the rest."""
    rows = np.array([item.slope[:, number] for item in directions])
    there = np.isfinite(difference) & np.isfinite(rows).all(axis=0)
    weight = 1.0 / noise[:, np.newaxis]
    flat = np.where(there, rows * weight, 0.0).reshape(len(directions), -1)
    count = max(int(there.sum()), 1)
    answer = np.sqrt((flat**2).sum(axis=1) / count) * [item.expected for item in directions]
    identified = answer > LEAST_ANSWER
    amounts = np.zeros(len(directions))
    if identified.any():
        target = np.where(there, difference * weight, 0.0).ravel()
        amounts[identified] = np.linalg.lstsq(flat[identified].T, target, rcond=1e-6)[0]
    remainder = difference - np.tensordot(amounts, np.where(there, rows, 0.0), axes=1)
    return amounts, identified, np.where(there, remainder, np.nan)
