"""Fit each law that a drive may follow, and tell which one the measurement wants."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import xarray as xr

from turnout.errors import MeasurementError
from turnout.panel.load import LoadedPanel
from turnout.study.calibration.evaluate import Evaluator
from turnout.study.calibration.misfit import Misfit
from turnout.study.calibration.noise import Noise, measured_noise
from turnout.study.calibration.observed import Movement, observe, selected
from turnout.study.calibration.parameter import Parameter
from turnout.study.calibration.record import Calibration
from turnout.study.calibration.stage import Selection
from turnout.study.calibration.view import Comparison, Key
from turnout.study.discrepancy.descent import (
    Descent,
    criteria,
    descended,
    deviance,
    effective_samples,
    floored,
    learned_noise,
)
from turnout.study.discrepancy.laws import DriveLaw, drive_laws, level_key, stiffness_key

# "Very strong" evidence (Kass and Raftery 1995, doi 10.1080/01621459.1995.10476572, section 3.2).
DECISIVE = 10.0
FRICTION, FRICTION_SCATTER = "friction_coefficient", 0.02
FREE, OBJECTS = 2, 7


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
    """

    name: str
    text: str
    values: Mapping[str, float]
    scatter: Mapping[str, float]
    parameters: int
    deviance: float
    akaike: float
    schwarz: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LawComparison:
    """What came of a comparison.

    Attributes
    ----------
    drive : str
        Whose law.
    nominal : float
        Slip level that the panel states [N].
    movements : tuple of str
        Those that were fitted.
    samples : float
        Independent ones among them.
    results : tuple of LawResult
        The plain law first.
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
        """The law that the data want: the plain one unless another is decisively better."""
        other = min(self.results, key=lambda item: item.schwarz)
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
    is judged with whichever of these estimates makes it likeliest, so that none is judged by what
    another one misses.

    Parameters
    ----------
    dataset : xarray.Dataset
        A built campaign.
    panel : LoadedPanel
        As it was before the calibration.
    calibration : Calibration
        Where the fits start; what they do not change keeps its value.
    drive : str
        Whose law is asked for.
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
    laws = drive_laws(panel, drive)
    movements = _chosen(observe(dataset, panel), panel, source=str(dataset.attrs.get("title", "")))
    noise = floored(measured_noise(movements), movements)
    known = _parameters(calibration, panel, drive)
    fits: list[Descent] = []
    for number, law in enumerate(laws):
        if report is not None:
            report(number, len(laws))
        # Other laws begin where the plain one ended, so that equal throws are made once.
        start = {p.name: p.start for p in (*known, *law.extra)} | (fits[0].values if fits else {})
        fits.append(_fitted(law, known, start, movements, noise, evaluator, drive))
    noises = [learned_noise(item, noise) for item in fits]
    scores = [min((deviance(item, n), number) for number, n in enumerate(noises)) for item in fits]
    best = min(range(len(fits)), key=lambda number: scores[number][0])
    samples = effective_samples(fits[best], noises[scores[best][1]])
    results = []
    for law, own, score in zip(laws, fits, scores, strict=True):
        value = score[0]
        values = {name: own.values[name] for name in own.names}
        # Without its extra a law is the plain one, so it is never less likely than that.
        if law.extra and not law.scatter and scores[0][0] < value:
            value = scores[0][0]
            values = {name: fits[0].values[name] for name in fits[0].names}
            values |= {item.name: item.lower for item in law.extra}
        count = len(own.names) + len(law.scatter)
        akaike, schwarz = criteria(value, parameters=count, samples=samples)
        results.append(
            LawResult(
                name=law.name,
                text=law.text,
                values=values,
                scatter={name: own.misfit.comparison.scatter[name] for name in law.scatter},
                parameters=count,
                deviance=value,
                akaike=akaike,
                schwarz=schwarz,
            )
        )
    return LawComparison(
        drive=drive,
        nominal=panel.drive[drive].saturation_force,
        movements=tuple(item.name for item in movements),
        samples=samples,
        results=tuple(results),
    )


def _chosen(
    movements: Sequence[Movement], panel: LoadedPanel, *, source: str
) -> tuple[Movement, ...]:
    """Return closing movements: a few without an object, more with one."""
    free = selected(movements, Selection(objects="none", direction="closing", most=FREE), panel)
    trapped = selected(
        movements, Selection(objects="any", direction="closing", most=OBJECTS), panel
    )
    if not trapped:
        problem = "no closing movement with an object, so laws of a drive cannot be told apart"
        raise MeasurementError([problem], source=source)
    return (*free, *trapped)


def _fitted(
    law: DriveLaw,
    known: Sequence[Parameter],
    start: Mapping[str, float],
    movements: tuple[Movement, ...],
    noise: Mapping[Key, Noise],
    evaluator: Evaluator,
    drive: str,
) -> Descent:
    own = (stiffness_key(drive), level_key(drive))
    vary = [p for p in known if p.name in own or p.name.endswith(FRICTION)] + list(law.extra)
    scatter = {p.name: FRICTION_SCATTER for p in known if p.name.endswith(FRICTION)}
    misfit = Misfit(
        evaluator=evaluator,
        parameters=(*known, *law.extra),
        base=start,
        movements=movements,
        comparison=Comparison(noise=noise, scatter={**scatter, **law.scatter}),
        law=law.law,
        shape=law.shape,
    )
    return descended(misfit, vary, start)


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
            transform="log" if item.lower > 0 else "linear",
        )
        for item in calibration.parameters
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
