r"""Onsets of movements, found again by how well sound throws explain what comes before contact.

The early windows of all movements, those of the first one first, are :math:`f`. With the local
model of sound throws at a friction level, whose covariance is :math:`C`,

.. math:: Q = |R\,(f - m)|^2 = |\sum_M R_M (f_M - m_M)|^2, \qquad R^T R = C^{-1}

:math:`R` is lower triangular; :math:`R_M` holds the columns that belong to movement :math:`M`.
While one onset is tried, the term of the other movement stays, and while that one is tried, the
terms of this one at all instants are known already: each root is multiplied with each trial once.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

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
AGAIN = 10e-3
"""About the onset that was found first, where it is tried once more [s]."""
ONSET_DEVIATION = 12e-3
"""Standard deviation of onsets that are found in recordings [s]."""
EARLY = 0.6
"""Share of the closing movement by which it is aligned: before small objects are touched [-]."""
REST_AFTER = 0.7
"""After the movement in a layout, about [s]."""
FAR = 30.0
"""Friction levels whose log likelihood lies so far below the best one do not count."""


@dataclass(frozen=True, slots=True, eq=False)
class _Movement:
    """What is needed to move one movement: its windows, and sound throws at each level.

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
        roots, scales = zip(*(_root(centre, kept) for centre in view.centres), strict=True)
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
        found = {name: throw.onsets[name] for name in self.names(throw)}
        early = EarlyForces(self, throw, {name: at + SHIFTS for name, at in found.items()})

        # the friction level is that of all movements, whose onsets are right to some milliseconds
        levels = early.levels(found, next(iter(found)), more=1)

        def shift(name: str, which: slice) -> float:
            tried = SHIFTS[which]
            scores = early.scores(found, name, which, levels=levels)
            return _peak(tried, scores - 0.5 * (tried / ONSET_DEVIATION) ** 2)

        for name in found:
            found[name] = throw.onsets[name] + shift(name, ALL)
        for name in found if len(found) > 1 else ():
            # the other onset has moved: by little, so that this one is found near where it was
            near = np.flatnonzero(np.abs(SHIFTS - (found[name] - throw.onsets[name])) < AGAIN)
            some = slice(int(near[0]), int(near[-1]) + 1)
            after = shift(name, some)
            if not SHIFTS[some][1] < after < SHIFTS[some][-2]:
                after = shift(name, ALL)
            found[name] = throw.onsets[name] + after
        return found, early.sums

    def names(self, throw: Recorded) -> list[str]:
        """Return the movements of a throw that are used."""
        return [name for name in throw.onsets if name in self.movements]


ALL = slice(None)


class EarlyForces:
    """The forces of one throw before contact, whose onsets are sought.

    Parameters
    ----------
    aligner : Aligner
        Of the switch.
    throw : Recorded
        Without fault.
    tried : mapping of str to ndarray
        Rising instants at which each movement of the aligner may begin [s].

    Attributes
    ----------
    sums : dict of str to Integral
        Of the forces about each movement, until its end, where all of them were recorded: what is
        held at an end depends on the instants that are tried.
    """

    def __init__(self, aligner: Aligner, throw: Recorded, tried: Mapping[str, Floats]) -> None:
        self._aligner, self._movements = aligner, aligner.movements
        parts = {part.name: part for part in aligner.layout.parts}
        self._sums, self.sums = {}, {}
        for name, instants in tried.items():
            self._sums[name], held = sums_about(throw, aligner.layout, parts[name], instants)
            if not held:
                self.sums[name] = self._sums[name]
        self._windows = {name: self.windows(name, item) for name, item in tried.items()}
        self._terms: dict[str, tuple[slice, Singles]] = {}

    def windows(self, name: str, instants: Floats) -> Floats:
        """Return the early windows of a movement with its onset at some instants [N].

        Returns
        -------
        ndarray, shape (n_own, n_instants)
            Drive by drive; NaN beyond the samples.
        """
        part = self._movements[name].part
        means = self._sums[name].means(instants, part)
        return means.reshape(-1, len(instants))

    def levels(self, found: Mapping[str, float], name: str, *, more: int = 0) -> slice:
        """Return the friction levels that count, and some more on either side.

        Other parameters as of `scores`.
        """
        windows = self._windows[name]
        some = windows[:, :: max((windows.shape[1] - 1) // 2, 1)]
        likelihoods = self._likelihoods(found, name, self._term(name, some, ALL), ALL)
        best = np.nanmax(likelihoods, axis=0, initial=-np.inf)
        near = np.flatnonzero(~np.all(likelihoods < best - FAR, axis=1))
        return slice(max(int(near[0]) - more, 0), int(near[-1]) + 1 + more)

    def scores(
        self,
        found: Mapping[str, float],
        name: str,
        which: slice = ALL,
        *,
        levels: slice | None = None,
    ) -> Floats:
        """Return how well sound throws explain the early part with one onset at tried instants.

        Parameters
        ----------
        found : mapping of str to float
            Onsets of the other movements [s].
        name : str
            Of the movement whose onset is tried.
        which : slice
            Of the instants tried, n of them.
        levels : slice, optional
            Friction levels that count.

        Returns
        -------
        ndarray, shape (n,)
            Logarithms of the likelihood; NaN beyond the samples.
        """
        counted = self.levels(found, name) if levels is None else levels
        known, term = self._terms.get(name, (None, None))
        if term is None or known != counted:
            term = self._term(name, self._windows[name], counted)
            self._terms[name] = counted, term
        return log_sum(self._likelihoods(found, name, term[..., which], counted))

    def _term(self, name: str, windows: Floats, levels: slice) -> Singles:
        """Return what a movement adds to a whitened throw, shape (n_levels, n - first, n) [-]."""
        movement = self._movements[name]
        off = (windows - movement.mean[levels]).astype(np.float32)
        return np.asarray(movement.root[levels] @ off)

    def _likelihoods(
        self, found: Mapping[str, float], name: str, term: Singles, levels: slice
    ) -> Floats:
        """Return the likelihood at some levels with one movement tried, shape (n_levels, n)."""
        first, scale = self._movements[name].first, self._aligner.scale[levels, np.newaxis]
        others = np.zeros((len(scale), self._aligner.size, 1))
        for other in found:
            if other != name:
                there = self.windows(other, np.array([found[other]]))
                others[:, self._movements[other].first :] += self._term(other, there, levels)
        white = term + others[:, first:]
        square = np.einsum("kvs,kvs->ks", white, white)
        square += np.square(others[:, :first]).sum(axis=1)
        return np.asarray(log_density(square, size=self._aligner.size) + scale)


def _root(centre: Centre, kept: Ints) -> tuple[Floats, float]:
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


def _peak(places: Floats, values: Floats) -> float:
    """Return where values are highest, by the parabola through the highest three.

    Examples
    --------
    >>> places = np.arange(5.0)
    >>> round(_peak(places, -((places - 2.3) ** 2)), 6)
    2.3
    """
    at = int(np.clip(np.argmax(values), 1, len(values) - 2))
    left, middle, right = values[at - 1 : at + 2]
    bend = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    return float(places[at] + np.clip(shift, -1.0, 1.0) * (places[1] - places[0]))
