r"""MiniRocket (Dempster, Schmidt and Webb 2021, doi:10.1145/3447548.3467231), in numpy.

84 kernels of length 9, two weights: six are -1 and three are 2. Each is used at dilations up to the
length of the series; of each convolution the share of values above a bias is a feature, and biases
are quantiles of convolutions of training series. Several signals are added, in random subsets, as
its authors do in their multivariate version. Written here since the package `aeon`, which has it,
asks for an older numba than the solver.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

LENGTH, KERNELS = 9, 84
TRIPLES = tuple(combinations(range(LENGTH), 3))
MOST_DILATIONS = 32
GOLDEN = (np.sqrt(5.0) + 1.0) / 2.0
AT_ONCE = 256
"""Series that are transformed together."""


@dataclass(frozen=True, slots=True, eq=False)
class MiniRocket:
    """A fitted transform.

    Attributes
    ----------
    dilations : tuple of int
        Between the weights of a kernel.
    signals : tuple of tuple
        For each dilation and kernel the signals that are added.
    biases : tuple of ndarray, shape (84, n)
        For each dilation.
    """

    dilations: tuple[int, ...]
    signals: tuple[tuple[tuple[int, ...], ...], ...]
    biases: tuple[Floats, ...]

    def transform(self, series: NDArray[np.floating]) -> Floats:
        """Return the features of series, shape (n, n_signals, n_samples)."""
        parts = [
            self._some(np.asarray(series[first : first + AT_ONCE], dtype=np.float32))
            for first in range(0, len(series), AT_ONCE)
        ]
        return np.concatenate(parts)

    def _some(self, series: Floats) -> Floats:
        samples = series.shape[-1]
        # of at most so many samples the number above a bias fits into a byte: 8 times as fast
        counted = np.uint8 if samples < 256 else np.uint32
        found = np.empty((sum(part.size for part in self.biases), len(series)), dtype=np.float32)
        at = 0
        for number, dilation in enumerate(self.dilations):
            padding = (LENGTH - 1) * dilation // 2
            shifted = shifted_series(series, dilation)
            whole = sum(shifted[1:], start=shifted[0])
            for kernel, triple in enumerate(TRIPLES):
                values = _convolved(shifted, whole, triple, self.signals[number][kernel])
                if (number + kernel) % 2:
                    values = values[padding:-padding]
                for bias in self.biases[number][kernel]:
                    above = (values > bias).view(np.uint8)
                    found[at] = above.sum(axis=0, dtype=counted) / np.float32(len(values))
                    at += 1
        return found.T


def shifted_series(series: Floats, dilation: int) -> list[Floats]:
    """Return series shifted by the nine places of a kernel, zeros beyond their ends.

    Returns
    -------
    list of ndarray, shape (n_signals, n_samples, n)
        Views of one array, in which all series stand side by side.
    """
    count, signals, samples = series.shape
    reach = LENGTH // 2 * dilation
    padded = np.zeros((signals, samples + 2 * reach, count), dtype=np.float32)
    padded[:, reach : reach + samples] = series.transpose(1, 2, 0)
    return [padded[:, place * dilation : place * dilation + samples] for place in range(LENGTH)]


def _convolved(
    shifted: list[Floats], whole: Floats, triple: tuple[int, ...], signals: tuple[int, ...]
) -> Floats:
    """Return the convolution with weights -1, and 2 at three places, of added signals."""
    first, second, third = (shifted[place] for place in triple)
    added = [3.0 * (first[at] + second[at] + third[at]) - whole[at] for at in signals]
    return np.asarray(sum(added[1:], start=added[0]), dtype=np.float32)


def fit_minirocket(
    series: NDArray[np.floating], *, features: int = 9996, seed: int = 0
) -> MiniRocket:
    """Fit dilations and biases to training series.

    Parameters
    ----------
    series : ndarray, shape (n, n_signals, n_samples)
        Of training throws.
    features : int
        About so many.
    seed : int
        Of chance.
    """
    rng = np.random.default_rng(seed)
    samples, count = series.shape[-1], series.shape[1]
    dilations, each = dilations_of(samples, features // KERNELS)
    quantiles = (np.arange(1, KERNELS * sum(each) + 1) * GOLDEN) % 1.0
    chosen, biases, at = [], [], 0
    for dilation, number in zip(dilations, each, strict=True):
        subsets, rows = [], []
        example = rng.integers(0, len(series), KERNELS)
        for kernel, triple in enumerate(TRIPLES):
            size = int(2.0 ** rng.uniform(0.0, np.log2(count + 1.0)))
            own = sorted(rng.choice(count, min(size, count), replace=False).tolist())
            one = np.asarray(series[example[kernel]][np.newaxis], dtype=np.float32)
            shifted = shifted_series(one, dilation)
            whole = sum(shifted[1:], start=shifted[0])
            values = _convolved(shifted, whole, triple, tuple(own))
            rows.append(np.quantile(values[:, 0], quantiles[at : at + number]))
            subsets.append(tuple(own))
            at += number
        chosen.append(tuple(subsets))
        biases.append(np.array(rows, dtype=np.float32))
    return MiniRocket(tuple(dilations), tuple(chosen), tuple(biases))


def dilations_of(samples: int, each_kernel: int) -> tuple[list[int], list[int]]:
    """Return dilations and how many features of a kernel each gets.

    Examples
    --------
    >>> dilations_of(100, 10)
    ([1, 2, 3, 4, 5, 7, 9, 12], [3, 1, 1, 1, 1, 1, 1, 1])
    """
    most = min(each_kernel, MOST_DILATIONS)
    largest = np.log2((samples - 1) / (LENGTH - 1))
    spread = np.logspace(0.0, largest, most, base=2.0).astype(int)
    dilations, counts = np.unique(spread, return_counts=True)
    number = (counts * each_kernel / most).astype(int)
    rest, at = each_kernel - int(number.sum()), 0
    while rest > 0:
        number[at % len(number)] += 1
        at, rest = at + 1, rest - 1
    return dilations.tolist(), number.tolist()
