r"""Likelihood of a throw when the switch is sound and when something is the matter, by sampling.

Around friction level :math:`c` sound throws are normal with mean :math:`m_c` and covariance
:math:`C_c`. A cause changes them by one of its simulated signatures :math:`s_i`, known up to a
factor :math:`1 \pm \alpha` so that signatures reach those between them:

.. math::
    p(y) = \sum_c \pi_c\, N(y; m_c, C_c), \qquad
    p_k(y) = \sum_c \pi_c \sum_{i \in k} w_{ic}\, N(y; m_c + s_i, C_c + \alpha^2 s_i s_i^T)

:math:`w_{ic}` prefers signatures of about that friction level. The density of a throw that is
further from what is expected than the noise explains falls less fast than the normal one:

.. math:: \log N = -\tfrac{1}{2} \log\det C - \tfrac{1}{2} \begin{cases} Q & Q \le u \\
    u\,(1 + \log(Q / u)) & Q > u \end{cases}, \qquad Q = (y - m)^T C^{-1} (y - m)

with :math:`u = n + 3 \sqrt{2 n}`, within which :math:`Q` of n normal features stays but for one
throw in a thousand. Beyond it the density falls like that of a normal one whose scale is fitted to
the throw: a wrong model does not make small differences count as much as in a throw that fits.
From :math:`2 u` on :math:`\nu = 60` stands for the factor u: what is left is no larger noise then,
but a shape that nothing explains, and an object that explains a small share of it is not called.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from turnout.detection.density import log_density, sums_of_groups
from turnout.detection.triangular import Whitening, make_whitening

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Singles = NDArray[np.float32]

AMPLITUDE = 0.1
r""":math:`\alpha`, deviation of the factor on a signature [-]."""
TEMPER = 2.0
"""By which log likelihoods of signatures are divided for what an object is, how large, and where:
a throw lies between samples, and the nearest of them is not as much better than the next as its
likelihood says."""
REACH = 1.5
"""A signature is used at centres nearer than so many spacings of centres [-]."""


ROWS_AT_ONCE = 500
"""Components of some fifty throws that stay in the processor's caches while they are weighed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Signatures:
    """Changes that causes made in simulated throws.

    Attributes
    ----------
    basis : ndarray, shape (n_features, r)
        Orthonormal columns that they are made of [-].
    change : ndarray, shape (n, r)
        Of features, in this basis [N].
    gap : ndarray, shape (n, n_gaps)
        Of end gaps [m].
    level : ndarray, shape (n,)
        Friction level of the throw [-].
    kind : ndarray of int, shape (n,)
        Number of the cause, or of the place of an object.
    size : ndarray, shape (n,)
        Of the object [m]; NaN without one.
    x : ndarray, shape (n,)
        Where it was [m]; NaN without one.
    """

    basis: Floats
    change: Floats
    gap: Floats
    level: Floats
    kind: Ints
    size: Floats
    x: Floats

    def of(self, index: Ints) -> "Signatures":
        """Return some of them."""
        names = ("change", "gap", "level", "kind", "size", "x")
        return replace(self, **{name: getattr(self, name)[index] for name in names})

    def by_level(self) -> "Signatures":
        """Return them by rising friction level."""
        return self.of(np.argsort(self.level, kind="stable"))

    def seen_by(self, features: Ints) -> "Signatures":
        """Return them in some of the features."""
        return replace(self, basis=self.basis[features])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Centre:
    """Terms of one friction level for judging throws, by the root of its covariance.

    Attributes
    ----------
    mean : ndarray, shape (n_features,)
        [N]
    root : ndarray, shape (n_features, n_features)
        Inverse of the lower Cholesky factor of the covariance [1/N].
    variance : ndarray, shape (n_features,)
        Diagonal of the covariance [N^2].
    log_weight : float
        Logarithm of the share of throws around this level.
    log_scale : float
        Logarithm of the weight of the centre, less half the logarithm of the determinant.
    basis : ndarray of float32, shape (n_features, r)
        Of the signatures, whitened [1/N].
    gap_mean : ndarray, shape (n_gaps,)
        [m]
    gap_gain : ndarray, shape (n_gaps, n_features)
        Of a whitened throw on the expected gaps [m].
    gap_variance : ndarray, shape (n_gaps,)
        Of the gaps when the throw is known [m^2].
    gap_of_change : ndarray, shape (r, n_gaps)
        Of signatures, in their basis, on the expected gaps [m/N].
    """

    mean: Floats
    root: Floats
    variance: Floats
    log_weight: float
    log_scale: float
    basis: Singles
    gap_mean: Floats
    gap_gain: Floats
    gap_variance: Floats
    gap_of_change: Floats


