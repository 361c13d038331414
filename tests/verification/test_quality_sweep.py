"""Every fault that is well above its limit is seen, and sound throws are left alone.

The page docs/evidence/measurement-quality.md has more throws and the severities around each limit.
"""

import pytest
from benchmarks.studies.quality_sweep import (
    Level,
    Sweep,
    false_alarms,
    judged,
    rate_seen,
    recorded,
    sweeps,
)

CASES = [
    pytest.param(sweep, level, id=f"{sweep.kind}, {level.text}")
    for sweep in sweeps()
    for level in sweep.levels
    if level.clear
]


@pytest.mark.parametrize(("sweep", "level"), CASES)
def test_a_clear_fault_is_seen_each_time(sweep: Sweep, level: Level) -> None:
    assert rate_seen(level, sweep.kind, trials=3, first=300) == 1.0


def test_sound_throws_are_not_excluded() -> None:
    assert false_alarms(trials=18, first=400) == []


def test_a_throw_against_its_sheet_is_seen() -> None:
    verdict = judged(recorded(500), direction="opening")
    assert verdict is not None
    assert any(fault.kind == "direction" for fault in verdict.faults)
