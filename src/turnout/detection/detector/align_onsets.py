r"""Onsets of movements, found again by how well sound throws explain what comes before contact.

The early windows of all movements, those of the first one first, are :math:`f`. With the local
model of sound throws at a friction level, whose covariance is :math:`C`,

.. math:: Q = |R\,(f - m)|^2 = |\sum_M R_M (f_M - m_M)|^2, \qquad R^T R = C^{-1}

:math:`R` is lower triangular; :math:`R_M` holds the columns that belong to movement :math:`M`.
Both onsets are tried together: with the terms :math:`t_M` of each movement at each instant,
:math:`Q = |t_1|^2 + |t_2|^2 + 2\,t_1 \cdot t_2`, so each root is multiplied with each trial once.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from turnout.detection.density import log_density
from turnout.detection.detector.judging import View
from turnout.detection.detector.recorded import Recorded, sums_about
from turnout.detection.detector.throw_layout import Integral, Layout, Part
from turnout.detection.likelihood import Centre, log_sum

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.intp]

SHIFTS = np.arange(-40e-3, 41e-3, 4e-3)
"""Onsets that are tried about the one that was found [s]."""
ONSET_DEVIATION = 12e-3
"""Standard deviation of onsets that are found in recordings [s]."""
KNOWN = -0.5 * (SHIFTS / ONSET_DEVIATION) ** 2
"""Logarithm of how likely each of these shifts is before the forces are known."""
EARLY = 0.6
"""Share of the closing movement by which it is aligned: before small objects are touched [-]."""
REST_AFTER = 0.7
"""After the movement in a layout, about [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Movement:
    """Inputs for moving one movement: its windows, and sound throws at each level.

    Attributes
    ----------
    part : Part
        The movement, early windows alone.
    first : int
        Of its early windows among those of all movements.
    root : ndarray of float32, shape (k, n - first, n_own)
        Columns of the inverse root of the covariance, without the rows that are zero [1/N].
        Reading them takes most of the time, so they are of single precision; onsets move by less
        than a microsecond.
    mean : ndarray, shape (k, n_own, 1)
        Of sound throws [N].
    """

    part: Part
    first: int
    root: Singles
    mean: Floats


class Aligner:
    """Finds onsets again by how well sound throws explain what comes before contact.

    Parameters
    ----------
    view : View
        Of the switch, over the whole cycle or the closing alone.
    layout : Layout
        Of the detector.
    """

    def __init__(self, view: View, layout: Layout) -> None:
        part = layout.parts[-1]
        duration = part.edges[-1] - REST_AFTER
        early = layout.time[view.features] - part.start < EARLY * duration
        number = layout.part[view.features]
        kept = np.concatenate(
            [np.flatnonzero(early & (number == at)) for at in range(len(layout.parts))]
        )
        self.layout, self.size = layout, len(kept)
        roots, scales = zip(*(inverse_root(centre, kept) for centre in view.centres), strict=True)
        self.scale = np.array(scales)
        root, means = np.array(roots), np.array([centre.mean[kept] for centre in view.centres])
        self.movements = {
            item.name: _movement(
                item, number[kept] == at, means=means, root=root, drives=len(layout.drives)
            )
            for at, item in enumerate(layout.parts)
            if np.any(number[kept] == at)
        }

    def aligned(self, throw: Recorded) -> tuple[dict[str, float], dict[str, Integral]]:
        """Return the onsets under which sound throws explain the early part best.

        Returns
        -------
        onsets : dict of str to float
            By movement [s].
        sums : dict of str to Integral
            As of `EarlyForces.sums`.
        """
        given = {name: throw.onsets[name] for name in self.names(throw)}
        early = EarlyForces(self, throw, {name: at + SHIFTS for name, at in given.items()})
        values = early.scores() + reduce(np.add.outer, [KNOWN] * len(given))
        shifts = peak(SHIFTS, values)
        found = {name: at + shift for (name, at), shift in zip(given.items(), shifts, strict=True)}
        return found, early.sums

    def names(self, throw: Recorded) -> list[str]:
        """Return the movements of a throw that are used, in the order of time."""
        return [name for name in self.movements if name in throw.onsets]


class EarlyForces:
    """The forces of one throw before contact, whose onsets are sought.

    Parameters
    ----------
    aligner : Aligner
        Of the switch.
    throw : Recorded
        Without fault.
    tried : mapping of str to ndarray
        Rising instants at which each movement may begin, in the order of `Aligner.names` [s].

    Attributes
    ----------
    sums : dict of str to Integral
        Of the forces about each movement, until its end, where all of them were recorded: what is
        held at an end depends on the instants that are tried.
    """

    def __init__(self, aligner: Aligner, throw: Recorded, tried: Mapping[str, Floats]) -> None:
        self._aligner, self._tried = aligner, tried
        parts = {part.name: part for part in aligner.layout.parts}
        self._sums, self.sums = {}, {}
        for name, instants in tried.items():
            self._sums[name], held = sums_about(throw, aligner.layout, parts[name], instants)
            if not held:
                self.sums[name] = self._sums[name]

    def scores(self) -> Floats:
        """Return how well sound throws explain the early part for all onsets tried together.

        Returns
        -------
        ndarray, shape (n_instants,) or (n_instants of the first, n_instants of the second movement)
            Logarithms of the likelihood; NaN beyond the samples.
        """
        first, *others = (self._term(name) for name in self._tried)
        square = np.einsum("kvs,kvs->ks", first, first)
        for other in others:
            late = first[:, first.shape[1] - other.shape[1] :]
            both = 2.0 * (late.swapaxes(1, 2) @ other)
            both += np.einsum("kvs,kvs->ks", other, other)[:, np.newaxis]
            square = square[..., np.newaxis] + both
        scale = self._aligner.scale.reshape(-1, *[1] * len(self._tried))
        return log_sum(log_density(square, size=self._aligner.size) + scale)

    def _term(self, name: str) -> Floats:
        """Return what a movement adds to a whitened throw, shape (k, n - first, n_instants) [-]."""
        movement, instants = self._aligner.movements[name], self._tried[name]
        windows = self._sums[name].means(instants, movement.part).reshape(-1, len(instants))
        off = (windows - movement.mean).astype(np.float32)
        return (movement.root @ off).astype(np.float64)


def inverse_root(centre: Centre, kept: Ints) -> tuple[Floats, float]:
    """Return the inverse root of the covariance of some features, and the log of its determinant.

    Parameters
    ----------
    centre : Centre
        By the root of the covariance of all features.
    kept : ndarray of int
        Which of them, in this order.
    """
    rows = np.linalg.inv(centre.root)[kept]
    lower = np.linalg.cholesky(rows @ rows.T)
    root = solve_triangular(lower, np.eye(len(kept)), lower=True)
    return np.asarray(root), float(-np.log(np.diag(lower)).sum())


def _movement(
    part: Part, own: NDArray[np.bool_], *, means: Floats, root: Floats, drives: int
) -> _Movement:
    """Prepare to move one movement, whose windows follow each other."""
    first, count = int(np.argmax(own)), int(np.count_nonzero(own))
    mine = slice(first, first + count)
    early = replace(part, count=count // drives)
    columns = root[:, first:, mine].astype(np.float32, order="C")
    return _Movement(early, first, columns, means[:, mine, np.newaxis])


def peak(places: Floats, values: Floats) -> list[float]:
    """Return where values are highest on each axis, by the parabola through the highest ones.

    Parameters
    ----------
    places : ndarray, shape (n,)
        Evenly spaced, of each axis.
    values : ndarray, shape (n,) or (n, n)
        At these.

    Examples
    --------
    >>> places = np.arange(5.0)
    >>> first, second = places[:, np.newaxis] - 2.3, places - 1.2
    >>> values = -(first**2) - second**2 + 0.5 * first * second
    >>> [round(place, 6) for place in peak(places, values)]
    [2.3, 1.2]
    """
    highest = np.unravel_index(int(values.argmax()), values.shape)
    at = [min(max(int(place), 1), len(places) - 2) for place in highest]
    near = values[tuple(slice(place - 1, place + 2) for place in at)]
    lines = np.array([near] if near.ndim == 1 else [near[:, 1], near[1]])
    slope = 0.5 * (lines[:, 2] - lines[:, 0])
    bend = np.diag(lines[:, 0] - 2.0 * lines[:, 1] + lines[:, 2])
    if near.ndim > 1:
        bend[0, 1] = bend[1, 0] = 0.25 * (near[0, 0] + near[2, 2] - near[0, 2] - near[2, 0])
    shift = np.zeros(len(at))
    # neither holds at an end of the places, nor beyond the samples
    if np.isfinite(near).all() and np.linalg.eigvalsh(bend)[-1] < 0.0:
        shift = np.clip(-np.linalg.solve(bend, slope), -1.0, 1.0)
    return [
        float(places[own] + step * (places[1] - places[0]))
        for own, step in zip(at, shift, strict=True)
    ]
