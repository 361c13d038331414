"""Starts of a fit: near by, or in several places where stages were skipped."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from turnout.calibration.causes import (
    CAUSE_STEPS,
    CLEARLY,
    LEFT_MISSED,
    LESS_MISSED,
    is_worth_a_search,
    missed_share,
)
from turnout.calibration.fit import Fit, brief_fit, fit, update_movement_effects
from turnout.calibration.grid_search import misfit_share, other_minima, sweep
from turnout.calibration.measured_movements import MeasuredMovement
from turnout.calibration.misfit import Misfit
from turnout.calibration.objects import THICKER, thickness_name
from turnout.calibration.parameter import Parameter, coordinates, values_at
from turnout.core.errors import SolverError

# How often movements that join a fit are thrown at their own values before it goes on.
OWN_PASSES = 2
# Rounds of a first fit that misses something at most.
FIRST_ROUNDS = 3


def starts_of(
    misfit: Misfit,
    skipped: Sequence[tuple[Parameter, Sequence[float]]],
    parameters: Sequence[Parameter],
    values: Mapping[str, float],
) -> list[dict[str, float]]:
    """Return values in which those of skipped stages start at the best of their grid, and others.

    No stage has brought them near: from twice the true stiffness a fit follows causes instead. A
    grid is searched while other parameters are still off, so several are searched twice, and where
    one has another minimum that is nearly as deep, a fit starts there too.

    Parameters
    ----------
    misfit : Misfit
        Movements of the present stage.
    skipped : sequence of (Parameter, sequence of float)
        Parameters of skipped stages with their grids.
    parameters : sequence of Parameter
        Of the present stage.
    values : mapping of str to float
        Where earlier stages ended.

    Returns
    -------
    list of dict of str to float
        The likeliest first; the values as they are where nothing was skipped.
    """
    best, others = dict(values), list[dict[str, float]]()
    own = [(parameter, grid) for parameter, grid in skipped if parameter in parameters]
    for last in (False, True) if len(own) > 1 else (True,):
        for parameter, grid in own:
            tried = sorted({*grid, best[parameter.name]})
            searched = sweep(replace(misfit, quick=True), parameter, tried, best)
            best = dict(searched.values)
            if last:
                minima = other_minima(searched.grid, searched.misfit)
                others += [{**best, parameter.name: value} for value in minima]
    return [best, *others]


def nearest_fit(
    misfit: Misfit,
    parameters: Sequence[Parameter],
    starts: Sequence[Mapping[str, float]],
    *,
    on_step: Callable[[float], None] | None = None,
) -> Fit:
    """Fit roughly from each start, and return the fit that leaves least.

    Parameters
    ----------
    misfit, parameters
        As of `fit`.
    starts : sequence of mapping of str to float
        Of all parameters.
    on_step : callable, optional
        As of `fit`.
    """
    found = [fit(misfit, parameters, start, rough=True, on_step=on_step) for start in starts]
    return min(found, key=lambda item: misfit_share(item.misfit, item.local.simulated))


def with_thicker(
    misfit: Misfit, near: Fit, *, on_step: Callable[[float], None] | None = None
) -> Fit:
    """Return a rough fit of objects that are thicker or thinner by more, where that leaves less.

    Each thickness is thrown, with all other values adjusted to first order: whether a drive slips
    may change on the way, which no slope shows.

    Parameters
    ----------
    misfit : Misfit
        Before any fit.
    near : Fit
        Rough, of that misfit.
    on_step : callable, optional
        As of `fit`.
    """
    names = [item.name for item in near.parameters]
    if thickness_name() not in names:
        return near
    own = names.index(thickness_name())
    J = np.delete(near.jacobian, own, axis=1)
    others = [item for item in near.parameters if item.name != thickness_name()]
    tried = [(near.cost, near.values)]
    points = [{**near.values, thickness_name(): value} for value in THICKER]
    for point, row in zip(points, near.misfit.responses(points), strict=True):
        r = near.misfit.residuals_of(row, near.frame)
        if np.isfinite(r).all():
            step = np.linalg.lstsq(J, -r, rcond=None)[0]
            left = r + J @ step
            there = values_at(others, coordinates(others, point) + step)
            tried.append((float(left @ left), {**point, **there}))
    _, values = min(tried, key=lambda item: item[0])
    if values is near.values:
        return near
    again = fit(misfit, near.parameters, values, rough=True, on_step=on_step)
    return min((near, again), key=lambda item: misfit_share(item.misfit, item.local.simulated))


def with_movements(near: Fit, movements: Sequence[MeasuredMovement]) -> Fit:
    """Return a rough fit of some movements as one of more, each with its own values.

    Parameters
    ----------
    near : Fit
        Of some of the movements.
    movements : sequence of MeasuredMovement
        Of the fit that goes on.
    """
    if tuple(movements) == near.misfit.movements:
        return near
    places = {item.name: number for number, item in enumerate(near.misfit.movements)}
    effects = {
        name: tuple(row[places[item.name]] if item.name in places else 0.0 for item in movements)
        for name, row in near.misfit.effects.items()
    }
    misfit = replace(near.misfit, movements=tuple(movements), effects=effects)
    # Before slopes of all parameters are thrown where these movements then are not.
    local = misfit.local(near.values, ())
    misfit, local, _ = update_movement_effects(misfit, local, (), passes=OWN_PASSES)
    return replace(near, misfit=misfit, local=replace(local, stepped={}))


def first_fit(
    start: Misfit,
    parameters: Sequence[Parameter],
    near: Fit,
    found: Fit,
    *,
    on_step: Callable[[float], None] | None = None,
) -> Fit:
    """Fit from where quick throws led, to see what a model misses.

    Slopes of quick throws lead there where nothing is missed; else those of plain ones, with little
    of what is missed as noise, as long as that helps: a model that lacks nothing leaves it.

    Parameters
    ----------
    start : Misfit
        With the noise of the measurement.
    parameters : sequence of Parameter
        The free ones.
    near, found : Fit
        By quick throws, and by plain ones at its values.
    on_step : callable, optional
        As of `fit`.
    """
    first = brief_fit(start, parameters, near.values, near=found, passes=1, on_step=on_step)
    before = replace(first, local=replace(first.local, stepped={}))
    for _ in range(FIRST_ROUNDS):
        if not is_worth_a_search(first):
            break
        again = brief_fit(
            start,
            parameters,
            before.values,
            near=before,
            share=LEFT_MISSED,
            passes=1,
            steps=CAUSE_STEPS,
            on_step=on_step,
        )
        goes_on = missed_share(again) <= LESS_MISSED * missed_share(first)
        first = before = again
        if not goes_on:
            break
    if not is_worth_a_search(first, share=CLEARLY):
        return first
    return _gone_to_its_end(start, parameters, found, on_step) or first


def _gone_to_its_end(
    start: Misfit,
    parameters: Sequence[Parameter],
    found: Fit,
    on_step: Callable[[float], None] | None,
) -> Fit | None:
    """Return a fit to its end if that misses no more than another solver would.

    Where values and each movement's friction are off together, brief fits leave that so slowly that
    the model seems to lack something, and causes that are not there would be taken up.
    """
    try:
        whole = fit(start, parameters, found.values, near=found, refined=False, on_step=on_step)
    except SolverError:
        return None
    return None if is_worth_a_search(whole) else whole
