"""Noise of a fit: the model error at its start, and what is left over at its end."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import hypot
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.comparison import Comparison, Key
from turnout.calibration.measured_movements import BIN
from turnout.calibration.misfit import Misfit
from turnout.calibration.noise import missed_by_model
from turnout.calibration.parameter import Parameter
from turnout.calibration.predict import compared, predicted
from turnout.calibration.shared import left_out, poorly_followed, shared_discrepancy, without_common
from turnout.calibration.shared_estimates import shared_corrections
from turnout.core.running_current import MAD_TO_SIGMA

if TYPE_CHECKING:
    from turnout.calibration.fit import Fit

Floats = NDArray[np.float64]
# How many movements the expected scatter counts for beside those that were measured.
SCATTER_WEIGHT = 2.0
# Relative change of the noise beyond which the fit is repeated with it [-].
NOISE_TOLERANCE = 0.25
# Residuals beyond this many standard deviations, such as at an impact, count less once near.
OUTLIER_LIMIT = 3.0


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


def reestimate_noise(found: "Fit", first: Misfit) -> Misfit:
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


def _remaining_series(found: "Fit") -> dict[tuple[str, str, str], list[Floats]]:
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


def is_poor(misfit: Misfit) -> bool:
    """Return whether a model misses too much for a trustworthy fit."""
    return bool(poorly_followed(misfit.comparison, misfit.movements))


def noise_near(near: Misfit, comparison: Comparison) -> Comparison:
    """Return a comparison with the noise that a fit near by left."""
    known = near.comparison
    return replace(
        comparison,
        noise=known.noise,
        scatter=known.scatter,
        discrepancy=known.discrepancy,
        outlier_limit=known.outlier_limit,
    )


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
