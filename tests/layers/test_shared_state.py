"""Tests leave alone what threads of other tests use, such as the clock of a studio at work.

A clock that is replaced in the module `time` is that of every event loop: one that reads it once
then sleeps for hours, and its server never ends.
"""

import re

import pytest

# Replace the name in the module under test instead: setattr(module, "time", SimpleNamespace(...)).
CLOCK = re.compile(r"setattr\(\s*(?:[\w.]*\btime,|\"[\w.]*\btime\.\w+\",)")


def test_no_test_replaces_the_clock_of_all_threads(pytestconfig: pytest.Config) -> None:
    folder = pytestconfig.rootpath / "tests"
    assert [
        path.name for path in folder.rglob("*.py") if CLOCK.search(path.read_text("utf-8"))
    ] == []


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ('(time, "time_ns", fixed)', True),
        ('(progress.time, "monotonic", fixed)', True),
        ('("turnout.cli.watch.time.monotonic", fixed)', True),
        ('(progress, "time", SimpleNamespace())', False),
        ('(bands, "closing_time", fixed)', False),
        ('("turnout.detection.throws.closing_time", fixed)', False),
    ],
)
def test_the_pattern_finds_what_it_should(text: str, found: bool) -> None:
    assert bool(CLOCK.search(f"setattr{text}")) == found
