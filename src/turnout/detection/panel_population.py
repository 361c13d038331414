"""The population of the reference case about the values of another panel.

The study file of the reference case says how much switches and throws scatter about its own panel.
For another panel the scatter is the same and lies about the values of that panel: its closing
over-travel, its stress-free position, its times, its rods. Each of its drives has the inputs of a
drive. What the panel does not have as one number, such as a fit, a stress-free position where the
shape is typed, or rods of which each rises otherwise, does not vary, and the remarks of the study
say so.

The owner of a switch knows if it has rollers, which halve the force: those of the panel scatter
(`ROLLERS`), and a panel without has none.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import PanelError, StudyError
from turnout.panel.load import LoadedPanel
from turnout.study.design import Drawn
from turnout.study.distribution import Choice, Distribution
from turnout.study.random_inputs import RandomField
from turnout.study.study import Study
from turnout.study.variable import TEMPERATURE_KEY, Variable, value_kind

Floats = NDArray[np.float64]

DIFFERENCE, SHARE, RANGE = "difference", "share", "range"
SCATTER = {
    "over_travel_closed": DIFFERENCE,
    "stress_free": DIFFERENCE,
    "extra_time": DIFFERENCE,
    "start": DIFFERENCE,
    "ramp": DIFFERENCE,
    "face_slope": DIFFERENCE,
    "rod_slope": DIFFERENCE,
    "section_scale": SHARE,
    "lateral_inertia_scale": SHARE,
}
"""Scatter of inputs about the value of a panel; others have a range that all panels share."""
BOUNDS = {
    "over_travel_closed": (0.0, np.inf),
    "stress_free": (0.0, 1.0),
    "extra_time": (0.0, np.inf),
    "ramp": (0.0, np.inf),
}
"""Bounds of values."""
ROLLERS: Mapping[str, Distribution] = {
    "chair.roller_lift": Distribution(
        kind="uniform",
        parameters={"minimum": 0.8, "maximum": 1.2},  # assumption: set by a gauge
    ),
    "chair.roller_stiffness": Distribution(
        kind="lognormal",
        parameters={"median": 1.0, "log_deviation": 0.1},  # assumption: springs of one type
    ),
}
"""Factors on the rollers of a panel that has some, fixed for a switch, alike for all its chairs."""
MIDDLES = ("minimum", "maximum", "mean", "median", "mode")
"""Parameters of distributions that are values, not spreads."""


def population_for(study: Study, panel: LoadedPanel) -> Study:
    """Return the study of the reference case for another panel.

    Parameters
    ----------
    study : Study
        Of the reference case, with its own panel.
    panel : LoadedPanel
        Any number of drives.

    Raises
    ------
    StudyError
        When the panel lacks what the population varies.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> from turnout.calibration.load_study import load_study
    >>> made = population_for(load_study("detection-reference"), load_panel("60e1-300-1-9"))
    >>> law = next(d.law for d in made.design.drawn if d.name == "drive.1.over_travel_closed")
    >>> [round(1e3 * value, 6) for value in law.bounds]
    [2.8, 4.8]
    >>> any(name.startswith("drive.2") for name in made.variables)
    False
    """
    variables, laws, columns, lacking = dict(study.variables), [], [], []
    for column, item in enumerate(study.design.drawn):
        variable = study.variables[item.name]
        drive = drive_of(variable.key)
        key = _own_key(variable.key, study.panel, panel)
        of_second_rail = key.startswith(SECOND_RAIL) and len(panel.rail) == 1
        if of_second_rail or (drive is not None and drive not in panel.drive):
            del variables[item.name]
            continue
        if not _varies(panel, key):
            lacking.append(key)
            del variables[item.name]
            continue
        variables[item.name] = replace(variable, key=key)
        laws.append(replace(item, law=_moved(item.law, variable.key, study.panel, panel)))
        columns.append(column)
    further = [name for name in panel.drive if name not in study.panel.drive]
    added = [item for name in further for item in _of_further_drive(name, study, panel)]
    for variable, law in (*added, *_of_rollers(panel)):
        variables[variable.name] = variable
        laws.append(Drawn(name=variable.name, law=law))
    _refuse_no_switch(panel, [f.key for f in study.fields if not _varies(panel, f.key)])
    copula = _copula(study.design.copula, columns, len(laws))
    design = replace(study.design, drawn=tuple(laws), copula=copula)
    remarks = tuple(f"panel {panel.name} has no number {key}: it does not vary" for key in lacking)
    return replace(
        study, panel=panel, variables=variables, design=design,
        fields=tuple(_along(item, panel) for item in study.fields),
        remarks=(*study.remarks, *remarks),
    )  # fmt: skip


def _along(field: RandomField, panel: LoadedPanel) -> RandomField:
    """Return a field at the places that its family has in the panel."""
    members = getattr(panel, field.key.partition(".")[0])
    x = tuple(float(member.x) for member in members.values())
    return replace(field, members=tuple(members), x=x)


def _refuse_no_switch(panel: LoadedPanel, lacking: Sequence[str]) -> None:
    """Refuse a panel without drives or chairs."""
    faults = [
        f"panel {panel.name} has no {key}, which the reference case varies" for key in lacking
    ]
    if not panel.drive:
        faults.append(f"panel {panel.name} has no drive, so nothing shows an object")
    if faults:
        faults.append("take a switch panel, such as uic60-760-1-15, or a calibration of one")
        raise StudyError(faults, source="reference case of detection")


def drive_of(key: str) -> str | None:
    """Return the name of the drive that a key belongs to.

    Examples
    --------
    >>> drive_of("drive.2.stiffness"), drive_of("movement.return.extra_time.2")
    ('2', '2')
    >>> drive_of("movement.return.start"), drive_of("drive.rod_slope")
    (None, None)
    """
    parts = key.split(".")
    if parts[0] == "drive" and len(parts) > 2:
        return parts[1]
    if parts[0] == "movement" and "extra_time" in parts:
        return parts[-1]
    return None


def last_movement(panel: LoadedPanel) -> str:
    """Return the name of the movement that begins last."""
    return max(panel.movement, key=lambda name: float(panel.movement[name].start))


def _own_key(key: str, base: LoadedPanel, panel: LoadedPanel) -> str:
    """Return a key with the names that rails and the last movement have in another panel."""
    if key == FIT and not _varies(panel, key):
        return FIT.removesuffix(".value") if _one_fit(panel) else key
    names = _names(panel)
    for number, old in enumerate(_names(base)):
        if key.startswith(old):
            return (names[number] if number < len(names) else SECOND_RAIL) + key.removeprefix(old)
    return key


RODS = "drive.rod_slope"
"""Rise of all rods; where each rises otherwise, one number would level them."""
SECOND_RAIL = "rail.second."
"""Of keys that a panel with one rail does not have."""


FIT = "rail.fit_gap.value"
"""Gaps of a fit along the rail; a panel may have one gap instead, and one of 0 cannot vary."""


def _one_fit(panel: LoadedPanel) -> bool:
    return any(
        isinstance(rail.fit_gap, float) and rail.fit_gap > 0.0 for rail in panel.rail.values()
    )


def _names(panel: LoadedPanel) -> tuple[str, ...]:
    """Return how keys of the last movement, of the rail that closes and of the other begin."""
    rails = sorted(panel.rail, key=lambda name: name != panel.instrumented_rail)
    return (f"movement.{last_movement(panel)}.", *(f"rail.{name}." for name in rails))


def _field(key: str) -> str:
    return next((name for name in SCATTER if name in key.split(".")), "")


def _value(panel: LoadedPanel, key: str) -> float | None:
    """Return the value of a key, None where it has none or its members differ."""
    if "extra_time" in key:
        _, movement, _, drive = key.split(".")
        return float(panel.movement[movement].extra_time.get(drive, 0.0))
    try:
        found = panel.values_at(key)
    except PanelError:
        return None
    values = list(found.values())
    alike = bool(values) and all(value == values[0] for value in values)
    return float(values[0]) if alike and isinstance(values[0], int | float) else None


def _moved(
    law: Distribution | Choice, key: str, base: LoadedPanel, panel: LoadedPanel
) -> Distribution | Choice:
    """Return a law about the value of another panel, the same one where that is the same."""
    field = _field(key)
    old, new = _value(base, key), _value(panel, _own_key(key, base, panel))
    if not field or old is None or new in (None, old):
        return law
    return _about(law, field, old, float(new or 0.0))


def _about(law: Distribution | Choice, field: str, old: float, new: float) -> Distribution | Choice:
    if isinstance(law, Choice):
        return replace(law, values=tuple(float(value) + new - old for value in law.values))
    if SCATTER[field] == SHARE:
        return replace(law, parameters={name: v * new / old for name, v in law.parameters.items()})
    low, high = BOUNDS.get(field, (-np.inf, np.inf))
    moved = {
        name: float(np.clip(value + new - old, low, high)) if name in MIDDLES else value
        for name, value in law.parameters.items()
    }
    return replace(law, parameters=moved)


def _of_further_drive(
    name: str, study: Study, panel: LoadedPanel
) -> list[tuple[Variable, Distribution | Choice]]:
    """Return the inputs of a drive that the reference panel lacks, as those of its last drive."""
    last = list(study.panel.drive)[-1]
    found = []
    for item in study.design.drawn:
        variable = study.variables[item.name]
        if drive_of(variable.key) != last:
            continue
        key = ".".join(name if part == last else part for part in variable.key.split("."))
        made = replace(
            variable,
            name=item.name.replace(variable.key, key),
            key=_own_key(key, study.panel, panel),
        )
        law, field = item.law, _field(key)
        old, new = _value(study.panel, variable.key), _value(panel, made.key)
        if field and old is not None and new is not None:
            law = _about(law, field, old, new)
        found.append((made, law))
    return found


def _of_rollers(panel: LoadedPanel) -> list[tuple[Variable, Distribution]]:
    """Return the inputs of the rollers of a panel, if it has any."""
    if all(chair.roller_lift is None for chair in panel.chair.values()):
        return []
    kinds = {key: value_kind(panel, key, factor=True) for key in ROLLERS}
    return [
        (Variable(name=f"{key}.factor", key=key, kind=kinds[key], factor=True), law)
        for key, law in ROLLERS.items()
    ]


def _varies(panel: LoadedPanel, key: str) -> bool:
    """Return whether a panel has one number, or a list of them, that can vary."""
    if key == TEMPERATURE_KEY or "extra_time" in key:  # may be given to any drive
        return True
    if key == RODS:
        return _value(panel, key) is not None
    try:
        values = panel.values_at(key).values()
    except PanelError:
        return False
    return any(isinstance(value, int | float | tuple | list) for value in values)


def _copula(factor: Floats | None, columns: list[int], count: int) -> Floats | None:
    """Return the factor of the inputs that stay; those that are added depend on no other."""
    if factor is None or (columns == list(range(len(factor))) and count == len(factor)):
        return factor
    whole = np.eye(count)
    kept = len(columns)
    whole[:kept, :kept] = (factor @ factor.T)[np.ix_(columns, columns)]
    return np.asarray(np.linalg.cholesky(whole))
