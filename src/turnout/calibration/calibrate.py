"""Calibrate a panel to a campaign, stage by stage, with progress and a limit of time."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.calibration.advice import (
    advice_lines,
    check_shares,
    given_but,
    panel_column,
    panel_doubt_lines,
)
from turnout.calibration.candidate_causes import candidate_causes
from turnout.calibration.causes import (
    CAUSE_STEPS,
    MOST_THROWS,
    CauseSearch,
    cause_lines,
    first_fit,
    first_verdict,
    is_worth_a_search,
    with_causes,
    without_needless,
)
from turnout.calibration.comparison import Comparison, Uncertainty, measured_noise
from turnout.calibration.covariance import Spread, drop_unidentified_slip_levels, spread_of
from turnout.calibration.evaluate import WORK, Evaluator, throws_done
from turnout.calibration.fit import (
    MAX_PASSES,
    MAX_STEPS,
    Fit,
    brief_fit,
    fit,
)
from turnout.calibration.measured_movements import (
    MeasuredMovement,
    observe,
)
from turnout.calibration.misfit import Misfit
from turnout.calibration.requirements import (
    check_campaign,
    exclude_oversized_objects,
    rod_warnings,
)
from turnout.calibration.result import Calibration, StageLog
from turnout.calibration.result_entries import record_of
from turnout.calibration.sensors import (
    common_lead,
    sensor_reasons,
    stated_gains,
)
from turnout.calibration.shared import CLEARLY
from turnout.calibration.stages import (
    JOINT_MOVEMENTS,
    CalibrationPlan,
    Parameter,
    Stage,
    common_unknowns,
    default_plan,
    is_of_object,
    selected,
    with_unknowns,
)
from turnout.calibration.starts import (
    GridSearch,
    nearest_fit,
    starts_of,
    sweep,
    with_movements,
    with_thicker,
)
from turnout.core.errors import MeasurementError, PanelError
from turnout.core.scheme import Scheme
from turnout.core.threads import one_blas_thread
from turnout.core.workers import Workers
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
# Work over which the present pace is taken, in quick throws and as a share of all so far: that of
# the machine may change, and fits take time between throws.
PACE_WORK, PACE_SHARE = 100.0, 0.09
# Fits of a search with one cause, each with slopes of its own: without it, with it, and to the end.
SEARCH_FITS = 3
# Throws of each place and size for the planes that a fit ends with.
END_PLANES = 20
# Throws, for each movement, that fits begun before a search is ended and two ends take at most.
LAST_THROWS = 200
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
        of processor time, at the present pace of those that are made; where more were needed
        already, as much again as these took, and at least one more step; infinite where all were
        kept from before, so that nothing is known [s].
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
    """Return the usual work of a calibration, search and advice included [quick throws]."""
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
    """Return the work of the last stage without a search for causes [quick throws]."""
    leading = min(len(chosen), JOINT_MOVEMENTS)
    slopes = THROWN_SLOPES * len(parameters) + OBJECT_SLOPES
    joining = JOINING_THROWS if len(chosen) > leading else 0
    last = sum(WORK["lean"] if item.prior else WORK["plain"] for item in parameters)
    last += OBJECT_SLOPES * WORK["lean"] / THROWN_SLOPES
    return (
        leading * (ROUGH_THROWS + ROUGH_SLOPES * slopes + NEAR_THROWS * WORK["plain"])
        + len(chosen) * (joining + END_THROWS * WORK["plain"])
        + _distinct(chosen) * (THROWN_SLOPES * last + WORK["halved"] + WORK["fine"])
    )


def advice_work(movements: int, parameters: int) -> float:
    """Return what advice usually takes [quick throws]."""
    return WORK["plain"] * (movements + CANDIDATES * (parameters + 1))


def work_per_step(
    plan: CalibrationPlan, movements: Sequence[MeasuredMovement], panel: LoadedPanel
) -> float:
    """Return the work of one step of the last stage without slopes [quick throws]."""
    return WORK["plain"] * len(selected(movements, plan.stages[-1].movements, panel))


def work_of_search(found: Fit, panel: LoadedPanel) -> float:
    """Return the work of a search for one cause of a misfit, with its fit [quick throws].

    Each cause that changes the panel is thrown at all its sizes, and `SEARCH_FITS` fits follow.
    """
    count, tries = len(found.parameters), 0
    for cause in candidate_causes(panel, found.parameters, found.misfit.movements):
        if cause.shape is None:
            sizes = len(cause.tries) * (2 if cause.beside else 1)
            tries += len(cause.parameters) if cause.smooth else max(sizes, 1)
    each = tries + SEARCH_FITS * (CAUSE_STEPS + 2 * WORK["plain"] * (count + 2))
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
    latest: tuple[float, float] = (0.0, 0.0)
    searching: bool = False
    begun: float = 0.0
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
        seconds = time.monotonic() - self.began
        pace = self._paces(seconds, evaluator)[-1]
        left = self.planned - evaluator.work
        # How long a search goes on is not known: as long again as so far, if not as planned.
        beyond = evaluator.work - self.begun if self.searching else -left
        left = pace * max(left, beyond, self.per_step)
        self.report(
            CalibrationProgress(
                stage=self.stage,
                number=self.number,
                stages=self.stages,
                evaluations=evaluator.made,
                misfit=self.misfit,
                seconds=seconds,
                left=min(left, self.limit - seconds),
                verdict=self.verdict,
            )
        )

    def _paces(self, seconds: float, evaluator: Evaluator) -> tuple[float, float]:
        """Return the time that made throws took for each quick one: in the mean, and lately [s]."""
        made = evaluator.work - evaluator.spared
        self.latest = (seconds, made)
        if made <= 0.0:
            return float("inf"), float("inf")
        if made - self.marked[1] >= max(PACE_WORK, 0.0 if self.searching else PACE_SHARE * made):
            self.pace = (seconds - self.marked[0]) / (made - self.marked[1])
            self.marked = self.marked if self.searching else self.latest
        mean = seconds / made
        return mean, self.pace or mean

    def begin_advice(self, final: Fit, evaluator: Evaluator) -> None:
        """Note that advice about a fit comes after the stages."""
        self.stage, self.per_step, self.searching = "advice", WORK["plain"], False
        further = advice_work(len(final.misfit.movements), len(final.parameters))
        self.planned = evaluator.work + further

    def more(self, work: float, evaluator: Evaluator) -> None:
        """Plan a search for causes beside the work still planned [quick throws].

        Its throws are of other kinds than those before: the pace is taken over all of it.
        """
        self.planned = max(self.planned, evaluator.work + self.per_step) + work
        self.marked, self.searching, self.begun = self.latest, True, evaluator.work

    def end_search(self, found: Fit) -> None:
        """Plan the fit to the end alone, if a search for causes went before."""
        if self.searching:
            evaluator, each = found.misfit.evaluator, END_PLANES + len(found.parameters)
            work = WORK["plain"] * each + WORK["halved"] + WORK["fine"]
            self.begun = evaluator.work
            self.planned = evaluator.work + _distinct(found.misfit.movements) * work

    def time_of(self, throws: int, evaluator: Evaluator) -> float:
        """Return the time that so many plain throws take at the slower of the mean and late pace.

        The limit at most; infinite with no throw made so far [s].
        """
        spent = time.monotonic() - (self.began or time.monotonic())
        pace = max(self._paces(spent, evaluator))
        return max(min(throws * WORK["plain"] * pace, self.limit - spent), 0.0)

    def found(self, misfit: float) -> None:
        """Note the misfit of the latest step."""
        self.misfit = misfit


Floats = NDArray[np.float64]
# A lead of the motors that is seen before any cause is looked for [s].
LONG_LEAD = 0.08
CTRL_C = "Ctrl-C"
TOO_SHORT = "{:g} s were over before the first fit was done; give more seconds"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CalibrationOutcome:
    """A calibration, with its fit, spread and movements.

    Attributes
    ----------
    calibration : Calibration
        Fitted values in SI with deviations and intervals, as `save` writes them.
    final : Fit
        Fit of the last stage, all free parameters together.
    spread : Spread
        Covariance of the free parameters, shape (p, p), in coordinates of the fit.
    sweeps : tuple of GridSearch
        The grid searches, to draw.
    movements : tuple of MeasuredMovement
        All that were measured.
    ended : str
        What ended it after the first fit; empty where it came to its end.
    """

    calibration: Calibration
    final: Fit
    spread: Spread
    sweeps: tuple[GridSearch, ...]
    movements: tuple[MeasuredMovement, ...]
    ended: str = ""


def calibrate(
    dataset: xr.Dataset,
    panel: LoadedPanel,
    *,
    plan: CalibrationPlan | None = None,
    exclude: Sequence[str] = (),
    folder: Path | None = None,
    workers: int | Workers = 1,
    scheme: Scheme | None = None,
    uncertainty: Uncertainty | None = None,
    advise: bool = False,
    causes: bool = True,
    limit: float = float("inf"),
    panel_shares: Mapping[str, float] | None = None,
    report: Callable[[CalibrationProgress], None] | None = None,
) -> CalibrationOutcome:
    """Calibrate a panel to a campaign, stage by stage.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `build_campaign`, with dimensions movement and time.
    panel : LoadedPanel
        What was measured, with start values.
    plan : CalibrationPlan, optional
        Parameters and stages; default the published ones and a joint refinement.
    exclude : sequence of str
        Movements to leave out.
    folder : Path, optional
        Where throws are kept; the same call continues after a stop.
    workers : int or Workers
        Processes that simulate at the same time, at least 1, or those of `throw_processes`.
    scheme : Scheme, optional
        Step, cut-off and tolerances of every throw; by default those of `Scheme()`.
    uncertainty : Uncertainty, optional
        Of onsets, zeros, gains and the clock.
    advise : bool
        Whether to list systematic errors that parameters would absorb, and what to measure next.
    causes : bool
        Whether to look for causes of what the panel alone does not follow.
    limit : float
        Time after which what was found by then is given [s].
    panel_shares : mapping of str to float, optional
        Standard uncertainty of numbers of the panel that are not fitted, as shares [-]: intervals
        hold it too.
    report : callable, optional
        Called after each throw.

    Returns
    -------
    CalibrationOutcome
        Of Ctrl-C after the first fit too: what was found by then, with the reason not to trust it.

    Raises
    ------
    MeasurementError
        When the campaign cannot be calibrated to, with all problems, or the limit is over before
        the first fit.
    PanelError
        When the plan does not fit the panel.
    SolverError
        When a throw cannot be simulated.
    """
    plan, scheme = plan or default_plan(panel), scheme or Scheme()
    check_shares(panel_shares or {}, panel, plan.parameters)
    movements, oversized = exclude_oversized_objects(
        observe(dataset, panel, exclude=exclude), panel
    )
    check_campaign(movements, plan, panel, source=str(dataset.attrs.get("title", "campaign")))
    comparison = _comparison(dataset, movements, plan, uncertainty or Uncertainty())
    watch = ProgressReporter(
        report,
        len(plan.stages),
        planned=planned_work(plan, movements, panel, advise=advise),
        per_step=work_per_step(plan, movements, panel),
        limit=limit,
    )
    plan = with_unknowns(plan, common_unknowns(movements))
    # Matrices are small: threads would cost four times what the fits themselves take.
    with (
        one_blas_thread(),
        Evaluator(panel, folder=folder, workers=workers, scheme=scheme) as evaluator,
    ):
        evaluator.on_throw = lambda: watch.report_state(evaluator)
        evaluator.on_step = watch.found
        run = _Run(plan, panel, movements, comparison, evaluator, watch, causes)
        try:
            rods = rod_warnings(dataset, movements, evaluator)
            logs, sweeps, warnings, final, search = run.stages()
        except TimeIsUp:
            raise MeasurementError([TOO_SHORT.format(limit)], source="limit") from None
        watch.limit = float("inf")
        if not run.ended:
            final, slip_warnings = drop_unidentified_slip_levels(final)
            warnings += slip_warnings
        shares = {} if run.ended else panel_shares or {}
        said = [*oversized, *warnings, *rods]
        calibration, spread = _concluded(run, final, search, dataset, shares, said)
        if advise and not run.ended:
            watch.begin_advice(final, evaluator)
            lines = advice_lines(final, spread)
            calibration = replace(calibration, findings=(*calibration.findings, *lines))
    return CalibrationOutcome(
        calibration=replace(calibration, stages=tuple(logs)),
        final=final,
        spread=spread,
        sweeps=tuple(sweeps),
        movements=movements,
        ended="".join(run.ended),
    )


def _concluded(
    run: "_Run",
    final: Fit,
    search: CauseSearch | None,
    dataset: xr.Dataset,
    shares: Mapping[str, float],
    warnings: Sequence[str],
) -> tuple[Calibration, Spread]:
    """Return the record of a fit without stages, and its spread with stated doubts of the panel."""
    columns = {key: panel_column(final, key, share) for key, share in shares.items()}
    spread = spread_of(
        final, of_panel=list(columns.values()), rivals=search.rivals if search else ()
    )
    calibration = record_of(
        final,
        spread,
        fitted_causes=[item.name for item in search.taken] if search else (),
        causes=cause_lines(final, search),
        plan=run.plan,
        dataset=dataset,
        movements=run.movements,
        ended=run.ended,
        warnings=warnings,
    )
    return replace(
        calibration,
        findings=(*calibration.findings, *panel_doubt_lines(final, columns, shares)),
        about={**calibration.about, **given_but(shares)},
    ), spread


def _comparison(
    dataset: xr.Dataset,
    movements: Sequence[MeasuredMovement],
    plan: CalibrationPlan,
    known: Uncertainty,
) -> Comparison:
    """Return how movements are compared, with gains, zeros and clock as stated."""
    comparison = Comparison(
        noise=measured_noise(movements),
        scatter={p.name: p.scatter for p in plan.parameters if p.scatter > 0},
        uncertainty=known,
        common_zero=known.common_zero,
        cross_talk=known.cross_talk,
        clock=float(dataset.attrs.get("clock_uncertainty", known.clock)),
    )
    return replace(comparison, gains=stated_gains(dataset, comparison))


@dataclass(frozen=True, slots=True, eq=False)
class _Run:
    """The stages of one calibration: the best fit so far, and the cause of an early end."""

    plan: CalibrationPlan
    panel: LoadedPanel
    movements: tuple[MeasuredMovement, ...]
    comparison: Comparison
    evaluator: Evaluator
    watch: ProgressReporter
    causes: bool = True
    best: list[CauseSearch] = field(default_factory=list)
    ended: list[str] = field(default_factory=list)

    def stages(
        self,
    ) -> tuple[list[StageLog], list[GridSearch], list[str], Fit, CauseSearch | None]:
        """Do all stages, each from the end of the one before."""
        values = {item.name: item.start for item in self.plan.parameters}
        scatter = dict(self.comparison.scatter)
        logs: list[StageLog] = []
        sweeps: list[GridSearch] = []
        warnings: list[str] = []
        search: CauseSearch | None = None
        final: Fit | None = None
        skipped: list[tuple[Parameter, Sequence[float]]] = []
        counted = 0  # throws made; those that look for exchanged rods count to the first stage
        for number, stage in enumerate(self.plan.stages, 1):
            self.watch.stage, self.watch.number = stage.name, number
            chosen = selected(self.movements, stage.movements, self.panel)
            parameters = self.plan.named(stage.parameters)
            if not chosen or not parameters:
                warnings += skipped_stage(stage, chosen)
                skipped += [(item, stage.grid) for item in parameters[:1] if stage.grid]
                continue
            misfit = self._misfit(stage, chosen, values, scatter)
            # What leads near need not be all that there is.
            fewer = replace(stage.movements, most=stage.movements.most or JOINT_MOVEMENTS)
            leading = replace(misfit, movements=selected(chosen, fewer, self.panel))
            starts = starts_of(leading, skipped, parameters, values)
            values = starts[0]
            skipped = [item for item in skipped if item[0] not in parameters]
            swept: GridSearch | None = None
            if "sweep" in stage.method and parameters[0].name == stage.parameters[0]:
                swept = sweep(replace(leading, quick=True), parameters[0], stage.grid, values)
                sweeps.append(swept)
                values = {**values, **swept.values}
                starts = [values]
            if "fit" in stage.method:
                last = number == len(self.plan.stages)
                rough = replace(misfit.comparison, gains={}, common_zero=0.0, cross_talk=0.0)
                near = replace(leading, quick=True, comparison=rough)
                final = nearest_fit(near, parameters, starts)
                if last:
                    final = with_thicker(near, final)
                values = dict(final.values)
                if last:
                    start = replace(leading, base=values)
                    final, search = self._last(final, start, parameters, chosen)
                    values = dict(final.values)
                scatter = dict(final.misfit.comparison.scatter)
            made = self.evaluator.made - counted
            logs.append(stage_log(stage, chosen, parameters, values, final, swept, made))
            counted += made
        if final is None:
            problem = "no stage was fitted; give one with movements and free parameters"
            raise PanelError([problem], source="stages")
        return logs, sweeps, warnings, final, search

    def _last(
        self,
        near: Fit,
        start: Misfit,
        parameters: Sequence[Parameter],
        chosen: tuple[MeasuredMovement, ...],
    ) -> tuple[Fit, CauseSearch]:
        """Fit to the end, with a lead of the motors and the causes that the misfit asks for.

        Where this is ended after the first fit, what was found by then is given.
        """
        start, quick = self._first(near, start)
        found = brief_fit(start, quick, passes=1)
        misses = is_worth_a_search(found)
        self._say_whether_it_follows(found)
        if misses and self.causes:
            self.watch.more(work_of_search(found, self.panel), self.evaluator)
        self.best[:] = [CauseSearch(found=found, first=start, plain=start, misses=misses)]
        try:
            return self._searched(quick, chosen)
        except (KeyboardInterrupt, TimeIsUp) as error:
            self.ended[:] = [
                CTRL_C if isinstance(error, KeyboardInterrupt) else "the limit in seconds"
            ]
            return self.best[0].found, self.best[0].ended(self.best[0].found)

    def _say_whether_it_follows(self, found: Fit) -> None:
        throws = (MOST_THROWS + LAST_THROWS) * len(found.misfit.movements)
        most = self.watch.time_of(throws, self.evaluator)
        self.watch.verdict = first_verdict(found, causes=self.causes, most=most)

    def _first(self, near: Fit, start: Misfit) -> tuple[Misfit, Fit]:
        """Return the start by throws of the scheme, with a lead if any, and the fit at it."""
        # Slopes of quick throws serve to see what is missed, and for a first step.
        quick = replace(near, local=replace(near.local, quick=False))
        # What a model that is far off misses is seen at once; it would go on only to move away.
        found = brief_fit(start, quick, passes=1, steps=0)
        lead = common_lead(found)
        # A recorder that averages, or a bushing that is soft, delays forces too, by less.
        if abs(lead) > LONG_LEAD:
            start = replace(start, comparison=replace(start.comparison, lead=lead))
            found = brief_fit(start, quick, passes=1, steps=0)
        return start, found

    def _searched(
        self, quick: Fit, chosen: tuple[MeasuredMovement, ...]
    ) -> tuple[Fit, CauseSearch]:
        """Go on with the first fit, look for causes of its misfit, and fit to the end.

        Movements that lead near show that as well; all that were chosen join for the end.
        """
        search, begun = self.best[0], throws_done(self.evaluator)
        found = first_fit(search.first, quick, search.found)
        misses = is_worth_a_search(found)
        if search.misses and not misses:
            self._say_whether_it_follows(found)
        search = replace(search, found=found, misses=misses)
        self.best[:] = [search]
        if self.causes:
            search = with_causes(found, search.first, self.panel, begun=begun)
            self.best[:] = [search]
        lead = common_lead(search.found)
        known = replace(search.first.comparison, lead=lead)
        plain = replace(
            search.plain, comparison=replace(search.plain.comparison, lead=lead), movements=chosen
        )
        search = replace(
            search,
            found=with_movements(search.found, chosen),
            first=replace(search.first, comparison=known, movements=chosen),
            plain=plain,
        )
        final = self._final(search)
        self.best[:] = [replace(search, found=final)]
        fewer = without_needless(search, final)
        if fewer is not search:
            again = self._final(fewer)
            if fewer.is_as_likely(again, search, final):
                search, final = fewer, again
        return final, search.ended(final)

    def _final(self, search: CauseSearch) -> Fit:
        """Fit to the end from the end of a search for causes."""
        self.watch.end_search(search.found)
        misfit = replace(search.first, base=search.found.values)
        found = search.found
        if search.misses:
            # Exact slopes are no remedy for what it still misses; finer throws are where it is
            # trusted all the same. A search that was ended has taken its time already.
            passes, steps = (1, 0) if search.stopped else (MAX_PASSES, MAX_STEPS)
            found = brief_fit(misfit, found, passes=passes, steps=steps)
            if search.stopped or is_worth_a_search(found, share=CLEARLY) or sensor_reasons(found):
                return found
            misfit = replace(misfit, base=found.values)
        return fit(misfit, found.parameters, found.values, near=found)

    def _misfit(
        self,
        stage: Stage,
        chosen: tuple[MeasuredMovement, ...],
        values: Mapping[str, float],
        scatter: Mapping[str, float],
    ) -> Misfit:
        return Misfit(
            evaluator=self.evaluator,
            parameters=self.plan.parameters,
            base=values,
            movements=chosen,
            comparison=replace(
                self.comparison, channels=stage.channels, window=stage.window, scatter=scatter
            ),
        )


def skipped_stage(stage: Stage, chosen: Sequence[MeasuredMovement]) -> list[str]:
    """Say why a stage was left out."""
    if chosen:
        return [f"stage {stage.name} was left out: all its parameters are fixed"]
    where = f" at {stage.movements.place}" if stage.movements.place else ""
    return [
        f"stage {stage.name} was left out: no movement with an object{where}; its parameters come "
        "from the later stages alone"
    ]


def stage_log(
    stage: Stage,
    chosen: Sequence[MeasuredMovement],
    parameters: Sequence[Parameter],
    values: Mapping[str, float],
    final: Fit | None,
    swept: GridSearch | None,
    made: int,
) -> StageLog:
    """Return the record of a stage."""
    fitted = final if "fit" in stage.method else None
    return StageLog(
        name=stage.name,
        method=stage.method,
        movements=tuple(item.name for item in chosen),
        values={p.name: values[p.name] for p in parameters if not is_of_object(p)},
        misfit=fitted.rms if fitted else min(swept.misfit) if swept else float("nan"),
        evaluations=made,
        iterations=fitted.iterations if fitted else 0,
        message=fitted.message if fitted else "swept",
        sweep={"value": swept.grid, "misfit": swept.misfit} if swept else {},
    )
