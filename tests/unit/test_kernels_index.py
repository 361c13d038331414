"""Indexing in kernels: from the front, but for constants; Numba's own stays as it is."""

import numba
import numpy as np
from numpy.typing import NDArray

from turnout.kernels.compiled import compiled

Floats = NDArray[np.float64]


@compiled
def _picked(values: Floats, first: int, stop: int, found: Floats) -> None:
    found[0] = values[-1]
    found[1] = values[first:].sum()
    found[2] = values[:stop].sum()
    found[3] = values[first:stop].size
    found[4] = values[stop:first].size
    found[5] = values[first]


def test_kernels_index_as_python_does_from_the_front() -> None:
    values = np.arange(10.0)
    found, expected = np.zeros(6), np.zeros(6)
    for first, stop in ((2, 5), (0, 10), (3, 99), (9, 9)):
        _picked(values, first, stop, found)
        _picked.py_func(values, first, stop, expected)
        np.testing.assert_array_equal(found, expected)


def test_other_code_of_numba_counts_from_the_end() -> None:
    _picked(np.arange(4.0), 0, 1, np.zeros(6))  # compiles, if that has not happened yet

    @numba.njit  # type: ignore[misc]
    def last(values: Floats, at: int) -> tuple[float, int]:
        return values[at], values[at:].size

    assert last(np.arange(4.0), -1) == (3.0, 1)
