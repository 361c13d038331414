"""Checks of a calibration's input and result.

Before the fit: whether a campaign suffices for the stages, and objects that do not fit between the
rails. After it: slip levels that are bounded from below only, and the panel of a calibration.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.fit import Fit
from turnout.calibration.linearisation import is_slip_level, touches
from turnout.calibration.measured_movements import MeasuredMovement, selected
from turnout.calibration.parameter import Parameter
from turnout.calibration.result import Calibration
from turnout.calibration.stages import NONE, CalibrationPlan
from turnout.core.errors import MeasurementError
from turnout.panel.load import LoadedPanel
from turnout.throw.object_fit import object_fits

# A drive whose marker moves, but whose rod never changes by this, is dead or not there [N].
LEAST_FORCE = 30.0


def check_campaign(
    movements: Sequence[MeasuredMovement], plan: CalibrationPlan, panel: LoadedPanel, *, source: str
) -> None:
    """Refuse a campaign that the stages cannot be fitted to, with all problems."""
    problems = []
    for stage in plan.stages:
        chosen = selected(movements, stage.movements, panel)
        if not chosen and not stage.optional and plan.named(stage.parameters):
            if stage.movements.objects == NONE:
                problems.append(
                    f"stage {stage.name}: no movement without an object is left; measure one, keep "
                    "one that was excluded, or fix friction (--fix chair.friction_coefficient)"
                )
            else:
                problems.append(f"stage {stage.name}: no movement is selected")
    known = {name: _force_changes(movements, name) for name in panel.drive}
    if not any(known.values()):
        problems.append("no movement has the force of a drive; map the columns of the rods")
    for name, changes in known.items():
        if changes and max(changes) < LEAST_FORCE:
            problems.append(
                f"drive {name}: never moves, its force changes by {max(changes):.0f} N at most; "
                "check its column in the channel map"
            )
    if problems:
        raise MeasurementError(problems, source=source)


def _force_changes(movements: Sequence[MeasuredMovement], drive: str) -> list[float]:
    """Return by how much the force of a drive changes in each movement that has it [N]."""
    return [
        float(np.nanmax(signal.values) - np.nanmin(signal.values))
        for movement in movements
        for signal in movement.signals
        if signal.channel == "drive_force" and signal.drive == drive
    ]


def unmeasured_drives(movements: Sequence[MeasuredMovement], panel: LoadedPanel) -> list[str]:
    """Return a warning on each drive whose force no movement has."""
    return [
        f"drive {name}: no movement has its force, so its values come from the other channels alone"
        for name in panel.drive
        if not _force_changes(movements, name)
    ]


def exclude_oversized_objects(
    movements: Sequence[MeasuredMovement], panel: LoadedPanel
) -> tuple[tuple[MeasuredMovement, ...], list[str]]:
    """Return the movements whose object fits between the rails, and a message for each other.

    An object is placed between the rails as soon as they stand far enough apart. Where they never
    do it is not there, and a throw with it is one without: comparing it with a measurement in
    which it was squeezed would spoil every value.

    Parameters
    ----------
    movements : sequence of MeasuredMovement
        From `observe`; sizes of objects [m].
    panel : LoadedPanel
        What was measured.

    Raises
    ------
    MeasurementError
        When nothing is left.
    """
    fits = {
        (item.place, item.size): object_fits(panel, item.size, item.place)
        for item in movements
        if item.size > 0
    }
    kept = tuple(item for item in movements if fits.get((item.place, item.size), True))
    texts = [
        f"{item.text} was left out: the object does not fit into the gap of panel {panel.name}; "
        "check size and place in the run sheet, and the geometry of the panel there"
        for item in movements
        if not fits.get((item.place, item.size), True)
    ]
    if not kept:
        raise MeasurementError(texts, source="no movement is left")
    return kept, texts


Floats = NDArray[np.float64]
# How much further a slip level is tried [coordinate], and by how much the cost must then rise for
# the level to be identified from above (95 %, one parameter).
FURTHER, IDENTIFIED = 0.05, 3.84


def drop_unidentified_slip_levels(found: Fit) -> tuple[Fit, list[str]]:
    """Drop slip levels that are bounded from below only, with a warning.

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
        if is_slip_level(item) and not _is_identified(found, item, column):
            slopes[:, column] = 0.0
            value = found.values[item.name]
            warnings.append(
                f"{item.name}: not identifiable from these movements, only at least {value:.0f} N; "
                "measure a larger object beside the drive, at which it slips"
            )
    return (replace(found, jacobian=slopes) if warnings else found), warnings


def _is_identified(found: Fit, item: Parameter, column: int) -> bool:
    """Return whether a higher level makes the cost rise, whatever the other parameters do."""
    value = found.values[item.name]
    higher = item.value(item.coordinate(value) + FURTHER)
    numbers = [n for n, row in enumerate(found.local.simulated) if touches(item, value, row)]
    if not numbers or higher <= value:
        return bool(numbers)
    others = np.delete(found.jacobian, column, axis=1)
    ahead = _least(_residuals(found, item, higher, numbers), others)
    return ahead - _least(found.residuals, others) > IDENTIFIED


def _residuals(found: Fit, item: Parameter, value: float, numbers: Sequence[int]) -> Floats:
    """Return the residuals with another value of a parameter, thrown where it acts."""
    misfit = found.misfit
    part = misfit.of(numbers)
    made = part.responses([{**found.values, item.name: value}])[0]
    responses = list(found.local.simulated)
    for number, response in zip(numbers, made, strict=True):
        responses[number] = response
    return misfit.residuals_of(responses, found.frame)


def _least(residuals: Floats, slopes: Floats) -> float:
    """Return the cost that is left when parameters take up what they can."""
    step = np.linalg.lstsq(slopes, residuals, rcond=None)[0]
    rest = residuals - slopes @ step
    return float(rest @ rest)


def check_provenance(calibration: Calibration, *panels: LoadedPanel) -> tuple[str, ...]:
    """Say why a calibration is not trustworthy, or that it is of another panel, by hash.

    Parameters
    ----------
    calibration : Calibration
        Its attributes hold the hash of its panel.
    *panels : LoadedPanel
        The same panel before and after what a user sets.

    Returns
    -------
    tuple of str
        Empty where it is trustworthy and belongs to one of them.
    """
    found = tuple(f"is not trustworthy: {text}" for text in calibration.distrust)
    if calibration.panel_hash in [panel.hash for panel in panels]:
        return found
    return (
        *found,
        f"the calibration is of panel {calibration.panel} with hash {calibration.panel_hash[:12]}, "
        f"not of {panels[0].name} with hash {panels[0].hash[:12]}; its values are used "
        "anyway",
    )
