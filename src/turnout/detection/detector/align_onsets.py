r"""Onsets of movements, found again by how well sound throws explain what comes before contact.

The early windows of one movement, :math:`f_V`, move with its onset while those of the other,
:math:`f_U`, stay. With the local model of sound throws at a friction level,

.. math:: Q = |R_U (f_U - m_U)|^2 + |R_V (f_V - m_V - G\,(f_U - m_U))|^2, \qquad
    G = C_{VU} C_{UU}^{-1}

:math:`R_U` and :math:`R_V` are inverse roots of :math:`C_{UU}` and of
:math:`C_{VV} - G\,C_{UV}`, so the first term is computed once for all instants that are tried.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from turnout.detection.density import log_density
from turnout.detection.detector.judging import CYCLE, View
from turnout.detection.detector.recorded import Recorded, held_at_ends, known_forces
from turnout.detection.detector.throw_layout import CLOSING, OPENING, Integral, Layout, Part
from turnout.detection.likelihood import Centre, log_sum

Floats = NDArray[np.float64]
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
    own, other : ndarray of int
        Its early windows among those of all movements, and the rest.
    mean : ndarray, shape (k, n_own)
        Of the former in sound throws [N].
    other_mean : ndarray, shape (k, n_other)
        Of the latter [N].
    root, other_root : ndarray, shape (k, n_own, n_own) and (k, n_other, n_other)
        Inverse roots of the covariances of the former, the latter known, and of the latter [1/N].
    gain : ndarray, shape (k, n_own, n_other)
        Of the latter on the former [-].
    scale : ndarray, shape (k,)
        Logarithm of the density where nothing is left.
    """

    part: Part
    own: Ints
    other: Ints
    mean: Floats
    other_mean: Floats
    root: Floats
    other_root: Floats
    gain: Floats
    scale: Floats


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
        kept = np.flatnonzero(early)
        self.layout, self._part = layout, view.part
        number = layout.part[view.features[kept]]
        covariances = [_covariance(centre, kept) for centre in view.centres]
        means = np.array([centre.mean[kept] for centre in view.centres])
        self.movements = {
            item.name: _movement(
                item, number == at, means=means, covariances=covariances, drives=len(layout.drives)
            )
            for at, item in enumerate(layout.parts)
            if np.any(number == at)
        }

    def align(self, throw: Recorded) -> dict[str, float]:
        """Return the onsets under which sound throws explain the early part best."""
        found = {name: throw.onsets[name] for name in self.names(throw)}
        early = EarlyForces(self, throw, found)

        first = next(iter(found))
        # the friction level is that of all movements, whose onsets are right to some milliseconds
        levels = early.levels(found, first, throw.onsets[first] + SHIFTS, more=1)

        def shift(name: str, tried: Floats) -> float:
            scores = early.scores(found, name, throw.onsets[name] + tried, levels=levels)
            return _peak(tried, scores - 0.5 * (tried / ONSET_DEVIATION) ** 2)

        for name in found:
            found[name] = throw.onsets[name] + shift(name, SHIFTS)
        for name in found if len(found) > 1 else ():
            # the other onset has moved: by little, so that this one is found near where it was
            before = found[name] - throw.onsets[name]
            some = SHIFTS[np.abs(SHIFTS - before) < AGAIN]
            after = shift(name, some)
            if not some[1] < after < some[-2]:
                after = shift(name, SHIFTS)
            found[name] = throw.onsets[name] + after
        return found

    def names(self, throw: Recorded) -> list[str]:
        """Return the movements of a throw that are used."""
        return [
            name
            for name in throw.onsets
            if name == CLOSING or (name == OPENING and self._part == CYCLE)
        ]


