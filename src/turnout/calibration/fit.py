"""Bounded nonlinear least squares on simulated movements (Levenberg-Marquardt).

Notation: theta coordinates of the parameters, r whitened residuals, J their Jacobian, lambda the
damping, cost :math:`r^T r`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import hypot

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from turnout.calibration.comparison import Key
from turnout.calibration.linearisation import Linearisation
from turnout.calibration.measured_movements import BIN
from turnout.calibration.misfit import (
    EFFECT_PASSES,
    Frame,
    Misfit,
    effects_after,
    jacobian,
    shared_corrections,
    update_movement_effects,
)
from turnout.calibration.noise import missed_by_model
from turnout.calibration.parameter import Parameter, coordinates, values_at
from turnout.calibration.predict import compared, predicted
from turnout.calibration.shared import (
    left_out,
    poorly_followed,
    shared_discrepancy,
    without_common,
)

Floats = NDArray[np.float64]
# Steps of a fit; how many more are allowed after one that still lowered the cost by this share and
# by a whole square of a standard deviation; and the limit of all.
MAX_STEPS, EXTRA_STEPS, STEP_LIMIT = 12, 4, 40
EXTENDING_SHARE, EXTENDING_DECREASE = 1e-3, 1.0
# Noise of the passes of a rough fit, as a share of the model error at the start [-].
ROUGH_SHARES, JOINT_SHARES = (1.0,), (1.0, 0.1)
MAX_PASSES = 4
# Longest step of a coordinate; half a unit is a factor of 1.6.
MAX_STEP = 0.5
# Steps below this are lost in the noise of the solver [coordinate].
MIN_STEP = 1e-4
# A step whose predicted decrease is below this is not tried [square of a standard deviation].
MIN_DECREASE = 0.05
# Of a stage that others follow: most steps, most rejected in a row, and the share of the cost that
# a step must be predicted to save.
ROUGH_STEPS, ROUGH_REJECTED, ROUGH_DECREASE = 6, 2, 0.01
# How many movements the expected scatter counts for beside those that were measured.
SCATTER_WEIGHT = 2.0
# Relative change of the noise beyond which the fit is repeated with it [-].
NOISE_TOLERANCE = 0.25
# Residuals beyond this many standard deviations, such as at an impact, count less once near.
OUTLIER_LIMIT = 3.0
# From the median of absolute values to the standard deviation of a normal distribution [-].
MAD_TO_SIGMA = 1.4826


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


def fit(
    misfit: Misfit,
    parameters: Sequence[Parameter],
    values: Mapping[str, float],
    *,
    rough: bool = False,
    noise_shares: Sequence[float] = ROUGH_SHARES,
    near: Fit | None = None,
    refined: bool = True,
    min_decrease: float = MIN_DECREASE,
    on_step: Callable[[float], None] | None = None,
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
    noise_shares : sequence of float
        For each pass of a rough fit, which share of the model error at the start is taken as noise
        [-].
    near : Fit, optional
        A rough fit that ended at the values: its movements' own values are gone on with.
    refined : bool
        Whether a fit that is not rough ends with shorter steps of the solver.
    min_decrease : float
        Predicted decrease of the cost below which a step is not tried
        [square of a standard deviation].
    on_step : callable, optional
        Called with the root mean square of the residuals after each step.

    Returns
    -------
    Fit

    Raises
    ------
    SolverError
        When a movement cannot be simulated at the start.
    """
    iterations, effects = 0, near.misfit.effects if near else {}
    local = near.local if near else None
    if rough:
        inflated = inflate_noise(misfit, parameters, values)
        for share in noise_shares:
            scaled = replace(scale_inflation(inflated, misfit, share), effects=effects)
            found = _least_squares(
                scaled, parameters, values, rough=True, on_step=on_step, local=local
            )
            iterations += found.iterations
            values, effects, local = found.values, found.misfit.effects, found.local
        return replace(found, misfit=reestimate_noise(found, misfit), iterations=iterations)
    first, misfit = misfit, replace(misfit, effects=effects)
    for number in range(MAX_PASSES):
        # Finer steps are no remedy for a model of something else.
        poor = bool(poorly_followed(misfit.comparison, misfit.movements))
        misfit = replace(misfit, fine=refined and number > 0 and not poor)
        found = _least_squares(
            misfit,
            parameters,
            values,
            rough=False,
            on_step=on_step,
            local=local,
            min_decrease=min_decrease,
        )
        iterations += found.iterations
        values, local = found.values, found.local
        misfit = reestimate_noise(found, first)
        if number > 0 and (poor or _same_noise(found.misfit, misfit)):
            break
    return replace(found, iterations=iterations)


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


def scale_inflation(inflated: Misfit, first: Misfit, share: float) -> Misfit:
    """Return a misfit with a share of the inflated noise, nowhere below the measured noise."""
    noise = dict(first.comparison.noise)
    for key, measured in noise.items():
        size = share * inflated.comparison.noise[key].missed
        if size > measured.missed:
            noise[key] = replace(measured, missed=size, missed_length=BIN)
    return replace(first, comparison=replace(first.comparison, noise=noise))


