"""Calibration progress."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from turnout.calibration.candidate_causes import candidate_causes
from turnout.calibration.causes import CAUSE_STEPS
from turnout.calibration.emulator import points_needed
from turnout.calibration.evaluate import Evaluator, throws_done
from turnout.calibration.fit import ROUGH_STEPS, Fit
from turnout.calibration.measured_movements import MeasuredMovement, selected
from turnout.calibration.stages import CalibrationPlan
from turnout.panel.load import LoadedPanel

# Steps that the last stage usually takes, each with its own sensitivities.
JOINT_STEPS = 5
# Throws over which the present pace is taken: those at the end take longer.
PACE_THROWS = 50
# Movements that advice usually looks at.
CANDIDATES = 8


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
        Since the start, and left by the throws that are usually needed, at the slower of the mean
        and the present pace; where more were needed already, as much again as these took, and at
        least one more step [s].
    """

    stage: str
    number: int
    stages: int
    evaluations: int
    misfit: float
    seconds: float
    left: float


def planned_throws(
    plan: CalibrationPlan,
    movements: Sequence[MeasuredMovement],
    panel: LoadedPanel,
    *,
    posterior: bool = False,
    advise: bool = False,
) -> int:
    """Return how many throws a calibration usually takes, with what comes after the stages."""
    total = 0
    for number, stage in enumerate(plan.stages, 1):
        chosen = len(selected(movements, stage.movements, panel))
        count = len(plan.named(stage.parameters))
        last = number == len(plan.stages)
        steps = JOINT_STEPS if last else ROUGH_STEPS // 2
        total += chosen * (2 * len(stage.grid) + steps * (count + 2))
        if last and posterior:
            total += posterior_throws(chosen, count)
        if last and advise:
            total += advice_throws(chosen, count)
    return total


def posterior_throws(movements: int, parameters: int) -> int:
    """Return how many throws the sampling of a posterior takes."""
    return movements * points_needed(parameters)


def advice_throws(movements: int, parameters: int) -> int:
    """Return how many throws advice usually takes."""
    return movements + CANDIDATES * (parameters + 1)


def throws_per_step(
    plan: CalibrationPlan, movements: Sequence[MeasuredMovement], panel: LoadedPanel
) -> int:
    """Return how many throws one step of the last stage takes."""
    stage = plan.stages[-1]
    count = len(plan.named(stage.parameters))
    return len(selected(movements, stage.movements, panel)) * (count + 2)


def throws_of_search(found: Fit, panel: LoadedPanel) -> int:
    """Return how many throws a search for one cause of what a fit misses takes, with its fit.

    Each cause that changes the panel is thrown at all its sizes; the likeliest one is fitted with
    slopes of its own, and then with all values to the end.
    """
    count, tries = len(found.parameters), 0
    for cause in candidate_causes(panel, found.parameters):
        if cause.shape is None:
            tries += len(cause.parameters) if cause.smooth else max(len(cause.tries), 1)
    return len(found.misfit.movements) * (tries + CAUSE_STEPS + 2 * (count + 2))


@dataclass(slots=True)
class ProgressReporter:
    """Collects the progress of a calibration and reports it after each throw."""

    report: Callable[[CalibrationProgress], None] | None
    stages: int
    planned: int
    per_step: int = 0
    stage: str = ""
    number: int = 0
    misfit: float = float("nan")
    began: float = 0.0
    pace: float = 0.0
    marked: tuple[float, int] = (0.0, 0)

    def report_state(self, evaluator: Evaluator) -> None:
        """Report the state after a throw."""
        self.began = self.began or time.monotonic()
        if self.report is None:
            return
        seconds, made = time.monotonic() - self.began, max(evaluator.made, 1)
        if made - self.marked[1] >= PACE_THROWS:
            self.pace = (seconds - self.marked[0]) / (made - self.marked[1])
            self.marked = (seconds, made)
        missing = self.planned - made - evaluator.reused
        pace = max(seconds / made, self.pace)
        self.report(
            CalibrationProgress(
                stage=self.stage,
                number=self.number,
                stages=self.stages,
                evaluations=evaluator.made,
                misfit=self.misfit,
                seconds=seconds,
                left=pace * max(abs(missing), self.per_step),
            )
        )

    def begin(self, stage: str, final: Fit, evaluator: Evaluator) -> None:
        """Note what comes after the stages: "advice" or "posterior" about a fit."""
        self.stage, self.per_step = stage, 1
        throws = {"advice": advice_throws, "posterior": posterior_throws}[stage]
        count = throws(len(final.misfit.movements), len(final.parameters))
        self.planned = throws_done(evaluator) + count

    def more(self, throws: int, evaluator: Evaluator) -> None:
        """Plan so many more throws than are still planned, such as those of a search for causes."""
        done = throws_done(evaluator)
        self.planned = max(self.planned, done + self.per_step) + throws

    def found(self, misfit: float) -> None:
        """Note the misfit of the latest step."""
        self.misfit = misfit
