"""Sensors as unknowns: what is stated of gains, zeros and clock, and what a fit says of them."""

import json
import math
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from turnout.calibration.comparison import Comparison, Key
from turnout.calibration.covariance import model_columns, solver_columns
from turnout.calibration.fit import Fit
from turnout.calibration.misfit import framed, plain_jacobian, shared_estimates
from turnout.calibration.parameter import prior_slopes
from turnout.calibration.shared import CLOCK, GAIN, ZERO, SensorColumn

# A gain this many deviations from where it was stated to be gives a warning.
LEAVES_PRIOR = 2.0
# One this many of its own deviations from nothing is off.
CLEAR = 4.0
# One so many stated deviations off: something else is wrong that the sensors take up.
BEYOND_BELIEF = 4.0
# Movements that all begin later than their currents say, in standard deviations of an onset.
LATE, LEAST_ONSETS, LEAD_PASSES = 3.0, 2, 3


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundSensor:
    """An unknown of the measuring chain, as stated and as found.

    Attributes
    ----------
    column : SensorColumn
        Which one, and its standard deviation before the measurement.
    value, deviation : float
        How much too high it reads or too long its seconds are, and the standard deviation of that
        [-, N, -].
    """

    column: SensorColumn
    value: float
    deviation: float

    @property
    def stated(self) -> float:
        """Standard deviation before the measurement."""
        return self.column.stated

    @property
    def name(self) -> str:
        """Name in texts."""
        if self.column.kind == CLOCK:
            return "clock of the recorder"
        where = f"gauges of drive {self.column.drive}" if self.column.drive else "load cell"
        return f"zero of the {where}" if self.column.kind == ZERO else where

    @property
    def key(self) -> str:
        """Key of a calibration's `chain`."""
        return chain_key(self.column.kind, self.column.channel, self.column.drive)

    @property
    def text(self) -> str:
        """Stated and found value in words."""
        factor, unit, _ = self._shown
        return (
            f"{self.short_text.removesuffix(f' {unit}')} ± "
            f"{factor * self.deviation:.{self._decimals}f} "
            f"{unit} (stated ± {factor * self.stated:.3g} {unit})"
        )

    @property
    def short_text(self) -> str:
        """Found value alone in words."""
        factor, unit, _ = self._shown
        # Adding zero turns a negative zero into a plain one.
        number = round(factor * self.value, self._decimals) + 0.0
        return f"{self.name} {number:+.{self._decimals}f} {unit}"

    @property
    def _shown(self) -> tuple[float, str, int]:
        """Factor from SI to the unit shown, that unit, and decimals at least."""
        return (1.0, "N", 1) if self.column.kind == ZERO else (100.0, "%", 2)

    @property
    def _decimals(self) -> int:
        """Decimals that show a deviation with a digit at least."""
        factor, _, least = self._shown
        size = factor * self.deviation
        return max(least, math.ceil(-math.log10(size))) if size > 0.0 else least

    @property
    def warning(self) -> str:
        """What to do where it leaves its prior."""
        remedy = {
            GAIN: "calibrate the channel (shunt or known loads), state gain_uncertainty in the "
            "channel map, or look for another cause",
            ZERO: "zero the channel with the rail unloaded, or look for another cause",
            CLOCK: "check the sampling rate that the recorder states, or look for another cause",
        }
        return f"{self.text}: further off than was stated; {remedy[self.column.kind]}"

    @property
    def cause(self) -> str:
        """Name of the cause that it is where the movements show it; empty where they do not."""
        if abs(self.value) <= max(CLEAR * self.deviation, self.stated):
            return ""
        return {GAIN: "gain", ZERO: "zero", CLOCK: "timing"}[self.column.kind]

    @property
    def leaves(self) -> bool:
        """Whether the movements put it beyond what was stated of it."""
        return abs(self.value) > LEAVES_PRIOR * self.stated


def chain_key(kind: str, channel: str = "", drive: str = "") -> str:
    """Return the key of an unknown of the measuring chain.

    Examples
    --------
    >>> chain_key(GAIN, "drive_force", "1"), chain_key(ZERO, "object_force"), chain_key(CLOCK)
    ('gain drive_force.1', 'zero object_force', 'clock')
    """
    return f"{kind} {f'{channel}.{drive}'.strip('.')}".strip()


