"""Fit each law that a drive may follow, and report which one the measurement supports."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from turnout.calibration.comparison import Comparison, Key
from turnout.calibration.drive_law.candidates import (
    BOTH,
    SOFT,
    WORN,
    DriveLaw,
    drive_laws,
    is_slight,
    level_key,
    stiffness_key,
)
from turnout.calibration.drive_law.fit_law import (
    LawFit,
    criteria,
    deviance,
    effective_samples,
    fitted_from,
    fitted_plain,
    fitted_variant,
    floored,
)
from turnout.calibration.evaluate import Evaluator
from turnout.calibration.measured_movements import MeasuredMovement, observe, selected
from turnout.calibration.misfit import Misfit
from turnout.calibration.noise import Noise, measured_noise
from turnout.calibration.objects import as_found
from turnout.calibration.parameter import Parameter
from turnout.calibration.result import Calibration
from turnout.calibration.stages import Selection
from turnout.core.errors import MeasurementError
from turnout.core.threads import one_blas_thread
from turnout.panel.load import LoadedPanel

# "Very strong" evidence (Kass and Raftery 1995, doi 10.1080/01621459.1995.10476572, section 3.2).
DECISIVE = 10.0
FRICTION, FRICTION_SCATTER = "friction_coefficient", 0.02
FREE, OBJECTS = 2, 7
FIXED = "fixed"


@dataclass(frozen=True, slots=True, kw_only=True)
class LawResult:
    """One law as it was fitted.

    Attributes
    ----------
    name, text : str
        As of the law.
    values : mapping of str to float
        Of its parameters, in SI.
    scatter : mapping of str to float
        From throw to throw, as a share of the value.
    parameters : int
        That were fitted, scatter among them.
    deviance : float
        Minus twice the logarithm of the likelihood.
    akaike, schwarz : float
        Information criteria with the effective number of samples; the least is best.
    slight : bool
        Whether all that it has beyond the plain law is too little to matter.
    """

    name: str
    text: str
    values: Mapping[str, float]
    scatter: Mapping[str, float]
    parameters: int
    deviance: float
    akaike: float
    schwarz: float
    slight: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class LawComparison:
    """What came of a comparison.

    Attributes
    ----------
    drive : str
        Name of the drive whose laws are compared, such as "2".
    nominal : float
        Slip level that the panel states [N].
    movements : tuple of str
        Those that were fitted.
    samples : float
        Independent ones among them.
    results : tuple of LawResult
        One a law, the plain one first.
    """

    drive: str
    nominal: float
    movements: tuple[str, ...]
    samples: float
    results: tuple[LawResult, ...]

    @property
    def plain(self) -> LawResult:
        """The bilinear law."""
        return self.results[0]

    @property
    def best(self) -> LawResult:
        """The law that the data support: the plain one unless another is decisively better."""
        other = min((r for r in self.results if not r.slight), key=lambda item: item.schwarz)
        better = min(self.plain.schwarz - other.schwarz, self.plain.akaike - other.akaike)
        return other if better > DECISIVE else self.plain

    @property
    def rejected(self) -> tuple[LawResult, ...]:
        """Laws that are decisively worse than the best."""
        return tuple(r for r in self.results if r.schwarz - self.best.schwarz > DECISIVE)


def compare_laws(
    dataset: xr.Dataset,
    panel: LoadedPanel,
    calibration: Calibration,
    *,
    drive: str,
    evaluator: Evaluator,
    report: Callable[[int, int], None] | None = None,
) -> LawComparison:
    """Fit friction, stiffness and slip level of a drive with each law, and compare the fits.

    Noise, what a law misses and how long that hangs together are estimated with each law; each law
    is judged with the likeliest of these estimates, so that none is judged by what another one
    misses.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `build_campaign`, with dimensions movement and time.
    panel : LoadedPanel
        As it was before the calibration.
    calibration : Calibration
        Where the fits start; what they do not change keeps its value.
    drive : str
        Drive whose law is compared.
    evaluator : Evaluator
        Open; throws the same panel.
    report : callable, optional
        Called with laws fitted and laws in all.

    Raises
    ------
    PanelError
        When there is no such drive.
    MeasurementError
        When the campaign has no closing movement with an object.
    """
    drive_laws(panel, drive)
    movements = _select_movements(
        observe(dataset, panel), panel, source=str(dataset.attrs.get("title", ""))
    )
    fits = fitted_laws(
        as_found(movements, calibration.objects),
        panel,
        calibration,
        drive=drive,
        evaluator=evaluator,
        report=report,
    )
    results, samples = law_results(fits)
    return LawComparison(
        drive=drive,
        nominal=panel.drive[drive].saturation_force,
        movements=tuple(item.name for item in movements),
        samples=samples,
        results=results,
    )


@one_blas_thread()
def fitted_laws(
    movements: tuple[MeasuredMovement, ...],
    panel: LoadedPanel,
    calibration: Calibration,
    *,
    drive: str,
    evaluator: Evaluator,
    report: Callable[[int, int], None] | None = None,
) -> list[LawFit]:
    """Fit each law to the same movements and to the same end, the plain one first.

    All that the calibration fitted is fitted again, other drives included: what
    another value there would explain is no sign of another law.

    Raises
    ------
    PanelError
        When there is no such drive.
    SolverError
        When a movement cannot be simulated.
    """
    laws = drive_laws(panel, drive)
    noise = floored(measured_noise(movements), movements)
    known = _parameters(calibration, panel, drive)
    misfits = [_misfit(law, known, movements, noise, evaluator, drive) for law in laws]
    fits: list[LawFit] = []
    for number, (law, misfit) in enumerate(zip(laws, misfits, strict=True)):
        if report is not None:
            report(number, len(laws))
        vary = [item for item in misfit.parameters if item.vary]
        if not fits:
            fits.append(fitted_plain(law, misfit, vary))
        elif law.name != BOTH:
            fits.append(fitted_variant(law, misfit, vary, plain=fits[0].found, drive=drive))
        else:
            scores = [score for score, _ in _scores(fits)]
            fits[0], scores[0] = _refit_plain(fits, scores, misfits[0])
            # Two defects are looked for where one of them shows.
            gains = {
                item.law.name: scores[0] - score for item, score in zip(fits, scores, strict=True)
            }
            if max(gains[WORN], gains[SOFT]) > DECISIVE:
                fits.append(fitted_variant(law, misfit, vary, plain=fits[0].found, drive=drive))
    return fits


def _scores(fits: Sequence[LawFit]) -> list[tuple[float, int]]:
    """Return the least deviance of each law under any state of noise, and which state that is."""
    noises = [item.found.misfit.comparison.noise for item in fits]
    return [
        min((deviance(item.found, noise), number) for number, noise in enumerate(noises))
        for item in fits
    ]


def _refit_plain(
    fits: Sequence[LawFit], scores: Sequence[float], misfit: Misfit
) -> tuple[LawFit, float]:
    """Return the plain law fitted from where a likelier law ended, if that is better.

    Else a law that happened to end nearer would win by what the plain one could as well.
    """
    number = int(np.argmin(scores))
    if number == 0:
        return fits[0], scores[0]
    again = fitted_from(fits[0], misfit, fits[number].found)
    before, after = (score for score, _ in _scores([fits[0], again]))
    return (again, after) if after < before else (fits[0], scores[0])


@one_blas_thread()
def law_results(fits: Sequence[LawFit]) -> tuple[tuple[LawResult, ...], float]:
    """Return the laws as they are judged, and how many independent samples judge them."""
    scores = _scores(fits)
    best = min(range(len(fits)), key=lambda number: scores[number][0])
    judge = fits[scores[best][1]].found.misfit.comparison.noise
    samples = effective_samples(fits[best].found, judge)
    results = []
    for item, score in zip(fits, scores, strict=True):
        law, value = item.law, score[0]
        values = {name: item.found.values[name] for name in item.names}
        # Without its extra a law is the plain one, so it is never less likely than that.
        if law.extra and not law.scatter and scores[0][0] < value:
            value = scores[0][0]
            values = {name: fits[0].found.values[name] for name in fits[0].names}
            values |= {extra.name: extra.lower for extra in law.extra}
        count = len(item.names) + len(law.scatter)
        akaike, schwarz = criteria(value, parameters=count, samples=samples)
        scatter = item.found.misfit.comparison.scatter
        results.append(
            LawResult(
                name=law.name,
                text=law.text,
                values=values,
                scatter={name: scatter[name] for name in law.scatter},
                parameters=count,
                deviance=value,
                akaike=akaike,
                schwarz=schwarz,
                slight=is_slight(law, values),
            )
        )
    return tuple(results), samples


def _select_movements(
    movements: Sequence[MeasuredMovement], panel: LoadedPanel, *, source: str
) -> tuple[MeasuredMovement, ...]:
    """Return closing movements: a few without an object, more with one."""
    free = selected(movements, Selection(objects="none", direction="closing", most=FREE), panel)
    trapped = selected(
        movements, Selection(objects="any", direction="closing", most=OBJECTS), panel
    )
    if not trapped:
        problem = "no closing movement with an object, so laws of a drive cannot be compared"
        raise MeasurementError([problem], source=source)
    return (*free, *trapped)


def _misfit(
    law: DriveLaw,
    known: Sequence[Parameter],
    movements: tuple[MeasuredMovement, ...],
    noise: Mapping[Key, Noise],
    evaluator: Evaluator,
    drive: str,
) -> Misfit:
    scatter = {p.name: FRICTION_SCATTER for p in known if p.name.endswith(FRICTION)}
    parameters = (*known, *law.extra)
    return Misfit(
        evaluator=evaluator,
        parameters=parameters,
        base={item.name: item.start for item in parameters},
        movements=movements,
        comparison=Comparison(noise=noise, scatter={**scatter, **law.scatter}),
        law=law.law,
        shape=law.shape,
        always=(level_key(drive), *(item.name for item in law.extra)) if law.extra else (),
    )


def _parameters(calibration: Calibration, panel: LoadedPanel, drive: str) -> list[Parameter]:
    """Return the parameters of a calibration at its values, stiffness and level among them."""
    found = [
        Parameter(
            name=item.name,
            keys=item.keys,
            start=item.value,
            lower=item.lower,
            upper=item.upper,
            unit=item.unit,
            vary=item.state != FIXED,
            transform="log" if item.lower > 0 else "linear",
        )
        for item in calibration.parameters
        if item.keys
    ]
    record = panel.drive[drive]
    for key, value, unit in (
        (stiffness_key(drive), record.stiffness, "N/m"),
        (level_key(drive), record.saturation_force, "N"),
    ):
        if key not in {item.name for item in found}:
            low, high = 0.1 * value, 10.0 * value
            found.append(
                Parameter(name=key, keys=(key,), start=value, lower=low, upper=high, unit=unit)
            )
    return found


def law_lines(found: LawComparison) -> list[str]:
    """Return a comparison as lines for the screen, the verdict first."""
    best, plain = found.best, found.plain
    lines = [f"drive {found.drive}: the data support the law '{best.name}': {best.text}"]
    if best is plain:
        lines[0] += "; no other law is decisively better"
    else:
        gain = plain.schwarz - best.schwarz
        lines[0] += f"; the bilinear law is rejected (BIC {gain:.0f} higher)"
    level = best.values[level_key(found.drive)]
    share = best.scatter.get(level_key(found.drive))
    excess = 100.0 * (level / found.nominal - 1.0)
    side = "above" if excess > 0 else "below"
    lines.append(
        f"  slips at {level / 1e3:.2f} kN, {abs(excess):.1f} % {side} the stated "
        f"{found.nominal / 1e3:g} kN"
        + (f", scattering by {100 * share:.1f} % from throw to throw" if share else "")
    )
    for item in found.results:
        extra = ", ".join(f"{n} = {v:.3g}" for n, v in item.values.items() if "." not in n)
        mark = "rejected" if item in found.rejected else ("chosen" if item is best else "possible")
        if item.slight:
            mark = "no more than the bilinear law"
        lines.append(
            f"  {item.name:<44} AICc {item.akaike - best.akaike:+8.1f}  "
            f"BIC {item.schwarz - best.schwarz:+8.1f}  {mark}{'  ' + extra if extra else ''}"
        )
    lines.append(
        f"  from {len(found.movements)} movements worth {found.samples:.0f} independent samples; "
        f"decisive from a difference of {DECISIVE:g} on"
    )
    return lines
