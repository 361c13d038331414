r"""Of which kind a trapped object is: odds by kind, given that there is an object.

Kinds differ in how they yield. What stays as it is holds the rail off from contact to the end; a
stone splits and ice crumbles, so that the force drops while the switch closes and little is left at
its end; snow and wood give way at once and go on giving way. Where a drive presses too little to
break a stone or ice they are as stiff as steel, and forces say nothing of the kind.

The same objects, at the same places in the same states, are thrown once of each kind. With
:math:`p_k(y)` the density of a throw over the signatures of kind :math:`k`, the odds are

.. math:: o_k = \left( \frac{p_k(y)}{\max_j p_j(y)} \right)^{1/2}

The root is that of places and sizes, see `TEMPER`. Kinds with odds from `LEAST_ODDS` on can
explain the throw as well as the likeliest.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from turnout.detection.likelihood import (
    TEMPER,
    Centre,
    Evidence,
    Hypotheses,
    Signatures,
    make_hypotheses,
    weigh_again,
)
from turnout.detection.triangular import Whitening

Floats = NDArray[np.float64]

RIGID = "rigid"
"""An object that stays as it is: steel, or a stone that is not pressed hard enough to break."""
LEAST_ODDS = 0.1
"""Odds against the likeliest kind from which on a kind explains the throw as well [-]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KindSignatures:
    """Signatures of objects of several kinds.

    Attributes
    ----------
    names : tuple of str
        Of the kinds.
    signatures : Signatures
        Numbered by these.
    """

    names: tuple[str, ...]
    signatures: Signatures

    def seen_by(self, features: NDArray[np.intp]) -> "KindSignatures":
        """Return them in some of the features."""
        return replace(self, signatures=self.signatures.seen_by(features))


@dataclass(slots=True, kw_only=True, eq=False)
class KindView:
    """Weights of the throws of a switch for the kind of an object, made when first needed.

    Attributes
    ----------
    known : KindSignatures
        In the features of the view.
    centres : tuple of Centre
        Of the view.
    whitening : Whitening
        By their roots.
    distance : ndarray, shape (k, n_signatures)
        Of the levels of signatures from those of the centres, in spacings of centres [-].
    """

    known: KindSignatures
    centres: tuple[Centre, ...]
    whitening: Whitening
    distance: Floats
    _hypotheses: Hypotheses | None = field(init=False, default=None)

    @property
    def hypotheses(self) -> Hypotheses:
        """Signatures of all kinds at the centres."""
        if self._hypotheses is None:
            signatures = self.known.signatures
            self._hypotheses = make_hypotheses(
                self.centres,
                signatures,
                distance=self.distance,
                kinds=len(self.known.names),
                whitening=self.whitening,
            )
        return self._hypotheses

    def odds(self, evidence: Evidence) -> Floats:
        """Return the odds of each kind against the likeliest, shape (n_kinds, n_throws) [-]."""
        logs = weigh_again(evidence, self.hypotheses).kind / TEMPER
        return np.asarray(np.exp(logs - logs.max(axis=0)))

    def odds_of(self, evidence: Evidence, number: int) -> dict[str, float]:
        """Return the same of one throw by the name of the kind, likeliest first."""
        odds = self.odds(evidence.of_throw(number))[:, 0]
        order = np.argsort(-odds, kind="stable")
        return {self.known.names[at]: float(odds[at]) for at in order}


def kinds_in_words(odds: Mapping[str, float]) -> str:
    """Return which kinds an object may be of; "" where no kinds were learned.

    Parameters
    ----------
    odds : mapping of str to float
        Of each kind against the likeliest, likeliest first [-].

    Examples
    --------
    >>> kinds_in_words({"snow": 1.0, "wood": 0.02, "ice": 0.01})
    'snow'
    >>> kinds_in_words({"snow": 1.0, "wood": 0.4, "ice": 0.01})
    'not identifiable (snow or wood)'
    >>> kinds_in_words({"snow": 1.0, "wood": 0.4, "ice": 0.3})
    'not identifiable'
    """
    likely = [name for name, value in odds.items() if value >= LEAST_ODDS]
    if len(likely) == 1:
        return likely[0]
    if not likely or len(likely) == len(odds):
        return "not identifiable" if likely else ""
    return f"not identifiable ({', '.join(likely[:-1])} or {likely[-1]})"
