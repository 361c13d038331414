r"""Likelihood of a throw when the switch is sound and when something is the matter, by sampling.

Around friction level :math:`c` sound throws are normal with mean :math:`m_c` and covariance
:math:`C_c`. A cause changes them by one of its simulated signatures :math:`s_i`, known up to a
factor :math:`1 \pm \alpha` so that signatures reach those between them:

.. math::
    p(y) = \sum_c \pi_c\, N(y; m_c, C_c), \qquad
    p_k(y) = \sum_c \pi_c \sum_{i \in k} w_{ic}\, N(y; m_c + s_i, C_c + \alpha^2 s_i s_i^T)

:math:`w_{ic}` prefers signatures of about that friction level. The density of a throw that is
further from what is expected than the noise explains falls less fast than the normal one:

.. math:: \log N = -\tfrac12 \log\det C - \tfrac12 \begin{cases} Q & Q \le u \\
    u\,(1 + \log(Q / u)) & Q > u \end{cases}, \qquad Q = (y - m)^T C^{-1} (y - m)

with :math:`u = n + 3 \sqrt{2 n}`, within which :math:`Q` of n normal features stays but for one
throw in a thousand. Beyond it the density falls like that of a normal one whose scale is fitted to
the throw: a wrong model does not make small differences count as much as in a throw that fits.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import logsumexp

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

AMPLITUDE = 0.1
r""":math:`\alpha`, deviation of the factor on a signature [-]."""
REACH = 1.5
"""A signature is used at centres nearer than so many spacings of centres [-]."""


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

    def seen_by(self, features: Ints) -> "Signatures":
        """Return them in some of the features."""
        return replace(self, basis=self.basis[features])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Centre:
    """What is needed of one friction level to judge throws, by the root of its covariance.

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
    basis : ndarray, shape (n_features, r)
        Of the signatures, whitened [1/N].
    index : ndarray of int, shape (m,)
        Signatures that are used here.
    change : ndarray, shape (m, r)
        These, in their basis [N].
    square : ndarray, shape (m, 1)
        Their squared lengths, whitened [-].
    log_share : ndarray, shape (m, 1)
        Logarithm of the weight of each within its kind.
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
    basis: Floats
    index: Ints
    change: Floats
    square: Floats
    log_share: Floats
    gap_mean: Floats
    gap_gain: Floats
    gap_variance: Floats
    gap_of_change: Floats


