r"""Interpolation of signatures: samples near a throw, moved to where it lies among them.

Signatures are few: an object lies at another place than the nearest of them, and is larger or
smaller. How place, size or gap change with the signature is learned from the samples around the
throw. Of these :math:`s_i`, whitened, with weights :math:`w_i` of the likelihood to the power
:math:`1/T`, the covariances are those of a normal distribution; what is left of the likelihood,
with the power :math:`1 - 1/T`, measures the signature with noise of variance
:math:`R = T / (T - 1)`. Each sample is moved by the gain of that measurement (ensemble Kalman
filter, Evensen 1994; as a correction of accepted samples Beaumont, Zhang and Balding 2002):

.. math:: v_i + B^T (z - s_i), \qquad B = (C_{ss} + R\,I)^{-1} C_{sv}

:math:`z` is the throw less the mean of sound throws, whitened; its noise adds :math:`R\,|B|^2` to
the variance of each moved sample.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from turnout.detection.detector.judging import View
from turnout.detection.likelihood import Evidence

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

EVEN = 4.0
r""":math:`T`, between the nearest sample alone, 1, and all of them alike."""
LEFT = EVEN / (EVEN - 1.0)
""":math:`R`, variance of what is left of the likelihood in units of that of a throw [-]."""
DIRECTIONS = 8
"""In which signatures differ most; for the others samples are too few to learn from."""
MOST_SAMPLES = 64
"""Signatures that are counted, the likeliest."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """The signatures nearest to a throw.

    Attributes
    ----------
    components : ndarray of int, shape (n,)
        The likeliest of each signature.
    share : ndarray, shape (n,)
        Weights, which sum to 1 [-].
    change : ndarray, shape (n, n_features)
        Signatures less their mean, whitened [-].
    left : ndarray, shape (n, n_features)
        What each leaves of the throw, whitened [-].
    """

    components: Ints
    share: Floats
    change: Floats
    left: Floats

    @cached_property
    def _directions(self) -> tuple[Floats, Floats]:
        """Directions in which signatures differ most, and the gain of each sample along them.

        Returns
        -------
        directions : ndarray, shape (n_features, d)
            Not of unit length.
        gains : ndarray, shape (n, d)
        """
        change = np.sqrt(self.share)[:, np.newaxis] * self.change
        # the others are as many as there are samples
        squares, among = np.linalg.eigh(change @ change.T)
        squares, among = squares[-DIRECTIONS:], among[:, -DIRECTIONS:]
        return change.T @ among, among / (squares + LEFT)

    def moved(self, values: Floats) -> tuple[Floats, Floats]:
        """Move what is known of each signature to where the throw lies among them.

        Parameters
        ----------
        values : ndarray, shape (n, m)
            Such as places and sizes.

        Returns
        -------
        moved : ndarray, shape (n, m)
            In the same units.
        deviation : ndarray, shape (m,)
            What noise adds to each.
        """
        directions, gains = self._directions
        deviating = np.sqrt(self.share)[:, np.newaxis] * (values - self.share @ values)
        gain = directions @ (gains.T @ deviating)
        return values + self.left @ gain, np.sqrt(LEFT * np.square(gain).sum(axis=0))


def samples_near(view: View, evidence: Evidence, number: int, components: slice) -> Samples:
    """Return the signatures nearest to one of some throws, each once.

    Parameters
    ----------
    view : View
        That the throws were weighed with.
    evidence : Evidence
        Of these.
    number : int
        Which one.
    components : slice
        Those whose signatures count, the first ones.
    """
    hypotheses, signatures = evidence.hypotheses, view.signatures
    logs = evidence.component[components, number]
    near = np.flatnonzero(logs > logs.max() - EVEN * NEAR)
    near = near[np.argsort(-logs[near], kind="stable")]
    signature = hypotheses.number[near]
    shares = np.bincount(signature, np.exp((logs[near] - logs[near[0]]) / EVEN))
    positive = shares[shares > 0.0]
    if len(positive) > MOST_SAMPLES:
        least = np.partition(positive, -MOST_SAMPLES)[-MOST_SAMPLES]
        near = near[shares[signature] >= least]
        signature = hypotheses.number[near]
    of, first = np.unique(signature, return_index=True)
    share = shares[of]
    share = share / share.sum()
    at = int(hypotheses.place[near[0]])
    change = signatures.change[of].astype(np.float32) @ hypotheses.centres[at].basis.T
    change = change.astype(np.float64)
    return Samples(
        components=near[first],
        share=share,
        change=change - share @ change,
        left=evidence.white[at, :, number] - change,
    )


NEAR = 9.0
"""Samples weigh nothing whose evened logarithm lies so far below the highest."""
