"""Calibration progress."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from turnout.calibration.candidate_causes import candidate_causes
from turnout.calibration.causes import CAUSE_STEPS
from turnout.calibration.evaluate import (
    FINE_WORK,
    HALVED_WORK,
    LEAN_WORK,
    PLAIN_WORK,
    Evaluator,
)
from turnout.calibration.fit import Fit
from turnout.calibration.measured_movements import MeasuredMovement, selected
from turnout.calibration.parameter import Parameter
from turnout.calibration.stages import JOINT_MOVEMENTS, CalibrationPlan
from turnout.panel.load import LoadedPanel

# Throws of the last stage by movement: quick ones beside the slopes of a rough fit, how often these
# are thrown, plain ones that lead near, and those at the end beside its slopes.
ROUGH_THROWS, ROUGH_SLOPES, NEAR_THROWS, END_THROWS = 11, 2, 2, 3
# Further quick throws of all movements where only some lead near.
JOINING_THROWS = 3
# Slopes of each movement that its object has: thickness.
OBJECT_SLOPES = 1
# Share of slopes that are thrown: slip levels that are not reached have none.
THROWN_SLOPES = 0.7
# Work over which the present pace is taken, in quick throws: that of the machine may change.
PACE_WORK = 100.0
# Movements that advice usually looks at.
CANDIDATES = 8


class TimeIsUp(Exception):  # noqa: N818 - no error: what is known is given
    """The limit of a calibration is over."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationProgress:
    """Calibration progress.

    Attributes
    ----------
    stage : str
        What is done now.
    number, stages : int
        Which one, and of how many.
    evaluations : int
        Throws simulated so far.
    misfit : float
        Root mean square of the residuals over their expected size; NaN before the first.
    seconds, left : float
        Since the start, and left by the throws that are usually needed, each kind with its share
        of processor time, at the slower of the mean and the present pace; where more were needed
        already, as much again as these took, and at least one more step [s].
    verdict : str
        Whether the first fit follows, and what is done next; empty before it.
    """

    stage: str
    number: int
    stages: int
    evaluations: int
    misfit: float
    seconds: float
    left: float
    verdict: str = ""


def planned_work(
    plan: CalibrationPlan,
    movements: Sequence[MeasuredMovement],
    panel: LoadedPanel,
    *,
    advise: bool = False,
) -> float:
    """Return what a calibration usually takes, with what comes after the stages [quick throws]."""
    total = 0.0
    for number, stage in enumerate(plan.stages, 1):
        chosen = selected(movements, stage.movements, panel)
        parameters = plan.named(stage.parameters)
        if number < len(plan.stages):
            grid = 2 * len(stage.grid)
            total += _distinct(chosen) * (grid + 2 * len(parameters)) + 3 * len(chosen)
            continue
        total += _joint_work(chosen, parameters)
        if advise:
            total += advice_work(len(chosen), len(parameters))
    return total


def _distinct(movements: Sequence[MeasuredMovement]) -> int:
    """Return how many places and sizes there are: repeats share throws."""
    return len({(item.place, item.size) for item in movements})


def _joint_work(chosen: Sequence[MeasuredMovement], parameters: Sequence[Parameter]) -> float:
    """Return what the last stage takes without a search for causes [quick throws]."""
    leading = min(len(chosen), JOINT_MOVEMENTS)
    slopes = THROWN_SLOPES * len(parameters) + OBJECT_SLOPES
    joining = JOINING_THROWS if len(chosen) > leading else 0
    last = sum(LEAN_WORK if item.prior else PLAIN_WORK for item in parameters)
    last += OBJECT_SLOPES * LEAN_WORK / THROWN_SLOPES
    return (
        leading * (ROUGH_THROWS + ROUGH_SLOPES * slopes + NEAR_THROWS * PLAIN_WORK)
        + len(chosen) * (joining + END_THROWS * PLAIN_WORK)
        + _distinct(chosen) * (THROWN_SLOPES * last + HALVED_WORK + FINE_WORK)
    )


def advice_work(movements: int, parameters: int) -> float:
    """Return what advice usually takes [quick throws]."""
    return PLAIN_WORK * (movements + CANDIDATES * (parameters + 1))


def work_per_step(
    plan: CalibrationPlan, movements: Sequence[MeasuredMovement], panel: LoadedPanel
) -> float:
    """Return what one step of the last stage takes without slopes [quick throws]."""
    return PLAIN_WORK * len(selected(movements, plan.stages[-1].movements, panel))


def work_of_search(found: Fit, panel: LoadedPanel) -> float:
    """Return what a search for one cause of what a fit misses takes, with its fit [quick throws].

    Each cause that changes the panel is thrown at all its sizes; the likeliest one is fitted with
    slopes of its own, and then with all values to the end.
    """
    count, tries = len(found.parameters), 0
    for cause in candidate_causes(panel, found.parameters, found.misfit.movements):
        if cause.shape is None:
            tries += len(cause.parameters) if cause.smooth else max(len(cause.tries), 1)
    each = tries + CAUSE_STEPS + 2 * PLAIN_WORK * (count + 2)
    return len(found.misfit.movements) * each


@dataclass(slots=True)
class ProgressReporter:
    """Collects the progress of a calibration, reports it after each throw and keeps its limit.

    `limit` counts from the first throw on [s]; it is infinite once it was used up.
    """

    report: Callable[[CalibrationProgress], None] | None
    stages: int
    planned: float
    per_step: float = 0.0
    stage: str = ""
    number: int = 0
    misfit: float = float("nan")
    began: float = 0.0
    pace: float = 0.0
    marked: tuple[float, float] = (0.0, 0.0)
    limit: float = float("inf")
    verdict: str = ""

    def report_state(self, evaluator: Evaluator) -> None:
        """Report the state after a throw; raises `TimeIsUp` once where the limit is over."""
        self.began = self.began or time.monotonic()
        if self.limit < float("inf") and time.monotonic() - self.began > self.limit:
            self.limit = float("inf")
            raise TimeIsUp
        if self.report is None:
            return
        seconds, work = time.monotonic() - self.began, max(evaluator.work, 1.0)
        if work - self.marked[1] >= PACE_WORK:
            self.pace = (seconds - self.marked[0]) / (work - self.marked[1])
            self.marked = (seconds, work)
        pace = max(seconds / work, self.pace)
        self.report(
            CalibrationProgress(
                stage=self.stage,
                number=self.number,
                stages=self.stages,
                evaluations=evaluator.made,
                misfit=self.misfit,
                seconds=seconds,
                left=min(pace * max(abs(self.planned - work), self.per_step), self.limit - seconds),
                verdict=self.verdict,
            )
        )

    def begin_advice(self, final: Fit, evaluator: Evaluator) -> None:
        """Note that advice about a fit comes after the stages."""
        self.stage, self.per_step = "advice", PLAIN_WORK
        further = advice_work(len(final.misfit.movements), len(final.parameters))
        self.planned = evaluator.work + further

    def more(self, work: float, evaluator: Evaluator) -> None:
        """Plan more work than is still planned, such as a search for causes [quick throws]."""
        self.planned = max(self.planned, evaluator.work + self.per_step) + work

    def found(self, misfit: float) -> None:
        """Note the misfit of the latest step."""
        self.misfit = misfit
