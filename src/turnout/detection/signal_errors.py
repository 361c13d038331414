r"""How the discrepancy between model and switch shows in forces, currents and powers.

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

from turnout.detection.conditions import CURRENT, FORCE, POWER, Conditions
from turnout.detection.drive_quantities import Signal, after_inrush, force_peaks, read_signals
from turnout.detection.features import correlation, discrepancy_covariance
from turnout.machine.components import Machine
from turnout.machine.rows import supply_voltage
from turnout.machine.steady import shaft_travel, steady_point, torque_for
from turnout.panel.load import LoadedPanel
from turnout.response.drives import ON
from turnout.response.simulate import simulate
from turnout.scheme import Scheme

Floats = NDArray[np.float64]

FORCES = 41
"""Of the table of steady points, from 0 to what the clutch holds."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SignalErrors:
    """How errors of the force show in each signal, from the nominal sound throw.

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


def signal_errors(
    panel: LoadedPanel, signals: Sequence[Signal], *, time: Floats, scheme: Scheme | None = None
) -> SignalErrors:
    """Simulate the nominal sound throw and return how errors of its forces show.

    Parameters
    ----------
    panel : LoadedPanel
        At its nominal friction.
    signals : sequence of Signal
        Of its drives.
    time : ndarray, shape (n_times,)
        Of the gains [s].
    scheme : Scheme, optional
        Numerical choices.
    """
    if all(item.quantity == FORCE for item in signals):
        peaks = force_peaks(panel, scheme=scheme)
        names = list(panel.drive)
        amplitude = np.array([peaks[names.index(item.drive)] for item in signals])
        return forces_only(amplitude, count=time.size)
    dataset = simulate(panel, scheme=scheme)
    instants = dataset["time"].to_numpy()
    values = read_signals(dataset.expand_dims("scenario"), signals)[0]
    amplitude, peak, gain = [], [], []
    for item, row in zip(signals, values, strict=True):
        force = dataset["drive_force"].sel(drive=item.drive).to_numpy()
        peak.append(float(np.abs(force).max()))
        if item.quantity == FORCE:
            amplitude.append(peak[-1])
            gain.append(np.ones(time.size))
            continue
        state = dataset["drive_state"].sel(drive=item.drive).to_numpy()
        amplitude.append(float(np.abs(row[np.isfinite(row) & after_inrush(instants, state)]).max()))
        own = _gain_along(panel, item, force=force, state=state)
        gain.append(own[np.clip(np.searchsorted(instants, time), 0, instants.size - 1)])
    return SignalErrors(
        amplitude=np.array(amplitude), force_peak=np.array(peak), gain=np.array(gain)
    )


def forces_only(amplitude: Floats, *, count: int) -> SignalErrors:
    """Return the errors where every signal is the force of a drive."""
    return SignalErrors(
        amplitude=amplitude, force_peak=amplitude, gain=np.ones((len(amplitude), count))
    )


def _gain_along(panel: LoadedPanel, item: Signal, *, force: Floats, state: Floats) -> Floats:
    """Return the local gain of a machine at every instant of a throw."""
    name = panel.drive[item.drive].machine
    assert name is not None
    force_table, gain_table = local_gain(panel.machine[name], item.quantity)
    gain = np.interp(np.maximum(force, 0.0), force_table, gain_table)
    return np.where(state == ON, gain, 0.0)


def local_gain(machine: Machine, quantity: str) -> tuple[Floats, Floats]:
    """Return forces [N] and the change of current [A/N] or power [W/N] with the force there.

    Parameters
    ----------
    machine : Machine
        In mid-stroke, moving.
    quantity : str
        "current" or "power".

    Examples
    --------
    >>> from turnout.machine.machine_file import load_machines
    >>> force, gain = local_gain(load_machines("jea73").machine["jea73"], "current")
    >>> bool(np.all((1e3 * gain > 0.1) & (1e3 * gain < 0.3)))  # A/kN
    True
    """
    held = machine.clutch.torque * (1.0 - machine.clutch.worn) * machine.gear.efficiency
    force = np.linspace(0.0, held / shaft_travel(machine), FORCES)
    points = [steady_point(machine, torque=torque_for(machine, float(each))) for each in force]
    power = np.array([point.power for point in points])
    from_supply = machine.circuit.measured_current == "supply" and machine.motor.kind != "induction"
    current = power / supply_voltage(machine) if from_supply else [p.current for p in points]
    return force, np.gradient({CURRENT: np.asarray(current), POWER: power}[quantity], force)


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
