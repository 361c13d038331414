"""Bounded nonlinear least squares on simulated movements (Levenberg-Marquardt).

Notation: theta coordinates of the parameters, r whitened residuals, J their Jacobian, lambda the
damping, cost :math:`r^T r`.

Noise is the model error where a fit starts, and what is left over where it ends.

Effects of each movement of its own, such as its friction, are estimated, and the movement is thrown
with them until they rest.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import hypot

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.comparison import (
    Comparison,
    Key,
    align,
    compared,
    missed_by_model,
    predicted,
)
from turnout.calibration.linearisation import (
    REACH,
    SAME_ROUGH_SLOPE,
    Linearisation,
    Thrown,
    bounded_step,
    reaches_of,
)
from turnout.calibration.measured_movements import BIN
from turnout.calibration.misfit import (
    Frame,
    Misfit,
    about_clock,
    framed,
    jacobian,
    remaining,
    slopes_of,
)
from turnout.calibration.shared import (
    CLEARLY,
    left_out,
    missing_more,
    shared_discrepancy,
    without_common,
)
from turnout.calibration.stages import (
    Parameter,
    coordinates,
    prior_residuals,
    values_at,
)
from turnout.core.errors import SolverError
from turnout.core.running_current import MAD_TO_SIGMA
from turnout.core.threads import one_blas_thread

Floats = NDArray[np.float64]
# How far an estimated effect may be from the simulated one, how often it is simulated again where
# it is further, by how much at most it then changes, and the largest effect [share].
SAME_EFFECT, EFFECT_PASSES, LONGEST_EFFECT_STEP, FURTHEST_EFFECT = 2e-3, 6, 0.04, 0.5


def update_movement_effects(
    misfit: Misfit, local: Linearisation, names: Sequence[str], *, passes: int
) -> tuple[Misfit, Linearisation, Frame]:
    """Simulate movements at their own values until these agree with the estimates.

    The response to a movement effect is linear over a part of a per cent only. Estimated from
    further away it would bias the common values, and its large residuals would count as noise.
    """
    frame = framed(local, misfit)
    for _ in range(passes):
        misfit = about_clock(misfit, frame)
        estimates = [
            {name: mean for name, (mean, _) in item.estimates.items()} for item in frame.alignments
        ]
        found = _clipped(misfit, frame, estimates)
        effects = _where_further(misfit, found)
        if effects == misfit.effects:
            break
        misfit = replace(misfit, effects=effects)
        local = replace(local, simulated=tuple(misfit.responses([local.values])[0]))
        frame = framed(local, misfit)
    misfit, before = about_clock(misfit, frame), local.stepped
    local = misfit.local_near(local.values, names, local)
    return misfit, local, frame if local.stepped is before else framed(local, misfit)


def effects_after(
    misfit: Misfit, local: Linearisation, frame: Frame, names: Sequence[str], step: Floats
) -> dict[str, tuple[float, ...]]:
    """Return the movement effects expected after a step of the common values."""
    slopes = slopes_of(local, frame, names)
    expected = [
        alignment.effects_from(alignment.measured - alignment.reduced(response) - slope @ step)
        for alignment, slope, response in zip(
            frame.alignments, slopes, local.simulated, strict=True
        )
    ]
    return _clipped(misfit, frame, expected)


def _clipped(
    misfit: Misfit, frame: Frame, estimates: Sequence[Mapping[str, float]]
) -> dict[str, tuple[float, ...]]:
    """Return effects no further than the longest step from those of a misfit.

    A movement that a model cannot follow must not lead to friction below zero. One that says
    nothing of an effect, as one in which a drive does not slip, keeps it: carried back to the
    common value it might slip there, and would be carried to and fro.
    """
    effects = {}
    for name in misfit.comparison.scatter:
        shares = []
        for number, (found, alignment) in enumerate(zip(estimates, frame.alignments, strict=True)):
            before = misfit.effect(name, number)
            after = found[name] if alignment.shows(name) else before
            near = float(np.clip(after, before - LONGEST_EFFECT_STEP, before + LONGEST_EFFECT_STEP))
            shares.append(float(np.clip(near, -FURTHEST_EFFECT, FURTHEST_EFFECT)))
        effects[name] = tuple(shares)
    return effects


def _where_further(
    misfit: Misfit, found: Mapping[str, tuple[float, ...]]
) -> Mapping[str, tuple[float, ...]]:
    """Return the effects of a misfit, and estimates where they are further off than is allowed.

    A movement is simulated again only where one of its own has changed.
    """
    known = {
        name: tuple(misfit.effect(name, number) for number in range(len(shares)))
        for name, shares in found.items()
    }
    further = [
        any(abs(found[name][number] - known[name][number]) > SAME_EFFECT for name in found)
        for number in range(len(misfit.movements))
    ]
    if not any(further):
        return misfit.effects
    return {
        name: tuple(
            share if far else before
            for share, before, far in zip(found[name], known[name], further, strict=True)
        )
        for name in found
    }


# A movement stands out whose residuals are so many times those of half of them; its own values that
# are then tried, in deviations that are expected [-].
STANDS_OUT, OWN_TRIES = 3.0, (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)


def sought_effects(found: "Fit") -> dict[str, tuple[float, ...]]:
    """Return movement effects, those of movements that stand out where a throw misses least.

    Over its own friction the misfit of a movement has several minima where a drive has play or a
    rail sticks: one that took up what the model lacked is held there.

    Parameters
    ----------
    found : Fit
        With all values near their end.
    """
    misfit, effects = found.misfit, dict(found.misfit.effects)
    rows = [
        item.whitened(item.measured - item.reduced(response))
        for item, response in zip(found.frame.alignments, found.local.simulated, strict=True)
    ]
    sizes = np.array([np.sqrt(np.mean(row**2)) for row in rows])
    for number in np.flatnonzero(sizes > STANDS_OUT * np.median(sizes)).tolist():
        one = misfit.of([number])
        for p in (item for item in misfit.parameters if item.scatter > 0.0):
            tried = [misfit.effect(p.name, number), *(p.scatter * size for size in OWN_TRIES)]
            costs = [
                _own_cost(replace(one, effects={**one.effects, p.name: (share,)}), found.values)
                + (share / p.scatter) ** 2
                for share in tried
            ]
            row = list(effects.get(p.name, (0.0,) * len(rows)))
            row[number] = tried[int(np.argmin(costs))]
            effects[p.name] = tuple(row)
    return effects


def _own_cost(one: Misfit, values: Mapping[str, float]) -> float:
    """Return the sum of squares of one movement at its own values; infinite where it failed."""
    response = one.responses([values])[0][0]
    if response.failure:
        return float("inf")
    aligned = align(one.movements[0], response, comparison=one.comparison, sensitivities={})
    row = aligned.whitened(aligned.measured - aligned.predicted(response))
    return float(row @ row)


# Steps of a fit; how many more are allowed after one that still lowered the cost by this share and
# by a whole square of a standard deviation; and the limit of all.
MAX_STEPS, EXTRA_STEPS, STEP_LIMIT = 12, 4, 40
EXTENDING_SHARE, EXTENDING_DECREASE = 1e-3, 1.0
# Fits with noise found again at most: it rests after two where the model is right.
MAX_PASSES = 4
# Steps that the noise of the solver hides [coordinate].
MIN_STEP = 1e-4
# A step of a smaller predicted decrease for each parameter is not tried: it moves them by a third
# of their deviations, which planes see better [square of a standard deviation].
MIN_DECREASE = 0.1
# Of a fit that others follow: most steps, most rejected in a row, and the share of the cost that
# a step must be predicted to save.
ROUGH_STEPS, ROUGH_REJECTED, ROUGH_DECREASE = 6, 2, 0.02
# Of a brief fit: passes with noise found again, steps of each, how often movement effects are
# thrown again in a step, and the decrease below which a step is not tried; and rejected steps in a
# row: far from the end a step is to shorten by so much.
BRIEF_PASSES, BRIEF_STEPS, BRIEF_EFFECTS, BRIEF_DECREASE, BRIEF_REJECTED = 2, 8, 1, 0.5, 4
# Planes at the end of a fit at most, the predicted decrease for each parameter below which it is
# there [square of a standard deviation], after how many of them noise is found again, and how far a
# step goes at most [reaches].
SMOOTH_PASSES, SMOOTH_DECREASE, SMOOTH_NOISES, SMOOTH_STEP = 16, 0.3, 3, 10.0
# The predicted decrease for each parameter from which on slopes of single throws are good enough
# for a first step [square of a standard deviation]: what is rough hides 10 to 40 in all.
FAR_DECREASE = 10.0
# A step turns back where the cosine between what it and the one before change is below this [-].
TURNED_BACK = -0.5
# Planes from a brief fit before single throws lead on where these still promise as much: right
# models come to their end in 4 to 7.
FIRST_PASSES = 8
# How many movements the expected scatter counts for beside those that were measured.
SCATTER_WEIGHT = 2.0
# Relative change of the noise beyond which the fit is repeated with it [-].
NOISE_TOLERANCE = 0.25
# Residuals beyond this many standard deviations, such as at an impact, count less once near.
OUTLIER_LIMIT = 3.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """End of a fit.

    Attributes
    ----------
    misfit : Misfit
        With the noise and scatter that it ended with.
    parameters : tuple of Parameter
        Those that it changed.
    values : mapping of str to float
        Of all parameters.
    local, frame : Linearisation, Frame
        Responses and alignments there.
    residuals : ndarray, shape (n,)
        Whitened, in standard deviations [-].
    jacobian : ndarray, shape (n, p)
        Of the residuals to the coordinates.
    iterations : int
        Steps tried, rejected ones included.
    message : str
        How it ended.
    converged : bool
        Whether it met a convergence criterion, instead of a limit of steps.
    """

    misfit: Misfit
    parameters: tuple[Parameter, ...]
    values: Mapping[str, float]
    local: Linearisation
    frame: Frame
    residuals: Floats
    jacobian: Floats
    iterations: int
    message: str
    converged: bool

    @property
    def point(self) -> Floats:
        """The coordinates of the parameters."""
        return coordinates(self.parameters, self.values)

    @property
    def cost(self) -> float:
        """Sum of the squared whitened residuals [-]."""
        return float(self.residuals @ self.residuals)

    @property
    def rms(self) -> float:
        """Root mean square of the residuals; 1 where the model is right."""
        return float(np.sqrt(np.mean(self.residuals**2)))


@one_blas_thread()
def fit(
    misfit: Misfit,
    parameters: Sequence[Parameter],
    values: Mapping[str, float],
    *,
    rough: bool = False,
    near: Fit | None = None,
    refined: bool = True,
) -> Fit:
    """Fit parameters to movements, and the noise and scatter to what is left over.

    Parameters
    ----------
    misfit : Misfit
        Movements and how they are compared.
    parameters : sequence of Parameter
        The p free parameters; all others keep their value in `values`.
    values : mapping of str to float
        Where to start, of all parameters.
    rough : bool
        Whether other fits follow, so that nearby is good enough, and the noise begins inflated.
    near : Fit, optional
        A rough fit that ended at the values: its movements' own values are gone on with.
    refined : bool
        Whether a fit that is not rough ends with shorter steps of the solver; one that does not is
        given up where it still misses too much after `MAX_STEPS`.

    Returns
    -------
    Fit

    Raises
    ------
    SolverError
        When a movement cannot be simulated at the start.
    """
    effects = near.misfit.effects if near else {}
    local: Linearisation | None = near.local if near else None
    if rough:
        misfit = replace(misfit, same_slope=SAME_ROUGH_SLOPE)
        inflated = replace(inflate_noise(misfit, parameters, values), effects=effects)
        found = _least_squares(inflated, parameters, values, rough=True, local=local)
        return replace(found, misfit=reestimate_noise(found, misfit))
    first, misfit = misfit, replace(misfit, effects=effects)
    if not refined or near is None or is_poor(near.misfit):
        return _by_single_throws(misfit, first, parameters, values, local=local, refined=refined)
    left = near.misfit.comparison
    known = replace(
        misfit.comparison,
        noise=left.noise,
        scatter=left.scatter,
        discrepancy=left.discrepancy,
        outlier_limit=left.outlier_limit,
    )
    misfit = replace(misfit, comparison=known).refined(values)
    found = replace(near, misfit=misfit, values=values, iterations=0)
    # Slopes that led near are of elsewhere: planes that they are part of would be too.
    with suppress(SolverError):
        slopes = misfit.local_near(values, [item.name for item in parameters], near.local)
        found = _nearer(replace(found, local=slopes), first)
    before = found.iterations
    found = smooth_end(found, first, most=FIRST_PASSES)
    # Single throws see less than planes that go to and fro near their end.
    if found.converged or found.iterations >= before + SMOOTH_PASSES:
        return found
    # What is further off than planes lead, single throws may come to.
    with suppress(SolverError):
        return _by_single_throws(
            found.misfit, first, parameters, found.values, local=found.local, refined=refined
        )
    return found


def _nearer(found: Fit, first: Misfit) -> Fit:
    """Step by slopes from single throws where they promise more than roughness hides."""
    found = _at(found, found.local)
    step, predicted_decrease = _newton_step(found)
    if predicted_decrease < FAR_DECREASE * len(found.parameters):
        return found
    found, effects = _stepped(found, step, _reaches(found))
    return replace(found, misfit=replace(reestimate_noise(found, first), effects=effects))


def _by_single_throws(
    misfit: Misfit,
    first: Misfit,
    parameters: Sequence[Parameter],
    values: Mapping[str, float],
    *,
    local: Linearisation | None,
    refined: bool,
) -> Fit:
    """Fit by single throws, noise found again with each pass, and end by planes if refined."""
    iterations = 0
    for number in range(MAX_PASSES):
        # Finer steps are no remedy for a model of something else, and too long a way from afar.
        poor = number == 0 or is_poor(misfit)
        if not refined or poor:
            misfit = replace(misfit, refinement=())
        elif not misfit.refinement:
            misfit = misfit.refined(values)
        limit = STEP_LIMIT if refined else MAX_STEPS
        found = _least_squares(misfit, parameters, values, rough=False, local=local, limit=limit)
        iterations += found.iterations
        values, local = found.values, found.local
        misfit = reestimate_noise(found, first)
        if number > 0 and (poor or same_noise(found.misfit, misfit)):
            break
        if not refined and is_poor(misfit):
            break
    found = replace(found, iterations=iterations)
    return smooth_end(found, first) if refined and not poor else found


@one_blas_thread()
def smooth_end(found: Fit, first: Misfit, *, most: int | None = None) -> Fit:
    """Go on with a fit from where it ended, by means over throws on all sides.

    Near its end single throws decide nothing: the cost is rough, and steps that would lower it are
    refused. Each step is that of a plane through responses on all sides, and is taken as it is.

    Parameters
    ----------
    found : Fit
        Near its end.
    first : Misfit
        As of `reestimate_noise`.
    most : int, optional
        Planes after which it is given up where it is still far off; it ends after `SMOOTH_PASSES`.

    Returns
    -------
    Fit
        Not converged where planes come to no end, or a throw of them cannot be simulated.
    """
    names, known, misfit = [p.name for p in found.parameters], found.local, found.misfit
    thrown, gain, before = dict[int, Thrown](), 1.0, np.zeros(len(names))
    for number in range(1, 1 + SMOOTH_PASSES):
        try:
            wide = _reaches(replace(found, misfit=misfit))
            local = misfit.smoothed(found.values, names, thrown, wide, known)
        except SolverError as error:
            message = f"stopped before planes through throws on all sides of its values: {error}"
            return replace(found, message=message, converged=False)
        found = _at(replace(found, misfit=misfit), local)
        step, predicted_decrease = _newton_step(found)
        # Steps to and fro, as slopes that are too small make them, have their end half-way.
        if _turns_back(found.jacobian, before, step):
            gain = 0.5
        before, step = step, gain * step
        near = predicted_decrease < SMOOTH_DECREASE * len(names)
        message = "converged" if near else f"stopped after {number} planes before convergence"
        found, effects = _stepped(replace(found, message=message, converged=near), step, wide)
        found.misfit.evaluator.step_made(found.rms)
        # Noise that is found again with each step may alternate, and so would the steps.
        again = reestimate_noise(found, first) if number <= SMOOTH_NOISES else found.misfit
        if near and same_noise(found.misfit, again):
            break
        misfit = replace(again, effects=effects)
        if most == number and predicted_decrease > FAR_DECREASE * len(names):
            break
    return found


def _at(found: Fit, local: Linearisation) -> Fit:
    """Return a fit at a linearisation, its clock where that shows it."""
    frame = framed(local, found.misfit)
    misfit = about_clock(found.misfit, frame)
    return replace(
        found,
        misfit=misfit,
        values=local.values,
        local=local,
        frame=frame,
        residuals=misfit.residuals_of(local.simulated, frame),
        jacobian=jacobian(local, frame, [p.name for p in found.parameters]),
    )


def _newton_step(found: Fit) -> tuple[Floats, float]:
    return bounded_step(found.residuals, found.jacobian, found.parameters, found.values, 0.0)


def _reaches(found: Fit) -> Floats:
    return reaches_of(found.parameters, found.jacobian, found.misfit.comparison.scatter)


def _stepped(found: Fit, step: Floats, reaches: Floats) -> tuple[Fit, dict[str, tuple[float, ...]]]:
    """Take a step along slopes, of `SMOOTH_STEP` at most; with the movement effects then.

    `step` is in coordinates, `reaches` as of `reaches_of`.
    """
    names = [p.name for p in found.parameters]
    # Beyond, planes are no longer those of the responses.
    far = np.linalg.solve(REACH * reaches, step)
    step = step * min(1.0, SMOOTH_STEP / float(np.abs(far).max(initial=1e-9)))
    effects = effects_after(found.misfit, found.local, found.frame, names, step)
    values = {**found.values, **values_at(found.parameters, found.point + step)}
    local = found.local.moved(values, dict(zip(names, step, strict=True)))
    return replace(_at(found, local), iterations=found.iterations + 1), effects


def _turns_back(J: Floats, before: Floats, step: Floats) -> bool:
    """Return whether a step goes back most of the way of the one before, by what both change."""
    old, new = J @ before, J @ step
    return float(old @ new) < TURNED_BACK * float(np.linalg.norm(old) * np.linalg.norm(new))


@one_blas_thread()
def brief_fit(
    misfit: Misfit,
    near: Fit,
    *,
    passes: int = BRIEF_PASSES,
    steps: int = BRIEF_STEPS,
    share: float = 1.0,
) -> Fit:
    """Fit near to the end only, to see what a model misses: few steps, with slopes from near by.

    A model that does not follow is fitted slowly: noise, discrepancy and each movement's friction
    change with every pass. What it misses is seen long before that.

    Parameters
    ----------
    misfit : Misfit
        Movements and how they are compared, with the noise of the measurement.
    near : Fit
        Where it starts, with its parameters and noise.
    passes : int
        How often noise and discrepancy are estimated at most.
    steps : int
        Of each pass at most; with none, only what the start misses is found.
    share : float
        Of what the start misses that is noise in the first pass [-]: a model that lacks nothing is
        found with little of it, one that lacks something would follow that.

    Returns
    -------
    Fit
        With the noise and discrepancy that it leaves.
    """
    noise = {
        key: replace(item, missed=max(share * item.missed, misfit.comparison.noise[key].missed))
        for key, item in near.misfit.comparison.noise.items()
    }
    kept = replace(misfit.comparison, noise=noise, scatter=near.misfit.comparison.scatter)
    kept = with_sensors_held(kept, share) if share < 1.0 else kept
    present = replace(
        misfit, comparison=kept, effects=near.misfit.effects, same_slope=SAME_ROUGH_SLOPE
    )
    found, iterations = near, 0
    for _ in range(passes):
        found = _least_squares(
            present, near.parameters, found.values, rough=False, brief=steps, local=found.local
        )
        iterations += found.iterations
        before, present = found.misfit, reestimate_noise(found, misfit)
        if same_noise(before, present):
            break
    frame = framed(found.local, present)
    return replace(
        found,
        misfit=present,
        frame=frame,
        residuals=present.residuals_of(found.local.simulated, frame),
        jacobian=jacobian(found.local, frame, [item.name for item in near.parameters]),
        iterations=iterations,
    )


def _least_squares(
    misfit: Misfit,
    parameters: Sequence[Parameter],
    values: Mapping[str, float],
    *,
    rough: bool,
    local: Linearisation | None = None,
    brief: int | None = None,
    limit: int = STEP_LIMIT,
) -> Fit:
    """Levenberg-Marquardt within bounds, in one state of noise and scatter."""
    names = [item.name for item in parameters]
    local = _local_at(misfit, values, names, local)
    damping, iterations = 1e-4, 0
    max_steps, max_rejected, passes = _limits(rough=rough, brief=brief)
    min_decrease = len(names) * MIN_DECREASE if brief is None else BRIEF_DECREASE
    message, converged, fresh = "", rough, False
    while True:
        slopes = local.stepped
        misfit, local, frame = update_movement_effects(misfit, local, names, passes=passes)
        fresh = fresh or local.stepped is not slopes
        r, J = misfit.residuals_of(local.simulated, frame), jacobian(local, frame, names)
        cost = _cost(r, parameters, local.values)
        misfit.evaluator.step_made(float(np.sqrt(cost / max(r.size, 1))))
        accepted, rejected = False, 0
        # Slopes from elsewhere are thrown again before a shorter step is tried.
        most = max_rejected if rough or fresh else 1
        while iterations < max_steps and rejected < most:
            iterations += 1
            step, predicted_decrease = bounded_step(r, J, parameters, local.values, damping)
            near = rough or brief is not None
            least = max(min_decrease, ROUGH_DECREASE * cost) if near else min_decrease
            if predicted_decrease < least or np.abs(step).max() < MIN_STEP:
                message, converged = "converged", True
                break
            theta = coordinates(parameters, local.values) + step
            trial = {**local.values, **values_at(parameters, theta)}
            trial_misfit = replace(misfit, effects=effects_after(misfit, local, frame, names, step))
            here = tuple(trial_misfit.responses([trial])[0])
            trial_cost = _cost(trial_misfit.residuals_of(here, frame), parameters, trial)
            if np.isfinite(trial_cost) and trial_cost < cost:
                damping, accepted, misfit = 0.1 * damping, True, trial_misfit
                if not rough and brief is None:
                    max_steps = max(max_steps, min(iterations + _further(cost, trial_cost), limit))
                break
            damping, rejected = max(10.0 * damping, 1e-3), rejected + 1
            if np.abs(step).max() < 10 * MIN_STEP:
                message, converged = "converged to the noise of the solver", True
                break
        if not accepted:
            if rejected and not (rough or fresh) and iterations < max_steps:
                local, fresh = misfit.local(local.values, names), True
                message, converged = "", False
                continue
            if brief is not None and rejected == most:
                message, converged = "converged as far as its slopes lead", True
            break
        local, fresh = replace(local, values=trial, simulated=here), False
    return Fit(
        misfit=misfit,
        parameters=tuple(parameters),
        values=local.values,
        local=local,
        frame=frame,
        residuals=r,
        jacobian=J,
        iterations=iterations,
        message=message or f"stopped after {iterations} steps before convergence",
        converged=converged,
    )


def _further(cost: float, trial_cost: float) -> int:
    """Return how many steps a fit may go on for after one: some as long as each is worth it."""
    worth = max(EXTENDING_DECREASE, EXTENDING_SHARE * trial_cost)
    return EXTRA_STEPS if cost - trial_cost > worth else 0


def _local_at(
    misfit: Misfit, values: Mapping[str, float], names: Sequence[str], local: Linearisation | None
) -> Linearisation:
    """Return responses at values, with the slopes that are known where they suffice."""
    if local is None or not set(names) <= set(local.stepped):
        return misfit.local(values, names)
    whole = {**misfit.base, **values}
    return replace(local, values=whole, simulated=tuple(misfit.responses([whole])[0]))


def _limits(*, rough: bool, brief: int | None) -> tuple[int, int, int]:
    """Return steps, rejected ones in a row and passes of movement effects of a fit at most."""
    if brief is not None:
        return brief, BRIEF_REJECTED, BRIEF_EFFECTS
    return (ROUGH_STEPS, ROUGH_REJECTED, 1) if rough else (MAX_STEPS, MAX_STEPS, EFFECT_PASSES)


def _cost(r: Floats, parameters: Sequence[Parameter], values: Mapping[str, float]) -> float:
    """Return the sum of squares of residuals, and of what priors of parameters add to them."""
    away = prior_residuals(parameters, coordinates(parameters, values))
    return float(r @ r) + float(away @ away)


def inflate_noise(
    misfit: Misfit, parameters: Sequence[Parameter], values: Mapping[str, float]
) -> Misfit:
    """Return a misfit whose noise holds the model error where a fit starts.

    Weighed by the noise of the measurement alone, a model that is still far off would follow single
    bins and what onset and scatter can imitate, instead of the large differences.

    Parameters
    ----------
    misfit : Misfit
        With the noise of the measurement.
    parameters : sequence of Parameter
        The p free parameters; all others keep their value in `values`.
    values : mapping of str to float
        Where the fit starts.
    """
    local = misfit.local(values, [item.name for item in parameters])
    squares: dict[Key, list[Floats]] = {}
    for movement, response in zip(misfit.movements, local.simulated, strict=True):
        for signal, bins in compared(
            movement, misfit.comparison.channels, misfit.comparison.window
        ):
            row = signal.values[bins] - predicted(response, movement, signal, bins)
            squares.setdefault((signal.channel, signal.drive), []).append(row**2)
    noise = dict(misfit.comparison.noise)
    for key, rows in squares.items():
        size = float(np.sqrt(np.mean(np.concatenate(rows))))
        if size > noise[key].missed:
            noise[key] = replace(noise[key], missed=size, missed_length=BIN)
    return replace(misfit, comparison=replace(misfit.comparison, noise=noise))


def reestimate_noise(found: Fit, first: Misfit) -> Misfit:
    """Return a misfit whose noise holds the model error, and whose scatter is as estimated.

    Parameters
    ----------
    found : Fit
        In the present state.
    first : Misfit
        With the noise of the measurement, and the scatter that was expected.
    """
    series = _remaining_series(found)
    noise = dict(first.comparison.noise)
    discrepancy = shared_discrepancy(series, noise) if first.comparison.gains else {}
    own: dict[Key, list[Floats]] = {}
    for (channel, drive, direction), rows in series.items():
        shared = (channel, drive, direction) in discrepancy
        own.setdefault((channel, drive), []).extend(without_common(rows) if shared else rows)
    for key, rows in own.items():
        size, length = missed_by_model(rows, noise[key])
        if size > noise[key].missed:
            noise[key] = replace(noise[key], missed=size, missed_length=length)
    for (channel, drive, direction), (size, length) in discrepancy.items():
        most = max(row.size for row in series[channel, drive, direction])
        rest = left_out(most, size=size, length=length)
        known = noise[channel, drive]
        noise[channel, drive] = replace(known, left=hypot(known.left, rest))
    scatter = {}
    for name, expected in first.comparison.scatter.items():
        estimates = [v.estimates[name] for v in found.frame.alignments if name in v.estimates]
        squares = sum(mean**2 + deviation**2 for mean, deviation in estimates)
        total = squares + SCATTER_WEIGHT * expected**2
        # One movement's worth is used up by the common value itself.
        scatter[name] = float(np.sqrt(total / (max(len(estimates) - 1, 0) + SCATTER_WEIGHT)))
    comparison = replace(
        first.comparison,
        noise=noise,
        scatter=scatter,
        discrepancy=discrepancy,
        outlier_limit=OUTLIER_LIMIT,
    )
    return replace(found.misfit, comparison=comparison)


def _remaining_series(found: Fit) -> dict[tuple[str, str, str], list[Floats]]:
    """Return by channel, drive and direction what nuisances and gains leave of the residuals."""
    series: dict[tuple[str, str, str], list[Floats]] = {}
    noise = found.misfit.comparison.noise
    for alignment, parts in remaining(found.local, found.frame):
        for signal, _, row in parts:
            known = noise[signal.channel, signal.drive].total
            most = OUTLIER_LIMIT * max(known, MAD_TO_SIGMA * float(np.median(np.abs(row))))
            key = (signal.channel, signal.drive, alignment.movement.direction)
            series.setdefault(key, []).append(np.clip(row, -most, most))
    return series


def is_poor(misfit: Misfit) -> bool:
    """Return whether a model misses too much for a trustworthy fit."""
    return bool(missing_more(misfit.comparison, misfit.movements, share=CLEARLY))


def with_sensors_held(comparison: Comparison, share: float) -> Comparison:
    """Return a comparison whose sensors are known better, by the share that noise is reduced by.

    With less noise than a model misses, priors that stay as they are would count for nothing: gains
    far beyond belief would take up what the model lacks.
    """
    return replace(
        comparison,
        gains={key: share * size for key, size in comparison.gains.items()},
        common_zero=share * comparison.common_zero,
        clock=share * comparison.clock,
        cross_talk=share * comparison.cross_talk,
    )


def _discrepancies(
    *misfits: Misfit,
) -> list[dict[tuple[str, str, str], tuple[float, float]]]:
    """Return shared discrepancies with the same keys, of no size where there is none."""
    keys = [key for misfit in misfits for key in misfit.comparison.discrepancy]
    return [{key: m.comparison.discrepancy.get(key, (0.0, BIN)) for key in keys} for m in misfits]


def same_noise(before: Misfit, after: Misfit) -> bool:
    """Return whether noise and scatter changed by at most a quarter, `NOISE_TOLERANCE`."""
    if before.comparison.outlier_limit != after.comparison.outlier_limit:
        return False
    pairs = [
        (before.comparison.noise[key].total, noise.total)
        for key, noise in after.comparison.noise.items()
    ]
    pairs += [
        (hypot(a.total, first[key][0]), hypot(b.total, second[key][0]))
        for first, second in [_discrepancies(before, after)]
        for key in first
        for a, b in [(before.comparison.noise[key[:2]], after.comparison.noise[key[:2]])]
    ]
    pairs += [
        (before.comparison.scatter[name], share) for name, share in after.comparison.scatter.items()
    ]
    return all(abs(a - b) <= NOISE_TOLERANCE * max(a, b) for a, b in pairs)
