"""Progress of a calibration: the time that is reported as left."""

from types import SimpleNamespace
from typing import Any

import pytest
from tests.unit.test_calibration_fit import PARAMETERS, TRUE, alike, misfit

from turnout.calibration.calibrate import (
    CalibrationProgress,
    ProgressReporter,
    TimeIsUp,
    work_of_search,
)
from turnout.calibration.causes import first_verdict
from turnout.calibration.comparison import Key, peaks_of
from turnout.calibration.evaluate import WORK
from turnout.calibration.fit import fit
from turnout.cli.calibrate import stage_line
from turnout.panel.load import load_panel

KEY = ("drive_force", "1")


class Watched:
    """A reporter of one stage, and what it reported at each instant of a clock."""

    def __init__(self, patch: pytest.MonkeyPatch, clock: tuple[float, ...], **plan: float) -> None:
        monotonic = iter(clock).__next__
        patch.setattr("turnout.calibration.calibrate.time", SimpleNamespace(monotonic=monotonic))
        self.states: list[CalibrationProgress] = []
        self.evaluator: Any = SimpleNamespace(made=0, work=0.0, spared=0.0)
        self.watch = ProgressReporter(self.states.append, 1, **plan)

    def left(self, work: float) -> float:
        """Return the time left [s] after so much work."""
        self.evaluator.made, self.evaluator.work = int(work), work
        self.watch.report_state(self.evaluator)
        return float(self.states[-1].left)


def test_time_left_is_never_less_than_that_of_one_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fits that need more throws than usual said "about 0 s left" for minutes."""
    stage = Watched(monkeypatch, (10.0, 30.0), planned=80, per_step=40, began=10.0)
    stage.left(100.0)
    assert stage.left(100.0) == pytest.approx(0.4 * 20.0)
    assert stage.states[-1].seconds == 20.0


def test_time_left_follows_the_present_pace_and_what_was_needed_beyond_the_plan(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Quick throws come first: by their pace "less than 5 s" were left from second 8 to 85."""
    stage = Watched(monkeypatch, (8.0, 18.0, 58.0), planned=800, per_step=98, began=1e-9)
    stage.left(700.0)
    assert stage.left(800.0) == pytest.approx(0.1 * 98)
    assert stage.left(1200.0) == pytest.approx(0.1 * 400)