def make_centre(
    *, mean: Floats, covariance: Floats, log_weight: float, signatures: Signatures
) -> Centre:
    """Prepare a friction level.

    Parameters
    ----------
    mean : ndarray, shape (n,)
        Of features, then of gaps.
    covariance : ndarray, shape (n, n)
        Of these.
    log_weight : float
        Logarithm of the share of throws around this level.
    signatures : Signatures
        In these features.
    """
    features = len(signatures.basis)
    lower = np.linalg.cholesky(covariance[:features, :features])
    root = solve_triangular(lower, np.eye(features), lower=True)
    basis = root @ signatures.basis
    cross = covariance[features:, :features] @ root.T
    unexplained = np.diag(covariance)[features:] - np.einsum("ij,ij->i", cross, cross)
    return Centre(
        mean=mean[:features],
        root=root,
        variance=np.diag(covariance)[:features].copy(),
        log_weight=log_weight,
        log_scale=float(log_weight - np.log(np.diag(lower)).sum()),
        basis=basis.astype(np.float32),
        gap_mean=mean[features:],
        gap_gain=cross,
        gap_variance=np.maximum(unexplained, 0.0),
        gap_of_change=basis.T @ cross.T,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Block:
    """Signatures that are used at the same centres, which follow each other.

    Attributes
    ----------
    change : ndarray of float32, shape (m, r)
        Of features, in the basis of the signatures [N]; reading it takes most of the time.
    centres : slice
        Of all centres.
    rows : slice
        Of all components by blocks: those of a signature follow each other.
    """

    change: Singles
    centres: slice
    rows: slice


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hypotheses:
    """Sound throws at some centres and signatures there: what throws are weighed by.

    A component is a signature at a centre that it is used at. Those of a kind follow each other.

    Attributes
    ----------
    centres : tuple of Centre
        Friction levels.
    mean : ndarray, shape (k, n_features, 1)
        Of the centres [N].
    whitening : Whitening
        By their roots.
    basis : ndarray of float32, shape (n_features, r)
        Of the signatures [-].
    blocks : tuple of Block
        Of the components.
    order : ndarray of int, shape (n_components,)
        Which row of the blocks each component is.
    number, place, kind : ndarray of int, shape (n_components,)
        Signature, centre and kind of each component.
    square : ndarray, shape (n_components, 1)
        Squared length of its signature, whitened [-].
    tight : ndarray, shape (n_components, 1)
        Variance of the factor on it when the throw is known [-].
    log_scale : ndarray, shape (n_components, 1)
        Logarithm of its density where nothing is left.
    starts : ndarray of int, shape (n_used,)
        Where the kinds begin that have components.
    used : ndarray of int, shape (n_used,)
        These kinds.
    kinds : int
        How many there are.
    """

    centres: tuple[Centre, ...]
    mean: Floats
    whitening: Whitening
    basis: Singles
    blocks: tuple[Block, ...]
    order: Ints
    number: Ints
    place: Ints
    kind: Ints
    square: Floats
    tight: Floats
    log_scale: Floats
    starts: Ints
    used: Ints
    kinds: int

    def before(self, kind: int) -> int:
        """Return how many components are of kinds of a lower number."""
        return int(np.searchsorted(self.kind, kind))

    def of_kind(self, kind: int) -> slice:
        """Return the components of a kind."""
        return slice(self.before(kind), self.before(kind + 1))


def make_hypotheses(
    centres: tuple[Centre, ...],
    signatures: Signatures,
    *,
    distance: Floats,
    kinds: int,
    whitening: Whitening | None = None,
) -> Hypotheses:
    """Combine centres, by rising level, with the signatures that are used at each.

    Parameters
    ----------
    signatures : Signatures
        All; sorted by level they are not copied.
    distance : ndarray, shape (k, n_signatures)
        Of their levels from those of the centres, in spacings of centres [-].
    kinds : int
        How many kinds of signature there are.
    whitening : Whitening, optional
        By the roots of the centres, where it is made.
    """
    weight = np.maximum(1.0 - np.abs(distance) / REACH, 0.0)
    total = np.array([np.bincount(signatures.kind, weights=row, minlength=kinds) for row in weight])
    first, count = np.argmax(weight > 0.0, axis=0), np.count_nonzero(weight, axis=0)
    bases = [(centre.root @ signatures.basis).astype(np.float32) for centre in centres]
    metrics = [basis.T @ basis for basis in bases]
    blocks, parts, end = [], [], 0
    for start, length in sorted({(int(a), int(b)) for a, b in zip(first, count, strict=True) if b}):
        number = np.flatnonzero((first == start) & (count == length))
        span = slice(start, start + length)
        change = _rows(signatures.change, number).astype(np.float32)
        squares = [np.einsum("ij,ij->i", change @ own, change) for own in metrics[span]]
        square = np.stack(squares, axis=1).astype(np.float64)
        kind = signatures.kind[number]
        share = np.log(weight[span, number] / total[span][:, kind]).T
        scale = np.array([centre.log_scale for centre in centres[span]])
        tight = AMPLITUDE**2 / (1.0 + AMPLITUDE**2 * square)
        log_scale = scale + share - 0.5 * np.log1p(AMPLITUDE**2 * square)
        place = np.tile(np.arange(start, start + length), (len(number), 1))
        parts.append((np.tile(number[:, np.newaxis], length), place, square, tight, log_scale))
        rows = slice(end, end + square.size)
        blocks.append(Block(change=change, centres=span, rows=rows))
        end += square.size
    joined = [np.concatenate([part.ravel() for part in item]) for item in zip(*parts, strict=True)]
    order = np.argsort(signatures.kind[joined[0]], kind="stable")
    number, place, square, tight, log_scale = (item[order] for item in joined)
    kind = signatures.kind[number]
    used, starts = np.unique(kind, return_index=True)
    return Hypotheses(
        centres=centres,
        mean=np.array([centre.mean[:, np.newaxis] for centre in centres]),
        whitening=whitening or make_whitening(np.array([centre.root for centre in centres])),
        basis=signatures.basis.astype(np.float32),
        blocks=tuple(blocks),
        order=order,
        number=number,
        place=place,
        kind=kind,
        square=square[:, np.newaxis],
        tight=tight[:, np.newaxis],
        log_scale=log_scale[:, np.newaxis],
        starts=starts,
        used=used,
        kinds=kinds,
    )


def _rows(values: Floats, number: Ints) -> Floats:
    """Return some rows, without a copy where they follow each other."""
    if number[-1] - number[0] + 1 == len(number):
        return values[number[0] : number[-1] + 1]
    return values[number]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evidence:
    """Logarithms of densities of some throws.

    Attributes
    ----------
    sound : ndarray, shape (n_throws,)
        When the switch is sound.
    kind : ndarray, shape (n_kinds, n_throws)
        For each kind of signature; minus infinity without a component.
    tempered : ndarray, shape (n_kinds, n_throws)
        The same, where logarithms of densities of components are divided by `TEMPER`.
    centre : ndarray, shape (k, n_throws)
        Of sound throws at each centre.
    white : ndarray, shape (k, n_features, n_throws)
        Throws less the mean of each centre, whitened [-].
    back : ndarray of float32, shape (k, n_features, n_throws)
        These by the transposed roots of the centres [1/N].
    own : ndarray, shape (k, n_throws)
        Squared lengths of the throws, whitened [-].
    component : ndarray, shape (n_components, n_throws)
        Of each component.
    square : ndarray, shape (n_components, n_throws)
        Squared length of what it leaves, whitened [-].
    off : ndarray, shape (n_components, n_throws)
        Its whitened signature times what it leaves [-].
    hypotheses : Hypotheses
        What the throws were weighed by.
    """

    sound: Floats
    kind: Floats
    tempered: Floats
    centre: Floats
    white: Floats
    back: Singles
    own: Floats
    component: Floats
    square: Floats
    off: Floats
    hypotheses: Hypotheses

    def factors(self, components: Ints, number: int) -> Floats:
        """Return the most likely factor on the signature of some components in one throw [-]."""
        tight = self.hypotheses.tight[components, 0]
        return np.asarray(1.0 + tight * self.off[components, number])

    def of_throw(self, number: int) -> "Evidence":
        """Return that of one throw, without a copy."""
        names = (
            *("sound", "kind", "tempered", "centre", "white", "back", "own"),
            *("component", "square", "off"),
        )
        column = slice(number, number + 1)
        return replace(self, **{name: getattr(self, name)[..., column] for name in names})


def weigh(features: Floats, hypotheses: Hypotheses) -> Evidence:
    """Return the likelihood of throws, shape (n_throws, n_features) [N], under every hypothesis."""
    white, back = hypotheses.whitening.of(features.T - hypotheses.mean)
    return _weighed(white, back, hypotheses)


def weigh_again(evidence: Evidence, hypotheses: Hypotheses) -> Evidence:
    """Return the same for other signatures at the same centres."""
    return _weighed(evidence.white, evidence.back, hypotheses)


def _weighed(white: Floats, back: Singles, hypotheses: Hypotheses) -> Evidence:
    """Return the likelihood of whitened throws, multiplied by the transposed roots as well.

    Signatures are projected on the latter, not on the former by whitened bases of each level:
    reading these would take as long as the roots.
    """
    count, size, throws = white.shape
    projected = hypotheses.basis.T @ back.swapaxes(0, 1).reshape(size, -1)
    projected = projected.reshape(-1, count, throws)
    own = np.square(white).sum(axis=1)
    scale = np.array([[centre.log_scale] for centre in hypotheses.centres])
    sound = scale + log_density(own, size=size)
    along = np.empty((len(hypotheses.number), throws), dtype=np.float32)
    for block in hypotheses.blocks:
        seen = projected[:, block.centres].reshape(len(projected), -1)
        np.matmul(block.change, seen, out=along[block.rows].reshape(len(block.change), -1))
    off, square, component = np.empty((3, *along.shape))
    for first in range(0, len(along), ROWS_AT_ONCE):
        rows = slice(first, first + ROWS_AT_ONCE)
        length, tight = hypotheses.square[rows], hypotheses.tight[rows]
        left = np.subtract(along.take(hypotheses.order[rows], axis=0), length, out=off[rows])
        gained = tight * left
        gained += 2.0
        gained *= left
        gained += length
        left = np.subtract(own.take(hypotheses.place[rows], axis=0), gained, out=square[rows])
        np.maximum(left, 0.0, out=left)
        component[rows] = log_density(left, size=size) + hypotheses.log_scale[rows]
    kind, tempered = np.full((2, hypotheses.kinds, throws), -np.inf)
    found = sums_of_groups(component, hypotheses.starts, temper=TEMPER)
    kind[hypotheses.used], tempered[hypotheses.used] = found
    return Evidence(
        sound=log_sum(sound),
        kind=kind,
        tempered=tempered,
        centre=sound,
        white=white,
        back=back,
        own=own,
        component=component,
        square=square,
        off=off,
        hypotheses=hypotheses,
    )


def log_sum(values: Floats) -> Floats:
    """Return the logarithm of the sum of exponentials along the first axis, without checks.

    Parameters
    ----------
    values : ndarray, shape (n, ...)
        Logarithms, not all of them minus infinity.

    Examples
    --------
    >>> log_sum(np.log([[1.0], [2.0], [5.0]])).round(6).tolist()
    [2.079442]
    """
    highest = values.max(axis=0)
    return np.asarray(highest + np.log(np.exp(values - highest).sum(axis=0)))
