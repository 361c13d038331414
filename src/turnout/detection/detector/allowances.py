r"""Allowed differences of a measured throw from a simulated one, as covariances of features.

A detector that takes its simulation for the truth trusts differences that no switch honours. So it
assumes, besides the discrepancy and noise of the reference case:

- the onset of a movement is known to some milliseconds, :math:`\sigma_\tau^2\,\dot y \dot y^T`;
- the force sensors have a gain, the same in all throws of a switch, and a zero that drifts.
"""

from dataclasses import dataclass, fields
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from turnout.detection.conditions import CURRENT, FORCE, POWER, Conditions, ErrorModel
from turnout.detection.detector.throw_layout import Layout, means_on
from turnout.detection.features import discrepancy_covariance
from turnout.detection.signal_discrepancy import Signal, SignalErrors, discrepancy_of_signals

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Allowances(ErrorModel):
    """Allowances of a detector: errors as in `ErrorModel`, and what is not in a simulation.

    More `discrepancy` than is expected makes a detector robust and a little blind. The zeros of
    current and power are taken to be as uncertain as a sample of them.

    Attributes
    ----------
    timing : float
        Standard deviation of the onset of each movement [s].
    gain : float
        Of the force sensors, fixed for a switch [-].
    zero : float
        Standard deviation of the zero of each force sensor in a throw [N].
    gap : float
        Of gaps beside what the model says [m].
    """

    timing: float = 3e-3
    gain: float = 0.01
    zero: float = 20.0
    gap: float = 0.2e-3

    def noise_of(self, quantity: str) -> float:
        """Return the noise of a sample of a quantity [N], [A] or [W]."""
        return {FORCE: self.noise, CURRENT: self.current_noise, POWER: self.power_noise}[quantity]

    def zero_of(self, quantity: str) -> float:
        """Return the standard deviation of the zero of a quantity in a throw [N], [A] or [W]."""
        return self.zero if quantity == FORCE else self.noise_of(quantity)

    @property
    def conditions(self) -> Conditions:
        """The part that the reference case knows too."""
        return Conditions(**{item.name: getattr(self, item.name) for item in fields(ErrorModel)})


def discrepancy_through_machines(
    layout: Layout, *, quantity: str, errors: SignalErrors, conditions: Conditions
) -> Floats:
    """Return the covariance of features of currents or powers, [A^2] or [W^2].

    The discrepancy is one of the force, which the machine passes on, and one of its own.

    Parameters
    ----------
    layout : Layout
        Windows.
    quantity : str
        "current" or "power".
    errors : SignalErrors
        Of the drives, with gains at the instants of `gain_times`.
    conditions : Conditions
        Sizes, kernel, time.
    """
    time, means = means_on(layout, rate=FINE_RATE)
    signals = [Signal(quantity=quantity, drive=drive) for drive in layout.drives]
    return discrepancy_of_signals(
        time, means, errors=errors, signals=signals, conditions=conditions
    )


def gain_times(layout: Layout) -> Floats:
    """Return the instants of a nominal throw that the gains of machines are needed at [s]."""
    return means_on(layout, rate=FINE_RATE)[0]


def discrepancy_of(layout: Layout, *, amplitude: Floats, conditions: Conditions) -> Floats:
    """Return the covariance of features that the discrepancy causes, of switch and throw [N^2].

    One process over opening and closing, independent between drives.

    Parameters
    ----------
    layout : Layout
        Windows.
    amplitude : ndarray, shape (n_drives,)
        Peak absolute force of the nominal sound throw [N].
    conditions : Conditions
        Size, kernel, time.
    """
    found = _unit_discrepancy(layout, conditions)
    scale = np.repeat(np.asarray(amplitude, dtype=np.float64), layout.windows)
    return found * np.outer(scale, scale)


@lru_cache(maxsize=8)
def _unit_discrepancy(layout: Layout, conditions: Conditions) -> Floats:
    """Return the covariance for amplitudes of 1; a detector needs the same one again and again."""
    time, means = means_on(layout, rate=FINE_RATE)
    found = discrepancy_covariance(
        time, means, amplitude=np.ones(len(layout.drives)), conditions=conditions
    )
    found.setflags(write=False)
    return found


FINE_RATE = 125.0
"""At which the kernel of the discrepancy is averaged over windows [Hz]."""


def noise_of(layout: Layout, *, noise: float, rate: float) -> Floats:
    """Return the covariance of features that white noise of samples causes [N^2]."""
    return np.diag(noise**2 / np.maximum(layout.width * rate, 1.0))


def zeros_of(layout: Layout, *, zero: float) -> Floats:
    """Return the covariance of features that unknown zeros of the force sensors cause [N^2]."""
    return np.asarray(zero**2 * (layout.drive[:, np.newaxis] == layout.drive))


def gains_of(layout: Layout, mean: Floats, *, gain: float) -> Floats:
    """Return the covariance of features that unknown gains cause, of one mean throw [N^2]."""
    same = layout.drive[:, np.newaxis] == layout.drive
    return np.asarray(gain**2 * np.where(same, np.outer(mean, mean), 0.0))
