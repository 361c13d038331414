"""Progress of a calibration: the time that is reported as left."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.unit.test_calibration_fit import PARAMETERS, TRUE, misfit, movement

from turnout.calibration import stage_progress
from turnout.calibration.fit import fit
from turnout.calibration.stage_progress import (
    CalibrationProgress,
    ProgressReporter,
    work_of_search,
)
from turnout.cli.calibrate import _ProgressLog
from turnout.panel.load import load_panel


def test_time_left_is_never_less_than_that_of_one_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fits that need more throws than usual said "about 0 s left" for minutes."""
    clock = iter([10.0, 30.0])
    monkeypatch.setattr(stage_progress, "time", SimpleNamespace(monotonic=clock.__next__))
    states: list[CalibrationProgress] = []
    evaluator: Any = SimpleNamespace(made=100, work=100.0)
    watch = ProgressReporter(states.append, 1, planned=80, per_step=40, began=10.0)
    watch.report_state(evaluator)
    watch.report_state(evaluator)
    assert states[-1].seconds == 20.0
    assert states[-1].left == pytest.approx(0.4 * 20.0)


def test_time_left_follows_the_present_pace_and_what_was_needed_beyond_the_plan(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Quick throws come first: by their pace "less than 5 s" were left from second 8 to 85."""
    clock = iter([8.0, 18.0, 58.0])
    monkeypatch.setattr(stage_progress, "time", SimpleNamespace(monotonic=clock.__next__))
    states: list[CalibrationProgress] = []
    evaluator: Any = SimpleNamespace(made=700, work=700.0)
    watch = ProgressReporter(states.append, 1, planned=800, per_step=98, began=1e-9)
    watch.report_state(evaluator)
    evaluator.work = 800.0
    watch.report_state(evaluator)
    assert states[-1].left == pytest.approx(0.1 * 98)
    evaluator.work = 1200.0
    watch.report_state(evaluator)
    assert states[-1].left == pytest.approx(0.1 * 400)


def test_advice_counts_its_own_throws(monkeypatch: pytest.MonkeyPatch) -> None:
    """It said "about 51 s left" for all of 20 s, by a step of the stage before."""
    clock = iter([20.0, 30.0])
    monkeypatch.setattr(stage_progress, "time", SimpleNamespace(monotonic=clock.__next__))
    states: list[CalibrationProgress] = []
    evaluator: Any = SimpleNamespace(made=1000, work=1000.0)
    final: Any = SimpleNamespace(parameters=range(4), misfit=SimpleNamespace(movements=range(20)))
    watch = ProgressReporter(states.append, 1, planned=500, per_step=98, began=10.0)
    watch.begin("advice", final, evaluator)
    watch.report_state(evaluator)
    evaluator.work = 1100.0
    watch.report_state(evaluator)
    work = 3.5 * 60
    assert states[0].left == pytest.approx(0.01 * work)
    assert states[1].left == pytest.approx(0.1 * (work - 100))


def test_time_left_is_not_said_of_the_first_throws(capsys: pytest.CaptureFixture[str]) -> None:
    """The first line was "1 throws, 0 s, less than 5 s left", of a fit that took minutes."""
    log = _ProgressLog()
    for made in (1, 40):
        log._due = 0.0
        log.report(
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
    first, later = capsys.readouterr().err.splitlines()
    assert first == "stage friction (1 of 4): 1 throw, 3 s"
    assert later.endswith("40 throws, 3 s, about 80 s left")


def test_a_search_for_causes_is_in_the_time_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes more throws than all stages before, which said "about 10 s" all the while."""
    clock = iter([10.0, 20.0, 21.0])
    monkeypatch.setattr(stage_progress, "time", SimpleNamespace(monotonic=clock.__next__))
    states: list[CalibrationProgress] = []
    evaluator: Any = SimpleNamespace(made=100, work=100.0)
    watch = ProgressReporter(states.append, 1, planned=110, per_step=40, began=10.0)
    watch.report_state(evaluator)
    rng = np.random.default_rng(3)
    found = fit(misfit([movement(f"m{n}", rng=rng) for n in range(3)]), PARAMETERS, TRUE)
    throws = work_of_search(found, load_panel("sb1"))
    assert throws > 3 * 40
    watch.more(throws, evaluator)
    watch.report_state(evaluator)
    assert states[-1].left == pytest.approx(0.1 * (40 + throws))
