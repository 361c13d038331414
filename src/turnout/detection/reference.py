"""The reference case of detection: what stands beside the population of its study file.

The study `detection-reference` of the library holds the population of switches and throws; this
record holds what a test adds to them: the discrepancy between model and switch, the noise, the
history that is known of a switch, and the rates of false alarms.
"""

from dataclasses import replace

from turnout.calibration.load_study import load_study
from turnout.detection.conditions import Conditions
from turnout.detection.drive_quantities import stored_channels
from turnout.detection.held_rails import with_held_rails
from turnout.detection.panel_population import population_for
from turnout.panel.load import LoadedPanel
from turnout.panel.records import Drive
from turnout.study.design import Drawn
from turnout.study.distribution import Distribution
from turnout.study.study import Study

STUDY = "detection-reference"

PER_THROW = (
    *("chair.friction_coefficient", "temperature", "movement.return.start", "chair field"),
    "object_defaults.face_slope",
)
"""Inputs of the study that differ from throw to throw; all others are fixed for a switch."""

FRICTION, TEMPERATURE, FIELD_MEAN = "chair.friction_coefficient", "temperature", "chair field.mean"

NOMINAL_FRICTION = 0.3
"""Friction coefficient of the nominal sound throw, whose peak forces are the amplitudes [-]."""

DISCREPANCIES = (0.03, 0.05, 0.10)
"""The reference, and what is shown beside it [-]."""
HISTORIES = (0, 5, 20)
FALSE_ALARM_RATES = (1e-3, 1e-4)
THROWS_A_DAY = 20


def reference_study(
    panel: LoadedPanel | None = None,
    *,
    count: int | None = None,
    over_travel: float | None = None,
) -> Study:
    """Load the population of the reference case.

    Parameters
    ----------
    panel : LoadedPanel, optional
        In place of the default panel; the population lies about its values, see `population_for`,
        and its drives hold the rails that they press home, see `with_held_rails`.
    count : int, optional
        States; fewer give the first of them.
    over_travel : float, optional
        Middle of the closing over-travel of every drive, instead of that of the study; it varies
        as much as there, but not below 0 [m].

    Examples
    --------
    >>> reference_study(count=3).count
    3
    """
    study = load_study(STUDY)
    if panel is not None:
        study = _with_machines(population_for(study, panel))
    if over_travel is not None:
        study = replace(study, design=replace(study.design, drawn=_moved(study, over_travel)))
    if panel is not None or over_travel is not None:
        study = with_held_rails(study)
    return study if count is None else replace(study, design=replace(study.design, draws=count))


def _moved(study: Study, middle: float) -> tuple[Drawn, ...]:
    """Return what is drawn, the closing over-travel about another middle [m]."""
    found = []
    for item in study.design.drawn:
        if item.name.endswith(OVER_TRAVEL) and isinstance(item.law, Distribution):
            given = item.law.parameters
            half = 0.5 * (given["maximum"] - given["minimum"])
            ends = {"minimum": max(middle - half, 0.0), "maximum": middle + half}
            found.append(replace(item, law=replace(item.law, parameters={**given, **ends})))
        else:
            found.append(item)
    return tuple(found)


OVER_TRAVEL = "over_travel_closed"


def _with_machines(study: Study) -> Study:
    """Return a study that keeps the currents of machines and varies their clutches.

    The slip level of a drive that is a machine is that of its clutch, so what multiplies
    `drive.N.saturation_force` multiplies the torque of the clutch instead. Drives of one machine
    share it, and vary together.
    """
    kept = dict.fromkeys((*study.output.channels, *stored_channels(study.panel)))
    variables, taken = dict(study.variables), set()
    for name, drive in study.panel.drive.items():
        key = f"drive.{name}.{SLIP_LEVEL}"
        found = next((item for item in variables.values() if item.key == key), None)
        if drive.machine is None or found is None or drive.machine in taken:
            continue
        taken.add(drive.machine)
        variables[found.name] = replace(found, key=slip_level_key(name, drive))
    return replace(study, variables=variables, output=replace(study.output, channels=tuple(kept)))


SLIP_LEVEL = "saturation_force"


def slip_level_key(name: str, drive: Drive) -> str:
    """Return the key of the slip level of a drive: torque of the clutch where it is a machine.

    Parameters
    ----------
    name : str
        Of the drive.
    drive : Drive
        Of a panel.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> panel = load_panel("sb1")
    >>> slip_level_key("2", panel.drive["2"])
    'drive.2.saturation_force'
    >>> changed = panel.with_overrides({"drive.2.machine": "jea73"})
    >>> slip_level_key("2", changed.drive["2"])
    'machine.jea73.clutch.torque'
    """
    if drive.machine is not None:
        return f"machine.{drive.machine}.clutch.torque"
    return f"drive.{name}.{SLIP_LEVEL}"


def switch_inputs(study: Study) -> tuple[str, ...]:
    """Return the inputs that are fixed for a switch.

    Examples
    --------
    >>> "drive.2.over_travel_closed" in switch_inputs(reference_study())
    True
    """
    return tuple(name for name in study.variables if name not in PER_THROW)


__all__ = [
    "DISCREPANCIES",
    "FALSE_ALARM_RATES",
    "FIELD_MEAN",
    "FRICTION",
    "HISTORIES",
    "NOMINAL_FRICTION",
    "PER_THROW",
    "STUDY",
    "TEMPERATURE",
    "THROWS_A_DAY",
    "Conditions",
    "reference_study",
    "slip_level_key",
    "switch_inputs",
]
