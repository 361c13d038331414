"""The one chain from a campaign to a calibration."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.errors import MeasurementError, PanelError
from turnout.files.provenance import content_hash, provenance
from turnout.integrate.scheme import Scheme
from turnout.panel.load import LoadedPanel
from turnout.study.calibration.covariance import Spread, spread_of
from turnout.study.calibration.evaluate import Evaluator
from turnout.study.calibration.fit import Fit, fit
from turnout.study.calibration.misfit import Misfit
from turnout.study.calibration.noise import measured_noise
from turnout.study.calibration.observed import Movement, observe, selected
from turnout.study.calibration.parameter import Parameter
from turnout.study.calibration.record import Calibration, Fitted, StageLog
from turnout.study.calibration.stage import NONE, Plan, Stage, default_plan
from turnout.study.calibration.sweep import Sweep, sweep
from turnout.study.calibration.view import Comparison, Doubt

Floats = NDArray[np.float64]
# A drive whose marker moves, but whose rod never changes by this, is dead or not there [N].
LEAST_FORCE = 30.0
# Residuals this much above their expected size say that the model misses something [-].
LARGE_MISFIT = 1.5


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """How far a calibration is, for whoever watches.

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
    seconds : float
        Since the start [s].
    """

    stage: str
    number: int
    stages: int
    evaluations: int
    misfit: float
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outcome:
    """A calibration and what it was made with, for what comes after.

    Attributes
    ----------
    calibration : Calibration
        The record.
    final : Fit
        The last stage.
    spread : Spread
        How sure it is.
    sweeps : tuple of Sweep
        The grid searches, to draw.
    movements : tuple of Movement
        All that were measured.
    """

    calibration: Calibration
    final: Fit
    spread: Spread
    sweeps: tuple[Sweep, ...]
    movements: tuple[Movement, ...]


def calibrate(
    dataset: xr.Dataset,
    panel: LoadedPanel,
    *,
    plan: Plan | None = None,
    exclude: Sequence[str] = (),
    folder: Path | None = None,
    workers: int = 1,
    scheme: Scheme | None = None,
    doubt: Doubt | None = None,
    report: Callable[[State], None] | None = None,
) -> Outcome:
    """Calibrate a panel to a campaign, stage by stage.

    Parameters
    ----------
    dataset : xarray.Dataset
        A built campaign.
    panel : LoadedPanel
        What was measured, with start values.
    plan : Plan, optional
        Parameters and stages; default the published ones and a joint refinement.
    exclude : sequence of str
        Movements to leave out.
    folder : Path, optional
        Where throws are kept; the same call goes on from there after a stop.
    workers : int
        Processes.
    scheme : Scheme, optional
        Numerical choices.
    doubt : Doubt, optional
        Of onsets and zeros.
    report : callable, optional
        Called after each throw.

    Returns
    -------
    Outcome

    Raises
    ------
    MeasurementError
        When the campaign cannot be calibrated to; with all problems.
    PanelError
        When the plan does not fit the panel.
    SolverError
        When a throw cannot be simulated.
    """
    plan = plan or default_plan(panel)
    movements = observe(dataset, panel, exclude=exclude)
    _check(movements, plan, panel, source=str(dataset.attrs.get("title", "campaign")))
    comparison = Comparison(
        noise=measured_noise(movements),
        scatter={p.name: p.scatter for p in plan.parameters if p.scatter > 0},
        doubt=doubt or Doubt(),
    )
    watch = _Watch(report, len(plan.stages))
    with Evaluator(panel, folder=folder, workers=workers, scheme=scheme or Scheme()) as evaluator:
        evaluator.told = lambda: watch.tell(evaluator)
        run = _Run(plan, panel, movements, comparison, evaluator, watch)
        logs, sweeps, warnings, final = run.stages()
    spread = spread_of(final)
    warnings += _warnings(final, spread)
    calibration = Calibration(
        parameters=_fitted(plan, final, spread),
        covariance=spread.covariance,
        panel=panel.name,
        panel_hash=panel.hash,
        data=str(dataset.attrs.get("title", "campaign")),
        data_hash=data_hash(movements),
        movements=tuple(item.name for item in final.misfit.movements),
        stages=tuple(logs),
        warnings=tuple(dict.fromkeys(warnings)),
        findings=spread.findings,
        noise=_noise_record(final),
        scatter=final.misfit.comparison.scatter,
        about={
            **provenance(),
            "written": datetime.now(UTC).isoformat(timespec="seconds"),
            "scheme": (scheme or Scheme()).describe(),
            "synthetic": str(dataset.attrs.get("synthetic", "")),
        },
    )
    return Outcome(
        calibration=calibration,
        final=final,
        spread=spread,
        sweeps=tuple(sweeps),
        movements=movements,
    )


def data_hash(movements: Sequence[Movement]) -> str:
    """Return the content hash of what was measured and compared."""
    return content_hash(
        [
            [
                item.name,
                item.direction,
                item.place,
                item.size,
                *(
                    [signal.channel, signal.drive, np.nan_to_num(signal.values).tolist()]
                    for signal in item.signals
                ),
            ]
            for item in movements
        ]
    )


@dataclass(slots=True)
class _Watch:
    """Puts together what the one who watches is told."""

    report: Callable[[State], None] | None
    stages: int
    stage: str = ""
    number: int = 0
    misfit: float = float("nan")
    began: float = 0.0

    def tell(self, evaluator: Evaluator) -> None:
        self.began = self.began or time.monotonic()
        if self.report is None:
            return
        self.report(
            State(
                stage=self.stage,
                number=self.number,
                stages=self.stages,
                evaluations=evaluator.made,
                misfit=self.misfit,
                seconds=time.monotonic() - self.began,
            )
        )

    def found(self, misfit: float) -> None:
        self.misfit = misfit


@dataclass(frozen=True, slots=True, eq=False)
class _Run:
    """The stages of one calibration."""

    plan: Plan
    panel: LoadedPanel
    movements: tuple[Movement, ...]
    comparison: Comparison
    evaluator: Evaluator
    watch: _Watch

    def stages(self) -> tuple[list[StageLog], list[Sweep], list[str], Fit]:
        """Do all stages, each from where the one before ended."""
        values = {item.name: item.start for item in self.plan.parameters}
        scatter = dict(self.comparison.scatter)
        logs: list[StageLog] = []
        sweeps: list[Sweep] = []
        warnings: list[str] = []
        final: Fit | None = None
        for number, stage in enumerate(self.plan.stages, 1):
            self.watch.stage, self.watch.number = stage.name, number
            chosen = selected(self.movements, stage.movements, self.panel)
            parameters = self.plan.named(stage.parameters)
            if not chosen or not parameters:
                warnings += _left_out(stage, chosen)
                continue
            before = self.evaluator.made
            misfit = self._misfit(stage, chosen, values, scatter)
            swept: Sweep | None = None
            if "sweep" in stage.method and parameters[0].name == stage.parameters[0]:
                swept = sweep(misfit, parameters[0], stage.grid, values)
                sweeps.append(swept)
                values = {**values, **swept.values}
            if "fit" in stage.method:
                last = number == len(self.plan.stages)
                final = fit(misfit, parameters, values, rough=not last, told=self.watch.found)
                values = dict(final.values)
                scatter = dict(final.misfit.comparison.scatter)
            made = self.evaluator.made - before
            logs.append(_log(stage, chosen, parameters, values, final, swept, made))
        if final is None:
            problem = "no stage was fitted; give one with movements and free parameters"
            raise PanelError([problem], source="stages")
        return logs, sweeps, warnings, final

    def _misfit(
        self,
        stage: Stage,
        chosen: tuple[Movement, ...],
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


def _left_out(stage: Stage, chosen: Sequence[Movement]) -> list[str]:
    if chosen:
        return [f"stage {stage.name} was left out: all its parameters are fixed"]
    where = f" at {stage.movements.place}" if stage.movements.place else ""
    return [
        f"stage {stage.name} was left out: no movement with an object{where}; its parameters come "
        "from the later stages alone"
    ]


def _log(
    stage: Stage,
    chosen: Sequence[Movement],
    parameters: Sequence[Parameter],
    values: Mapping[str, float],
    final: Fit | None,
    swept: Sweep | None,
    made: int,
) -> StageLog:
    fitted = final if "fit" in stage.method else None
    return StageLog(
        name=stage.name,
        method=stage.method,
        movements=tuple(item.name for item in chosen),
        values={item.name: values[item.name] for item in parameters},
        misfit=fitted.rms if fitted else min(swept.misfit) if swept else float("nan"),
        evaluations=made,
        iterations=fitted.iterations if fitted else 0,
        message=fitted.message if fitted else "swept",
        sweep={"value": swept.grid, "misfit": swept.misfit} if swept else {},
    )


def _check(movements: Sequence[Movement], plan: Plan, panel: LoadedPanel, *, source: str) -> None:
    """Refuse a campaign that the stages cannot be fitted to, with all problems."""
    problems = []
    for stage in plan.stages:
        chosen = selected(movements, stage.movements, panel)
        if not chosen and not stage.optional:
            if stage.movements.objects == NONE:
                problems.append(
                    f"stage {stage.name}: no movement without an object is left; measure one, keep "
                    "one that was excluded, or fix friction (--fix chair.friction_coefficient)"
                )
            else:
                problems.append(f"stage {stage.name}: no movement is selected")
    for name in panel.drive:
        changes = [
            float(np.nanmax(signal.values) - np.nanmin(signal.values))
            for movement in movements
            for signal in movement.signals
            if signal.channel == "drive_force" and signal.drive == name
        ]
        if not changes:
            problems.append(f"drive {name}: no movement has its force; map its column")
        elif max(changes) < LEAST_FORCE:
            problems.append(
                f"drive {name}: never moves, its force changes by {max(changes):.0f} N at most; "
                "check its column in the channel map"
            )
    if problems:
        raise MeasurementError(problems, source=source)


def _warnings(final: Fit, spread: Spread) -> list[str]:
    found = []
    if not final.converged:
        found.append(f"the last stage {final.message}")
    for item, state in zip(final.parameters, spread.states, strict=True):
        if state == "at its bound":
            found.append(
                f"{item.name} = {final.values[item.name]:.6g} lies at its bound: the data want "
                "more; widen the bound, or look for what else is wrong"
            )
        elif state == "not identified":
            found.append(
                f"{item.name}: these movements do not tell it; fix it, or measure one that does"
            )
    for key, noise in final.misfit.comparison.noise.items():
        measured = float(np.hypot(noise.white, noise.slow))
        if noise.missed > LARGE_MISFIT * measured:
            name = f"{key[0]} of drive {key[1]}" if key[1] else key[0]
            found.append(
                f"{name}: the model misses {noise.missed:.3g} N beside a noise of "
                f"{measured:.2g} N; deviations allow for it"
            )
    return found


def _fitted(plan: Plan, final: Fit, spread: Spread) -> tuple[Fitted, ...]:
    places = {item.name: number for number, item in enumerate(final.parameters)}
    found = []
    for item in plan.parameters:
        number = places.get(item.name)
        value = final.values[item.name]
        deviation, interval, state = float("nan"), (value, value), "fixed"
        if number is not None:
            deviation = spread.deviations[number]
            interval = spread.intervals[number]
            state = spread.states[number]
        found.append(
            Fitted(
                name=item.name,
                keys=item.keys,
                unit=item.unit,
                value=value,
                deviation=deviation,
                lower=item.lower,
                upper=item.upper,
                interval=interval,
                start=item.start,
                state=state,
            )
        )
    return tuple(found)


def _noise_record(final: Fit) -> dict[str, dict[str, float]]:
    return {
        (f"{channel} of drive {drive}" if drive else channel): {
            "white": noise.white,
            "slow": noise.slow,
            "slow_length": noise.slow_length,
            "missed": noise.missed,
            "missed_length": noise.missed_length,
        }
        for (channel, drive), noise in final.misfit.comparison.noise.items()
    }
