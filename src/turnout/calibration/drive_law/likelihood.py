"""How likely the residuals of a fit are under a state of noise, and what criteria make of that."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from turnout.calibration.comparison import Key
from turnout.calibration.fit import Fit
from turnout.calibration.misfit import framed
from turnout.calibration.noise import Noise, peaks_of
from turnout.calibration.observed import Movement

# Two solvers agree to this share of a channel's peak, for about this long [-], [s]: less than that
# says nothing about a law.
AGREEMENT, AGREEMENT_TIME = 3e-3, 0.1


def floored(noise: Mapping[Key, Noise], movements: Sequence[Movement]) -> dict[Key, Noise]:
    """Return noise that holds what solvers of the same mechanics may differ by."""
    peaks = peaks_of(movements)
    return {
        key: replace(item, missed=AGREEMENT * peaks[key], missed_length=AGREEMENT_TIME)
        for key, item in noise.items()
    }


def deviance(found: Fit, noise: Mapping[Key, Noise]) -> float:
    r"""Return minus twice the logarithm of the likelihood of a fit under a state of noise.

    .. math:: D = r^T C^{-1} r + \ln \det C

    with the covariance `C` of noise, doubts of onset and zero, and what scatters.
    """
    comparison = replace(found.misfit.comparison, noise=noise)
    misfit = replace(found.misfit, comparison=comparison, frame=None)
    frame = framed(found.local, misfit)
    residuals = misfit.residuals_of(found.local.here, frame)
    total = float(residuals @ residuals)
    for view in frame.views:
        for factor in view.factors:
            total += 2.0 * float(np.log(np.diag(factor)).sum())
        total -= 2.0 * float(np.log1p(-view.shrink).sum())
    return total


def effective_samples(found: Fit, noise: Mapping[Key, Noise]) -> float:
    """Return how many independent samples the movements of a fit are worth."""
    frame = framed(found.local, found.misfit)
    return sum(
        noise[signal.channel, signal.drive].effective(signal.time[bins])
        for view in frame.views
        for signal, bins in view.parts
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
