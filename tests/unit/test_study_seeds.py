"""Generators of many states are those that NumPy makes of each."""

import numpy as np
import pytest

from turnout.study.seeds import generators, seed_words

STATES = [0, 1, 7, 2**31, 2**32 - 1]


@pytest.mark.parametrize(
    "first", [[0], [1, 2], [7, 2**32], [2**40 + 5, 1], [5**60, 3, 2], [1, 2, 3, 4, 5]], ids=str
)
@pytest.mark.parametrize("last", [[], [3], [2**33, 1]], ids=str)
def test_they_are_those_of_numpy(first: list[int], last: list[int]) -> None:
    words = seed_words(first, STATES, last, count=3)
    made = generators(first, STATES, last)
    for state, own, rng in zip(STATES, words, made, strict=True):
        entropy = [*first, state, *last]
        whole = np.random.SeedSequence(entropy).generate_state(3, np.uint64)
        np.testing.assert_array_equal(own, whole)
        wanted = np.random.default_rng(entropy)
        np.testing.assert_array_equal(rng.random(4), wanted.random(4))
        np.testing.assert_array_equal(rng.normal(size=3), wanted.normal(size=3))
        assert rng.bit_generator.state == wanted.bit_generator.state


def test_numbers_that_no_seed_has_are_refused() -> None:
    for states in ([0, 2**32], [-1]):
        with pytest.raises(ValueError, match="from 0 to 4294967295"):
            seed_words([1], states, count=1)
    with pytest.raises(ValueError, match="-7: must be at least 0"):
        generators([3, -7], [0])
    assert generators([1], []) == []
