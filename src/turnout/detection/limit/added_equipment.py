r"""Gain of a sensor at the rail or of a further drive.

A sensor reads the gap between switch rail and stock rail, or the force at a stop, at the end of a
throw. Its reading of a sound throw scatters about what the friction level says, by the population,
by the discrepancy of the model and by its own error; an object changes it by :math:`\Delta`. The
index of detection becomes

.. math:: d^2 = d_F^2 + (\Delta / \sigma)^2

where the scatter of the sensor counts as independent of that of the drive forces. A real pair would
do better, since the forces explain a part of it. A contact only closes or opens: it is set to the
gap that sound throws of all friction levels exceed at the rate of false alarms.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.errors import StudyError
from turnout.core.progress import Pace
from turnout.core.workers import Workers
from turnout.detection.conditions import Conditions
from turnout.detection.drive_quantities import ALL
from turnout.detection.limit.limit_map import limit_map
from turnout.detection.limit.what_if import ADDED, EQUIPMENT, Measure, read_measure, some_states
from turnout.detection.reference import reference_study, switch_inputs
from turnout.detection.throws import (
    STEPS,
    Throws,
    closing_time,
    few_instants,
    objects_study,
    of_kind,
    places_of,
    throw_all,
)
from turnout.panel.load import LoadedPanel, panel_from_document
from turnout.study.sweep.read import last_values, open_batches
from turnout.study.sweep.run import throw_studies

Floats = NDArray[np.float64]

READINGS, READINGS_SOUND = "readings", "readings-sound"
STATES, DRIVE_SOUND = 24, 200
"""States thrown for a sensor or a drive, and sound throws of a panel with a further drive."""
GAP_ERROR, SENSOR_ERROR = 0.3e-3, 0.1e-3
"""Of the model and of a position sensor [m]; assumptions."""
FORCE_NOISE = 20.0
"""Of a force sensor; the discrepancy is a share of the sound reading, as for drives [N]."""
LEVEL_DEGREE = 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Readings:
    """Readings of sensors along the rail at the end of throws.

    Attributes
    ----------
    gap : ndarray, shape (n_states, n_places, n_sizes, n_x)
        With an object [m].
    sound_gap : ndarray, shape (n_states, n_x)
        Without one [m].
    force, sound_force : ndarray
        The same at stops, of last dimension n_stops [N].
    x, stop_x : ndarray
        Where [m].
    level : ndarray, shape (n_states,)
        Mean friction coefficient [-].
    switch : ndarray, shape (n_states, n_inputs)
        What is fixed for a switch.
    """

    gap: Floats
    sound_gap: Floats
    force: Floats
    sound_force: Floats
    x: Floats
    stop_x: Floats
    level: Floats
    switch: Floats


def equipment_of(text: str) -> tuple[str, float] | None:
    """Return kind and place of a measure such as "position sensor at 3.6 m", None of another.

    Examples
    --------
    >>> equipment_of("drive at 3.6 m")
    ('drive', 3.6)
    >>> equipment_of("second throw") is None
    True
    """
    found = re.fullmatch(ADDED, " ".join(text.split()))
    return (found[1], float(found[2])) if found else None


def check_equipment(texts: Sequence[str], panel: LoadedPanel) -> None:
    """Refuse sensors and drives beyond the places of objects, before anything is thrown."""
    along = list(places_of(panel).values())
    low, high = min(along), max(along)
    faults = [
        f'what-if "{text}": lies outside {low:g} to {high:g} m, where objects are tried'
        for text in texts
        if (found := equipment_of(text)) and not low <= found[1] <= high
    ]
    if faults:
        raise StudyError(faults, source="limit")


def read_sensors(
    panel: LoadedPanel | None,
    folder: Path,
    throws: Throws,
    *,
    workers: int | Workers = 1,
    pace: Pace | None = None,
) -> Readings:
    """Throw what is missing of the states with objects again, and keep gaps and forces at stops.

    Parameters
    ----------
    panel : LoadedPanel or None
        None for that of the reference case.
    folder : Path
        That of `throw_all`.
    throws : Throws
        From there.
    workers : int or Workers
        Processes.
    pace : Pace, optional
        Counts the throws.
    """
    used = np.flatnonzero(throws.states < STATES)
    study = reference_study(panel, count=STATES)
    sizes = {
        place: tuple(map(float, row))
        for place, row in zip(throws.places, throws.sizes, strict=True)
    }
    rail = study.panel.object_defaults.rail
    names = READINGS_SOUND, of_kind(READINGS, throws.kind)
    made = study, objects_study(study, sizes, kind=throws.kind)
    kept = {
        folder / name: few_instants(item, "gap", "stop_force", title=READINGS)
        for name, item in zip(names, made, strict=True)
    }
    throw_studies(kept, workers=workers, pace=pace)
    sound, objects = map(open_batches, kept)
    rows = throws.states[used]
    gap, x = _last(objects, "gap", rail=rail)
    sound_gap, _ = _last(sound, "gap", rail=rail)
    force, stop_x = _last(objects, "stop_force", rail=rail)
    sound_force, _ = _last(sound, "stop_force", rail=rail)
    shape = (STATES, len(throws.places), throws.sizes.shape[1], -1)
    return Readings(
        gap=gap.reshape(shape)[rows], sound_gap=sound_gap[rows],
        force=force.reshape(shape)[rows], sound_force=sound_force[rows],
        x=x, stop_x=stop_x, level=throws.level[rows], switch=throws.switch[rows],
    )  # fmt: skip


def _last(dataset: xr.Dataset, name: str, *, rail: str) -> tuple[Floats, Floats]:
    """Return the last values of a channel along a rail, and where they are."""
    last = last_values(dataset[name].sel(rail=rail)).astype(np.float64)
    along = dataset["x" if name == "gap" else "stop_x"].to_numpy().astype(np.float64)
    along = along if along.ndim == 1 else along[0]
    there = np.isfinite(last).any(axis=0) & np.isfinite(along)
    return last[:, there], along[there]


def sensor_measure(
    text: str, throws: Throws, readings: Readings, conditions: Conditions
) -> Measure:
    """Return what the bound is computed with if there is a sensor.

    Parameters
    ----------
    text : str
        As `equipment_of` reads it.
    throws : Throws
        Of the reference case.
    readings : Readings
        From `read_sensors`.
    conditions : Conditions
        Discrepancy, history.
    """
    equipment = equipment_of(text)
    assert equipment is not None
    kind, x = equipment
    some = some_states(throws, throws.states < STATES)
    if kind == "force sensor":
        at = int(np.abs(readings.stop_x - x).argmin())
        sound, reading = readings.sound_force[:, at], readings.force[..., at]
        error = np.hypot(FORCE_NOISE, conditions.discrepancy * np.abs(sound).max())
        note = f"at the stop at {readings.stop_x[at]:g} m; error {error:.0f} N"
    else:
        sound = np.array([np.interp(x, readings.x, row) for row in readings.sound_gap])
        reading = _along(readings, x)
        error = float(np.hypot(GAP_ERROR, SENSOR_ERROR))
        note = f"gap at the end of the throw; error {1e3 * error:.1f} mm"
    if kind == "contact sensor":
        spread = float(np.hypot(sound.std(ddof=1), error))
        change = np.maximum(reading - sound.mean(), 0.0)
        note = "closed or open, set to what sound throws do not reach"
    else:
        spread = float(np.hypot(_scatter(sound, readings, conditions), error))
        change = np.abs(reading - sound[:, np.newaxis, np.newaxis])
    return Measure(
        name=" ".join(text.split()), note=note, throws=some, conditions=conditions,
        beside=np.nan_to_num(change / spread), base=some,
    )  # fmt: skip


def _along(readings: Readings, x: float) -> Floats:
    """Return gaps with an object at a place of a sensor, shape (n_states, n_places, n_sizes)."""
    shape = readings.gap.shape
    flat = readings.gap.reshape(-1, shape[-1])
    return np.array([np.interp(x, readings.x, row) for row in flat]).reshape(shape[:-1])


def _scatter(sound: Floats, readings: Readings, conditions: Conditions) -> float:
    """Return how readings of sound throws scatter about what friction, and a history, say."""
    columns = [readings.level**power for power in range(LEVEL_DEGREE + 1)]
    if conditions.history:
        spread = readings.switch.std(axis=0)
        theta = (readings.switch - readings.switch.mean(axis=0))[:, spread > 0.0]
        columns += list((theta / spread[spread > 0.0]).T)
    design = np.column_stack(columns)
    free = len(sound) - design.shape[1]
    if free < 1:
        design, free = design[:, : LEVEL_DEGREE + 1], len(sound) - LEVEL_DEGREE - 1
    found, *_ = np.linalg.lstsq(design, sound, rcond=None)
    rest = sound - design @ found
    return float(np.sqrt(rest @ rest / free))


def with_drive(panel: LoadedPanel, x: float) -> LoadedPanel:
    """Return a panel with a further drive, whose values lie between those of its neighbours.

    Parameters
    ----------
    panel : LoadedPanel
        Has two drives or more.
    x : float
        Of the drive [m].

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> made = with_drive(load_panel("uic60-760-1-15"), 3.6)
    >>> round(made.drive["3"].stroke, 4)
    0.0975
    """
    drives = sorted(panel.drive.values(), key=lambda item: item.x)
    near = min(panel.drive, key=lambda name: abs(panel.drive[name].x - x))
    along = [item.x for item in drives]
    own = dict(panel.document.tree["drive"][near]) | {"x": f"{x:.6g} m"}
    for field, unit in BETWEEN.items():
        value = np.interp(x, along, [getattr(item, field) for item in drives])
        own[field] = f"{value:.9g} {unit}"
    number = next(str(n) for n in range(1, 100) if str(n) not in panel.drive)
    tree = dict(panel.document.tree)
    tree["drive"] = dict(tree["drive"]) | {number: own}
    return panel_from_document(
        replace(panel.document, tree=tree),
        source=panel.source, folder=panel.folder, overrides=panel.overrides,
    )  # fmt: skip


BETWEEN = {
    "stroke": "m",
    "over_travel_open": "m",
    "over_travel_closed": "m",
    "stiffness": "N/m",
    "saturation_force": "N",
}
"""Values of a further drive that are taken between its neighbours."""


def drive_measure(
    text: str,
    panel: LoadedPanel | None,
    folder: Path,
    throws: Throws,
    conditions: Conditions,
    *,
    steps: Sequence[float] = STEPS,
    workers: int | Workers = 1,
    pace: Pace | None = None,
) -> Measure:
    """Throw the reference case with a further drive, in a folder of its own inside the given one.

    Parameters
    ----------
    text : str
        As `equipment_of` reads it.
    panel : LoadedPanel or None
        Without the drive.
    folder : Path
        That of `throw_all`.
    throws : Throws
        From there.
    conditions : Conditions
        Discrepancy, history.
    steps : sequence of float
        As `throw_all` took them [m].
    workers : int or Workers
        Processes.
    pace : Pace, optional
        Counts the throws.
    """
    equipment = equipment_of(text)
    assert equipment is not None
    _, x = equipment
    made = with_drive(reference_study(panel, count=1).panel, x)
    quantities = {item.quantity for item in throws.signals}
    given = throw_all(
        made, folder / f"drive-{x:g}", sound=DRIVE_SOUND, states=STATES, steps=steps,
        channels=quantities.pop() if len(quantities) == 1 else ALL, kind=throws.kind,
        workers=workers, pace=pace,
    )  # fmt: skip
    kept = np.array([place in throws.places for place in given.places])
    given = replace(
        given, change=given.change[:, kept], force_peak=given.force_peak[:, kept],
        gap=given.gap[:, kept], x=given.x[kept], sizes=given.sizes[kept],
        places=tuple(place for place in given.places if place in throws.places),
    )  # fmt: skip
    return Measure(
        name=" ".join(text.split()),
        note="a third force, and the rail held there; values between those of the drives",
        throws=given, conditions=conditions, base=some_states(throws, throws.states < STATES),
    )  # fmt: skip


def read_measures(
    texts: Sequence[str],
    panel: LoadedPanel | None,
    folder: Path,
    throws: Throws,
    conditions: Conditions,
    *,
    advise: bool = False,
    steps: Sequence[float] = STEPS,
    workers: int | Workers = 1,
    pace: Pace | None = None,
) -> list[Measure]:
    """Return what measures mean, and throw what those at the rail need.

    Parameters
    ----------
    texts : sequence of str
        As `check_measures` and `check_equipment` let them pass.
    panel : LoadedPanel or None
        None for that of the reference case.
    folder : Path
        That of `throw_all`.
    throws : Throws
        From there.
    conditions : Conditions
        Without a measure.
    advise : bool
        Whether to add sensors and a drive where a90 is largest.
    steps : sequence of float
        As `throw_all` took them [m].
    workers : int or Workers
        Processes.
    pace : Pace, optional
        Counts the throws.
    """
    inputs = switch_inputs(reference_study(panel, count=1))
    wanted = list(dict.fromkeys(" ".join(text.split()) for text in texts))
    if advise:
        x = worst_place(throws, conditions, panel=panel)
        added = [item.replace("3.6 m", f"{x:g} m") for item in EQUIPMENT]
        wanted = list(dict.fromkeys([*wanted, *added]))
    readings, found = None, []
    for text in wanted:
        equipment = equipment_of(text)
        if equipment is None:
            found.append(read_measure(text, throws, conditions, inputs=inputs))
        elif equipment[0] == "drive":
            found.append(
                drive_measure(
                    text, panel, folder, throws, conditions, steps=steps, workers=workers, pace=pace
                )
            )
        else:
            if readings is None:
                readings = read_sensors(panel, folder, throws, workers=workers, pace=pace)
            found.append(sensor_measure(text, throws, readings, conditions))
    return found


def worst_place(throws: Throws, conditions: Conditions, *, panel: LoadedPanel | None) -> float:
    """Return where the largest a90 is, for sensors whose place is not given [m]."""
    found = limit_map(throws, conditions, closing=closing_time(panel))
    a90 = found["a90"].sel(channel="both drives").to_numpy()
    return float(throws.x[int(np.nan_to_num(a90, nan=np.inf).argmax())])