def test_time_left_and_that_of_a_search_count_the_pace_of_made_throws_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With 900 of 1000 kept, ten times as many as were made seemed to be left in the same time."""
    stage = Watched(monkeypatch, (20.0, 20.0, 20.0), planned=1100, per_step=40, began=10.0)
    stage.evaluator.spared = 1000.0
    assert stage.left(1000.0) == float("inf")
    stage.evaluator.spared = 900.0
    assert stage.left(1000.0) == pytest.approx(100 * 10.0 / 100.0)
    assert stage.watch.time_of(2, stage.evaluator) == pytest.approx(2 * WORK["plain"] * 0.1)


def test_advice_counts_its_own_throws(monkeypatch: pytest.MonkeyPatch) -> None:
    """It said "about 51 s left" for all of 20 s, by a step of the stage before."""
    stage = Watched(monkeypatch, (20.0, 30.0), planned=500, per_step=98, began=10.0)
    stage.evaluator.made, stage.evaluator.work = 1000, 1000.0
    final: Any = SimpleNamespace(parameters=range(4), misfit=SimpleNamespace(movements=range(20)))
    stage.watch.begin_advice(final, stage.evaluator)
    work = 3.5 * 60
    assert stage.left(1000.0) == pytest.approx(0.01 * work)
    assert stage.left(1100.0) == pytest.approx(0.1 * (work - 100))


def test_time_left_is_not_said_of_the_first_throws() -> None:
    """The first line was "1 throws, 0 s, less than 5 s left", of a fit that took minutes."""
    first, later = (
        stage_line(
            CalibrationProgress(
                stage="friction",
                number=1,
                stages=4,
                evaluations=made,
                misfit=float("nan"),
                seconds=3.0,
                left=80.0,
            )
        )
        for made in (1, 40)
    )
    assert first == "stage friction (1 of 4): 1 throw, 3 s"
    assert later.endswith("40 throws, 3 s, about 80 s left")


def test_a_search_for_causes_is_in_the_time_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes more throws than all stages before, which said "about 10 s" all the while."""
    clock = (10.0, 20.0, 28.0, 35.0, 40.0, 41.0)
    whole = Watched(monkeypatch, clock, planned=110, per_step=40, began=10.0)
    whole.left(100.0)
    found = fit(misfit(alike(3, seed=3)), PARAMETERS, TRUE)
    throws = work_of_search(found, load_panel("sb1"))
    assert throws > 3 * 40
    whole.watch.more(throws, whole.evaluator)
    assert whole.left(100.0) == pytest.approx(0.1 * (40 + throws))
    # All of the search says how fast it goes, and none of the stages before.
    whole.left(300.0)
    assert whole.left(400.0) == pytest.approx(25.0 / 300.0 * max(40 + throws - 300, 300))
    # One that goes on beyond it is not about to end; the fit to the end then has a plan of its own.
    assert whole.left(1100.0) == pytest.approx(30.0 / 1000.0 * 1000.0)
    found.misfit.evaluator = whole.evaluator
    whole.watch.end_search(found)
    end = WORK["halved"] + WORK["fine"] + WORK["plain"] * (20 + len(PARAMETERS))
    assert whole.left(1100.0) == pytest.approx(31.0 / 1000.0 * end)


def test_the_limit_is_over_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is known then is worked out without it."""
    stage = Watched(monkeypatch, (14.0, 14.0, 16.0, 30.0), planned=80, began=10.0)
    stage.watch.limit = 5.0
    assert stage.left(20.0) <= 1.0
    with pytest.raises(TimeIsUp):
        stage.left(30.0)
    stage.left(40.0)


def test_the_time_of_a_search_follows_from_that_of_throws(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Watched(monkeypatch, (14.0, 20.0, 20.0, 20.0, 30.0), planned=80, began=10.0)
    assert stage.watch.time_of(100, stage.evaluator) == float("inf")
    stage.evaluator.made, stage.evaluator.work = 40, 50.0
    time = stage.watch.time_of(100, stage.evaluator)
    assert time == pytest.approx(100 * WORK["plain"] * 10.0 / 50.0)
    stage.evaluator.spared, stage.evaluator.work = 50.0, 100.0
    assert stage.watch.time_of(100, stage.evaluator) == pytest.approx(time)
    stage.watch.limit = 15.0
    assert stage.watch.time_of(100, stage.evaluator) == pytest.approx(5.0)
    assert stage.watch.time_of(100, stage.evaluator) == 0.0


@pytest.mark.parametrize(
    ("missed", "causes", "most", "words"),
    [
        ({}, True, 90.0, "so far the model follows; fitting to the end"),
        ({KEY: 0.03}, True, 80.0, "misses 3 %; looking for the cause, at most 80 s"),
        ({KEY: 0.03}, True, float("inf"), "misses 3 %; looking for the cause"),
        ({KEY: 0.03}, False, 90.0, "misses 3 %; causes are not looked for"),
    ],
)
def test_the_first_fit_has_a_verdict(
    missed: dict[Key, float],
    causes: bool,
    most: float,
    words: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole = misfit(alike(1, seed=2))
    (peak,) = peaks_of(whole.movements).values()
    far = {key: share * peak for key, share in missed.items()}
    monkeypatch.setattr("turnout.calibration.causes.missing_more", lambda *_, **__: far)
    found: Any = SimpleNamespace(misfit=whole)
    assert first_verdict(found, causes=causes, most=most).endswith(words)
