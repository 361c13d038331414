r"""Discrepancy between model and switch in forces, currents and powers.

The discrepancy is one of the force. At a machine, current and power follow the force, so an error
:math:`\delta_F` of the force shows in them through the local gain of the machine's map:

.. math:: \delta_I(t) = g_I(t)\,\delta_F(t) + \varepsilon\,\hat I\,u(t), \qquad
    \delta_P(t) = g_P(t)\,\delta_F(t) + \varepsilon\,\hat P\,u(t), \qquad
    g_I = \frac{\partial I}{\partial F}

at the steady points of the machine for the force of the nominal sound throw; it is zero while the
machine is off, held, or its clutch slips. :math:`u` is the machine's own error, a process with the
kernel of the discrepancy, common to current and power and independent of the force; :math:`\hat I`
is the peak after the inrush. Without it, :math:`I - g_I F` would be free of error, and the smallest
deviation from the steady map would count as visible.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.detection.conditions import FORCE, Conditions
from turnout.detection.features import correlation, discrepancy_covariance

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Signal:
    """A quantity of a drive.

    Attributes
    ----------
    quantity : str
        "force", "current" or "power".
    drive : str
        Name.
    """

    quantity: str
    drive: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SignalErrors:
    """Response of each signal to errors of the force, from the nominal sound throw.

    Attributes
    ----------
    amplitude : ndarray, shape (n_signals,)
        Peak of each signal; of currents and powers after the inrush [N], [A] or [W].
    force_peak : ndarray, shape (n_signals,)
        Of the drive that the signal belongs to [N].
    gain : ndarray, shape (n_signals, n_times)
        Change of the signal with the force of its drive: 1, [A/N] or [W/N].
    """

    amplitude: Floats
    force_peak: Floats
    gain: Floats


def forces_only(amplitude: Floats, *, count: int) -> SignalErrors:
    """Return the errors where every signal is the force of a drive."""
    return SignalErrors(
        amplitude=amplitude, force_peak=amplitude, gain=np.ones((len(amplitude), count))
    )


def discrepancy_of_signals(
    time: Floats,
    means: Floats,
    *,
    errors: SignalErrors,
    signals: Sequence[Signal],
    conditions: Conditions,
) -> Floats:
    """Return the covariance of features that the discrepancy causes, of a switch and of a throw.

    Parameters
    ----------
    time : ndarray, shape (n_times,)
        [s]
    means : ndarray, shape (n_windows, n_times)
        From `window_means`.
    errors : SignalErrors
        From `signal_errors`.
    signals : sequence of Signal
        Whose features.
    conditions : Conditions
        Discrepancy of forces and of machines, kernel, time.

    Returns
    -------
    ndarray, shape (n_features, n_features)
        Signal by signal, of which those of a drive are correlated.
    """
    if all(item.quantity == FORCE for item in signals):
        return discrepancy_covariance(
            time, means, amplitude=errors.amplitude, conditions=conditions
        )
    kernel = correlation(time[:, np.newaxis] - time, conditions)
    windows = len(means)
    found = np.zeros((len(signals) * windows, len(signals) * windows))
    of_drive: dict[str, list[int]] = {}
    for number, item in enumerate(signals):
        of_drive.setdefault(item.drive, []).append(number)
    for rows in of_drive.values():
        force, own = [], []
        for number in rows:
            peak = conditions.discrepancy * errors.force_peak[number]
            force.append(peak * means * errors.gain[number])
            is_force = signals[number].quantity == FORCE
            share = 0.0 if is_force else conditions.machine_discrepancy
            own.append(share * errors.amplitude[number] * means)
        block = sum(way @ kernel @ way.T for way in (np.vstack(force), np.vstack(own)))
        at = np.concatenate([np.arange(windows) + number * windows for number in rows])
        found[np.ix_(at, at)] = block
    return found
