r"""The known-place bound: a likelihood ratio for one place, with sampled signatures.

Around friction level :math:`c` sound throws are normal with mean :math:`m_c` and covariance
:math:`C_c`. If the place of an object is known, but neither its size nor the state of the
switch, the best test compares the ratio (Neyman and Pearson 1933)

.. math::
    \Lambda(y) = \frac{\sum_i \frac{1}{n} \sum_c p(c | l_i)\, N(y; m_c + s_i, C_c + \alpha^2 s_i
    s_i^T)}{\sum_c \pi_c\, N(y; m_c, C_c)}, \qquad \pi_c = \sum_i \frac{1}{n} p(c | l_i)

with a threshold; :math:`s_i` are the signatures of objects of all sizes that were thrown there, in
the states :math:`i` with friction level :math:`l_i`; the factor :math:`1 \pm \alpha` reaches sizes
between them. A throw with an object is judged without the signatures of its own state. A real
detector does not know the place; one with more signatures knows them better. So the limit of what
can be seen lies between this bound and the linear-Gaussian one.

A threshold that sound throws exceed at a small rate :math:`\alpha_0` follows from as many drawn
throws with and without an object, in the mean :math:`q = (p_0 + p_1) / 2` of their densities:

.. math:: P_0(\Lambda > t) = E_q\!\left[\frac{2}{1 + \Lambda}\, 1(\Lambda > t)\right]

(multiple importance sampling, balance heuristic; Veach and Guibas 1995, SIGGRAPH, 419-428). Its
relative error is below :math:`1 / \sqrt{\alpha_0 (1 + t) N}` of N draws of each, usually 1 %, where
counting alarms of as many sound throws alone has 20 %.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import expit, logsumexp

from turnout.detection.alarm_threshold import share_interval
from turnout.detection.likelihood import AMPLITUDE

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.intp]

DRAWS, OBJECT_DRAWS = 20_000, 1_000
"""Sound throws that are drawn, and those of them that objects of each size are put in."""
AT_ONCE = 250
"""Drawn throws judged together."""
LEAST_SHARE = 1e-4
"""A signature is used at the levels that hold more than this share of its state [-]."""
RESAMPLES = 200


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Population:
    """Sound throws as local Gaussians along the friction level.

    Attributes
    ----------
    level : ndarray, shape (k,)
        Of the centres [-].
    spread : float
        Standard deviation of the level of throws about a centre [-].
    mean : ndarray, shape (k, n_features)
        [N]
    covariances : sequence of ndarray, each of shape (n_features, n_features)
        Given what is known of the switch [N^2].
    shifts : sequence of ndarray, each of shape (n_features, r)
        By which what is known moves the mean of a switch, for r independent standard normal
        numbers [N]; r is 0 without a history.
    """

    level: Floats
    spread: float
    mean: Floats
    covariances: Sequence[Floats]
    shifts: Sequence[Floats]

    def shares(self, level: Floats) -> Floats:
        """Return the share of each centre in throws of some levels, shape (n, k) [-]."""
        off = (np.asarray(level)[:, np.newaxis] - self.level) / self.spread
        return np.asarray(np.exp(-0.5 * off**2 - logsumexp(-0.5 * off**2, axis=1, keepdims=True)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Draws:
    """Sound throws drawn from a population in the states of the signatures.

    Attributes
    ----------
    state : ndarray of int, shape (n_draws,)
        Number of the state; every state as often.
    share : ndarray, shape (n_states, k)
        Of each centre in throws of a state [-].
    roots : ndarray, shape (k, n_features, n_features)
        Inverse of the lower Cholesky factor of each covariance [1/N].
    white : ndarray, shape (k, n_features, n_draws)
        Draws less the mean of each centre, whitened [-].
    log_density : ndarray, shape (k, n_draws)
        Logarithm of the density of a draw at each centre, times the weight of the centre.
    """

    state: Ints
    share: Floats
    roots: Floats
    white: Singles
    log_density: Floats


def draw_sound(
    population: Population, level: Floats, *, draws: int = DRAWS, seed: int = 1
) -> Draws:
    """Draw sound throws.

    Parameters
    ----------
    population : Population
        Of which.
    level : ndarray, shape (n_states,)
        Friction levels of the states that were thrown with objects [-].
    draws : int
        How many.
    seed : int
        Of chance.
    """
    rng = np.random.default_rng([seed, 17])
    share = population.shares(level)
    state = np.arange(draws, dtype=np.intp) % len(level)
    centre = (rng.random((draws, 1)) > np.cumsum(share, axis=1)[state]).sum(axis=1)
    centre = np.minimum(centre, share.shape[1] - 1)
    lower = [np.linalg.cholesky(item) for item in population.covariances]
    size = population.mean.shape[1]
    roots = np.array([solve_triangular(item, np.eye(size), lower=True) for item in lower])
    scale = np.log(np.maximum(share.mean(axis=0), 1e-300))
    scale -= np.array([np.log(np.diag(item)).sum() for item in lower])
    white = np.empty((len(roots), size, draws), dtype=np.float32)
    density = np.empty((len(roots), draws))
    for number in range(len(roots)):
        own = np.flatnonzero(centre == number)
        of_switch = rng.standard_normal((population.shifts[number].shape[1], own.size))
        throw = population.mean[number][:, np.newaxis] + population.shifts[number] @ of_switch
        throw += lower[number] @ rng.standard_normal((size, own.size))
        for other, root in enumerate(roots):
            left = throw - population.mean[other][:, np.newaxis]
            made = root @ (left - population.shifts[other] @ of_switch)
            white[other][:, own] = made
            density[other, own] = scale[other] - 0.5 * np.einsum("ij,ij->j", made, made)
    return Draws(state=state, share=share, roots=roots, white=white, log_density=density)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Power:
    """Visible sizes at a place that is known.

    Attributes
    ----------
    threshold : float
        Of the logarithm of the ratio.
    pod : ndarray, shape (n_tried,)
        Probability of detection of each tried object [-].
    pods : ndarray, shape (n_resamples, n_tried)
        The same for resampled draws and states: threshold and probability vary.
    alarms : int
        Drawn sound throws above the threshold.
    draws : int
        Drawn sound throws.
    """

    threshold: float
    pod: Floats
    pods: Floats
    alarms: int
    draws: int

    @property
    def alarm_rate(self) -> tuple[float, float]:
        """The 95 % interval of the rate of alarms of the drawn sound throws (Clopper-Pearson)."""
        low, high = share_interval(self.alarms, self.draws)
        return float(low), float(high)


def known_place_power(
    draws: Draws,
    hypothesis: Floats,
    tried: Floats,
    *,
    false_alarm_rate: float,
    amplitude: float = AMPLITUDE,
    objects: int = OBJECT_DRAWS,
    held_out: bool = True,
    seed: int = 1,
) -> Power:
    """Return the probability of detection at a place that is known.

    Parameters
    ----------
    draws : Draws
        From `draw_sound`.
    hypothesis : ndarray, shape (n_states, n_sizes, n_features)
        Signatures that the ratio averages over: sizes that are as likely as each other [N].
    tried : ndarray, shape (n_states, n_tried, n_features)
        Signatures of the objects whose probability of detection is wanted [N].
    false_alarm_rate : float
        [-]
    amplitude : float
        Deviation of the factor on a signature [-].
    objects : int
        Draws that each object is put in.
    held_out : bool
        Whether a throw with an object is judged without the signatures of its state.
    seed : int
        Of chance.

    Examples
    --------
    >>> one = Population(level=np.zeros(1), spread=1.0, mean=np.zeros((1, 1)),
    ...                  covariances=[np.eye(1)], shifts=[np.zeros((1, 0))])
    >>> sound = draw_sound(one, np.zeros(2))
    >>> four = np.full((2, 1, 1), 4.0)
    >>> found = known_place_power(sound, four, four, false_alarm_rate=1e-3, amplitude=0.0)
    >>> bool(abs(found.pod[0] - 0.82) < 0.04)  # Phi(4 - 3.09)
    True
    """
    rng = np.random.default_rng([seed, 23])
    states, sizes, _ = hypothesis.shape
    count = len(draws.state)
    judge = _Judge(draws, hypothesis, tried, amplitude=amplitude)
    drawn_size = rng.integers(0, sizes, count)
    factor = 1.0 + amplitude * rng.standard_normal(count)
    objects = min(objects - objects % states or states, count)
    sound, likely, seen = np.empty(count), np.empty(count), np.empty((objects, tried.shape[1]))
    for first in range(0, count, AT_ONCE):
        rows = np.arange(first, min(first + AT_ONCE, count))
        sound[rows], likely[rows] = judge.ratios(rows, drawn_size[rows], factor[rows])
        own = rows[rows < objects]
        if own.size:
            seen[own] = judge.of_tried(own, held_out=held_out)
    threshold = threshold_of(sound, likely, rate=false_alarm_rate)
    detected = seen > threshold
    return Power(
        threshold=threshold,
        pod=detected.mean(axis=0),
        pods=_resampled(
            (sound, likely), seen, draws.state[:objects], rate=false_alarm_rate, rng=rng
        ),
        alarms=int(np.count_nonzero(sound > threshold)),
        draws=count,
    )


def threshold_of(sound: Floats, likely: Floats, *, rate: float) -> float:
    """Return what sound throws exceed at a rate, from log ratios of drawn throws.

    Parameters
    ----------
    sound, likely : ndarray, shape (n,)
        Of throws drawn as the denominator and as the numerator of the ratio says.
    rate : float
        [-]

    Examples
    --------
    >>> normal = np.random.default_rng(0).standard_normal((2, 50_000))
    >>> sound, likely = 3.0 * normal - 4.5 + 9.0 * np.array([[0.0], [1.0]])
    >>> z = (threshold_of(sound, likely, rate=1e-3) + 4.5) / 3.0
    >>> round(z, 1)  # 3.09
    3.1
    """
    falling = np.sort(np.concatenate([sound, likely]))[::-1]
    rates = np.cumsum(expit(-falling)) / len(sound)
    return float(falling[min(int(np.searchsorted(rates, rate)), len(falling) - 1)])


def _resampled(
    drawn: tuple[Floats, Floats],
    seen: Floats,
    state: Ints,
    *,
    rate: float,
    rng: np.random.Generator,
) -> Floats:
    """Return probabilities of detection with draws and states resampled."""
    states, count = int(state.max()) + 1, len(drawn[0])
    found = []
    for _ in range(RESAMPLES):
        sound, likely = (item[rng.integers(0, count, count)] for item in drawn)
        threshold = threshold_of(sound, likely, rate=rate)
        often = np.bincount(rng.integers(0, states, states), minlength=states)[state]
        found.append(often @ (seen > threshold) / often.sum())
    return np.array(found)


class _Judge:
    """Ratios at one place, by the whitened signatures at every centre."""

    def __init__(
        self, draws: Draws, hypothesis: Floats, tried: Floats, *, amplitude: float
    ) -> None:
        self._draws, self._sizes = draws, hypothesis.shape[1]
        flat = hypothesis.reshape(-1, hypothesis.shape[2])
        state = np.repeat(np.arange(len(hypothesis)), self._sizes)
        self._ways, self._tried, self._near, self._terms = [], [], [], []
        for number, root in enumerate(draws.roots):
            way = (flat @ root.T).astype(np.float32)
            near = np.flatnonzero(draws.share[state, number] > LEAST_SHARE)
            square = np.einsum("ij,ij->i", way[near], way[near], dtype=np.float64)
            tight = amplitude**2 / (1.0 + amplitude**2 * square)
            scale = np.log(draws.share[state[near], number] / len(flat))
            scale -= np.log(draws.share[:, number].mean())
            constant = scale - 0.5 * np.log1p(amplitude**2 * square)
            constant += 0.5 * square * (tight * square - 1.0)
            terms = np.stack([0.5 * tight, 1.0 - tight * square, constant])[..., np.newaxis]
            self._ways.append(way)
            self._tried.append((tried @ root.T).astype(np.float32))
            self._near.append((near, state[near]))
            self._terms.append(terms.astype(np.float32))

    def ratios(self, rows: Ints, size: Ints, factor: Floats) -> tuple[Floats, Floats]:
        """Return log ratios of sound throws, and of the same with an object of a size."""
        own = self._draws.state[rows] * self._sizes + size
        scale = factor.astype(np.float32)
        sound, likely = _Sum(rows.size), _Sum(rows.size)
        for number, way in enumerate(self._ways):
            white = self._draws.white[number][:, rows]
            density = self._draws.log_density[number, rows]
            near, _ = self._near[number]
            along = way[near] @ white
            added = way[own].T * scale
            sound.add(density, self._components(number, along))
            more = along + way[near] @ added
            gain = np.einsum("ij,ij->j", added, white + 0.5 * added, dtype=np.float64)
            likely.add(density - gain, self._components(number, more))
        return sound.log_ratio, likely.log_ratio

    def of_tried(self, rows: Ints, *, held_out: bool) -> Floats:
        """Return log ratios of throws with the tried objects, shape (n_rows, n_tried)."""
        state = self._draws.state[rows]
        total = _Sum(rows.size * self._tried[0].shape[1])
        for number, way in enumerate(self._ways):
            white = self._draws.white[number][:, rows]
            near, of_state = self._near[number]
            added = self._tried[number][state]  # draw, tried, feature
            flat = added.reshape(-1, added.shape[2])
            along = way[near] @ flat.T
            along += np.repeat(way[near] @ white, added.shape[1], axis=1)
            gain = np.einsum("daf,fd->da", added, white, dtype=np.float64, optimize=True)
            gain += 0.5 * np.einsum("daf,daf->da", added, added, dtype=np.float64)
            density = self._draws.log_density[number, rows][:, np.newaxis] - gain
            parts = self._components(number, along)
            if held_out:
                own = of_state[:, np.newaxis] == np.repeat(state, added.shape[1])
                parts[own] = -np.inf
            total.add(density.ravel(), parts)
        count = len(self._draws.share)
        more = np.log(count / (count - 1.0)) if held_out and count > 1 else 0.0
        return np.asarray(total.log_ratio.reshape(rows.size, -1) + more)

    def _components(self, number: int, along: Singles) -> Singles:
        """Return logarithms of the density of each signature over that of a sound throw."""
        square, linear, constant = self._terms[number]
        return np.asarray((square * along + linear) * along + constant)


class _Sum:
    """Logarithms of two mixtures, centre by centre."""

    def __init__(self, count: int) -> None:
        self._sound = np.full(count, -np.inf)
        self._object = np.full(count, -np.inf)

    def add(self, density: Floats, components: Singles) -> None:
        """Add a centre: density of sound throws, and of each signature over it."""
        self._sound = np.logaddexp(self._sound, density)
        if not len(components):
            return
        top = np.maximum(components.max(axis=0), np.float32(-1e30))
        components -= top
        np.exp(components, out=components)
        total = components.sum(axis=0, dtype=np.float64)
        with np.errstate(divide="ignore"):
            self._object = np.logaddexp(self._object, density + top + np.log(total))

    @property
    def log_ratio(self) -> Floats:
        """Logarithm of the ratio of the two."""
        return np.asarray(self._object - self._sound)
