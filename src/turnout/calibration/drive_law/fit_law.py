"""Fits of one law: the chain of a calibration, from a start that the law itself suggests."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.comparison import Key
from turnout.calibration.drive_law.candidates import DriveLaw, level_key
from turnout.calibration.fit import Fit, fit
from turnout.calibration.measured_movements import MeasuredMovement, largest_force
from turnout.calibration.misfit import Misfit, framed
from turnout.calibration.noise import Noise, peaks_of
from turnout.calibration.parameter import Parameter

Floats = NDArray[np.float64]
# Values of what a law has beyond the plain one with which a fit may start, as shares of the first
# guess: what is small is found by no slope from far above.
TRIES = (0.1, 0.3, 1.0, 3.0)


class _End(TypedDict):
    refined: bool
    min_decrease: float


# How every law is fitted to its end: what half a step of the solver moves is within the noise that
# laws are judged by, and so is a tenth of a unit of the cost for
# each parameter.
END: _End = {"refined": False, "min_decrease": 0.1}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LawFit:
    """One law at its best.

    Attributes
    ----------
    law : DriveLaw
        Law of the drive, with its start values.
    names : tuple of str
        Parameters that were fitted.
    found : Fit
        Where it ended.
    """

    law: DriveLaw
    names: tuple[str, ...]
    found: Fit


def fitted_plain(law: DriveLaw, misfit: Misfit, vary: Sequence[Parameter]) -> LawFit:
    """Fit the plain law as a calibration does: roughly at first, then to convergence.

    Raises
    ------
    SolverError
        When a movement cannot be simulated.
    """
    near = fit(replace(misfit, quick=True), vary, misfit.base, rough=True)
    found = fit(replace(misfit, base=near.values), vary, near.values, near=near, **END)
    return LawFit(law=law, names=tuple(item.name for item in vary), found=found)


def fitted_variant(
    law: DriveLaw, misfit: Misfit, vary: Sequence[Parameter], *, plain: Fit, drive: str
) -> LawFit:
    """Fit another law from where the plain one ended, to the same end.

    Parameters
    ----------
    law : DriveLaw
        Not the plain one.
    misfit : Misfit
        With this law; its noise as the plain one's was before its fit.
    vary : sequence of Parameter
        To change, those of the law among them.
    plain : Fit
        Of the plain law, at its end.
    drive : str
        Whose law it is.

    Raises
    ------
    SolverError
        When a movement cannot be simulated.
    """
    at_plain = replace(misfit, effects=plain.misfit.effects, base={**misfit.base, **plain.values})
    values = _suggested(law, at_plain, plain)
    effects = dict(plain.misfit.effects)
    if level_key(drive) in law.scatter:
        effects[level_key(drive)] = _movement_levels(
            law, replace(at_plain, base=values), plain, drive
        )
    start = replace(plain, misfit=replace(at_plain, effects=effects, base=values), values=values)
    found = fit(replace(misfit, base=values), vary, values, near=start, **END)
    return LawFit(law=law, names=tuple(item.name for item in vary), found=found)


def fitted_from(before: LawFit, misfit: Misfit, other: Fit) -> LawFit:
    """Fit a law again from where a fit of another law ended.

    Parameters
    ----------
    before : LawFit
        Of the law, from another start.
    misfit : Misfit
        With the law; its noise as it was before the first fit.
    other : Fit
        Of the other law, at its end.

    Raises
    ------
    SolverError
        When a movement cannot be simulated.
    """
    vary = [item for item in misfit.parameters if item.name in before.names]
    values = {item.name: other.values[item.name] for item in misfit.parameters}
    effects = {
        name: row for name, row in other.misfit.effects.items() if name in misfit.comparison.scatter
    }
    # Slopes of another law are none of this one.
    near = replace(
        other,
        misfit=replace(misfit, effects=effects),
        values=values,
        local=replace(other.local, stepped={}),
    )
    found = fit(replace(misfit, base=values), vary, values, near=near, **END)
    return replace(before, found=found)


def _suggested(law: DriveLaw, misfit: Misfit, plain: Fit) -> dict[str, float]:
    """Return the values of the plain fit, with that start of the law's own which is nearest."""
    values = {**misfit.base}
    for item in law.extra:
        tried = [min(max(share * item.start, item.lower), item.upper) for share in TRIES]
        points = [{**values, item.name: value} for value in tried]
        costs = [
            float(np.sum(misfit.residuals_of(row, plain.frame) ** 2))
            for row in misfit.responses(points)
        ]
        values[item.name] = tried[int(np.argmin(costs))]
    return values


