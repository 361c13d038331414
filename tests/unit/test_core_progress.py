"""Time left of many throws, by a clock of its own."""

import heapq
from types import SimpleNamespace

import pytest

from turnout.core import progress
from turnout.core.progress import Pace, Progress

START, FIRST, BATCHES, WORKERS = 6.0, 3.0, 30, 2
"""Time before the first throw and more time of a first batch [s]; batches and processes."""


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Return the time of the clock [s], to be set."""
    seconds = [0.0]
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: seconds[0]))
    return seconds


@pytest.mark.parametrize("cost", [1.0, 4.0])
def test_the_whole_time_is_known_from_the_second_batch_of_each_process(
    now: list[float], cost: float
) -> None:
    told = list[Progress]()
    pace = Pace(told.append)
    pace.begin("throws", 10 * BATCHES)
    busy = [(START + FIRST + cost, FIRST + cost) for _ in range(WORKERS)]
    ends = list[float]()
    while busy:
        now[0], took = heapq.heappop(busy)
        pace.count("throws", 10, cost=took)
        ends.append(now[0])
        if len(ends) + len(busy) < BATCHES:
            heapq.heappush(busy, (now[0] + cost, cost))
    whole = [end + state.left for end, state in zip(ends, told, strict=True)]
    assert whole[2 * WORKERS - 1 :] == pytest.approx([ends[-1]] * (BATCHES - 3), rel=0.15)
    assert told[-1].left == 0.0


def test_time_left_goes_on_between_batches(now: list[float]) -> None:
    pace = Pace()
    pace.begin("throws", 40)
    for now[0] in (10.0, 20.0):
        pace.count("throws", 10, cost=10.0)
    assert pace.progress().left == pytest.approx(20.0)
    now[0] = 25.0
    assert pace.progress().left == pytest.approx(15.0)


def test_one_that_costs_little_does_not_stand_for_the_others(
    now: list[float],
) -> None:
    pace = Pace()
    pace.begin("panels", 12)
    for cost in (10.0, 0.05, 10.0, 10.0, 0.05, 10.0):
        now[0] += cost
        pace.count("panels", cost=cost)
    assert pace.progress().left == pytest.approx(40.0, rel=0.1)


def test_a_kind_that_is_still_to_come_takes_as_many_times_longer_as_planned(
    now: list[float],
) -> None:
    pace = Pace()
    pace.begin("throws", 20)
    pace.plan("thresholds", 4, like=50.0)
    now[0] = 10.0
    pace.count("throws", 10, cost=10.0)
    assert pace.progress().left == pytest.approx(10.0 + 4 * 50.0)
    pace.begin("thresholds", 4)
    now[0] = 70.0
    pace.count("thresholds", cost=60.0)
    assert pace.progress().left == pytest.approx(10.0 + 3 * 60.0)