class EarlyForces:
    """The forces of one throw before contact, whose onsets are sought.

    Parameters
    ----------
    aligner : Aligner
        Of the switch.
    throw : Recorded
        Without fault.
    about : mapping of str to float
        Onsets near which the true ones are sought [s].
    reach : float
        How near [s].
    """

    def __init__(
        self,
        aligner: Aligner,
        throw: Recorded,
        about: Mapping[str, float],
        *,
        reach: float = float(SHIFTS[-1]),
    ) -> None:
        self._movements = aligner.movements
        time, force = known_forces(throw, aligner.layout)
        self._sums = {}
        for name, at in about.items():
            edges = self._movements[name].part.edges
            begin = at + edges[0] + np.array([-reach, reach])
            end = at + edges[-1] + np.array([-reach, reach])
            first = max(int(np.searchsorted(time, begin[0])) - 1, 0)
            last = int(np.searchsorted(time, end[-1])) + 1
            own = held_at_ends(time[first:last], force[:, first:last], begin, end)
            self._sums[name] = Integral(*own)

    def windows(self, name: str, instants: Floats) -> Floats:
        """Return the early windows of a movement with its onset at some instants [N].

        Returns
        -------
        ndarray, shape (n_instants, n_own)
            Drive by drive; NaN beyond the samples.
        """
        part = self._movements[name].part
        until = self._sums[name].until(instants[:, np.newaxis] + part.edges)
        return (np.diff(until, axis=-1) / part.window).swapaxes(0, 1).reshape(len(instants), -1)

    def levels(
        self, found: Mapping[str, float], name: str, instants: Floats, *, more: int = 0
    ) -> slice:
        """Return the friction levels that count, and some more on either side.

        Other parameters as of `scores`.
        """
        some = instants[:: max((len(instants) - 1) // 2, 1)]
        likelihoods = self._likelihoods(found, name, some, slice(None))
        best = np.nanmax(likelihoods, axis=0, initial=-np.inf)
        near = np.flatnonzero(~np.all(likelihoods < best - FAR, axis=1))
        return slice(max(int(near[0]) - more, 0), int(near[-1]) + 1 + more)

    def scores(
        self,
        found: Mapping[str, float],
        name: str,
        instants: Floats,
        *,
        levels: slice | None = None,
    ) -> Floats:
        """Return how well sound throws explain the early part with one onset at some instants.

        Parameters
        ----------
        found : mapping of str to float
            Onsets of the other movements [s].
        name : str
            Of the movement whose onset is tried.
        instants : ndarray, shape (n,)
            [s]
        levels : slice, optional
            Friction levels that count.

        Returns
        -------
        ndarray, shape (n,)
            Logarithms of the likelihood; NaN beyond the samples.
        """
        counted = self.levels(found, name, instants) if levels is None else levels
        return log_sum(self._likelihoods(found, name, instants, counted))

    def _likelihoods(
        self, found: Mapping[str, float], name: str, instants: Floats, levels: slice
    ) -> Floats:
        """Return the same at each of some levels, shape (n_levels, n)."""
        movement = self._movements[name]
        expected, before = movement.mean[levels], np.zeros(len(movement.mean[levels]))
        others = [other for other in found if other != name]
        if others:
            seen = self.windows(others[0], np.array([found[others[0]]]))[0]
            rest = (seen - movement.other_mean[levels])[..., np.newaxis]
            expected = expected + (movement.gain[levels] @ rest)[..., 0]
            before = np.square(movement.other_root[levels] @ rest).sum(axis=(1, 2))
        off = self.windows(name, instants) - expected[:, np.newaxis]
        white = off @ movement.root[levels].swapaxes(1, 2)
        square = np.einsum("ksv,ksv->ks", white, white) + before[:, np.newaxis]
        size = len(movement.own) + len(movement.other)
        return np.asarray(log_density(square, size=size) + movement.scale[levels, np.newaxis])


def _covariance(centre: Centre, kept: Ints) -> Floats:
    """Return the covariance of some features from the root of that of all."""
    rows = np.linalg.inv(centre.root)[kept]
    return np.asarray(rows @ rows.T)


def _movement(
    part: Part,
    own: NDArray[np.bool_],
    *,
    means: Floats,
    covariances: list[Floats],
    drives: int,
) -> _Movement:
    """Prepare to move one movement."""
    mine, rest = np.flatnonzero(own), np.flatnonzero(~own)
    roots, other_roots, gains, scales = [], [], [], []
    for covariance in covariances:
        lower = np.linalg.cholesky(covariance[np.ix_(rest, rest)])
        half = solve_triangular(lower, covariance[np.ix_(rest, mine)], lower=True)
        left = np.linalg.cholesky(covariance[np.ix_(mine, mine)] - half.T @ half)
        roots.append(solve_triangular(left, np.eye(len(mine)), lower=True))
        other_roots.append(solve_triangular(lower, np.eye(len(rest)), lower=True))
        gains.append(half.T @ other_roots[-1])
        scales.append(-np.log(np.diag(left)).sum() - np.log(np.diag(lower)).sum())
    early = Part(
        name=part.name,
        start=part.start,
        before=part.before,
        window=part.window,
        count=len(mine) // drives,
    )
    return _Movement(
        part=early,
        own=mine,
        other=rest,
        mean=means[:, mine],
        other_mean=means[:, rest],
        root=np.array(roots),
        other_root=np.array(other_roots),
        gain=np.array(gains),
        scale=np.array(scales),
    )


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
