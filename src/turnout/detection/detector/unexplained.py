r"""Remainder of a throw after the best explanation: its size and its irregularity.

:math:`z` is what the most likely of all hypotheses leaves, whitened by the covariance :math:`C` of
the throw. How much that is, says its squared length. A cause that is not known shows best, however,
where sound throws vary by themselves: dry chairs change the instants at which chairs break away,
which differ in every throw, and hardly anything else. With :math:`W` the covariance of what varies
from throw to throw and :math:`\Lambda = C^{-1/2}\, W\, C^{-T/2}`,

.. math:: T = \frac{z^T M z - \operatorname{tr} M}{\sqrt{2 \operatorname{tr} M^2}}, \qquad
    M = a \Lambda\, (I + a \Lambda)^{-1}

is the statistic of the likelihood ratio of a throw that varies more in these ways, by a further
covariance :math:`a W`, against one that does not: zero mean and unit variance of a normal sound
throw.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from turnout.detection.likelihood import Centre, Evidence, Signatures

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

EXCESS = 16.0
""":math:`a`, further variance of a throw that varies more than sound ones [-]."""


@dataclass(frozen=True, slots=True, eq=False)
class Weights:
    """Of the squares of what is left, at one centre.

    Attributes
    ----------
    matrix : ndarray, shape (n_features, n_features)
        :math:`M` [-].
    mean, deviation : float
        Of the weighted sum in a sound throw [-].
    """

    matrix: Floats
    mean: float
    deviation: float


@dataclass(slots=True, eq=False)
class Variation:
    """Variation of sound throws by themselves, and what follows for the remainder of a throw.

    Attributes
    ----------
    within : ndarray, shape (k, n_features, n_features)
        Covariance of what varies from throw to throw at each centre [N^2].
    """

    within: Floats
    _weights: dict[int, Weights] = field(init=False, default_factory=dict)

    def weights(self, number: int, centre: Centre) -> Weights:
        """Return the weights at a centre, made when they are first needed."""
        if number not in self._weights:
            share = centre.root @ self.within[number] @ centre.root.T
            share = 0.5 * EXCESS * (share + share.T)
            size = np.eye(len(share))
            matrix = size - cho_solve(cho_factor(size + share), size)
            square = np.einsum("ij,ij->", matrix, matrix)
            self._weights[number] = Weights(
                matrix, float(np.trace(matrix)), float(np.sqrt(2.0 * square))
            )
        return self._weights[number]


def least_squares(evidence: Evidence, *, kept: NDArray[np.bool_] | None = None) -> Floats:
    """Return the squared length of what the hypothesis that fits best leaves, shape (n_throws,).

    Parameters
    ----------
    evidence : Evidence
        Of the throws.
    kept : ndarray of bool, shape (n_components,)
        Components that count beside sound throws; default all.
    """
    square = evidence.square if kept is None else evidence.square[kept]
    return np.asarray(np.minimum(evidence.own.min(axis=0), square.min(axis=0, initial=np.inf)))


def irregularities(
    evidence: Evidence,
    variation: Variation,
    signatures: Signatures,
    *,
    kept: NDArray[np.bool_] | None = None,
) -> Floats:
    """Return :math:`T` of what the most likely hypothesis leaves, shape (n_throws,).

    Parameters
    ----------
    evidence : Evidence
        Of the throws.
    variation : Variation
        Of sound throws at the centres.
    signatures : Signatures
        That throws were weighed by.
    kept : ndarray of bool, shape (n_components,)
        Components that count beside sound throws; default all.
    """
    hypotheses = evidence.hypotheses
    density = evidence.component if kept is None else evidence.component[kept]
    numbers = np.arange(len(evidence.component)) if kept is None else np.flatnonzero(kept)
    most = density.max(axis=0, initial=-np.inf)
    found = np.empty(len(most))
    for throw, sound in enumerate(np.argmax(evidence.centre, axis=0)):
        at = int(sound)
        left = evidence.white[at, :, throw]
        if most[throw] > evidence.centre[at, throw]:
            component = numbers[np.argmax(density[:, throw])]
            at = int(hypotheses.place[component])
            change = signatures.change[hypotheses.number[component]].astype(np.float32)
            moved = hypotheses.centres[at].basis @ change
            (factor,) = evidence.factors(np.array([component]), throw)
            left = evidence.white[at, :, throw] - factor * moved
        weights = variation.weights(at, hypotheses.centres[at])
        found[throw] = (left @ weights.matrix @ left - weights.mean) / weights.deviation
    return found
