"""Which scenarios are in which batch: few sizes, no worker that waits long, chains whole."""

import heapq
from dataclasses import replace
from pathlib import Path

import pytest
from tests.unit.sweeps import small_study

from turnout.calibration.load_study import load_study
from turnout.study.study import Study
from turnout.study.sweep.batch import LARGEST_BATCH, SIZES, plan_batches


def sizes_of(study: Study) -> list[int]:
    return [sum(map(len, batch)) for batch in plan_batches(study)]


def last_end(sizes: list[int], workers: int) -> int:
    """When the last of some workers ends, each taking the next batch as soon as it can."""
    ends = [0] * workers
    for size in sizes:
        heapq.heappush(ends, heapq.heappop(ends) + size)
    return max(ends)


def test_batches_depend_on_the_study_alone_and_split_no_chain(tmp_path: Path) -> None:
    batches = plan_batches(small_study(tmp_path))
    assert [index for batch in batches for chain in batch for index in chain] == list(range(20))
    campaign = load_study("paper-campaign")
    chains = [chain for batch in plan_batches(campaign) for chain in batch]
    assert chains == list(campaign.chains)


@pytest.mark.parametrize("count", [1, 20, 65, 100, 257, 300, 500, 1000, 1025, 2000, 2049, 10_000])
@pytest.mark.parametrize("histories", [True, False])
def test_no_worker_waits_long(tmp_path: Path, count: int, histories: bool) -> None:
    study = small_study(tmp_path, count=count)
    if not histories:
        study = replace(study, output=replace(study.output, channels=()))
    sizes = sizes_of(study)
    assert sum(sizes) == count
    assert sizes[:-1] == sorted(sizes[:-1], reverse=True)
    assert set(sizes[:-1]) <= set(SIZES)
    assert len(set(sizes)) <= len(SIZES)
    assert not histories or max(sizes) <= LARGEST_BATCH
    for workers in (1, 2, 4, 8):
        assert last_end(sizes, workers) <= 1.03 * count / workers + SIZES[0], workers


def test_batches_are_large_where_there_are_many_throws(tmp_path: Path) -> None:
    sizes = sizes_of(small_study(tmp_path, count=2000))
    assert sizes[:12] == [LARGEST_BATCH] * 12
    assert len(sizes) <= 25
