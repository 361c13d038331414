"""Whether movements show a drive slip, or only that it does not slip below some force."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from turnout.study.calibration.fit import Fit
from turnout.study.calibration.local import is_slip_level, touches
from turnout.study.calibration.parameter import Parameter

Floats = NDArray[np.float64]
# How much further a slip level is tried [coordinate], and by how much the cost must then rise for
# the level to be told from above (95 %, one parameter).
FURTHER, TOLD = 0.05, 3.84


def told_from_above(found: Fit) -> tuple[Fit, list[str]]:
    """Forget slip levels that were only pushed out of the way, and say so.

    A level below the largest force is raised by a fit until it just no longer matters. There the
    cost is steep on one side and flat on the other, and its slope would claim a sharp value.

    Parameters
    ----------
    found : Fit
        At its end.

    Returns
    -------
    Fit, list of str
        Without the slopes of such levels; a warning for each of them.
    """
    slopes, warnings = found.jacobian.copy(), []
    for column, item in enumerate(found.parameters):
        if is_slip_level(item) and not _told(found, item, column):
            slopes[:, column] = 0.0
            value = found.values[item.name]
            warnings.append(
                f"{item.name}: no movement tells it, only that it is not below {value:.0f} N; "
                "measure a larger object beside the drive, at which it slips"
            )
    return (replace(found, jacobian=slopes) if warnings else found), warnings


def _told(found: Fit, item: Parameter, column: int) -> bool:
    """Tell whether a higher level makes the cost rise, whatever the other parameters do."""
    value = found.values[item.name]
    higher = item.value(item.coordinate(value) + FURTHER)
    numbers = [n for n, row in enumerate(found.local.here) if touches(item, value, row)]
    if not numbers or higher <= value:
        return bool(numbers)
    others = np.delete(found.jacobian, column, axis=1)
    ahead = _least(_residuals(found, item, higher, numbers), others)
    return ahead - _least(found.residuals, others) > TOLD


def _residuals(found: Fit, item: Parameter, value: float, numbers: Sequence[int]) -> Floats:
    """Return the residuals with another value of a parameter, thrown where it acts."""
    misfit = found.misfit
    part = replace(
        misfit,
        movements=tuple(misfit.movements[n] for n in numbers),
        own={name: tuple(row[n] for n in numbers) for name, row in misfit.own.items()},
        frame=None,
    )
    made = part.responses([{**found.values, item.name: value}])[0]
    responses = list(found.local.here)
    for number, response in zip(numbers, made, strict=True):
        responses[number] = response
    return misfit.residuals_of(responses, found.frame)


def _least(residuals: Floats, slopes: Floats) -> float:
    """Return the cost that is left when parameters take up what they can."""
    step = np.linalg.lstsq(slopes, residuals, rcond=None)[0]
    rest = residuals - slopes @ step
    return float(rest @ rest)
