"""Generators and seeds of many states at once, the same as NumPy makes of each.

NumPy hashes the numbers that a generator is made of one generator at a time, which takes longer
than what most states draw. Its hash is documented and fixed
(https://numpy.org/doc/stable/reference/random/bit_generators/generated/numpy.random.SeedSequence.html,
after M. E. O'Neill, "Developing a seed_seq alternative", 2015); here it goes over arrays.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.random.bit_generator import ISeedSequence
from numpy.typing import DTypeLike, NDArray

Words = NDArray[np.uint32]

POOL, SHIFT = 4, np.uint32(16)
MULTIPLIER_IN, MULTIPLIER_OUT = 0x931E8875, 0x58F38DED
START_IN, START_OUT = 0x43B0D7E5, 0x8B51F9DD
MIX_LEFT, MIX_RIGHT = np.uint32(0xCA01F9DD), np.uint32(0x4973F715)
SEED_LIMIT = 2**32


def generators(
    first: Sequence[int], states: Sequence[int], last: Sequence[int] = ()
) -> list[np.random.Generator]:
    """Return ``numpy.random.default_rng([*first, state, *last])`` for each state.

    Parameters
    ----------
    first, states, last : sequence of int
        At least 0; states below 2**32.

    Examples
    --------
    >>> found = generators([1, 2], [7, 8])
    >>> found[1].random() == np.random.default_rng([1, 2, 8]).random()
    True
    """
    words = seed_words(first, states, last, count=4)
    given: list[Any] = [_Given(own) for own in words]
    return [np.random.Generator(np.random.PCG64(own)) for own in given]


def seed_words(
    first: Sequence[int], states: Sequence[int], last: Sequence[int] = (), *, count: int
) -> NDArray[np.uint64]:
    """Return the words of ``numpy.random.SeedSequence([*first, state, *last])`` for each state.

    Parameters
    ----------
    first, states, last : sequence of int
        As of `generators`.
    count : int
        Of words of 64 bits.

    Returns
    -------
    ndarray of uint64, shape (n_states, count)

    Examples
    --------
    >>> whole = np.random.SeedSequence([1, 2, 8]).generate_state(2, np.uint64)
    >>> seed_words([1, 2], [7, 8], count=2)[1].tolist() == whole.tolist()
    True
    """
    if not all(0 <= state < SEED_LIMIT for state in states):
        message = f"states are counted from 0 to {SEED_LIMIT - 1}"
        raise ValueError(message)
    before, after = (
        [np.full(len(states), word, dtype=np.uint32) for number in given for word in _words(number)]
        for given in (first, last)
    )
    pool = _mixed([*before, np.array(states, dtype=np.uint32), *after])
    halves = zip(range(2 * count), _constants(START_OUT, MULTIPLIER_OUT), strict=False)
    found = [_hashed(pool[half % POOL], hashed).astype(np.uint64) for half, hashed in halves]
    low, high = np.array(found[::2]), np.array(found[1::2])
    return np.ascontiguousarray((low | high << np.uint64(32)).T)


def _words(number: int) -> list[int]:
    """Return a number in words of 32 bits, the least first."""
    if number < 0:
        message = f"seed {number}: must be at least 0"
        raise ValueError(message)
    words = [number % SEED_LIMIT]
    while number := number // SEED_LIMIT:
        words.append(number % SEED_LIMIT)
    return words


def _constants(start: int, multiplier: int) -> Iterator[tuple[np.uint32, np.uint32]]:
    """Yield each constant of a hash with the one after it."""
    while True:
        after = start * multiplier % SEED_LIMIT
        yield np.uint32(start), np.uint32(after)
        start = after


def _hashed(values: Words, constants: tuple[np.uint32, np.uint32]) -> Words:
    found = (values ^ constants[0]) * constants[1]
    return found ^ (found >> SHIFT)


def _mixed(entropy: Sequence[Words]) -> list[Words]:
    """Return the pool of a seed sequence."""
    constants = _constants(START_IN, MULTIPLIER_IN)
    nothing = np.zeros_like(entropy[0])
    begin = [*entropy[:POOL], *[nothing] * (POOL - len(entropy))]
    pool = [_hashed(words, next(constants)) for words in begin]

    def mix(number: int, words: Words) -> None:
        joined = MIX_LEFT * pool[number] - MIX_RIGHT * _hashed(words, next(constants))
        pool[number] = joined ^ (joined >> SHIFT)

    for source in range(POOL):
        for number in range(POOL):
            if number != source:
                mix(number, pool[source])
    for words in entropy[POOL:]:
        for number in range(POOL):
            mix(number, words)
    return pool


class _Given(ISeedSequence):
    """Words that are known, as a generator takes them."""

    def __init__(self, words: NDArray[np.uint64]) -> None:
        self._words = words

    def generate_state(self, n_words: int, dtype: DTypeLike = np.uint32) -> NDArray[Any]:
        """Return the words of 64 bits that a PCG64 begins with."""
        return self._words