def _least_squares(
    misfit: Misfit,
    parameters: Sequence[Parameter],
    values: Mapping[str, float],
    *,
    rough: bool,
    on_step: Callable[[float], None] | None,
    local: Linearisation | None = None,
    min_decrease: float = MIN_DECREASE,
) -> Fit:
    """Levenberg-Marquardt within bounds, in one state of noise and scatter."""
    names = [item.name for item in parameters]
    if local is None or not set(names) <= set(local.stepped):
        local = misfit.local(values, names)
    else:
        whole = {**misfit.base, **values}
        local = replace(local, values=whole, simulated=tuple(misfit.responses([whole])[0]))
    damping, iterations = 1e-4, 0
    max_steps, max_rejected = (ROUGH_STEPS, ROUGH_REJECTED) if rough else (MAX_STEPS, MAX_STEPS)
    message, converged = "", rough
    while True:
        misfit, local, frame = update_movement_effects(
            misfit, local, names, passes=1 if rough else EFFECT_PASSES
        )
        r = misfit.residuals_of(local.simulated, frame)
        J = jacobian(local, frame, names)
        cost = float(r @ r)
        if on_step is not None:
            on_step(float(np.sqrt(cost / max(r.size, 1))))
        accepted, rejected = False, 0
        while iterations < max_steps and rejected < max_rejected:
            iterations += 1
            step, predicted_decrease = _step(r, J, parameters, local.values, damping)
            least = max(min_decrease, ROUGH_DECREASE * cost) if rough else min_decrease
            if predicted_decrease < least or np.abs(step).max() < MIN_STEP:
                message, converged = "converged", True
                break
            theta = coordinates(parameters, local.values) + step
            trial = {**local.values, **values_at(parameters, theta)}
            trial_misfit = replace(misfit, effects=effects_after(misfit, local, frame, names, step))
            here = tuple(trial_misfit.responses([trial])[0])
            r_trial = trial_misfit.residuals_of(here, frame)
            trial_cost = float(r_trial @ r_trial)
            if np.isfinite(trial_cost) and trial_cost < cost:
                damping, accepted, misfit = 0.1 * damping, True, trial_misfit
                if not rough and cost - trial_cost > max(
                    EXTENDING_DECREASE, EXTENDING_SHARE * trial_cost
                ):
                    max_steps = max(max_steps, min(iterations + EXTRA_STEPS, STEP_LIMIT))
                break
            damping, rejected = max(10.0 * damping, 1e-3), rejected + 1
            if np.abs(step).max() < 10 * MIN_STEP:
                message, converged = "converged to the noise of the solver", True
                break
        if not accepted:
            break
        local = replace(local, values=trial, simulated=here)
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


def _step(
    r: Floats,
    J: Floats,
    parameters: Sequence[Parameter],
    values: Mapping[str, float],
    damping: float,
) -> tuple[Floats, float]:
    r"""Return the Levenberg-Marquardt step within bounds, and the predicted decrease of the cost.

    .. math::

        \min_s \|J s + r\|^2 + \lambda \|D s\|^2, \quad D_{jj} = \|J_{:j}\|

    Parameters
    ----------
    r : ndarray, shape (n,)
        Whitened residuals [-].
    J : ndarray, shape (n, p)
        Their change with each coordinate.
    parameters : sequence of Parameter
        With bounds, in the order of the columns of `J`.
    values : mapping of str to float
        At the present point.
    damping : float
        :math:`\lambda` [-].
    """
    D = np.sqrt((J**2).sum(axis=0))
    D = np.where(D > 0, D, 1.0)
    theta = coordinates(parameters, values)
    lower = np.array([item.coordinate(item.lower) for item in parameters]) - theta
    upper = np.array([item.coordinate(item.upper) for item in parameters]) - theta
    lower = np.minimum(np.maximum(lower, -MAX_STEP), -1e-12)
    upper = np.maximum(np.minimum(upper, MAX_STEP), 1e-12)
    # The triangle of [J r] gives the same step as the tall matrices.
    R: Floats = np.asarray(np.linalg.qr(np.column_stack([J, r]), mode="r"), dtype=np.float64)
    p = len(parameters)
    matrix = np.vstack([R[:, :p], np.sqrt(damping) * np.diag(D)])
    right = np.concatenate([-R[:, p], np.zeros(p)])
    step = lsq_linear(matrix, right, bounds=(lower, upper)).x
    r_linear = r + J @ step
    return np.asarray(step), float(r @ r - r_linear @ r_linear)


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
        noise[channel, drive] = replace(known, white=hypot(known.white, rest))
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
    corrections = shared_corrections(found.local, found.frame)
    for alignment, response, shared in zip(
        found.frame.alignments, found.local.simulated, corrections, strict=True
    ):
        for (signal, _), row in zip(
            alignment.parts, alignment.remaining_residuals(response, shared=shared), strict=True
        ):
            known = noise[signal.channel, signal.drive].total
            most = OUTLIER_LIMIT * max(known, MAD_TO_SIGMA * float(np.median(np.abs(row))))
            key = (signal.channel, signal.drive, alignment.movement.direction)
            series.setdefault(key, []).append(np.clip(row, -most, most))
    return series


def _discrepancies(
    *misfits: Misfit,
) -> list[dict[tuple[str, str, str], tuple[float, float]]]:
    """Return shared discrepancies with the same keys, of no size where there is none."""
    keys = [key for misfit in misfits for key in misfit.comparison.discrepancy]
    return [{key: m.comparison.discrepancy.get(key, (0.0, BIN)) for key in keys} for m in misfits]


def _same_noise(before: Misfit, after: Misfit) -> bool:
    """Return whether noise and scatter changed by at most a quarter."""
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