def make_centre(
    *,
    mean: Floats,
    covariance: Floats,
    log_weight: float,
    signatures: Signatures,
    distance: Floats,
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
        All.
    distance : ndarray, shape (n_signatures,)
        Of their levels from this one, in spacings of centres [-].
    """
    features = len(signatures.basis)
    lower = np.linalg.cholesky(covariance[:features, :features])
    root = solve_triangular(lower, np.eye(features), lower=True)
    weight = np.maximum(1.0 - np.abs(distance) / REACH, 0.0)
    index = np.flatnonzero(weight > 0.0)
    basis = root @ signatures.basis
    change = signatures.change[index]
    kinds = signatures.kind[index]
    total = np.bincount(kinds, weights=weight[index], minlength=int(signatures.kind.max()) + 1)
    cross = covariance[features:, :features] @ root.T
    unexplained = np.diag(covariance)[features:] - np.einsum("ij,ij->i", cross, cross)
    return Centre(
        mean=mean[:features],
        root=root,
        variance=np.diag(covariance)[:features].copy(),
        log_weight=log_weight,
        log_scale=float(log_weight - np.log(np.diag(lower)).sum()),
        basis=basis,
        index=index,
        change=change,
        square=np.einsum("ij,jk,ik->i", change, basis.T @ basis, change, optimize=True)[
            :, np.newaxis
        ],
        log_share=np.log(weight[index] / total[kinds])[:, np.newaxis],
        gap_mean=mean[features:],
        gap_gain=cross,
        gap_variance=np.maximum(unexplained, 0.0),
        gap_of_change=basis.T @ cross.T,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evidence:
    """Logarithms of densities of some throws.

    A component is a signature at a centre that it is used at.

    Attributes
    ----------
    sound : ndarray, shape (n_throws,)
        When the switch is sound.
    kind : ndarray, shape (n_kinds, n_throws)
        For each kind of signature.
    centre : ndarray, shape (k, n_throws)
        Of sound throws at each centre.
    white : ndarray, shape (k, n_features, n_throws)
        Throws less the mean of each centre, whitened [-].
    component : ndarray, shape (n_components, n_throws)
        Of each component.
    square : ndarray, shape (n_components, n_throws)
        Squared length of what it leaves, whitened [-].
    factor : ndarray, shape (n_components, n_throws)
        Most likely factor on its signature [-].
    number, place : ndarray of int, shape (n_components,)
        Of its signature and of its centre.
    """

    sound: Floats
    kind: Floats
    centre: Floats
    white: Floats
    component: Floats
    square: Floats
    factor: Floats
    number: Ints
    place: Ints


def log_density(square: Floats, *, size: int) -> Floats:
    """Return the logarithm of the density without its scale, by the squared distance.

    Parameters
    ----------
    square : ndarray
        :math:`Q` [-].
    size : int
        Of the throw, :math:`n`.

    Examples
    --------
    >>> log_density(np.array([8.0, 20.0]), size=8).tolist()
    [-4.0, -10.0]
    >>> round(float(log_density(np.array(20.0 * np.e), size=8)), 6)
    -20.0
    """
    given = np.asarray(square, dtype=np.float64)
    usual = size + USUAL * np.sqrt(2.0 * size)
    beyond = usual * (1.0 + np.log(np.maximum(given, usual) / usual))
    return -0.5 * np.where(given <= usual, given, beyond)


USUAL = 3.0
"""Standard deviations of the squared distance within which a density is normal [-]."""


def weigh(features: Floats, centres: tuple[Centre, ...], *, kind: Ints, kinds: int) -> Evidence:
    """Return the likelihood of throws under every hypothesis.

    Parameters
    ----------
    features : ndarray, shape (n_throws, n_features)
        [N]
    centres : tuple of Centre
        Friction levels.
    kind : ndarray of int, shape (n_signatures,)
        Of the signatures.
    kinds : int
        How many there are.
    """
    size = features.shape[1]
    whites, sound, component, square, factor = [], [], [], [], []
    for centre in centres:
        white = centre.root @ (features - centre.mean).T
        own = np.einsum("ij,ij->j", white, white)
        along = centre.change @ (centre.basis.T @ white)
        tight = AMPLITUDE**2 / (1.0 + AMPLITUDE**2 * centre.square)
        off = along - centre.square  # the signature times what it leaves
        left = np.maximum(own - 2.0 * along + centre.square - tight * off**2, 0.0)
        spread = 0.5 * np.log1p(AMPLITUDE**2 * centre.square)
        shared = centre.log_scale + centre.log_share - spread
        whites.append(white)
        sound.append(centre.log_scale + log_density(own, size=size))
        component.append(shared + log_density(left, size=size))
        square.append(left)
        factor.append(1.0 + tight * off)
    joined = np.concatenate(component)
    number = np.concatenate([centre.index for centre in centres])
    return Evidence(
        sound=np.asarray(logsumexp(sound, axis=0)),
        kind=log_sums(joined, kind[number], groups=kinds),
        centre=np.array(sound),
        white=np.array(whites),
        component=joined,
        square=np.concatenate(square),
        factor=np.concatenate(factor),
        number=number,
        place=np.repeat(np.arange(len(centres)), [len(centre.index) for centre in centres]),
    )


def log_sums(values: Floats, group: Ints, *, groups: int) -> Floats:
    """Return the logarithm of the sum of exponentials in each group; minus infinity of none.

    Parameters
    ----------
    values : ndarray, shape (n, m)
        Logarithms.
    group : ndarray of int, shape (n,)
        Of each row.
    groups : int
        How many there are.

    Returns
    -------
    ndarray, shape (groups, m)

    Examples
    --------
    >>> values = np.log([[1.0], [2.0], [5.0]])
    >>> log_sums(values, np.array([0, 0, 1]), groups=2).ravel().round(6).tolist()
    [1.098612, 1.609438]
    """
    highest = values.max(axis=0)
    scaled = np.exp(np.maximum(values - highest, LEAST))
    order = np.argsort(group, kind="stable")
    bounds = np.searchsorted(group[order], np.arange(groups + 1))
    found = np.full((groups, values.shape[1]), -np.inf)
    for number in range(groups):
        rows = order[bounds[number] : bounds[number + 1]]
        if rows.size:
            found[number] = np.log(scaled[rows].sum(axis=0)) + highest
    return found


LEAST = -600.0
"""Logarithms of densities are held at so much below the highest, above the smallest numbers."""
