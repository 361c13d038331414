"""Bounded least squares on simulations: steps that know what a throw costs and how sure it is."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from turnout.calibration.comparison import Key
from turnout.calibration.local import Local
from turnout.calibration.misfit import Frame, Misfit, jacobian
from turnout.calibration.movement_effects import (
    EFFECT_PASSES,
    effects_after,
    update_movement_effects,
)
from turnout.calibration.noise import missed_by_model, poorly_followed
from turnout.calibration.observed import BIN
from turnout.calibration.parameter import Parameter, coordinates, values_at
from turnout.calibration.predict import compared, predicted

Floats = NDArray[np.float64]
# Steps of a fit; so many more after each that still gained by this share of the cost and by a whole
# square of a standard deviation; and the most.
MOST_STEPS, MORE_STEPS, LAST_STEP = 12, 4, 40
STILL_SHARE, STILL_GAIN = 1e-3, 1.0
# Noise of the turns of a rough fit, as a share of what the model misses at the start [-].
LOOSE, TIGHTENING = (1.0,), (1.0, 0.1)
MOST_PASSES = 4
# Longest step of a coordinate; half a unit is a factor of 1.6.
LONGEST_STEP = 0.5
# Steps below this cannot be told from the noise of the solver [coordinate].
SHORTEST_STEP = 1e-4
# A step that promises less than this is not worth throws [square of a standard deviation].
LEAST_GAIN = 0.05
# Of a stage that others follow: how few steps, how few of them in vain, and which share of the cost
# one must promise.
ROUGH_STEPS, ROUGH_REFUSED, ROUGH_GAIN = 6, 2, 0.01
# How many movements the expected scatter counts for beside those that were measured.
SCATTER_WEIGHT = 2.0
# What the noise may change before the fit is done again with it [-].
SAME_NOISE = 0.25
# Residuals beyond this many standard deviations, such as at an impact, count less once near.
OUTLYING = 3.0
# From the median of absolute values to the standard deviation of a normal distribution [-].
TO_DEVIATION = 1.4826


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """Where a fit ended.

    Attributes
    ----------
    misfit : Misfit
        With the noise and scatter that it ended with.
    parameters : tuple of Parameter
        Those that it changed.
    values : mapping of str to float
        Of all parameters.
    local, frame : Local, Frame
        Responses and views there.
    residuals : ndarray, shape (n,)
        Whitened.
    jacobian : ndarray, shape (n, p)
        Of the residuals to the coordinates.
    iterations : int
        Steps tried.
    message : str
        How it ended.
    converged : bool
        Whether it ended by itself.
    """

    misfit: Misfit
    parameters: tuple[Parameter, ...]
    values: Mapping[str, float]
    local: Local
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
        """Sum of the squared residuals."""
        return float(self.residuals @ self.residuals)

    @property
    def rms(self) -> float:
        """Root mean square of the residuals; 1 where the model is right."""
        return float(np.sqrt(np.mean(self.residuals**2)))


def fit(
    misfit: Misfit,
    parameters: Sequence[Parameter],
    values: Mapping[str, float],
    *,
    rough: bool = False,
    loose_shares: Sequence[float] = LOOSE,
    near: Fit | None = None,
    refined: bool = True,
    enough: float = LEAST_GAIN,
    told: Callable[[float], None] | None = None,
) -> Fit:
    """Fit parameters to movements, and the noise and scatter to what is left over.

    Parameters
    ----------
    misfit : Misfit
        Movements and how they are compared.
    parameters : sequence of Parameter
        To change.
    values : mapping of str to float
        Where to start, of all parameters.
    rough : bool
        Whether others follow, so that nearby is good enough, and the noise begins loosened.
    loose_shares : sequence of float
        For each turn of a rough fit, which share of what the start misses is taken as noise [-].
    near : Fit, optional
        A rough fit that ended at the values: its movements' own values are gone on with.
    refined : bool
        Whether a fit that is not rough ends with shorter steps of the solver.
    enough : float
        What a step must promise to be worth throws [square of a standard deviation].
    told : callable, optional
        Called with the root mean square of the residuals after each step.

    Returns
    -------
    Fit

    Raises
    ------
    SolverError
        When a movement cannot be simulated at the start.
    """
    iterations, own = 0, near.misfit.own if near else {}
    local = near.local if near else None
    if rough:
        loose = loosened(misfit, parameters, values)
        for share in loose_shares:
            tighter = replace(tightened(loose, misfit, share), own=own)
            found = _least_squares(tighter, parameters, values, rough=True, told=told, local=local)
            iterations += found.iterations
            values, own, local = found.values, found.misfit.own, found.local
        return replace(found, misfit=relearned(found, misfit), iterations=iterations)
    first, misfit = misfit, replace(misfit, own=own)
    for number in range(MOST_PASSES):
        # Finer steps are no remedy for a model of something else.
        poor = bool(poorly_followed(misfit.comparison.noise, misfit.movements))
        misfit = replace(misfit, fine=refined and number > 0 and not poor)
        found = _least_squares(
            misfit, parameters, values, rough=False, told=told, local=local, enough=enough
        )
        iterations += found.iterations
        values, local = found.values, found.local
        misfit = relearned(found, first)
        if number > 0 and (poor or _alike(found.misfit, misfit)):
            break
    return replace(found, iterations=iterations)


def loosened(
    misfit: Misfit, parameters: Sequence[Parameter], values: Mapping[str, float]
) -> Misfit:
    """Return a misfit whose noise holds what the model misses where a fit starts.

    Weighed by the noise of the measurement alone, a model that is still far off would be led by
    single bins and by what onset and scatter can imitate, not by what is large.

    Parameters
    ----------
    misfit : Misfit
        With the noise of the measurement.
    parameters : sequence of Parameter
        To change.
    values : mapping of str to float
        Where the fit starts.
    """
    local = misfit.local(values, [item.name for item in parameters])
    squares: dict[Key, list[Floats]] = {}
    for movement, response in zip(misfit.movements, local.here, strict=True):
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
    return replace(misfit, comparison=replace(misfit.comparison, noise=noise), frame=None)


def tightened(loose: Misfit, first: Misfit, share: float) -> Misfit:
    """Return a misfit with a share of the loosened noise beside that of the measurement."""
    noise = dict(first.comparison.noise)
    for key, own in noise.items():
        size = share * loose.comparison.noise[key].missed
        if size > own.missed:
            noise[key] = replace(own, missed=size, missed_length=BIN)
    return replace(first, comparison=replace(first.comparison, noise=noise), frame=None)


def _least_squares(
    misfit: Misfit,
    parameters: Sequence[Parameter],
    values: Mapping[str, float],
    *,
    rough: bool,
    told: Callable[[float], None] | None,
    local: Local | None = None,
    enough: float = LEAST_GAIN,
) -> Fit:
    """Levenberg-Marquardt within bounds, in one state of noise and scatter."""
    names = [item.name for item in parameters]
    if local is None or not set(names) <= set(local.moved):
        local = misfit.local(values, names)
    else:
        whole = {**misfit.base, **values}
        local = replace(local, values=whole, here=tuple(misfit.responses([whole])[0]))
    damping, iterations = 1e-4, 0
    most, most_refused = (ROUGH_STEPS, ROUGH_REFUSED) if rough else (MOST_STEPS, MOST_STEPS)
    message, converged = "", rough
    while True:
        misfit, local, frame = update_movement_effects(
            misfit, local, names, turns=1 if rough else EFFECT_PASSES
        )
        residuals = misfit.residuals_of(local.here, frame)
        slopes = jacobian(local, frame, names)
        cost = float(residuals @ residuals)
        if told is not None:
            told(float(np.sqrt(cost / max(residuals.size, 1))))
        moved, refused = False, 0
        while iterations < most and refused < most_refused:
            iterations += 1
            step, gain = _step(residuals, slopes, parameters, local.values, damping)
            least = max(enough, ROUGH_GAIN * cost) if rough else enough
            if gain < least or np.abs(step).max() < SHORTEST_STEP:
                message, converged = "converged", True
                break
            point = coordinates(parameters, local.values) + step
            trial = {**local.values, **values_at(parameters, point)}
            ahead = replace(misfit, own=effects_after(misfit, local, frame, names, step))
            here = tuple(ahead.responses([trial])[0])
            at_trial = ahead.residuals_of(here, frame)
            left = float(at_trial @ at_trial)
            if np.isfinite(left) and left < cost:
                damping, moved, misfit = 0.1 * damping, True, ahead
                if not rough and cost - left > max(STILL_GAIN, STILL_SHARE * left):
                    most = max(most, min(iterations + MORE_STEPS, LAST_STEP))
                break
            damping, refused = max(10.0 * damping, 1e-3), refused + 1
            if np.abs(step).max() < 10 * SHORTEST_STEP:
                message, converged = "converged to the noise of the solver", True
                break
        if not moved:
            break
        local = replace(local, values=trial, here=here)
    return Fit(
        misfit=misfit,
        parameters=tuple(parameters),
        values=local.values,
        local=local,
        frame=frame,
        residuals=residuals,
        jacobian=slopes,
        iterations=iterations,
        message=message or f"ended after {iterations} steps; more may improve it",
        converged=converged,
    )


def _step(
    residuals: Floats,
    slopes: Floats,
    parameters: Sequence[Parameter],
    values: Mapping[str, float],
    damping: float,
) -> tuple[Floats, float]:
    """Return the damped step within bounds, and the fall of the cost that it promises."""
    scale = np.sqrt((slopes**2).sum(axis=0))
    scale = np.where(scale > 0, scale, 1.0)
    here = coordinates(parameters, values)
    low = np.array([item.coordinate(item.lower) for item in parameters]) - here
    high = np.array([item.coordinate(item.upper) for item in parameters]) - here
    low = np.minimum(np.maximum(low, -LONGEST_STEP), -1e-12)
    high = np.maximum(np.minimum(high, LONGEST_STEP), 1e-12)
    # The small triangle holds all that the tall matrix knows of the step.
    tall = np.column_stack([slopes, residuals])
    triangle: Floats = np.asarray(np.linalg.qr(tall, mode="r"), dtype=np.float64)
    count = len(parameters)
    matrix = np.vstack([triangle[:, :count], np.sqrt(damping) * np.diag(scale)])
    right = np.concatenate([-triangle[:, count], np.zeros(count)])
    step = lsq_linear(matrix, right, bounds=(low, high)).x
    ahead = residuals + slopes @ step
    return np.asarray(step), float(residuals @ residuals - ahead @ ahead)


def relearned(found: Fit, first: Misfit) -> Misfit:
    """Return a misfit whose noise holds what the model misses, and whose scatter is as found.

    Parameters
    ----------
    found : Fit
        In the present state.
    first : Misfit
        With the noise of the measurement, and the scatter that was expected.
    """
    series: dict[Key, list[Floats]] = {}
    misfit_noise = found.misfit.comparison.noise
    for view, response in zip(found.frame.views, found.local.here, strict=True):
        for (signal, _), row in zip(view.parts, view.left_over(response), strict=True):
            known = misfit_noise[signal.channel, signal.drive].total
            most = OUTLYING * max(known, TO_DEVIATION * float(np.median(np.abs(row))))
            series.setdefault((signal.channel, signal.drive), []).append(np.clip(row, -most, most))
    noise = dict(first.comparison.noise)
    for key, rows in series.items():
        size, length = missed_by_model(rows, noise[key])
        if size > noise[key].missed:
            noise[key] = replace(noise[key], missed=size, missed_length=length)
    scatter = {}
    for name, expected in first.comparison.scatter.items():
        estimates = [v.estimates[name] for v in found.frame.views if name in v.estimates]
        squares = sum(mean**2 + deviation**2 for mean, deviation in estimates)
        total = squares + SCATTER_WEIGHT * expected**2
        # One movement's worth is used up by the common value itself.
        scatter[name] = float(np.sqrt(total / (max(len(estimates) - 1, 0) + SCATTER_WEIGHT)))
    comparison = replace(first.comparison, noise=noise, scatter=scatter, outlying=OUTLYING)
    return replace(found.misfit, comparison=comparison, frame=None)


def _alike(before: Misfit, after: Misfit) -> bool:
    """Tell whether noise and scatter changed too little to matter."""
    if before.comparison.outlying != after.comparison.outlying:
        return False
    pairs = [
        (before.comparison.noise[key].total, noise.total)
        for key, noise in after.comparison.noise.items()
    ]
    pairs += [
        (before.comparison.scatter[name], share) for name, share in after.comparison.scatter.items()
    ]
    return all(abs(a - b) <= SAME_NOISE * max(a, b) for a, b in pairs)
