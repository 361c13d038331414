"""Point machines identified from the currents of a campaign."""

import math
from collections.abc import Mapping, Sequence
from typing import Literal

import xarray as xr

from turnout.api.campaign import Campaign, dataset_of
from turnout.calibration.machine_estimates.force_anchor import Gauge, Sister
from turnout.calibration.machine_estimates.machine_fit import MachineFit
from turnout.calibration.machine_estimates.machine_fit import fit_machines as fit_dataset
from turnout.calibration.machine_estimates.three_phase import ThreePhaseFit
from turnout.calibration.machine_estimates.three_phase import fit_three_phase as fit_phases
from turnout.core.errors import MachineError


def fit_machines(
    campaign: Campaign | xr.Dataset,
    *,
    motor: Literal["linear", "series"] = "linear",
    saturation_current: float = math.inf,
    idle: Mapping[str, float] | None = None,
    clutch_force: Mapping[str, tuple[float, float]] | None = None,
    sister: Mapping[str, tuple[float, ...]] | None = None,
) -> MachineFit:
    """Identify machines from the currents of a campaign, per drive and direction.

    Idle current and amperes per newton where forces are measured too, slip current where a clutch
    slipped, with 95 % intervals; forces from currents only by an anchor.

    Parameters
    ----------
    campaign : Campaign or xarray.Dataset
        From `load_campaign`.
    motor : {"linear", "series"}
        "linear" for a permanent magnet or a separate field.
    saturation_current : float
        Of a series motor [A].
    idle : mapping of drive to float, optional
        Current with the rod taken off [A]; needed with the anchors below.
    clutch_force : mapping of drive to (float, float), optional
        Force at which the clutch slips, by a gauge, and its standard deviation [N].
    sister : mapping of drive to (float, float), optional
        Rise of the current with the force of a machine of this type, and its spread from machine
        to machine [A/N]. Of series motors, whose current does not rise straight, also the force up
        to which that rise was taken [N] and, where it differs, the sister's idle current [A].

    Returns
    -------
    MachineFit
        ``fit.of("1", "closing")`` has `line.idle`, `line.slope`, `slip` and so on; its
        ``force(1.4)`` is the force at 1.4 A.

    Raises
    ------
    MeasurementError
        When the campaign has no currents, or an anchor names an unknown drive.
    MachineError
        When an anchor cannot be.

    Examples
    --------
    >>> fit = fit_machines(load_campaign("autumn"))  # doctest: +SKIP
    >>> fit.of("1", "closing").line.slope.value  # doctest: +SKIP
    0.000206
    """
    return fit_dataset(
        dataset_of(campaign),
        saturation_current=saturation_current if motor == "series" else None,
        idle=idle,
        gauges={n: Gauge(force=f, deviation=d) for n, (f, d) in (clutch_force or {}).items()},
        sisters={name: _sister(name, given) for name, given in (sister or {}).items()},
    )


def _sister(drive: str, given: tuple[float, ...]) -> Sister:
    if not 2 <= len(given) <= 4:
        text = f"drive {drive}: rise, spread and, of series motors, force and idle current"
        raise MachineError([text], source="sister machine")
    return Sister(**dict(zip(("slope", "spread", "reference", "idle"), given, strict=False)))


def fit_three_phase(
    campaign: Campaign | xr.Dataset,
    *,
    rated_voltage: float,
    to_neutral: bool = False,
    free: Sequence[str] = (),
) -> tuple[ThreePhaseFit, ...]:
    """Identify three-phase machines from voltage, current and power of the throws of a campaign.

    Slopes of the current with voltage and power, sum of line and stator resistance, saturation and,
    with the rod off, iron and mechanical loss, all as the recorder sees them, with 95 % intervals.
    What cannot be told is a `NotIdentified` with its reason.

    Parameters
    ----------
    campaign : Campaign or xarray.Dataset
        At least two of `drive_voltage`, `drive_current` and `drive_power` (movement, drive, time).
    rated_voltage : float
        Between lines, rms [V].
    to_neutral : bool
        True if the recorded voltages are those of a phase.
    free : sequence of str
        Movements with the rod off.

    Returns
    -------
    tuple of ThreePhaseFit
        By drive; of one with fewer than two of the channels without anything, with 0 throws.

    Raises
    ------
    MeasurementError
        With too few channels or throws, or where the channels contradict each other.

    Examples
    --------
    >>> (fit,) = fit_three_phase(load_campaign("autumn"), rated_voltage=380.0)  # doctest: +SKIP
    >>> fit.resistance.value  # doctest: +SKIP
    12.4
    """
    return fit_phases(
        dataset_of(campaign), rated_voltage=rated_voltage, to_neutral=to_neutral, free=free
    )