def _movement_levels(law: DriveLaw, misfit: Misfit, plain: Fit, drive: str) -> tuple[float, ...]:
    """Return for each movement its likely slip level, as a share relative to the common one.

    Where a drive slips below the common level, a throw at the common one may not slip at all, and
    no slope shows that it should. So the largest force that was measured is tried as level.
    """
    name = level_key(drive)
    common = misfit.base[name]
    shares = tuple(largest_force(item, drive) / common - 1.0 for item in misfit.movements)
    tried = replace(misfit, effects={**misfit.effects, name: shares})
    rows = [
        (misfit, misfit.responses([misfit.base])[0]),
        (tried, tried.responses([misfit.base])[0]),
    ]
    chosen = []
    for number, alignment in enumerate(plain.frame.alignments):
        effects = {key: misfit.effect(key, number) for key in alignment.effects}
        costs = [
            float(
                np.sum(
                    alignment.whitened(alignment.measured - alignment.reduced(row[number], effects))
                    ** 2
                )
            )
            for _, row in rows
        ]
        costs[1] += (shares[number] / law.scatter[name]) ** 2
        chosen.append(shares[number] if costs[1] < costs[0] else 0.0)
    return tuple(chosen)


# Two solvers agree to this share of a channel's peak, for about this long [-], [s]: less than that
# says nothing about a law.
AGREEMENT, AGREEMENT_TIME = 3e-3, 0.1


def floored(noise: Mapping[Key, Noise], movements: Sequence[MeasuredMovement]) -> dict[Key, Noise]:
    """Return noise that holds what solvers of the same mechanics may differ by."""
    peaks = peaks_of(movements)
    return {
        key: replace(item, missed=AGREEMENT * peaks[key], missed_length=AGREEMENT_TIME)
        for key, item in noise.items()
    }


def deviance(found: Fit, noise: Mapping[Key, Noise]) -> float:
    r"""Return minus twice the logarithm of the likelihood of a fit under a state of noise.

    .. math:: D = r^T C^{-1} r + \ln \det C

    with the covariance `C` of noise, of the uncertain onset and zero, and of scattering parameters.
    """
    comparison = replace(found.misfit.comparison, noise=noise)
    misfit = replace(found.misfit, comparison=comparison)
    frame = framed(found.local, misfit)
    residuals = misfit.residuals_of(found.local.simulated, frame)
    total = float(residuals @ residuals)
    for alignment in frame.alignments:
        for factor in alignment.factors:
            total += 2.0 * float(np.log(np.diag(factor)).sum())
        total -= 2.0 * float(np.log1p(-alignment.shrink).sum())
    return total + (frame.shared.log_determinant if frame.shared else 0.0)


def effective_samples(found: Fit, noise: Mapping[Key, Noise]) -> float:
    """Return how many independent samples the movements of a fit are worth."""
    frame = framed(found.local, found.misfit)
    return sum(
        noise[signal.channel, signal.drive].effective(signal.time[bins])
        for alignment in frame.alignments
        for signal, bins in alignment.parts
    )


def criteria(deviance: float, *, parameters: int, samples: float) -> tuple[float, float]:
    r"""Return the criteria of Akaike, corrected for few samples, and of Schwarz.

    .. math::

        \mathrm{AICc} = D + 2 k + \frac{2 k (k + 1)}{n - k - 1}, \quad
        \mathrm{BIC} = D + k \ln n

    with the deviance `D`, `k` parameters and `n` effective samples. Sources: Hurvich and Tsai 1989,
    doi 10.1093/biomet/76.2.297; Schwarz 1978, doi 10.1214/aos/1176344136.

    Examples
    --------
    >>> akaike, schwarz = criteria(100.0, parameters=2, samples=50)
    >>> round(akaike, 3), round(schwarz, 3)
    (104.255, 107.824)
    """
    rest = samples - parameters - 1
    correction = 2.0 * parameters * (parameters + 1) / rest if rest > 0 else float("inf")
    akaike = deviance + 2.0 * parameters + correction
    return akaike, deviance + parameters * float(np.log(samples))
