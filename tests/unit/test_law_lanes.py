"""Eight numbers at a time: kernels do what the same functions do in Python, and no more."""

import copy
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from numba.core.errors import TypingError

from turnout.kernels import lanes
from turnout.kernels.compiled import compiled
from turnout.kernels.lanes import LANES
from turnout.kernels.shared_record import clone_record, shared_record
from turnout.kernels.vector import ROWS_TOGETHER, sum_weighted_rows

Floats = np.ndarray
VECTORS = ("a", "b", "places", "found")


class Given(NamedTuple):
    """Vectors that end within a line of memory, and a matrix."""

    a: Floats
    b: Floats
    places: Floats
    found: Floats
    matrix: Floats


@compiled
def _combine(given: Given) -> None:
    for i in range(0, given.a.size, LANES):
        a, b = lanes.load(given.a, i), lanes.load(given.b, i)
        picked = lanes.gather(given.a, given.places, i)
        more = lanes.greater(lanes.absolute(a), b)
        other = lanes.logical_or(more, lanes.greater(picked, lanes.broadcast(0.5)))
        lanes.store(lanes.select(other, a - b, a * b + picked), given.found, i)
        if lanes.any_true(lanes.greater(b, lanes.broadcast(1))):
            lanes.store(lanes.load(given.found, i) + lanes.broadcast(10.0), given.found, i)


@compiled
def _sum(values: Floats) -> float:
    return lanes.horizontal_sum(lanes.load(values, 0))


@compiled
def _gather(values: Floats, places: Floats, to: Floats) -> None:
    for i in range(0, to.size, LANES):
        lanes.store(lanes.gather(values, places, i), to, i)


@compiled
def _sum_rows(start: Floats, weights: Floats, rows: Floats, to: Floats) -> None:
    sum_weighted_rows(start, weights, rows, to)


@compiled
def _stream(values: Floats, to: Floats) -> None:
    for i in range(0, to.size, LANES):
        lanes.store_nontemporal(lanes.load(values, i), to, i)


@compiled
def _turn(values: Floats, step: int, to: Floats, to_step: int) -> None:
    lanes.turn(values[1:], step, to[2:], to_step)


def given(count: int, seed: int, kind: type = np.uint64) -> Given:
    rng = np.random.default_rng(seed)
    return Given(
        a=rng.normal(size=count),
        b=rng.normal(size=count),
        places=rng.integers(count, size=count).astype(kind),
        found=np.zeros(count),
        matrix=rng.normal(size=(2, 3)),
    )


def padded(vector: Floats) -> Floats:
    return np.pad(vector, (0, lanes.whole_lines(vector.size) - vector.size))


@pytest.mark.parametrize("kind", [np.uint64, np.int64])
@pytest.mark.parametrize("count", [1, 5, 8, 19, 40])
def test_kernels_do_what_the_functions_do_in_python(count: int, kind: type) -> None:
    """Comparisons with NaN, too, which say no."""
    for missing in (False, True):
        plain = given(count, count, kind)
        plain.a[:] = np.nan if missing else plain.a
        record = shared_record(plain)
        filled = plain._replace(**{name: padded(getattr(plain, name)) for name in VECTORS})
        _combine(record)
        _combine.py_func(filled)
        np.testing.assert_array_equal(record.found, filled.found[:count])
        assert np.any(record.found != 0.0)


def test_a_sum_has_one_order() -> None:
    values = np.array([1e16, 1.0, -1e16, 3.0, 0.5, 1e-9, 2.0, -7.0])
    halves = values[:4] + values[4:]
    quarters = halves[:2] + halves[2:]
    assert _sum(values) == quarters[0] + quarters[1] == lanes.horizontal_sum(values)
    assert _sum(values) != float(np.sum(np.sort(values)))


@pytest.mark.parametrize("kind", [np.int64, np.uint64])
def test_neighbours_and_any_other_places_are_gathered(kind: type) -> None:
    values = np.random.default_rng(3).normal(size=40)
    neighbours = np.arange(5, 5 + LANES)
    groups = [neighbours, neighbours + 27, neighbours[::-1], np.full(LANES, 7), 2 * neighbours]
    for lane in range(LANES):  # neighbours but for one
        changed = neighbours.copy()
        changed[lane] = 0
        groups.append(changed)
    places = np.concatenate(groups).astype(kind)
    found = np.zeros(places.size)
    _gather(values, places, found)
    np.testing.assert_array_equal(found, values[places])


