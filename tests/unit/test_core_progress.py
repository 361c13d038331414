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


def test_first_batches_state_the_whole_time_of_several_kinds(now: list[float]) -> None:
    """One batch of each kind first; a rare kind takes long, thresholds as planned, each process 1 s
    before its first batch."""
    kinds = {"sound": (4000, 128, 0.010), "loose": (400, 32, 0.060), "clutch": (400, 32, 0.010)}
    told, learned, like = list[Progress](), 320, 50.0
    pace = Pace(told.append)
    pace.plan("thresholds", learned, like=like)
    for kind, (throws, _, _) in kinds.items():
        pace.begin(kind, throws, at_once=WORKERS)
    first = [(kind, size, cost * size) for kind, (_, size, cost) in kinds.items()]
    rest = [
        batch
        for batch, (throws, size, _) in zip(first, kinds.values(), strict=True)
        for _ in range(throws // size - 1)
    ]
    mean = sum(throws * cost for throws, _, cost in kinds.values()) / 4800
    rest += [("thresholds", learned // 8, learned // 8 * 55.0 * mean)] * 8
    free, ends, fresh = [(START, 0), (START, 1)], list[float](), {0, 1}
    under_way: list[tuple[float, str, int, float, float]] = []
    for kind, size, usual in first + rest:
        begin, worker = heapq.heappop(free)
        cost = usual + (1.0 if worker in fresh else 0.0)
        fresh.discard(worker)
        heapq.heappush(free, (begin + cost, worker))
        under_way.append((begin + cost, kind, size, cost, usual))
    for now[0], kind, size, cost, usual in sorted(under_way):
        pace.count(kind, size, cost=cost, usual=usual)
        ends.append(now[0])
    whole = [end + state.left - START for end, state in zip(ends, told, strict=True)]
    stated = whole[len(kinds) - 1 : -8]  # but those of thresholds, which come at once
    assert stated == pytest.approx([ends[-1] - START] * len(stated), rel=0.3)
