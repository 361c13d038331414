"""The same scenario gives the same bits: in one process, in another, and with two workers."""

import multiprocessing

import pytest
from tests.verification.robustness_checks import digest, run_scenario
from tests.verification.robustness_scenarios import numbered_scenario

INDICES = (0, 2, 3, 4, 8)
"""One or two of each library panel and of the small ones."""


def digest_of(index: int) -> str:
    return digest(run_scenario(numbered_scenario(index)).dataset)


@pytest.fixture(scope="module")
def digests() -> list[str]:
    return [digest_of(index) for index in INDICES]


def test_digests_tell_runs_apart(digests: list[str]) -> None:
    assert len(set(digests)) == len(INDICES)


def test_a_run_repeats_in_this_process(digests: list[str]) -> None:
    assert [digest_of(index) for index in INDICES] == digests


@pytest.mark.usefixtures("worker_processes")
def test_other_processes_give_the_same_bits(digests: list[str]) -> None:
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        assert pool.map(digest_of, INDICES, chunksize=1) == digests


def test_the_kinds_are_all_there() -> None:
    kinds = {numbered_scenario(index).kind for index in INDICES}
    assert kinds == {"sb1", "sb2", "uic60-760-1-15", "small panel"}
