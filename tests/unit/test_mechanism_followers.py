"""Rows of a section that follow from others are found exactly, and only those."""

import numpy as np
import pytest

from turnout.core.lru_cache import LRUCache
from turnout.solver import condense
from turnout.solver.condense import LARGEST_WEIGHT, leading_rows


def rows_of_a_section(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return points of sections that move sideways, up and roll: four rows on three coordinates."""
    rows = np.zeros((4 * count, 3 * count))
    for section in range(count):
        at = slice(3 * section, 3 * section + 3)
        height, width = rng.uniform(0.05, 0.2, 2)
        rows[4 * section, at] = [1.0, 0.0, height]  # stop at the head
        rows[4 * section + 1, at] = [1.0, 0.0, 0.02]  # foot
        rows[4 * section + 2, at] = [0.0, -1.0, width]
        rows[4 * section + 3, at] = [0.0, -1.0, -width]
    return rows


def test_a_section_has_three_leading_rows_and_the_preferred_ones_lead() -> None:
    rows = rows_of_a_section(np.random.default_rng(1), 5)
    first = np.tile([False, True, True, True], 5)
    found = leading_rows(rows, first=first)
    assert found.leaders.tolist() == np.flatnonzero(first).tolist()
    np.testing.assert_allclose(found.weights @ rows[found.leaders], rows, rtol=0, atol=1e-15)
    assert np.count_nonzero(found.weights) == 5 * (3 + 3)  # of its own section only


def test_a_row_more_changes_nothing_for_the_others() -> None:
    rows = rows_of_a_section(np.random.default_rng(2), 4)
    first = np.tile([False, True, True, True], 4)
    alone = leading_rows(rows, first=first)
    more = np.vstack((rows, rows[5] + rows[6]))
    found = leading_rows(more, first=np.append(first, False))
    assert found.leaders.tolist() == alone.leaders.tolist()
    np.testing.assert_array_equal(found.weights[:-1], alone.weights)
    np.testing.assert_allclose(found.weights[-1] @ rows[found.leaders], more[-1], atol=1e-15)


def test_a_small_difference_of_large_rows_leads_itself() -> None:
    near = np.array([[1.0, 0.0], [1.0, 1e-3 / LARGEST_WEIGHT], [0.0, 1.0]])
    found = leading_rows(near, first=np.zeros(3, dtype=bool))
    assert found.leaders.tolist() == [0, 1, 2]
    np.testing.assert_array_equal(found.weights, np.eye(3))


@pytest.mark.parametrize("count", [0, 1])
def test_nothing_and_one_row_lead_themselves(count: int) -> None:
    found = leading_rows(np.ones((count, 2)), first=np.zeros(count, dtype=bool))
    assert found.leaders.tolist() == list(range(count))
    assert found.weights.shape == (count, count)


def test_a_row_that_never_moves_follows_from_none() -> None:
    found = leading_rows(np.array([[0.0, 0.0], [0.0, 2.0]]), first=np.zeros(2, dtype=bool))
    assert found.leaders.tolist() == [1]
    assert found.weights.tolist() == [[0.0], [1.0]]


def test_what_was_chosen_is_found_again_but_not_for_other_rows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rows = rows_of_a_section(np.random.default_rng(3), 3)
    first = np.tile([False, True, True, True], 3)
    found = leading_rows(rows, first=first)
    assert leading_rows(rows.copy(), first=first.copy()) is found
    assert not found.weights.flags.writeable
    other = leading_rows(rows, first=~first)
    assert other.leaders.tolist() != found.leaders.tolist()
    monkeypatch.setattr(condense, "_leading", LRUCache(1))
    leading_rows(2.0 * rows, first=first)
    assert leading_rows(rows, first=first) is not found, "older ones are forgotten"
