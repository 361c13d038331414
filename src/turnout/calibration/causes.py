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
from turnout.calibration.cause_trials import TestedCause, cause_trials, own_levels, with_cause
from turnout.calibration.fit import Fit, brief_fit
from turnout.calibration.measured_movements import OBJECT_FORCE
from turnout.calibration.misfit import Misfit
from turnout.calibration.noise import peaks_of
from turnout.calibration.sensors import found_gains
from turnout.calibration.shared import model_error
from turnout.errors import SolverError
from turnout.panel.load import LoadedPanel

Floats = NDArray[np.float64]
# Where a model misses less than this share of a channel's peak, no cause is looked for [-].
WORTH = {OBJECT_FORCE: 0.02}
WORTH_DRIVE = 1.5e-3
# Difference of the criterion from which on a cause is fitted, how many are taken up at most, and
# how many are fitted in turn until one is.
DECISIVE, MOST_CAUSES, ATTEMPTS = 10.0, 3, 3
# What a fit with a cause may miss at most, as a share of what one without it does [-].
LESS_MISSED = 0.85


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CauseSearch:
    """What a search for causes came to.

    Attributes
    ----------
    found : Fit
        With all causes that were taken up; near its end.
    first : Misfit
        As a fit with them begins: with the noise of the measurement.
    tested : tuple of TestedCause
        Those that were taken up, and others that explain something, the likeliest first.
    misses : bool
        Whether the model still misses more than other solvers would.
    """

    found: Fit
    first: Misfit
    tested: tuple[TestedCause, ...]
    misses: bool


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
) -> CauseSearch:
    """Test the causes of what a fit misses, and fit the decisive ones together with all values.

    All fits are brief: what a cause explains is seen long before a fit has converged, and one that
    lacks its cause converges slowly.

    Parameters
    ----------
    found : Fit
        Where a brief fit without them ended.
    first : Misfit
        As it began: with the noise of the measurement.
    panel : LoadedPanel
        That is thrown.
    on_step : callable, optional
        As of `fit`.

    Returns
    -------
    CauseSearch
    """
    taken: list[TestedCause] = []
    tested: list[TestedCause] = []
    left = candidate_causes(panel, found.parameters)
    while (misses := is_worth_a_search(found)) and len(taken) < MOST_CAUSES:
        trials = cause_trials(found, left)
        tested = [trial for trial, _ in trials if trial.gain > DECISIVE]
        fitted = _first_that_helps(found, first, trials[: min(len(tested), ATTEMPTS)], on_step)
        if fitted is None:
            break
        found, best, cause = fitted
        first = with_cause(first, cause)
        sizes = tuple(found.values[item.name] for item in cause.parameters)
        taken.append(replace(best, sizes=sizes, text=cause.text(sizes), fitted=True))
        left = tuple(item for item in left if item.name != cause.name or _is_other(item, cause))
    names = {item.name for item in taken}
    others = [item for item in tested if item.name not in names]
    return CauseSearch(
        found=found, first=first, tested=(*taken, *_each_name_once(others)), misses=misses
    )


def _each_name_once(tested: Sequence[TestedCause]) -> list[TestedCause]:
    """Return the likeliest of each name, in their order."""
    return list({item.name: item for item in reversed(tested)}.values())[::-1]


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


def _is_other(item: Cause, taken: Cause) -> bool:
    """Return whether a cause of the same name may still be added to one that was taken up."""
    return item is not taken and taken.name in ("clutch", "drive law")


def _missed(found: Fit) -> float:
    """Return what a fit misses of all channels, as shares of their peaks [-]."""
    comparison = found.misfit.comparison
    return sum(
        model_error(comparison, key) / max(peak, 1.0)
        for key, peak in peaks_of(found.misfit.movements).items()
    )


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
    effects = dict(found.misfit.effects)
    if not cause.parameters:
        effects = own_levels(found, next(iter(cause.scatter)).split(".")[1])
    values |= {item.name: size for item, size in zip(cause.parameters, best.sizes, strict=True)}
    misfit = replace(with_cause(first, cause), base=values)
    scatter = {**found.misfit.comparison.scatter, **cause.scatter}
    kept = replace(misfit.comparison, noise=found.misfit.comparison.noise, scatter=scatter)
    start = replace(
        found,
        values=values,
        misfit=replace(misfit, comparison=kept, effects=effects),
        local=replace(found.local, stepped={}),
    )
    vary = (*found.parameters, *cause.parameters)
    return brief_fit(misfit, vary, values, near=start, on_step=on_step)
