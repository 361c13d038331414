"""Estimates of machines from the currents of a campaign: idle, amperes per kN, slip current.

Per drive and direction, with intervals; in newtons only by an anchor. A permanent magnet, a
series motor and a gear leave the same traces in a current in many combinations, so what cannot be
separated is named instead of fitted.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.calibration.comparison import Uncertainty
from turnout.calibration.machine_estimates.current_fit import (
    ClutchTrend,
    Estimate,
    LoadLine,
    NotIdentified,
    RunningSpan,
    SlipLevel,
    clutch_trend,
    fit_load_line,
    slip_estimate,
)
from turnout.calibration.machine_estimates.force_anchor import ForceAnchor, Gauge, Sister
from turnout.calibration.machine_estimates.running_spans import (
    LEAST_RUN,
    OVERRUN,
    ran_spans,
    steady_and_slipping,
)
from turnout.core.errors import MeasurementError

Floats = NDArray[np.float64]

ALIKE = 1.6
"""Drives of a switch take at most so much longer than the fastest of them [-]."""
NOT_SEPARATED = (
    "supply voltage, resistance, motor constant and gear ratio: idle and slip current depend on "
    "T_0/k and T_s/k, the rise with the force on N eta k, so each may be exchanged for the others",
    "dry friction of motor and gear from their viscous drag: both are in the idle current",
    "scale errors of clamp and force transducer: they are common to all movements and are not in "
    "the intervals, which allow for noise, drift and cross-talk between the force channels",
)
WITHOUT_FORCES = (
    "idle current, rise with the force and force: without forces a current is only amperes; give "
    "an anchor (forces at the drive, a clutch-force gauge or a sister machine)"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Usage:
    """Current of one drive in one movement, and the force by the anchor.

    Attributes
    ----------
    movement : str
    mean, most : float
        Of the current while it runs, inrush and slipping left out [A].
    force_mean, force_most : Estimate or None
        None without an anchor [N].
    """

    movement: str
    mean: float
    most: float
    force_mean: Estimate | None
    force_most: Estimate | None


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveFit:
    """Estimates of one drive in one direction from its currents.

    Attributes
    ----------
    drive, direction : str
    movements : int
        In which its motor ran.
    line : LoadLine or NotIdentified
        Idle current and rise with the force.
    slip : Estimate or None
        Slip current [A]; None where the clutch did not slip.
    held : float
        Mean force that the standing gear held meanwhile, NaN where not known [N].
    levels : tuple of SlipLevel
        Slip current of each movement in which the clutch slipped.
    trend : ClutchTrend or None
        Of the slip current over the movements; None from fewer than five.
    energised : Estimate or None
        Time from contactor to cut-off where the clutch did not slip [s].
    anchor : ForceAnchor or None
        What an ampere means in newtons.
    usage : tuple of Usage
        Movement by movement.
    """

    drive: str
    direction: str
    movements: int
    line: LoadLine | NotIdentified
    slip: Estimate | None
    held: float
    levels: tuple[SlipLevel, ...]
    trend: ClutchTrend | None
    energised: Estimate | None
    anchor: ForceAnchor | None
    usage: tuple[Usage, ...]

    def force(self, current: float, *, deviation: float = 0.0) -> Estimate:
        """Return the force at a current by the anchor [N].

        Raises
        ------
        MeasurementError
            Without an anchor.
        """
        if self.anchor is None:
            text = (
                f"drive {self.drive}, {self.direction}: no anchor says what an ampere is in "
                "newtons; measure forces at the drive, or give a clutch-force gauge or a sister "
                "machine"
            )
            raise MeasurementError([text], source="force from current")
        return self.anchor.force(current, deviation=deviation)


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineFit:
    """Estimates of the machines of a campaign from their currents.

    Attributes
    ----------
    drives : tuple of DriveFit
        By drive and direction.
    not_separated : tuple of str
        What the currents cannot separate.
    """

    drives: tuple[DriveFit, ...]
    not_separated: tuple[str, ...]

    def of(self, drive: str, direction: str) -> DriveFit:
        """Return what is known of a drive in a direction.

        Raises
        ------
        MeasurementError
            When the campaign has no such movement.
        """
        found = [d for d in self.drives if (d.drive, d.direction) == (drive, direction)]
        if not found:
            known = ", ".join(f"{d.drive} {d.direction}" for d in self.drives)
            text = f"no current of drive {drive}, {direction}; there are: {known}"
            raise MeasurementError([text], source="machine fit")
        return found[0]


def fit_machines(
    campaign: xr.Dataset,
    *,
    saturation_current: float | None = None,
    idle: Mapping[str, float] | None = None,
    gauges: Mapping[str, Gauge] | None = None,
    sisters: Mapping[str, Sister] | None = None,
) -> MachineFit:
    """Fit idle current, rise with the force and slip current of every drive and direction.

    Parameters
    ----------
    campaign : xarray.Dataset
        `drive_current` (movement, drive, time), `drive_force` likewise where measured, both
        filtered alike; coordinate `direction`; time zero at the onset.
    saturation_current : float, optional
        Of series motors [A], infinite without saturation; left out for a permanent magnet or a
        separate field.
    idle : mapping of drive to float, optional
        Current with the rod taken off [A], for anchors of drives whose forces are not measured.
    gauges, sisters : mapping of drive to Gauge or Sister, optional
        Anchors of drives whose forces are not measured.

    Returns
    -------
    MachineFit

    Raises
    ------
    MeasurementError
        When the campaign has no currents, or an anchor names an unknown drive.
    """
    _check(campaign, {"idle": idle, "clutch force": gauges, "sister": sisters})
    ran = {
        (drive, direction): ran_spans(campaign, drive, direction)
        for drive in (str(name) for name in campaign["drive"].values)
        for direction in ("closing", "opening")
    }
    lengths = [item.duration for items in ran.values() for item in items]
    if not lengths:
        text = f"no motor runs: no drive_current stays above its standstill for {LEAST_RUN:g} s"
        raise MeasurementError([text], source="machine fit")
    usual = {name: _usual_length(ran, name, lengths) for name, _ in ran}
    cut = {key: steady_and_slipping(items, usual[key[0]]) for key, items in ran.items() if items}
    found = []
    for (drive, direction), (spans, levels) in cut.items():
        items, slip = ran[drive, direction], slip_estimate(levels)
        free = [i.duration for i in items if i.duration <= usual[drive] + OVERRUN]
        both = [level.current for key, (_, own) in cut.items() if key[0] == drive for level in own]
        lowest = min(both, default=math.inf)
        line = _line(spans, series=saturation_current, slip_current=lowest)
        given = (idle or {}, gauges or {}, sisters or {})
        anchor = _anchor(drive, line, slip, *given, series=saturation_current)
        known = line.idle.value if isinstance(line, LoadLine) else (idle or {}).get(drive)
        held = [level.held for level in levels if math.isfinite(level.held)]
        found.append(
            DriveFit(
                drive=drive,
                direction=direction,
                movements=len(items),
                line=line,
                slip=slip,
                held=float(np.mean(held)) if held else math.nan,
                levels=tuple(levels),
                trend=clutch_trend(levels, idle=known),
                energised=Estimate.mean(free) if len(free) > 1 else None,
                anchor=anchor,
                usage=tuple(_usage(span, anchor) for span in spans if span.usable.any()),
            )
        )
    unanchored = any(d.anchor is None for d in found)
    more = (WITHOUT_FORCES,) if unanchored and "drive_force" not in campaign else ()
    return MachineFit(drives=tuple(found), not_separated=(*NOT_SEPARATED, *more))


def _usual_length(
    ran: Mapping[tuple[str, str], Sequence[RunningSpan]], drive: str, lengths: Sequence[float]
) -> float:
    """Return how long a drive's motor usually runs when its clutch does not slip [s].

    From its own shortest tenth, since drives differ; but one that slips in all of its movements
    is seen by the others.
    """
    own = [i.duration for key, items in ran.items() if key[0] == drive for i in items]
    longest = ALIKE * float(np.quantile(lengths, 0.1))
    return min(float(np.quantile(own, 0.1)), longest) if own else longest


def _check(campaign: xr.Dataset, given: Mapping[str, Mapping[str, object] | None]) -> None:
    there = {*campaign.variables, *campaign.dims}
    lacks = [n for n in ("drive_current", "movement", "drive", "direction") if n not in there]
    text = "is missing; a fit needs currents of drives in movements, each closing or opening"
    problems = [f"{', '.join(lacks)}: {text}"] if lacks else []
    drives = [str(name) for name in campaign["drive"].values] if "drive" in campaign else []
    for what, by_drive in given.items():
        for name in by_drive or {}:
            if name not in drives:
                problems.append(f"{what} of drive '{name}': there are {', '.join(drives)}")
    if problems:
        raise MeasurementError(problems, source="machine fit")


def _line(
    spans: Sequence[RunningSpan], *, series: float | None, slip_current: float
) -> LoadLine | NotIdentified:
    with_force = [span for span in spans if np.isfinite(span.load).any()]
    if not with_force:
        return NotIdentified(reason="no force was measured at this drive")
    return fit_load_line(
        with_force,
        saturation_current=series,
        slip_current=slip_current,
        cross_talk=Uncertainty().cross_talk,
    )


def _anchor(
    drive: str,
    line: LoadLine | NotIdentified,
    slip: Estimate | None,
    idle: Mapping[str, float],
    gauges: Mapping[str, Gauge],
    sisters: Mapping[str, Sister],
    *,
    series: float | None,
) -> ForceAnchor | None:
    """Return the best anchor there is: forces, then a gauge, then a sister machine.

    `series` is the saturation current of a series motor [A].
    """
    if isinstance(line, LoadLine):
        return ForceAnchor(
            kind="force at the drive",
            slope=line.slope.value,
            slope_deviation=line.slope.deviation,
            idle=line.idle.value,
            idle_deviation=line.idle.deviation,
            covariance=line.covariance,
            series=None if series is None else (line.reference, series),
        )
    if drive not in idle:
        return None
    if drive in gauges and slip is not None:
        return gauges[drive].anchor(
            slip_current=slip.value,
            slip_deviation=slip.deviation,
            idle=idle[drive],
            saturation_current=series,
        )
    if drive in sisters:
        return sisters[drive].anchor(idle=idle[drive], saturation_current=series)
    return None


def _usage(span: RunningSpan, anchor: ForceAnchor | None) -> Usage:
    running = span.current[span.usable]
    mean, most = float(running.mean()), float(running.max())
    return Usage(
        movement=span.name,
        mean=mean,
        most=most,
        force_mean=anchor.force(mean) if anchor else None,
        force_most=anchor.force(most) if anchor else None,
    )
