"""The numerical scheme as a user chooses it: a step and a cut-off."""

import math

from turnout.errors import ResponseError
from turnout.integrate.scheme import Scheme

LEAST_OUTPUT_INTERVAL = 1e-3


def scheme_for(*, step: float, cutoff_frequency: float) -> Scheme:
    """Return a scheme that stores every step, but not more often than every millisecond.

    Parameters
    ----------
    step : float
        Time step [s].
    cutoff_frequency : float
        Modes up to here keep their inertia [Hz].

    Examples
    --------
    >>> scheme_for(step=2.5e-4, cutoff_frequency=300.0).stride
    4
    >>> scheme_for(step=2e-3, cutoff_frequency=300.0).output_interval
    0.002
    """
    if not step > 0:
        message = f"scheme: step = {step:g} s: must be more than 0"
        raise ResponseError(message)
    stride = max(1, math.ceil(LEAST_OUTPUT_INTERVAL / step - 1e-9))
    return Scheme(step=step, cutoff_frequency=cutoff_frequency, output_interval=stride * step)


__all__ = ["Scheme", "scheme_for"]