def stated_gains(dataset: xr.Dataset, comparison: Comparison) -> dict[Key, float]:
    """Return the uncertainty of the gain of each channel, from the channel map or the default.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `build_campaign`; its attribute `gain_uncertainty` holds what the channel map states.
    comparison : Comparison
        With the channels, and the default.

    Examples
    --------
    >>> from turnout.calibration.noise import Noise
    >>> stated = xr.Dataset(attrs={"gain_uncertainty": '{"drive_force.1": 0.002}'})
    >>> known = {("drive_force", "1"): Noise(white=1.0), ("object_force", ""): Noise(white=1.0)}
    >>> list(stated_gains(stated, Comparison(noise=known)).values())
    [0.002, 0.01]
    """
    stated = json.loads(str(dataset.attrs.get("gain_uncertainty", "{}")))
    default = comparison.uncertainty.common_gain
    return {
        (channel, drive): float(stated.get(f"{channel}.{drive}".rstrip("."), default))
        for channel, drive in comparison.noise
    }


def found_sensors(found: Fit) -> list[FoundSensor]:
    r"""Return gains, zeros and clock at a fit, with what the parameters leave uncertain of them.

    With the Jacobian `J` of the residuals that are whitened movement by movement, and columns `B`
    of what all movements share, parameters and columns have the joint covariance

    .. math:: \begin{pmatrix} J^T J & -J^T B \\ -B^T J & I + B^T B \end{pmatrix}^{-1}

    and cross-talk, the scale of the model, step, mesh and modes of the solver, each an error of all
    movements alike, add the squares of what they do to them.

    Parameters
    ----------
    found : Fit
        At its end.
    """
    shared = found.frame.shared
    if shared is None or not shared.sensors:
        return []
    J = plain_jacobian(found.local, found.frame, [item.name for item in found.parameters])
    B, count = shared.columns, J.shape[1]
    # Parameters with flat priors: a weak one keeps those that are not identified regular.
    weak = 1e-6 * np.eye(count) + np.diag(prior_slopes(found.parameters) ** 2)
    joint = np.block([[J.T @ J + weak, -J.T @ B], [-B.T @ J, np.eye(B.shape[1]) + shared.gram]])
    inverse = np.linalg.inv(joint)
    variance = np.diag(inverse)[count:].copy()
    for column in (*model_columns(found), *solver_columns(found)):
        move = inverse @ np.concatenate([-J.T @ column, B.T @ column])
        variance += move[count:] ** 2
    deviations = np.sqrt(variance)
    values = shared_estimates(found.local, found.frame)
    return [
        FoundSensor(
            column=item,
            value=float(values[n]) * item.stated,
            deviation=float(deviations[n]) * item.stated,
        )
        for n, item in enumerate(shared.sensors)
    ]


def sensor_reasons(found: Fit) -> list[str]:
    """Say which sensors would have to be off by more than anybody would believe of them.

    A cause that is not known is taken up by gains: rails of another stiffness, a bushing that is
    soft. Values are then off by as much as the gains are.
    """
    return [
        f"{item.text}: not to be believed of it, so something else is wrong"
        for item in found_sensors(found)
        # A clock is warped as it is: only other unknowns show that it took up something else.
        if item.column.kind != CLOCK and abs(item.value) > BEYOND_BELIEF * item.stated
    ]


def common_lead(found: Fit) -> float:
    """Return how much later than marked all movements begin [s]; 0 where they do not.

    Motors may run before the rods move: the onset that currents mark is then early in all
    movements alike, and their own uncertainty is about that lead.
    """
    comparison, lead = found.misfit.comparison, 0.0
    spread = comparison.uncertainty.clocked_onset
    if sum(item.clocked for item in found.misfit.movements) < LEAST_ONSETS:
        return 0.0
    # As if currents said no more of the onset than forces: else they would hold it where it is.
    wide = replace(comparison.uncertainty, clocked_onset=comparison.uncertainty.onset)
    for _ in range(LEAD_PASSES):
        about = replace(comparison, uncertainty=wide, lead=lead)
        frame = framed(found.local, replace(found.misfit, comparison=about))
        lead = float(
            np.median([a.estimates["onset"][0] for a in frame.alignments if a.movement.clocked])
        )
    return lead if abs(lead) > LATE * spread else 0.0


def needs_lead(found: Fit) -> bool:
    """Return whether all movements begin later than marked, though no lead is known of."""
    return not found.misfit.comparison.lead and bool(common_lead(found))


def lead_text(lead: float) -> str:
    """Say by how much motors lead.

    Examples
    --------
    >>> lead_text(0.15)
    'timing: the motors run 150 ms before the rods move'
    """
    way = "before" if lead > 0 else "after"
    return f"timing: the motors run {1e3 * abs(lead):.0f} ms {way} the rods move"