@pytest.mark.parametrize("width", [0, 8, 32, 40, 48, 56, 104])
@pytest.mark.parametrize("count", [0, 1, 12, 16, 17, 40])
def test_a_weighted_sum_of_rows_has_one_order(count: int, width: int) -> None:
    rng = np.random.default_rng(count)
    start, weights = rng.normal(size=112), rng.normal(size=count)
    rows, found = rng.normal(size=(count, 112)), np.full(112, np.nan)
    _sum_rows(start, weights, rows, found[:width])
    expected = start[:width].copy()
    for first in range(0, count, ROWS_TOGETHER):
        total = expected if first == 0 else np.zeros(width)
        own = slice(first, first + ROWS_TOGETHER)
        for weight, row in zip(weights[own], rows[own], strict=True):
            total = lanes.multiply_add(np.full(width, weight), row[:width], total)
        expected = total if first == 0 else expected + total
    np.testing.assert_array_equal(found[:width], expected)
    assert np.isnan(found[width:]).all()


def test_what_is_streamed_arrives() -> None:
    values = shared_record(given(24, seed=3))
    _stream(values.a, values.found)
    np.testing.assert_array_equal(values.found, values.a)


def test_vectors_fill_lines_of_their_own_and_matrices_stay() -> None:
    plain = given(11, seed=2)
    record = shared_record(plain, b=-np.inf)
    for name in VECTORS:
        vector = getattr(record, name)
        assert vector.ctypes.data % (8 * LANES) == 0
        np.testing.assert_array_equal(vector, getattr(plain, name))
        assert not np.shares_memory(vector, getattr(plain, name))
    beyond = {name: record.memory[start + 11 : start + 16] for name, (start, *_) in
              record.layout.vectors.items()}  # fmt: skip
    assert np.all(beyond["b"] == -np.inf)
    assert np.all(beyond["a"] == 0.0)
    assert record.matrix is plain.matrix


def test_another_record_has_vectors_and_matrices_of_its_own() -> None:
    first = shared_record(given(11, seed=4))
    matrix = np.zeros((2, 3))
    second = clone_record(first, matrix=matrix)
    kept = first.found.copy()
    _combine(second)
    np.testing.assert_array_equal(first.found, kept)
    assert np.any(second.found != 0.0)
    assert second.matrix is matrix
    assert second.a.ctypes.data % (8 * LANES) == 0


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda: shared_record(given(4, seed=5)._replace(a=np.zeros(8)[::2])),
         r"Given\.a must be an array of 8-byte numbers without gaps"),
        (lambda: clone_record(shared_record(given(3, seed=6))), "pass every matrix"),
        (lambda: copy.deepcopy(shared_record(given(3, seed=7))), "stays where it is"),
    ],
    ids=["gaps", "no matrix", "sent elsewhere"],
)  # fmt: skip
def test_a_record_that_cannot_be_is_refused(ask: Callable[[], object], message: str) -> None:
    with pytest.raises(TypeError, match=message):
        ask()


@pytest.mark.parametrize("values", [np.arange(8), np.arange(16.0)[::2], np.arange(8.0, dtype="f4")])
def test_other_arrays_than_vectors_of_numbers_are_refused(values: Floats) -> None:
    with pytest.raises(TypingError):
        _sum(values)


@pytest.mark.parametrize(("step", "to_step"), [(8, 8), (11, 9), (40, 72)])
def test_rows_become_columns(step: int, to_step: int) -> None:
    values = np.random.default_rng(step).normal(size=8 * step + 9)
    found, expected = np.zeros((2, 8 * to_step + 10))
    _turn(values, step, found, to_step)
    lanes.turn(values[1:], step, expected[2:], to_step)
    np.testing.assert_array_equal(found, expected)
    eight = [values[1 + i * step + 5] for i in range(LANES)]
    np.testing.assert_array_equal(found[2 + 5 * to_step :][:LANES], eight)
