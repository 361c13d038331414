"""Why a model does not follow: likely causes, each tested by a fit with one more parameter.

A cause is a parameter that the panel does not have, or that a calibration usually takes as known: a
recorder that averages, a bushing that is soft at first, rails of another stiffness, friction that
rises along the switch, a slip level of its own in each throw. Each is tried at a few sizes, with
the other values adjusted to first order, and judged by the Bayesian information criterion. One that
is decisively better is fitted together with all values, so that they are freed of its effect.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.candidate_causes import Cause, candidate_causes
from turnout.calibration.drive_law.candidates import level_key
from turnout.calibration.drive_law.fit_law import END, criteria
from turnout.calibration.evaluate import Response
from turnout.calibration.fit import Fit, fit
from turnout.calibration.measured_movements import OBJECT_FORCE
from turnout.calibration.misfit import Frame, Misfit, framed, jacobian
from turnout.calibration.noise import peaks_of
from turnout.calibration.parameter import Parameter
from turnout.calibration.predict import predicted
from turnout.calibration.sensors import found_gains
from turnout.calibration.shared import effective_samples, model_error
from turnout.errors import SolverError
from turnout.panel.load import LoadedPanel

Floats = NDArray[np.float64]
# Where a model misses less than this share of a channel's peak, no cause is looked for [-].
WORTH = {OBJECT_FORCE: 0.02}
WORTH_DRIVE = 1.5e-3
# Difference of the criterion from which on a cause is fitted, how many are taken up at most, and
# how many are fitted in turn until one is.
DECISIVE, MOST_CAUSES, ATTEMPTS = 10.0, 3, 2
# What a fit with a cause may miss at most, as a share of what one without it does [-].
LESS_MISSED = 0.85
# How often the levels of the movements are estimated again in a trial.
LEVEL_PASSES = 2
# A drive slips within this share of its level, over so many bins; a level of a movement is no
# further off [-].
SLIPS, LEAST_SLIPPING, FURTHEST_LEVEL = 0.005, 3, 0.25
# A drive that reaches the first share of its level, and is measured below the second share of
# that, has slipped at less [-].
NEARLY, LOWER = 0.85, 0.98


@dataclass(frozen=True, slots=True, kw_only=True)
class TestedCause:
    """How well a cause explains what the model misses.

    Attributes
    ----------
    name, text : str
        Of the cause, at its likeliest size.
    size : float
        In the unit of its parameter; NaN where each movement has its own.
    gain : float
        By how much it lowers the Bayesian information criterion [-].
    fitted : bool
        Whether it was fitted together with all values.
    """

    name: str
    text: str
    size: float
    gain: float
    fitted: bool = False

    @property
    def line(self) -> str:
        """Return the cause as a line for the screen."""
        state = "fitted with the values" if self.fitted else "possible"
        return f"{self.name}: {self.text} ({state}, BIC {self.gain:.0f} lower)"


def is_worth_a_search(found: Fit) -> bool:
    """Return whether a model misses more of a channel than another solver would, or by its gain."""
    if any(item.leaves for item in found_gains(found)):
        return True
    comparison = found.misfit.comparison
    return any(
        model_error(comparison, key)
        > max(WORTH.get(key[0], WORTH_DRIVE) * peak, 1.5 * comparison.noise[key].white)
        for key, peak in peaks_of(found.misfit.movements).items()
    )


def with_causes(
    found: Fit, first: Misfit, panel: LoadedPanel, *, on_step: Callable[[float], None] | None = None
) -> tuple[Fit, tuple[TestedCause, ...]]:
    """Test the causes of what a fit misses, and fit the decisive ones together with all values.

    Parameters
    ----------
    found : Fit
        Where the fit without them ended.
    first : Misfit
        As it began: with the noise of the measurement.
    panel : LoadedPanel
        That is thrown.
    on_step : callable, optional
        As of `fit`.

    Returns
    -------
    Fit, tuple of TestedCause
        The fit with all causes that were taken up; these and the others that explain something, the
        likeliest first.
    """
    taken: list[TestedCause] = []
    tested: list[TestedCause] = []
    left = candidate_causes(panel, found.parameters)
    while is_worth_a_search(found) and len(taken) < MOST_CAUSES:
        trials = [(_tested(found, cause), cause) for cause in left]
        trials.sort(key=lambda pair: -pair[0].gain)
        tested = [trial for trial, _ in trials if trial.gain > DECISIVE]
        fitted = _first_that_helps(found, first, trials[: min(len(tested), ATTEMPTS)], on_step)
        if fitted is None:
            break
        found, best, cause = fitted
        first = _carried_over(first, found, cause)
        size = found.values[cause.parameter.name] if cause.parameter else float("nan")
        taken.append(replace(best, size=size, text=cause.text(size), fitted=True))
        left = tuple(item for item in left if item.name != cause.name or _is_other(item, cause))
    names = {item.name for item in taken}
    return found, (*taken, *(item for item in tested if item.name not in names))


def _first_that_helps(
    found: Fit,
    first: Misfit,
    trials: Sequence[tuple[TestedCause, Cause]],
    on_step: Callable[[float], None] | None,
) -> tuple[Fit, TestedCause, Cause] | None:
    """Fit with the likeliest causes in turn until one makes the model miss less."""
    for best, cause in trials:
        try:
            again = _fitted_with(found, first, cause, best, on_step=on_step)
        except SolverError:
            continue
        if _missed(again) <= LESS_MISSED * _missed(found):
            return again, best, cause
    return None


def _carried_over(first: Misfit, found: Fit, cause: Cause) -> Misfit:
    """Return the misfit that fits begin with, with a cause that was taken up."""
    scatter = {**first.comparison.scatter, **cause.scatter}
    return replace(
        first,
        parameters=found.misfit.parameters,
        law=found.misfit.law,
        shape=found.misfit.shape,
        always=found.misfit.always,
        comparison=replace(first.comparison, scatter=scatter),
    )


def _is_other(item: Cause, taken: Cause) -> bool:
    """Return whether a cause of the same name may still be added to one that was taken up."""
    return item is not taken and taken.name in ("friction by chair", "clutch")


def _missed(found: Fit) -> float:
    """Return what a fit misses of all channels, as shares of their peaks [-]."""
    comparison = found.misfit.comparison
    return sum(
        model_error(comparison, key) / max(peak, 1.0)
        for key, peak in peaks_of(found.misfit.movements).items()
    )


def with_cause(misfit: Misfit, cause: Cause) -> Misfit:
    """Return a misfit with a cause beside those that it has."""
    law, shape = misfit.law, misfit.shape
    if cause.law is not None:
        one, other = misfit.law, cause.law
        law = other if one is None else (lambda values: {**one(values), **other(values)})
    if cause.shape is not None:
        before, after = misfit.shape, cause.shape
        shape = (
            after
            if before is None
            else (lambda response, values: after(before(response, values), values))
        )
    parameter = cause.parameter
    if parameter is None:
        return replace(
            misfit,
            comparison=replace(
                misfit.comparison, scatter={**misfit.comparison.scatter, **cause.scatter}
            ),
        )
    always = misfit.always if parameter.keys else (*misfit.always, parameter.name)
    return replace(
        misfit,
        parameters=(*misfit.parameters, parameter),
        base={**misfit.base, parameter.name: parameter.start},
        law=law,
        shape=shape,
        always=always,
    )


def _tested(found: Fit, cause: Cause) -> TestedCause:
    """Try a cause at its sizes, with all values adjusted to first order."""
    misfit = _judging(with_cause(found.misfit, cause))
    before = _judging(found.misfit)
    frame = framed(found.local, before)
    samples = effective_samples(frame.alignments, before.comparison)
    plain = _adjusted(found, before, frame)
    results = []
    if cause.parameter is None:
        drive = next(iter(cause.scatter)).split(".")[1]
        results.append((_with_own_levels(found, misfit, drive), float("nan")))
    else:
        points = [{**found.values, cause.parameter.name: size} for size in cause.tries]
        for size, row in zip(cause.tries, misfit.responses(points), strict=True):
            if any(item.failure for item in row):
                continue
            if cause.smooth:
                results.append(_along(found, before, frame, row, cause.parameter, size))
                continue
            local = replace(found.local, simulated=tuple(row))
            results.append((_adjusted(found, misfit, framed(local, misfit), row), size))
    best, size = min(results, default=(plain, float("nan")))
    gain = criteria(plain, parameters=0, samples=samples)[1]
    gain -= criteria(best, parameters=1, samples=samples)[1]
    return TestedCause(name=cause.name, text=cause.text(size), size=size, gain=gain)


def _judging(misfit: Misfit) -> Misfit:
    """Return a misfit in which all that the model misses is noise of each movement."""
    comparison = misfit.comparison
    noise = {
        key: replace(item, missed=model_error(comparison, key))
        for key, item in comparison.noise.items()
    }
    return replace(
        misfit,
        comparison=replace(comparison, noise=noise, discrepancy={}, outlier_limit=float("inf")),
    )


def _adjusted(
    found: Fit, misfit: Misfit, frame: Frame, responses: Sequence[Response] | None = None
) -> float:
    """Return minus twice the log-likelihood with all values adjusted to first order."""
    rows = found.local.simulated if responses is None else responses
    residuals = misfit.residuals_of(rows, frame)
    J = jacobian(found.local, frame, [item.name for item in found.parameters])
    step = np.linalg.lstsq(J, -residuals, rcond=None)[0]
    rest = residuals + J @ step
    return float(rest @ rest) + _log_determinant(frame)


def _along(
    found: Fit,
    misfit: Misfit,
    frame: Frame,
    responses: Sequence[Response],
    parameter: Parameter,
    size: float,
) -> tuple[float, float]:
    """Return what `_adjusted` does where a cause is adjusted to first order too, and its size."""
    residuals = misfit.residuals_of(found.local.simulated, frame)
    column = misfit.residuals_of(responses, frame) - residuals
    J = jacobian(found.local, frame, [item.name for item in found.parameters])
    whole = np.column_stack([J, column])
    step = np.linalg.lstsq(whole, -residuals, rcond=None)[0]
    start = found.values.get(parameter.name, parameter.start)
    likeliest = start + float(step[-1]) * (size - start)
    reached = min(max(likeliest, parameter.lower), parameter.upper)
    share = (reached - start) / (size - start)
    plain = residuals + share * column
    rest = plain + J @ np.linalg.lstsq(J, -plain, rcond=None)[0]
    return float(rest @ rest) + _log_determinant(frame), reached


def _log_determinant(frame: Frame) -> float:
    """Return the part of the log-likelihood that nuisances and shared directions have."""
    total = -sum(2.0 * float(np.log1p(-item.shrink).sum()) for item in frame.alignments)
    return total + (frame.shared.log_determinant if frame.shared else 0.0)


def _with_own_levels(found: Fit, misfit: Misfit, drive: str) -> float:
    """Return what `_adjusted` does with the slip level of each movement where it slips."""
    effects, least = own_levels(found, drive), float("inf")
    name = level_key(drive)
    for _ in range(LEVEL_PASSES):
        misfit = replace(misfit, effects=effects)
        row = misfit.responses([found.values])[0]
        if any(item.failure for item in row):
            break
        frame = framed(replace(found.local, simulated=tuple(row)), misfit)
        least = min(least, _adjusted(found, misfit, frame, row))
        estimates = [a.estimates.get(name, (0.0, 0.0))[0] for a in frame.alignments]
        effects = {**effects, name: tuple(np.clip(estimates, -FURTHEST_LEVEL, FURTHEST_LEVEL))}
    return least


def own_levels(found: Fit, drive: str) -> dict[str, tuple[float, ...]]:
    """Return the effects of a fit with a slip level for each movement that slips.

    Where the simulated drive slips, measured over simulated force is how far the level is off.
    Where it does not quite, a smaller measured peak is a level that the movement has reached. Any
    other movement says nothing of it and keeps its own.
    """
    name = level_key(drive)
    shares = []
    for number, (alignment, response) in enumerate(
        zip(found.frame.alignments, found.local.simulated, strict=True)
    ):
        before = found.misfit.effect(name, number)
        level = found.values[name] * (1.0 + before)
        share = before
        for signal, bins in alignment.parts:
            if (signal.channel, signal.drive) != ("drive_force", drive):
                continue
            shift = alignment.shift
            model = np.abs(predicted(response, alignment.movement, signal, bins, shift=shift))
            seen = np.abs(signal.values[bins])
            slips = model > (1.0 - SLIPS) * level
            if slips.sum() >= LEAST_SLIPPING:
                share = (1.0 + before) * float(np.median(seen[slips] / model[slips])) - 1.0
            elif NEARLY * level < model.max() and seen.max() < LOWER * model.max():
                share = (1.0 + before) * float(seen.max() / level) - 1.0
        shares.append(float(np.clip(share, -FURTHEST_LEVEL, FURTHEST_LEVEL)))
    return {**found.misfit.effects, name: tuple(shares)}


def _fitted_with(
    found: Fit,
    first: Misfit,
    cause: Cause,
    best: TestedCause,
    *,
    on_step: Callable[[float], None] | None,
) -> Fit:
    """Fit all values together with a cause, from where both are."""
    values = dict(found.values)
    vary = list(found.parameters)
    effects = dict(found.misfit.effects)
    if cause.parameter is None:
        effects = own_levels(found, next(iter(cause.scatter)).split(".")[1])
    else:
        values[cause.parameter.name] = best.size
        vary.append(cause.parameter)
    misfit = replace(with_cause(first, cause), base=values)
    start = replace(
        found,
        values=values,
        misfit=replace(misfit, effects=effects),
        local=replace(found.local, stepped={}),
    )
    return fit(misfit, vary, values, near=start, on_step=on_step, **END)
